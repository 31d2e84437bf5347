#include "clothctl/grasp/robot_clearance.hpp"

#include <cmath>
#include <limits>
#include <random>
#include <utility>

#include "clothctl/collision/shapes.hpp"
#include "clothctl/grasp/joint_path_planner.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;

namespace {

using Vec = Vector3<double>;
using Tree = KinematicTree<double>;
using Clearance = RobotClearance<Tree>;

std::vector<LinkCapsule<double>> hand_capsules(const Tree& tree) {
  std::vector<LinkCapsule<double>> out;
  for (const Capsule<double>& c : hand34_capsules<double>())
    out.push_back({tree.find_link(c.link), c.from, c.to, c.radius});
  return out;
}

VectorX<double> random_pose(const Tree& tree, std::mt19937& random) {
  VectorX<double> q(tree.nq());
  for (Index i = 0; i < q.size(); ++i) {
    const double low = std::max(tree.lower()[i], -1.0), high = std::min(tree.upper()[i], 1.0);
    q[i] = std::uniform_real_distribution<double>(low, high)(random);
  }
  return q;
}

/// A collider that never answers.
struct Mute {
  template <class X, class Out>
  QueryStatus distance(const X&, Out&&) const {
    return QueryStatus::InvalidArgument;
  }
  template <class X>
  QueryStatus closest(const X&, std::span<SurfacePoint<double>>) const {
    return QueryStatus::InvalidArgument;
  }
  template <class X, class Out>
  QueryStatus sweep(const X&, const X&, double, double, Out&&) const {
    return QueryStatus::InvalidArgument;
  }
  BoundingBox<double> bounds(double) const { return {}; }
};

double to_segment(const Vec& x, const Vec& a, const Vec& b) {
  const double square = (b - a).squaredNorm();
  const double share = square > 0 ? std::min(1.0, std::max(0.0, (x - a).dot(b - a) / square)) : 0.0;
  return (x - a - share * (b - a)).norm();
}

/// Distance between capsules i and j in the last query, at n + 1 points of the axis of i, m.
double apart(const Clearance& clearance, std::size_t i, std::size_t j, int n) {
  const auto [a, b] = clearance.ends(static_cast<int>(i));
  const auto [c, d] = clearance.ends(static_cast<int>(j));
  double least = std::numeric_limits<double>::infinity();
  for (int s = 0; s <= n; ++s)
    least = std::min(least, to_segment(a + static_cast<double>(s) / n * (b - a), c, d));
  return least - clearance.capsules()[i].radius - clearance.capsules()[j].radius;
}

}  // namespace

TEST_CASE("the clearance is a lower bound, and close to dense sampling", "[grasp]") {
  const Tree tree = hand34<double>();
  auto clearance = Clearance::create(tree, hand_capsules(tree), 1e-4).value();
  // The pairs that are looked at: on different frames, and apart in the posture at home.
  (void)clearance(hand34_home(tree));
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t i = 0; i < clearance.capsules().size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (clearance.capsules()[i].frame == clearance.capsules()[j].frame) continue;
      if (apart(clearance, i, j, 400) > 1e-3) pairs.emplace_back(i, j);
    }
  }
  CHECK(clearance.ignore_pairs(hand34_home(tree), 1e-3) == pairs.size());
  const auto ball = SphereCollider<double>::create(Vec(0.15, 0.02, 0.1), 0.03).value();
  const auto box = BoxCollider<double>::create(Vec(0, 0, -0.1), Vec(0.2, 0.2, 0.02)).value();
  const std::vector<ColliderRef<double>> obstacles{ColliderRef<double>(ball),
                                                   ColliderRef<double>(box)};
  clearance.set_obstacles(obstacles);
  std::mt19937 random(3);
  int overlapping = 0, itself = 0;
  double worst = 0;
  for (int k = 0; k < 200; ++k) {
    const ClosestPart<double> told = clearance.closest(random_pose(tree, random));
    if (told.distance < 0) ++overlapping;
    double sampled = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < clearance.capsules().size(); ++i) {
      const auto [a, b] = clearance.ends(static_cast<int>(i));
      for (int s = 0; s <= 200; ++s) {
        const Points<double> x = a + s / 200.0 * (b - a);
        VectorX<double> d(1);
        for (const auto& o : obstacles) {
          (void)o.distance(x, d);
          sampled = std::min(sampled, d[0] - clearance.capsules()[i].radius);
        }
      }
    }
    double between = std::numeric_limits<double>::infinity();
    for (const auto& [i, j] : pairs) {
      if (apart(clearance, i, j, 20) < std::min(sampled, between) + 4e-3)
        between = std::min(between, apart(clearance, i, j, 400));
    }
    if (told.other >= 0) ++itself;
    const double least = std::min(sampled, between);
    CHECK(told.distance <= least);
    worst = std::max(worst, least - told.distance);
  }
  CHECK(overlapping > 10);
  CHECK(itself > 10);
  CHECK(worst < 3e-4);  // the tolerance, twice, and the sampling
}

TEST_CASE("no point of a capsule moves farther than its joints' reach says", "[grasp]") {
  const Tree tree = hand34<double>();
  const auto capsules = hand_capsules(tree);
  const VectorX<double> reach = joint_reach<double>(tree, capsules).value();
  REQUIRE(reach.size() == tree.nv());
  auto clearance = Clearance::create(tree, capsules).value();
  std::mt19937 random(5);
  double most = 0;
  for (int k = 0; k < 300; ++k) {
    const VectorX<double> from = random_pose(tree, random), to = random_pose(tree, random);
    const VectorX<double> mid = from + 0.2 * (to - from);
    const double way = reach.dot((mid - from).cwiseAbs());
    (void)clearance(from);
    std::vector<std::pair<Vec, Vec>> before;
    for (std::size_t i = 0; i < capsules.size(); ++i)
      before.push_back(clearance.ends(static_cast<int>(i)));
    (void)clearance(mid);
    for (std::size_t i = 0; i < capsules.size(); ++i) {
      const auto [a, b] = clearance.ends(static_cast<int>(i));
      const double moved = std::max((a - before[i].first).norm(), (b - before[i].second).norm());
      most = std::max(most, moved / way);
    }
  }
  CHECK(most <= 1);
  CHECK(most > 0.2);  // the bound is not absurd
  for (const char* slide : {"base_tx", "base_ty", "base_tz"})
    CHECK(reach[tree.bodies()[std::size_t(tree.find_joint(slide))].velocity] == 1);
}

TEST_CASE("pairs that touch at home are left out, and only they", "[grasp]") {
  const Tree tree = hand34<double>();
  auto clearance = Clearance::create(tree, hand_capsules(tree)).value();
  const VectorX<double> home = hand34_home(tree);
  CHECK(clearance(home) < 0);  // neighbouring bones
  const std::size_t left = clearance.ignore_pairs(home, 1e-3);
  CHECK(left > 50);
  CHECK(clearance(home) > 0.7e-3);
  CHECK(clearance.ignore_pairs(home, 1e-3) == left);
  VectorX<double> fist = home;
  for (Index i = 6; i < fist.size(); ++i) fist[i] = tree.upper()[i];
  CHECK(clearance.closest(fist).other >= 0);
}

TEST_CASE("clearance with nothing to be near, and bad input", "[grasp]") {
  const Tree tree = hand34<double>();
  const double nan = std::nan("");
  auto one = Clearance::create(tree, {{0, Vec(0, 0, 0), Vec(0, 0, 0.1), 0.01}}).value();
  CHECK(is_unbounded(one(hand34_home(tree))));
  CHECK(!is_finite(one(hand34_home(tree))));
  CHECK(one.closest(hand34_home(tree)).capsule == -1);
  const auto is_nan = [](double x) { return !is_finite(x) && !is_unbounded(x); };
  CHECK(is_nan(one(VectorX<double>::Constant(tree.nq(), nan))));
  CHECK(is_nan(one(VectorX<double>::Zero(3))));
  // What does not answer is not free, whatever else answers.
  const Mute mute;
  const auto ball = SphereCollider<double>::create(Vec(0, 0, 2), 0.03).value();
  const std::vector<ColliderRef<double>> obstacles{ColliderRef<double>(mute),
                                                   ColliderRef<double>(ball)};
  one.set_obstacles(obstacles);
  CHECK(is_nan(one(hand34_home(tree))));
  CHECK(one.closest(hand34_home(tree)).obstacle == 0);
  const auto refuse = [&](LinkCapsule<double> c, double tolerance = 1e-4) {
    const auto made = Clearance::create(tree, {c}, tolerance);
    return made ? std::string() : made.error();
  };
  CHECK(refuse({999, Vec::Zero(), Vec::Zero(), 0.01}) ==
        "capsule 0 is on frame 999, which does not exist");
  CHECK_FALSE(refuse({0, Vec(nan, 0, 0), Vec::Zero(), 0.01}).empty());
  CHECK_FALSE(refuse({0, Vec::Zero(), Vec::Zero(), -1}).empty());
  CHECK_FALSE(refuse({0, Vec::Zero(), Vec::Zero(), 1}, 0).empty());
  const std::vector<LinkCapsule<double>> bad{{-1, Vec::Zero(), Vec::Zero(), 0.01}};
  CHECK_FALSE(joint_reach<double>(tree, bad));
}

TEST_CASE("a query of the clearance never allocates", "[grasp]") {
  const Tree tree = hand34<double>();
  auto clearance = Clearance::create(tree, hand_capsules(tree)).value();
  const auto ball = SphereCollider<double>::create(Vec(0.15, 0.02, 0.1), 0.03).value();
  const std::vector<ColliderRef<double>> obstacles{ColliderRef<double>(ball)};
  clearance.set_obstacles(obstacles);
  const VectorX<double> home = hand34_home(tree);
  const long before = clothctl_test::allocations();
  const double first = clearance(home), second = clearance(home);
  const long allocated = clothctl_test::allocations() - before;
  CHECK(first == second);
  if (clothctl_test::allocation_counting_works()) CHECK(allocated == 0);
}

TEST_CASE("a hand finds its way around a wall", "[grasp]") {
  const Tree tree = hand34<double>();
  const auto capsules = hand_capsules(tree);
  auto clearance = Clearance::create(tree, capsules).value();
  VectorX<double> from = hand34_home(tree);
  (void)clearance.ignore_pairs(from, 1e-3);
  const auto wall = BoxCollider<double>::create(Vec(0.1, 0, 0.1), Vec(0.4, 0.01, 0.3)).value();
  const std::vector<ColliderRef<double>> obstacles{ColliderRef<double>(wall)};
  clearance.set_obstacles(obstacles);
  VectorX<double> to = from;
  from[1] -= 0.25;
  to[1] += 0.25;
  const VectorX<double> reach = joint_reach<double>(tree, capsules).value();
  const auto path = plan_joint_path<double>(from, to, tree.lower(), tree.upper(), reach, clearance);
  REQUIRE(path.message == "");
  REQUIRE(path.status == JointPathStatus::Found);
  CHECK(path.iterations > 0);
  CHECK(is_path_free<double>(path.positions, reach, clearance, 1e-3, 1e-3));
  for (std::size_t k = 1; k < path.positions.size(); ++k) {
    const VectorX<double> way = path.positions[k] - path.positions[k - 1];
    const int parts = static_cast<int>(reach.dot(way.cwiseAbs()) / 1e-3) + 1;
    for (int s = 0; s <= parts; s += clothctl_test::trials(7, 1, 97))
      CHECK(clearance(path.positions[k - 1] + double(s) / parts * way) > 0);
  }
  CHECK_FALSE(is_path_free<double>({from, to}, reach, clearance, 1e-3, 1e-3));
}
