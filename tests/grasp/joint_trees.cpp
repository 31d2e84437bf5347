// JointTree, JointBox and JointTrees: parents, nearest nodes, bounds of steps, paths that join.

#include "clothctl/grasp/detail/joint_trees.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "support/catch.hpp"

using clothctl::Index;
using clothctl::VectorX;
using clothctl::detail::joint_way;
using clothctl::detail::JointBox;
using clothctl::detail::JointTree;
using clothctl::detail::JointTrees;
using clothctl::detail::MotionCheck;
using clothctl::detail::Posture;
using clothctl::detail::SplitMix;

namespace {

VectorX<double> vector(double a, double b) {
  VectorX<double> v(2);
  v << a, b;
  return v;
}

}  // namespace

TEST_CASE("a tree knows parents and the nearest node", "[joint_trees]") {
  JointTree<double> tree({vector(0, 0), 1});
  const auto a = tree.add({vector(1, 0), 1}, 0);
  const auto b = tree.add({vector(1, 1), 1}, a);
  tree.add({vector(0, 1), 1}, 0);
  CHECK(tree.size() == 4);
  const std::vector<Posture<double>> branch = tree.branch(b);
  REQUIRE(branch.size() == 3);
  CHECK(branch[0].q == vector(1, 1));
  CHECK(branch[1].q == vector(1, 0));
  CHECK(branch[2].q == vector(0, 0));
  CHECK(tree.branch(0).size() == 1);
  const VectorX<double> reach = vector(1, 1);
  CHECK(tree.nearest(vector(0.9, 0.2), reach) == a);
  CHECK(tree.nearest(vector(0.5, 0.5), reach) == 0);         // the first of equals
  CHECK(tree.nearest(vector(0.9, 0.6), vector(9, 1)) == b);  // by way, in which reach counts
}

TEST_CASE("nearest agrees with a search of all", "[joint_trees]") {
  SplitMix random(3);
  const JointBox<double> box{vector(-1, -2), vector(1, 2)};
  const VectorX<double> reach = vector(0.3, 1.2);
  VectorX<double> q = vector(0, 0);
  JointTree<double> tree({q, 1});
  for (int i = 0; i < 300; ++i) {
    box.draw(random, q);
    const std::size_t found = tree.nearest(q, reach);
    for (std::size_t k = 0; k < tree.size(); ++k)
      REQUIRE(joint_way(tree[found].q, q, reach) <= joint_way(tree[k].q, q, reach));
    tree.add({q, 1}, found);
  }
}

TEMPLATE_TEST_CASE("random postures fill their box and stay in it", "[joint_trees]", float,
                   double) {
  using Scalar = TestType;
  const JointBox<Scalar> box{VectorX<Scalar>::Constant(2, Scalar(-0.1)),
                             VectorX<Scalar>::Constant(2, Scalar(0.7))};
  SplitMix random(4);
  VectorX<Scalar> q(2), low = box.upper, high = box.lower;
  for (int i = 0; i < 2000; ++i) {
    box.draw(random, q);
    low = low.cwiseMin(q);
    high = high.cwiseMax(q);
  }
  CHECK((low.array() >= box.lower.array()).all());
  CHECK((high.array() <= box.upper.array()).all());
  CHECK((low.array() < Scalar(-0.09)).all());
  CHECK((high.array() > Scalar(0.69)).all());
  q << Scalar(-5), Scalar(0.8);
  box.clamp(q);
  CHECK(q[0] == box.lower[0]);
  CHECK(q[1] == box.upper[1]);
}

TEST_CASE("trees meet, and their path is a chain of free steps from start to goal",
          "[joint_trees]") {
  const auto clearance = [](const VectorX<double>& q) { return q.norm() - 0.5; };
  const VectorX<double> reach = vector(1, 1), from = vector(-0.9, 0), to = vector(0.9, 0);
  const JointBox<double> box{vector(-1, -1), vector(1, 1)};
  const double step = 0.1;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    MotionCheck<double, const decltype(clearance)> check(clearance, reach, 1e-3, 1e-3);
    JointTrees<double, const decltype(clearance)> trees(check, box, step, check.posture(from),
                                                        check.posture(to));
    SplitMix random(seed);
    int iterations = -1;
    const auto path = trees.connect(random, 5000, iterations);
    REQUIRE(path.size() > 18);
    CHECK(iterations > 0);
    CHECK(iterations < 5000);
    CHECK(path.front().q == from);
    CHECK(path.back().q == to);
    for (std::size_t i = 0; i + 1 < path.size(); ++i) {
      const double way = joint_way(path[i].q, path[i + 1].q, reach);
      CHECK(way > 0);
      CHECK(way <= step * (1 + 1e-12));
      CHECK(check.is_free(path[i], path[i + 1]));
      CHECK(path[i].clearance == clearance(path[i].q));
    }
  }
}

TEST_CASE("trees that cannot meet spend their iterations", "[joint_trees]") {
  const auto wall = [](const VectorX<double>& q) { return std::abs(q[0]) - 0.1; };
  const VectorX<double> reach = vector(1, 1);
  const JointBox<double> box{vector(-1, -1), vector(1, 1)};
  for (const int most : {0, 1, 100}) {
    MotionCheck<double, const decltype(wall)> check(wall, reach, 1e-3, 1e-3);
    JointTrees<double, const decltype(wall)> trees(check, box, 0.1, check.posture(vector(-0.5, 0)),
                                                   check.posture(vector(0.5, 0)));
    SplitMix random(1);
    int iterations = -1;
    CHECK(trees.connect(random, most, iterations).empty());
    CHECK(iterations == most);
  }
}

TEST_CASE("a step below the rounding of postures ends", "[joint_trees]") {
  const auto wall = [](const VectorX<double>& q) { return std::abs(q[0]) - 0.1; };
  const VectorX<double> reach = vector(1, 1);
  const JointBox<double> box{vector(-1, -1), vector(1, 1)};
  MotionCheck<double, const decltype(wall)> check(wall, reach, 1e-3, 1e-3);
  JointTrees<double, const decltype(wall)> trees(
      check, box, 1e-30, check.posture(vector(-0.5, 0.3)), check.posture(vector(0.5, 0.3)));
  SplitMix random(1);
  int iterations = 0;
  CHECK(trees.connect(random, 50, iterations).empty());
  CHECK(iterations == 50);
}
