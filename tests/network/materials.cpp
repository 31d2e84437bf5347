#include "clothctl/network/materials.hpp"

#include <cmath>
#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("every preset is found by its name and is valid", "[cloth]", float, double) {
  using S = TestType;
  CHECK(material_names().front() == "handkerchief");
  for (std::string_view name : material_names()) {
    const auto material = material_preset<S>(name);
    REQUIRE(material);
    CHECK(material->name == name);
    CHECK(material->validate().empty());
  }
}

TEST_CASE("the handkerchief is the default material, and the iri sheet is heavier and stiffer",
          "[cloth]") {
  const auto preset = material_preset("handkerchief");
  REQUIRE(preset);
  const Material<double> standard;
  for (const Material<double>* m : {&preset.value(), &standard}) {
    CHECK(m->name == "handkerchief");
    CHECK(m->area_density == 0.2);
    CHECK(m->stretch_warp == 1000.0);
    CHECK(m->stretch_weft == 1000.0);
    CHECK(m->shear == 200.0);
    CHECK(m->bending_warp == 2e-5);
    CHECK(m->bending_weft == 2e-5);
    CHECK(m->damping_time == 0.002);
    CHECK(m->drag == 0.5);
    CHECK(m->friction == 0.5);
    CHECK(m->air_normal == 1.0);
    CHECK(m->air_tangent == 0.1);
  }
  const auto iri = material_preset("iri");
  REQUIRE(iri);
  CHECK(iri->area_density == 1.1);
  CHECK(iri->stretch_warp == 3000.0);
  CHECK(iri->shear == 600.0);
  CHECK(iri->bending_warp == standard.bending_warp);
  CHECK(iri->damping_time == standard.damping_time);
}

TEST_CASE("presets are ordered as real fabrics: light to heavy, soft to stiff", "[cloth]") {
  const auto get = [](std::string_view name) { return material_preset(name).value(); };
  CHECK(get("silk").area_density < get("cotton").area_density);
  CHECK(get("cotton").area_density < get("denim").area_density);
  CHECK(get("silk").bending_warp < get("cotton").bending_warp);
  CHECK(get("cotton").bending_warp < get("denim").bending_warp);
  CHECK(get("denim").bending_warp < get("paper").bending_warp);
  CHECK(get("knit").stretch_warp < get("wool").stretch_warp);
  CHECK(get("wool").stretch_warp < get("paper").stretch_warp);
}

TEST_CASE(
    "the presets are the same along warp and weft, and felt, which has no threads, is isotropic",
    "[cloth]") {
  for (std::string_view name : material_names()) {
    const Material<double> material = material_preset(name).value();
    CHECK(material.stretch_warp == material.stretch_weft);
    CHECK(material.bending_warp == material.bending_weft);
  }
  // A grid has C11 = stretch + shear, C12 = C66 = shear, which is isotropic if C11 - C12 = 2 C66.
  const Material<double> felt = material_preset("felt").value();
  CHECK(felt.stretch_warp == 2.0 * felt.shear);
}

TEST_CASE("the bending length of each preset is that of real cloth", "[cloth]") {
  // The cantilever tests (ASTM D1388, ISO 9073-7) measure the length c at which a strip bends under
  // its own weight: B = area density · g · c³. Cloth has 1 to 5 cm, paper some more.
  for (std::string_view name : material_names()) {
    const Material<double> material = material_preset(name).value();
    const double length = std::cbrt(material.bending_warp / (9.81 * material.area_density));
    CAPTURE(name, length);
    CHECK(length > 0.01);
    CHECK(length < (name == "paper" ? 0.10 : 0.05));
  }
}

TEST_CASE("set_stretch and set_bending set warp and weft", "[cloth]") {
  Material<double> material;
  material.set_stretch(7.0);
  material.set_bending(3e-5);
  CHECK(material.stretch_warp == 7.0);
  CHECK(material.stretch_weft == 7.0);
  CHECK(material.bending_warp == 3e-5);
  CHECK(material.bending_weft == 3e-5);
}

TEST_CASE("an unknown material is refused with the list of known ones", "[cloth]") {
  const auto none = material_preset("velvet");
  REQUIRE_FALSE(none);
  CHECK(none.error().find("\"velvet\"") != std::string::npos);
  for (std::string_view name : material_names())
    CHECK(none.error().find(name) != std::string::npos);
  CHECK_FALSE(material_preset(""));
}

TEMPLATE_TEST_CASE("a material with a bad value is refused with the quantity and its value",
                   "[cloth]", float, double) {
  using S = TestType;
  Material<S> material;
  CHECK(material.validate().empty());
  material.name = "mine";
  material.friction = S(-0.5);
  CHECK(material.validate() == "material \"mine\": friction must not be negative, got -0.5");
  material = Material<S>();
  material.area_density = S(0);
  CHECK(material.validate() == "material \"handkerchief\": area_density must be positive, got 0");
  for (S Material<S>::*member :
       {&Material<S>::area_density, &Material<S>::stretch_warp, &Material<S>::stretch_weft,
        &Material<S>::shear, &Material<S>::bending_warp, &Material<S>::bending_weft,
        &Material<S>::damping_time, &Material<S>::drag, &Material<S>::friction,
        &Material<S>::air_normal, &Material<S>::air_tangent}) {
    for (S bad : {S(-1), std::numeric_limits<S>::quiet_NaN(), std::numeric_limits<S>::infinity()}) {
      material = Material<S>();
      material.*member = bad;
      CHECK_FALSE(material.validate().empty());
    }
  }
}

TEST_CASE("quotes and line breaks in a material's name are escaped in messages", "[materials]") {
  Material<double> material;
  material.name = "two\nlines \"quoted\"";
  material.friction = -1.0;
  CHECK(material.validate() ==
        "material \"two\\nlines \\\"quoted\\\"\": friction must not be negative, got -1");
  const Result<Material<double>> unknown = material_preset<double>("tweed\nred");
  REQUIRE_FALSE(unknown.has_value());
  CHECK(unknown.error().substr(0, 35) == "unknown material \"tweed\\nred\"; know");
  CHECK(unknown.error().find('\n') == std::string::npos);
}
