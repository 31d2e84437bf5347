#include "clothctl/qp/detail/factor_update.hpp"

#include <algorithm>
#include <random>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

// A list of unknowns that counts its calls and refuses some unknowns.
struct List {
  std::vector<Index> held;
  Index refused = -1, most_updates = 4;
  int updates = 0, renewals = 0;

  Index size() const { return static_cast<Index>(held.size()); }
  Index order(Index k) const { return held[static_cast<std::size_t>(k)]; }
  Index place(Index i) const {
    const auto at = std::find(held.begin(), held.end(), i);
    return at == held.end() ? -1 : at - held.begin();
  }
  bool few(Index changes, Index) const { return changes <= most_updates; }
  void append(Index i) {
    ++updates;
    if (i != refused) held.push_back(i);
  }
  void remove(Index k) {
    ++updates;
    held.erase(held.begin() + k);
  }
  void renew(const std::vector<Index>& list, Index count) {
    ++renewals;
    held.clear();
    for (Index k = 0; k < count; ++k) {
      if (list[static_cast<std::size_t>(k)] != refused)
        held.push_back(list[static_cast<std::size_t>(k)]);
    }
  }
};

}  // namespace

TEST_CASE(
    "a factor changes to any set, by updates if they are few, and keeps the order of the rest",
    "[qp]") {
  std::mt19937 random(2);
  const Index n = 12;
  std::vector<Index> fresh(n), kept(n);
  List list;
  for (int step = 0; step < 300; ++step) {
    list.most_updates = static_cast<Index>(step % 13);
    const List before = list;
    unsigned wanted = random() % 4096u;
    const auto is_wanted = [&](Index i) { return (wanted >> i & 1u) != 0; };
    const Index count = detail::update_factor_to(list, n, is_wanted, fresh, kept);
    Index changes = 0, news = 0;
    for (Index i = 0; i < n; ++i) {
      REQUIRE((list.place(i) >= 0) == is_wanted(i));
      changes += (before.place(i) >= 0) != is_wanted(i) ? 1 : 0;
      news += before.place(i) < 0 && is_wanted(i) ? 1 : 0;
    }
    REQUIRE(count == news);
    for (Index k = 0; k < count; ++k) CHECK(before.place(fresh[static_cast<std::size_t>(k)]) < 0);
    CHECK(list.updates - before.updates == (changes <= list.most_updates ? changes : 0));
    CHECK(list.renewals - before.renewals == (changes > list.most_updates ? 1 : 0));
    std::vector<Index> stayed;
    for (Index i : before.held) {
      if (is_wanted(i)) stayed.push_back(i);
    }
    CHECK(std::equal(stayed.begin(), stayed.end(), list.held.begin()));
  }
}

TEST_CASE("an unknown that the factor refused counts as new at the next call", "[qp]") {
  std::vector<Index> fresh(6), kept(6);
  List list;
  list.refused = 2;
  const auto even = [](Index i) { return i % 2 == 0; };
  CHECK(detail::update_factor_to(list, 6, even, fresh, kept) == 3);
  CHECK(list.held == std::vector<Index>{0, 4});
  CHECK(detail::update_factor_to(list, 6, even, fresh, kept) == 1);
  CHECK(fresh[0] == 2);
}
