// Contacts: their defaults, and names of their states.

#include "clothctl/contact/detail/contact_sample.hpp"

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("a new contact is rigid, without friction, and remembers nothing", "[contact]") {
  const ContactSample<double> c;
  CHECK((c.a.side == -1 && c.b.side == -1));
  CHECK((c.compliance == 0 && c.friction == 0 && c.gap == 0));
  CHECK(c.offset == Vector3<double>::Zero());
  CHECK(c.impulse == Vector3<double>::Zero());
  CHECK(c.state == ContactState::Open);
}

TEST_CASE("the states of a contact have names", "[contact]") {
  CHECK(to_string(ContactState::Open) == "open");
  CHECK(to_string(ContactState::Stick) == "stick");
  CHECK(to_string(ContactState::Slip) == "slip");
}
