// The map from the QP's unknowns to forces or velocities of the held vertices.

#include "clothctl/mpc/detail/grip_basis.hpp"

#include <cmath>
#include <random>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"

using namespace clothctl;

namespace {

const clothctl_test::HangingSheet& sheet() {
  static const clothctl_test::HangingSheet made = clothctl_test::hanging_sheet(5, 1, 20);
  return made;
}

Grip<double> patch_grip(int side, int size) {
  return make_pinch<double>(sheet().corner_patch(side, size), 0.4, 2.0);
}

VectorX<double> random_vector(Index n, std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  VectorX<double> out(n);
  for (Index i = 0; i < n; ++i) out[i] = uniform(random);
  return out;
}

}  // namespace

TEST_CASE("coefficients give the sum of the finger forces, each inside its friction cone",
          "[mpc]") {
  std::mt19937 random(3);
  std::vector<Grip<double>> grips{patch_grip(0, 2), patch_grip(1, 1)};
  grips[0].fingers[1].contact.pyramid = 6;
  grips[0].fingers[1].contact.friction = 0.9;
  detail::GripBasis<double> basis(grips, sheet().network.triangles, GripInput::Force);
  CHECK(basis.held().vertices() == std::vector<int>{15, 16, 20, 21, 24});
  CHECK(basis.held().grip_begin(0) == 0);
  CHECK(basis.held().grip_begin(1) == 4);
  CHECK(basis.held().grip_begin(2) == 5);
  CHECK(basis.inputs() == 15);
  CHECK(basis.unknowns() == 4 * (4 + 6) + 8);
  CHECK(basis.force_count() == 10);
  REQUIRE(basis.fingers().size() == 4);
  const Points<double> x = clothctl_test::shaken(sheet().state, 1).positions;
  std::vector<FingerForce<double>> forces(static_cast<std::size_t>(basis.force_count()));
  const VectorX<double> d = random_vector(basis.unknowns(), random);
  const long before = clothctl_test::allocations();
  basis.update(x);
  basis.finger_forces(d, forces);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  VectorX<double> sum = VectorX<double>::Zero(basis.inputs());
  for (const auto& columns : basis.fingers()) {
    const Finger<double>& finger = basis.finger(columns);
    double normal = 0;
    for (std::size_t j = 0; j < finger.vertices.size(); ++j) {
      const FingerForce<double>& f = forces[static_cast<std::size_t>(columns.first_force) + j];
      CHECK(f.grip == columns.grip);
      CHECK(f.finger == columns.finger);
      CHECK(f.vertex == finger.vertices[j]);
      const std::vector<int>& held = basis.held().vertices();
      const auto slot = std::find(held.begin(), held.end(), f.vertex) - held.begin();
      CHECK(columns.held_slots[j] == slot);
      sum.segment<3>(3 * slot) += f.force;
      CHECK(f.normal.norm() == Approx(1.0));
      CHECK(cone_violation<double>(f.force, f.normal, finger.contact.friction, 1e9) < 1e-14);
      // For one generator with d = 1, the normal part is 1/√(1+μ²).
      const Index pyramid = finger.contact.pyramid;
      const double share =
          d.segment(columns.column + static_cast<Index>(j) * pyramid, pyramid).sum() /
          std::sqrt(1.0 + finger.contact.friction * finger.contact.friction);
      CHECK(f.force.dot(f.normal) == Approx(share));
      normal += share;
    }
    CHECK(basis.normal_force(columns, d) == Approx(normal));
  }
  CHECK((basis.matrix() * d - sum).norm() < 1e-13);
  // A column has nonzeros in the rows that it names only.
  for (Index c = 0; c < basis.unknowns(); ++c) {
    const std::pair<Index, Index> rows = basis.rows(c);
    CHECK(basis.matrix().col(c).segment(rows.first, rows.second).norm() == Approx(1.0));
    CHECK(basis.matrix().col(c).norm() == Approx(1.0));
  }
}

TEST_CASE("opposed fingers press from opposite sides of the sheet", "[mpc]") {
  detail::GripBasis<double> basis({patch_grip(0, 1)}, sheet().network.triangles, GripInput::Force);
  basis.update(sheet().network.rest_positions);  // the plane y = 0, front towards -y
  std::vector<FingerForce<double>> forces(2);
  basis.finger_forces(VectorX<double>::Ones(8), forces);
  CHECK((forces[0].normal - Vector3<double>(0.0, -1.0, 0.0)).norm() < 1e-12);
  CHECK((forces[1].normal - Vector3<double>(0.0, 1.0, 0.0)).norm() < 1e-12);
  // Without triangles, the fallback normal is used.
  Grip<double> grip = patch_grip(0, 1);
  grip.fallback_normal = Vector3<double>(0.0, 0.0, 1.0);
  detail::GripBasis<double> rope({grip}, {}, GripInput::Force);
  rope.update(sheet().state.positions);
  rope.finger_forces(VectorX<double>::Ones(8), forces);
  CHECK(forces[0].normal == Vector3<double>(0.0, 0.0, 1.0));
}

TEST_CASE("the pose of a grip moves its vertices as a rigid body", "[mpc]") {
  std::mt19937 random(8);
  detail::GripBasis<double> basis({patch_grip(0, 2), patch_grip(1, 1)}, sheet().network.triangles,
                                  GripInput::Pose);
  CHECK(basis.unknowns() == 6 + 3);
  CHECK(basis.fingers().empty());
  const Points<double> x = clothctl_test::shaken(sheet().state, 2).positions;
  basis.update(x);
  const VectorX<double> u = random_vector(9, random);
  const VectorX<double> r = basis.matrix() * u;
  const Vector3<double> v = u.head<3>(), omega = u.segment<3>(3), c = basis.held().centroid(x, 0);
  for (Index j = 0; j < 4; ++j) {
    const Vector3<double> arm = x.col(basis.held().vertices()[static_cast<std::size_t>(j)]) - c;
    CHECK((r.segment<3>(3 * j) - (v + omega.cross(arm))).norm() < 1e-14);
  }
  CHECK((r.tail<3>() - u.tail<3>()).norm() < 1e-15);
}

TEST_CASE("bounds follow from force limits and largest steps", "[mpc]") {
  const Points<double> x = sheet().state.positions;
  detail::GripBasis<double> forces({patch_grip(0, 2)}, sheet().network.triangles, GripInput::Force);
  VectorX<double> lower(forces.unknowns()), upper(forces.unknowns());
  forces.bounds(x, 0.05, 0.02, lower, upper);
  CHECK(lower.norm() == 0.0);
  // A single coefficient at its bound reaches its finger's limit.
  CHECK(upper.minCoeff() == Approx(2.0 * std::sqrt(1.0 + 0.16)));
  CHECK(upper.maxCoeff() == Approx(upper.minCoeff()));

  // At any corner of the box, the centre moves at most max_step along each axis, and rotation adds
  // at most as much.
  detail::GripBasis<double> poses({patch_grip(0, 3)}, sheet().network.triangles, GripInput::Pose);
  poses.update(x);
  lower.resize(6);
  upper.resize(6);
  poses.bounds(x, 0.01, 0.02, lower, upper);
  CHECK((lower + upper).norm() == 0.0);
  for (int corner = 0; corner < 64; ++corner) {
    VectorX<double> u = upper;
    for (int i = 0; i < 6; ++i) {
      if (((corner >> i) & 1) != 0) u[i] = lower[i];
    }
    VectorX<double> turn = u;
    turn.head<3>().setZero();
    CHECK((0.02 * (poses.matrix() * (u - turn))).cwiseAbs().maxCoeff() < 0.01 * (1.0 + 1e-12));
    CHECK((0.02 * (poses.matrix() * turn)).cwiseAbs().maxCoeff() < 0.01 * (1.0 + 1e-12));
  }
}

TEST_CASE("coefficients that a solver leaves off the contact law are brought back to it", "[mpc]") {
  std::mt19937 random(5);
  std::vector<Grip<double>> grips{patch_grip(0, 2), patch_grip(1, 1)};
  detail::GripBasis<double> basis(grips, sheet().network.triangles, GripInput::Force);
  basis.update(sheet().state.positions);
  const detail::GripBasis<double>::FingerColumns& first = basis.fingers()[0];
  VectorX<double> d = 0.01 * random_vector(basis.unknowns(), random);
  d[first.column] = 5.0;         // beyond the limit of 2 N
  d[first.column + 1] = -1e-12;  // and below zero
  d[basis.fingers()[2].column] = -1e-12;
  VectorX<double> kept = d;
  basis.keep_limits(kept);
  CHECK(kept.minCoeff() == 0.0);
  CHECK(std::abs(basis.normal_force(first, kept) - 2.0) < 1e-14);
  CHECK(basis.most_pressed(first) == 2.0);
  // Its coefficients keep their proportions, and other fingers what they had.
  const double share = kept[first.column] / d[first.column];
  for (Index i = 0; i < basis.unknowns(); ++i) {
    const bool scaled = first.column <= i && i < first.column + first.count;
    const double expected = d[i] < 0 ? 0.0 : scaled ? share * d[i] : d[i];
    CHECK(std::abs(kept[i] - expected) <= 1e-15);
  }
}
