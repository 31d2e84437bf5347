// The archetype satisfies its concept, has nothing else, obeys the laws, and works in grips and
// their basis.

#include "archetypes/contact_model.hpp"

#include <type_traits>

#include "clothctl/mpc/detail/grip_basis.hpp"
#include "laws/contact_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::ContactModelArchetype;

static_assert(ContactModel<ContactModelArchetype<float>, float> &&
              ContactModel<ContactModelArchetype<double>, double>);
static_assert(!std::is_default_constructible_v<ContactModelArchetype<double>> &&
              !std::is_copy_assignable_v<ContactModelArchetype<double>>);
static_assert(!ContactModel<int> && !ContactModel<void*> && !ContactModel<std::string>);

TEMPLATE_TEST_CASE("the archetype of a contact model obeys the laws", "[archetypes]", float,
                   double) {
  const TestType tolerance = std::is_same_v<TestType, float> ? TestType(1e-5) : TestType(1e-13);
  clothctl_test::check_contact_laws<TestType>(ContactModelArchetype<TestType>(1), tolerance);
}

TEMPLATE_TEST_CASE("grips and their basis need no more from a contact than the concept names",
                   "[archetypes]", float, double) {
  using S = TestType;
  using Contact = ContactModelArchetype<S>;
  const Grip<S, Contact> grip = make_pinch<S>({0, 1, 2}, Contact(1), S(4));
  CHECK(validate_grips<S>(std::vector<Grip<S, Contact>>{grip}, 3) == "");
  detail::GripBasis<S, Contact> basis({grip}, {}, GripInput::Force);
  REQUIRE(basis.unknowns() == 2);
  const Points<S> x = clothctl_test::contact_patch<S>(3, false).points;
  basis.update(x);
  CHECK(basis.offset().isZero(S(0)));
  VectorX<S> d(2);
  d << S(3), S(1);
  std::vector<FingerForce<S>> forces(6);
  basis.finger_forces(d, forces);
  for (std::size_t j = 0; j < 6; ++j) {
    // The fallback normal is y. Each of three vertices carries a third of the force.
    const S expected = j < 3 ? S(1) : S(-1) / S(3);
    CHECK((forces[j].force - Vector3<S>(S(0), expected, S(0))).norm() <= S(1e-6));
  }
  CHECK(basis.normal_force(basis.fingers()[0], d) == Approx(3.0));
}
