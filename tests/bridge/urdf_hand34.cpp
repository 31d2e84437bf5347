// The 34-joint hand as a file: the included file equals the builder's hand, and both equal the hand
// of the shared folder.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "clothctl/bridge/urdf.hpp"
#include "clothctl/bridge/urdf_writer.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/inverse_dynamics.hpp"
#include "robot/random_tree.hpp"
#include "support/catch.hpp"
#include "support/reading.hpp"
#include "support/shared_data.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

std::string contents(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

std::string shipped_path() {
#ifdef CLOTHCTL_SOURCE_DIR
  return std::string(CLOTHCTL_SOURCE_DIR) + "/models/hand34.urdf";
#else
  return {};
#endif
}

/// The expected contents of the included file.
std::string shipped_text() {
  std::string text = urdf_text(hand34_builder<double>(), "hand34");
  return text.insert(text.find('\n') + 1,
                     "<!--\n"
                     "A right hand of 34 joints for simulation, part of clothctl; MIT licence. "
                     "models/README.md describes it.\n"
                     "Written from include/clothctl/robot/hand34.hpp: change it there.\n"
                     "-->\n");
}

/// A text in pieces: the numbers, and the text between them.
std::vector<std::string> pieces(const std::string& text) {
  std::vector<std::string> out(1);
  const auto numeric = [](char c) {
    return (c >= '0' && c <= '9') || c == '.' || c == '-' || c == '+' || c == 'e';
  };
  for (std::size_t k = 0; k < text.size(); ++k) {
    if (k > 0 && numeric(text[k]) != numeric(text[k - 1])) out.emplace_back();
    out.back() += text[k];
  }
  return out;
}

/// Returns every number of a text from a position on.
std::vector<double> numbers_after(const std::string& text, std::size_t place, std::size_t count) {
  std::vector<double> out;
  while (out.size() < count && place < text.size()) {
    const char c = text[place];
    if ((c >= '0' && c <= '9') || c == '-') {
      char* end = nullptr;
      out.push_back(std::strtod(text.c_str() + place, &end));
      place = static_cast<std::size_t>(end - text.c_str());
    } else {
      ++place;
    }
  }
  return out;
}

double six_digits(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return std::strtod(text, nullptr);
}

struct Masses {
  explicit Masses(const KinematicTree<double>& robot)
      : tree(robot), body_poses(robot), work(robot), M(34, 34) {}
  const MatrixX<double>& at(const VectorX<double>& q) {
    forward_kinematics<double>(tree, q, body_poses);
    mass_matrix<double>(tree, body_poses, work, M);
    return M;
  }
  const KinematicTree<double>& tree;
  BodyPoses<double> body_poses;
  MassMatrixWorkspace<double> work;
  MatrixX<double> M;
};

VectorX<double> anywhere(RobotDraws& draws, const KinematicTree<double>& tree) {
  VectorX<double> q(tree.nq());
  for (Index i = 0; i < q.size(); ++i) {
    q[i] = tree.lower()[i] + draws.below(1000001) / 1e6 * (tree.upper()[i] - tree.lower()[i]);
  }
  return q;
}

/// Checks that two trees have the same joints and limits. Returns the largest distance between
/// equal links in some poses.
double apart(const KinematicTree<double>& a, const KinematicTree<double>& b) {
  REQUIRE(a.bodies().size() == b.bodies().size());
  REQUIRE(a.links().size() == b.links().size());
  for (std::size_t k = 0; k < a.bodies().size(); ++k) {
    CHECK(a.bodies()[k].name == b.bodies()[k].name);
    CHECK(a.bodies()[k].type == b.bodies()[k].type);
  }
  CHECK(a.lower() == b.lower());
  CHECK(a.upper() == b.upper());
  CHECK(a.velocity_limits() == b.velocity_limits());
  CHECK(a.effort_limits() == b.effort_limits());
  RobotDraws draws(8);
  BodyPoses<double> at_a(a), at_b(b);
  double worst = 0;
  for (int k = 0; k < 30; ++k) {
    const VectorX<double> q = anywhere(draws, a);
    forward_kinematics<double>(a, q, at_a);
    forward_kinematics<double>(b, q, at_b);
    for (std::size_t link = 0; link < a.links().size(); ++link) {
      const int other = b.find_link(a.links()[link].name);
      REQUIRE(other >= 0);
      const Pose<double> x = link_pose(a, at_a, static_cast<int>(link)),
                         y = link_pose(b, at_b, other);
      worst = (std::max)({worst, (x.p - y.p).norm(), (x.R - y.R).cwiseAbs().maxCoeff()});
    }
  }
  return worst;
}

/// Returns the largest |A - B|_ij / sqrt(A_ii A_jj) over some poses.
double mass_gap(const KinematicTree<double>& a, const KinematicTree<double>& b) {
  Masses at_a(a), at_b(b);
  RobotDraws draws(9);
  double worst = 0;
  for (int k = 0; k < 30; ++k) {
    const VectorX<double> q = anywhere(draws, a);
    const MatrixX<double>&A = at_a.at(q), &B = at_b.at(q);
    for (Index i = 0; i < 34; ++i) {
      for (Index j = 0; j < 34; ++j)
        worst = (std::max)(worst, std::abs(A(i, j) - B(i, j)) / std::sqrt(A(i, i) * A(j, j)));
    }
  }
  return worst;
}

}  // namespace

TEST_CASE("hand34: rewrite the included file", "[.renew]") {
  std::ofstream file(shipped_path(), std::ios::binary);
  file << shipped_text();
  REQUIRE(file.flush());
}

TEST_CASE("hand34: the included file equals the builder's hand", "[urdf][hand34]") {
  const std::string path = shipped_path();
  if (path.empty()) {
    WARN("where the source lies is not known: the shipped hand is not checked");
    return;
  }
  INFO("renew it as models/README.md says");
  const std::vector<std::string> have = pieces(contents(path)), want = pieces(shipped_text());
  REQUIRE(have.size() == want.size());
  for (std::size_t k = 0; k < have.size(); ++k) {
    if (have[k] == want[k]) continue;
    // Compilers may fuse a product and a sum, which changes the last digit.
    const double a = std::strtod(have[k].c_str(), nullptr),
                 b = std::strtod(want[k].c_str(), nullptr);
    INFO(have[k] << " instead of " << want[k]);
    CHECK((b != 0 && std::abs(a - b) < 1e-14 * std::abs(b)));
  }
  const UrdfModel<double> model = value_of(read_urdf(path));
  CHECK(model.warnings.empty());
  CHECK(model.name == "hand34");
  CHECK(model.weightless_links.size() == 5);
  CHECK(std::abs(model.mass - 1.037) < 5e-4);
  const KinematicTree<double> own = hand34<double>();
  CHECK(apart(own, model.tree) < 2e-15);
  CHECK(mass_gap(own, model.tree) < 1e-14);
}

TEST_CASE("hand34: the hand equals that of the shared folder to its printed digits",
          "[urdf][hand34]") {
  const std::string path = shared_path("data/models/hand34.urdf");
  if (path.empty()) {
    WARN("no shared hand34.urdf: not checked");
    return;
  }
  const UrdfModel<double> shared = value_of(read_urdf(path));
  const KinematicTree<double> own = hand34<double>();
  const double places = apart(own, shared.tree), masses = mass_gap(own, shared.tree);
  // Masses and moments have six digits there: half a unit of the last one is up to 5e-6 of the
  // value.
  KinematicTreeBuilder<double> printed;
  const KinematicTreeBuilder<double> builder = hand34_builder<double>();
  for (const auto& link : builder.links()) {
    std::optional<Inertia<double>> inertia = link.inertia;
    if (inertia) {
      inertia->mass = six_digits(inertia->mass);
      inertia->about_com = inertia->about_com.unaryExpr(&six_digits).eval();
    }
    printed.add_link(link.name, inertia);
  }
  for (const Joint<double>& joint : builder.joints()) printed.add_joint(joint);
  const double printed_masses = mass_gap(printed.build().value(), shared.tree);
  INFO("places " << places << ", masses " << masses << ", with six digits " << printed_masses);
  CHECK(places < 1e-9);
  CHECK(masses < 5e-6);
  CHECK(printed_masses < 1e-9);
}

TEST_CASE("hand34: capsules, contact points and home equal those of the shared folder",
          "[urdf][hand34]") {
  const std::string path = shared_path("data/models/capsules_hand34.json");
  if (path.empty()) {
    WARN("no shared capsules_hand34.json: not checked");
    return;
  }
  const std::string json = contents(path);
  const auto quoted = [&](const std::string& word, std::size_t from) {
    return json.find('"' + word + '"', from);
  };
  std::size_t place = quoted("tips", 0);
  for (const FingerTip<double>& tip : hand34_tips<double>()) {
    for (const std::string& word : {tip.finger, tip.link, tip.contact_link}) {
      place = quoted(word, place);
      REQUIRE(place != std::string::npos);
    }
    const std::vector<double> point = numbers_after(json, json.find('[', place), 3);
    REQUIRE(point.size() == 3);
    for (std::size_t k = 0; k < 3; ++k) CHECK(tip.contact_point[static_cast<Index>(k)] == point[k]);
  }
  const KinematicTree<double> tree = hand34<double>();
  const VectorX<double> home = hand34_home(tree);
  place = quoted("home", place);
  for (const Body<double>& body : tree.bodies()) {
    place = quoted(body.name, place);
    REQUIRE(place != std::string::npos);
    CHECK(home[body.position] == numbers_after(json, json.find(':', place), 1).at(0));
  }
  place = quoted("capsules", place);
  const std::size_t end = quoted("boxes", place);
  std::size_t count = 0;
  for (const Capsule<double>& capsule : hand34_capsules<double>()) {
    place = quoted("link", place);
    REQUIRE(place < end);
    place = quoted(capsule.link, place);
    REQUIRE(place < end);
    const std::vector<double> from = numbers_after(json, json.find('[', quoted("p0", place)), 3);
    const std::vector<double> to = numbers_after(json, json.find('[', quoted("p1", place)), 3);
    const std::size_t radius = quoted("radius", place);
    for (std::size_t k = 0; k < 3; ++k) {
      CHECK(capsule.from[static_cast<Index>(k)] == from.at(k));
      CHECK(capsule.to[static_cast<Index>(k)] == to.at(k));
    }
    CHECK(capsule.radius == numbers_after(json, json.find(':', radius), 1).at(0));
    ++count;
  }
  CHECK(count == 23);
  CHECK(quoted("link", place) > end);
}
