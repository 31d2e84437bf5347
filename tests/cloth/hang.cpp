// The same cloth at another resolution hangs the same.

#include "support/hang.hpp"

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

/// Makes an implicit sheet whose steps are solved to convergence.
MassSpring<double> newton(const SpringNetwork<double>& network, double drag) {
  MassSpringSettings<double> settings;
  settings.integration = Integration::Newton;
  settings.drag = drag;
  return MassSpring<double>::create(network, settings).value();
}

}  // namespace

TEST_CASE("refined keeps corners and affine maps", "[cloth][hang]") {
  const auto coarse = make_grid<double>(5, 5, 0.4, 0.4).value();
  const auto fine = make_grid<double>(9, 9, 0.4, 0.4).value();
  CHECK((refined<double>(coarse.positions, 5, 9) - fine.positions).cwiseAbs().maxCoeff() < 1e-15);
}

TEST_CASE("a sheet hung from its top edge stretches under its weight as a bar does",
          "[cloth][hang]") {
  // A bar of length L, weight w L per width and modulus E t stretches by w L²/(2 E t). Between
  // E t = stretch (stretch + 2 shear)/(stretch + shear), free to contract sideways, and C11 =
  // stretch + shear, held sideways as by the top edge, lies the sheet.
  const Material<double> m;
  const double weight = 9.81 * m.area_density * 0.25 / 2;
  const double most = weight / (m.stretch_warp * (m.stretch_warp + 2 * m.shear) /
                                (m.stretch_warp + m.shear)),
               least = weight / (m.stretch_warp + m.shear);
  HangSettings settings;
  settings.dt = 0.1;
  const std::vector<double> sags = hang_all<double>({17, 33, 65}, settings, newton);
  for (const double sag : sags) {
    CHECK(sag - 0.5 > 0.99 * least);
    CHECK(sag - 0.5 < 1.01 * most);
  }
  CHECK(spread(sags) < 0.02);
  // Even the elongation alone hardly depends on the resolution.
  std::vector<double> longer = sags;
  for (double& sag : longer) sag -= 0.5;
  CHECK(spread(longer) < 0.02);
}

TEST_CASE("a sheet hung from two corners hangs as deep at any resolution", "[cloth][hang]") {
  for (const char* material : {"handkerchief", "knit"}) {
    HangSettings settings;
    settings.hung = Hung::TwoCorners;
    settings.dt = 0.1;
    settings.material = material;
    std::vector<int> resolutions{17};
    if (!kSanitized) resolutions.push_back(33);
    if (full_tier()) resolutions.push_back(65);
    const std::vector<double> sags = hang_all<double>(resolutions, settings, newton);
    CAPTURE(material, sags);
    CHECK(spread(sags) < 0.02);
    CHECK(sags.front() > 0.5);
    CHECK(sags.front() < 0.53);
  }
}

TEST_CASE("a sheet with a limit of stretch hangs as deep at any resolution", "[cloth][hang]") {
  const auto limited = [](const SpringNetwork<float>& network, float drag) {
    PositionBasedSettings<float> settings;
    settings.substeps = 10;
    settings.stretch_limit = 0.02f;
    settings.drag = drag;
    return PositionBased<float>::create(network, settings).value();
  };
  for (const char* material : {"handkerchief", "knit"}) {
    HangSettings settings;
    settings.hung = Hung::TwoCorners;
    settings.material = material;
    settings.seconds = 4;
    std::vector<int> resolutions{17, 33};
    if (!kSanitized) resolutions.push_back(65);
    const std::vector<double> sags = hang_all<float>(resolutions, settings, limited);
    CAPTURE(material, sags);
    CHECK(spread(sags) < 0.02);
    CHECK(sags.front() > 0.5);
    CHECK(sags.front() < 0.53);
  }
}
