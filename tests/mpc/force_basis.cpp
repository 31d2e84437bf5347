// The unknowns of planned contact forces: columns, offset and bounds for any contact model.

#include "clothctl/mpc/detail/force_basis.hpp"

#include "laws/contact_laws.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

// Fingers of one contact model on a patch, and the planner's data for them.
template <class Contact>
struct Fixture {
  std::vector<Grip<double, Contact>> grips;
  detail::HeldVertices<double> held;
  detail::ForceBasis<double, Contact> basis;
  std::vector<detail::RowRange> columns;
  MatrixX<double> B;
  VectorX<double> offset;
  Points<double> x = clothctl_test::contact_patch<double>(6, false).points;

  explicit Fixture(const Contact& contact) {
    grips.push_back(make_pinch<double>({4, 1, 3}, contact, 6.0));
    grips.push_back(make_pinch<double>({0}, contact, 3.0));
    for (const auto& grip : grips) held.add_grip(grip.vertices());
    basis.reserve(grips, held, {}, columns);
    B.setZero(3 * static_cast<Index>(held.vertices().size()), static_cast<Index>(columns.size()));
    offset.setZero(B.rows());
    basis.update(grips, held, {}, x, B, offset);
  }
};

template <class Contact>
void check_basis(const Contact& contact) {
  Fixture<Contact> f(contact);
  REQUIRE(f.basis.force_count() == 2 * (3 + 1));
  REQUIRE(f.basis.fingers().size() == 4);
  VectorX<double> d(f.B.cols()), upper(f.B.cols());
  for (Index i = 0; i < d.size(); ++i) d[i] = 0.1 + 0.07 * static_cast<double>((5 * i) % 7);
  std::vector<FingerForce<double>> forces(8);
  const long before = clothctl_test::allocations();
  f.basis.update(f.grips, f.held, {}, f.x, f.B, f.offset);
  f.basis.upper_bounds(f.grips, upper);
  f.basis.finger_forces(f.grips, f.held, f.B, d, forces);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);

  // The sum of the fingers' forces is B d + r0.
  VectorX<double> sum = VectorX<double>::Zero(f.B.rows());
  for (const FingerForce<double>& force : forces) {
    const std::size_t slot = f.held.slot(static_cast<std::size_t>(force.grip), force.vertex);
    sum.segment<3>(3 * static_cast<Index>(slot)) += force.force;
  }
  CHECK((f.B * d + f.offset - sum).norm() <= 1e-13);

  for (std::size_t k = 0; k < 4; ++k) {
    const auto& columns = f.basis.fingers()[k];
    Points<double> normals(3, static_cast<Index>(columns.held_slots.size())), own = normals,
                                                                              points = normals;
    double pressed = 0;
    for (Index j = 0; j < own.cols(); ++j) {
      const FingerForce<double>& force = forces[static_cast<std::size_t>(columns.first_force + j)];
      own.col(j) = force.force;
      normals.col(j) = force.normal;
      points.col(j) = f.x.col(force.vertex);
      pressed += force.force.dot(force.normal);
      CHECK(force.vertex == f.grips[static_cast<std::size_t>(columns.grip)]
                                .fingers[static_cast<std::size_t>(columns.finger)]
                                .vertices[static_cast<std::size_t>(j)]);
    }
    CHECK(f.basis.normal_force(f.grips, columns, d) == Approx(pressed));
    CHECK(contact_traits<Contact>::violation(contact, points, normals, own, 1e6) <= 1e-14);
    // A single coefficient at its bound reaches the finger's limit.
    VectorX<double> alone = VectorX<double>::Zero(d.size());
    alone[columns.column] = upper[columns.column];
    CHECK(f.basis.normal_force(f.grips, columns, alone) ==
          Approx(f.basis.finger(f.grips, columns).max_normal_force));
  }
  // A column has nonzeros in the rows that it names only.
  for (Index c = 0; c < f.B.cols(); ++c) {
    const detail::RowRange rows = f.columns[static_cast<std::size_t>(c)];
    CHECK(f.B.col(c).segment(rows.first, rows.second).squaredNorm() ==
          Approx(f.B.col(c).squaredNorm()));
  }
}

}  // namespace

TEST_CASE("columns and offset of a force basis give the fingers' forces", "[mpc]") {
  SECTION("frictionless") { check_basis(Frictionless<double>()); }
  SECTION("hard finger") { check_basis(HardFinger<double>{0.6, 5}); }
  SECTION("soft finger") { check_basis(SoftFinger<double>{0.6, 0.005, 4}); }
  SECTION("adhesive finger") { check_basis(AdhesiveFinger<double>{{0.6, 4}, 2.0}); }
}

TEST_CASE("the offset is the adhesion of all fingers, divided among their vertices", "[mpc]") {
  const AdhesiveFinger<double> sticky{{0.6, 4}, 3.0};
  Fixture<AdhesiveFinger<double>> f(sticky);
  CHECK(f.offset.norm() <= 1e-15);  // opposed fingers of equal adhesion cancel
  f.grips[0].fingers[1].contact.strength = 0.0;
  f.basis.update(f.grips, f.held, {}, f.x, f.B, f.offset);
  // Without triangles, the fallback normal (0, 1, 0) is used: each vertex is pulled by 1 N.
  for (Index slot = 0; slot < 3; ++slot)
    CHECK((f.offset.segment<3>(3 * slot) - Vector3<double>(0, -1, 0)).norm() <= 1e-15);
  CHECK(f.offset.tail<3>().norm() <= 1e-15);
}
