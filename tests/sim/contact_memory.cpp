// The memory of contacts: by feature, by place, once each, and pairs in order.

#include "clothctl/sim/detail/contact_memory.hpp"

#include <Eigen/Dense>
#include <utility>
#include <vector>

#include "support/catch.hpp"

using namespace clothctl;
using Contact = RigidContact<double>;
using V = Vector3<double>;

namespace {

Contact contact(int a, int b, unsigned feature, const V& position, double impulse = 0) {
  Contact c;
  c.a = a;
  c.b = b;
  c.age = impulse > 0 ? 3 : -1;
  c.feature = feature;
  c.position = position;
  c.sample.impulse = V(0, 0, impulse);
  return c;
}

}  // namespace

TEST_CASE("pairs are in order of A, then bodies before obstacles") {
  const std::vector<std::pair<int, int>> order = {{0, 1},  {0, 5}, {0, -1},
                                                  {0, -2}, {1, 2}, {1, -1}};
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (std::size_t j = 0; j < order.size(); ++j)
      CHECK(detail::pair_before(order[i], order[j]) == (i < j));
  }
}

TEST_CASE("a point takes over from the same feature, else from a close one, and each once") {
  const std::vector<Contact> old = {
      contact(0, 1, 7, V(0, 0, 0), 1), contact(0, 1, 8, V(1, 0, 0), 2),
      contact(0, 2, 7, V(0, 0, 0), 9), contact(0, -1, 7, V(0, 0, 0), 4)};
  detail::ContactMemory<double> memory;
  memory.start(old);
  int skipped = 0;
  const auto skip = [&](const Contact&) { ++skipped; };
  std::vector<Contact> now = {contact(0, 1, 8, V(5, 0, 0)), contact(0, 1, 99, V(0.01, 0, 0)),
                              contact(0, 1, 100, V(0.02, 0, 0)), contact(0, 1, 101, V(3, 0, 0))};
  memory.go_to(0, 1, skip);
  memory.remember(now.data(), 4, 0.1);
  CHECK(now[0].sample.impulse[2] == 2);
  CHECK(now[1].sample.impulse[2] == 1);
  CHECK(now[2].sample.impulse[2] == 0);
  CHECK((now[0].age == 4 && now[1].age == 4 && now[2].age == 0 && now[3].age == 0));
  CHECK(skipped == 0);
  memory.go_to(0, -1, skip);
  CHECK(skipped == 1);
  Contact last = contact(0, -1, 7, V(0, 0, 0));
  memory.remember(&last, 1, 0.1);
  CHECK(last.sample.impulse[2] == 4);
  memory.go_to(3, 0, skip);
  CHECK(skipped == 1);
}
