// The tree of boxes against all items, one by one: closest, first on a way, overlaps; boxes that
// move; trees of no and of few items.

#include "clothctl/collision/detail/box_tree.hpp"

#include <algorithm>
#include <array>
#include <random>
#include <vector>

#include "static/explicit_scalar.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/meshes.hpp"

using namespace clothctl;
using clothctl_test::uniform;
using detail::BoxTree;

template class clothctl::detail::BoxTree<clothctl_test::ExplicitDouble>;

namespace {

template <class S>
using Boxes = std::vector<BoundingBox<S>>;

template <class S>
Vector3<S> anywhere(std::mt19937& random, double low, double high) {
  Vector3<S> x;
  for (int i = 0; i < 3; ++i) x[i] = S(uniform(random, low, high));
  return x;
}

template <class S>
Boxes<S> random_boxes(int count, std::mt19937& random) {
  Boxes<S> boxes;
  for (int k = 0; k < count; ++k) {
    const Vector3<S> low = anywhere<S>(random, -1, 1), size = anywhere<S>(random, 0, 0.2);
    boxes.push_back({low, low + size});
  }
  // The same box again: of equal answers any will do.
  if (count > 9) boxes[7] = boxes[2];
  return boxes;
}

template <class S>
Points<S> centres_of(const Boxes<S>& boxes) {
  Points<S> centres(3, static_cast<Index>(boxes.size()));
  for (std::size_t k = 0; k < boxes.size(); ++k)
    centres.col(static_cast<Index>(k)) = S(0.5) * (boxes[k].lower + boxes[k].upper);
  return centres;
}

template <class S>
const BoundingBox<S>& at(const Boxes<S>& boxes, int k) {
  return boxes[static_cast<std::size_t>(k)];
}

/// Compares the searches for one box and one way with all items. Returns the number of items seen.
template <class S, int kLeaf>
int compare(const BoxTree<S, kLeaf>& tree, const Boxes<S>& boxes, std::mt19937& random) {
  const int count = static_cast<int>(boxes.size());
  const Vector3<S> x = anywhere<S>(random, -1.5, 1.5), y = anywhere<S>(random, -1.5, 1.5);
  int seen = 0;

  S least(100), first = no_impact<S>();
  const S reach(0.01f);
  for (const BoundingBox<S>& box : boxes) {
    least = std::min(least, detail::box_square<S>(box, x));
    first = std::min(first, detail::box_entry<S>(box.grown(reach), x, y, S(1)));
  }
  const auto square_of = [&](int k, const S&) {
    ++seen;
    return detail::box_square<S>(at(boxes, k), x);
  };
  const int nearest = tree.nearest(x, S(100), square_of);
  REQUIRE(nearest >= 0);
  CHECK(detail::box_square<S>(at(boxes, nearest), x) == least);
  // Nothing is closer than the closest, or than what is known already.
  CHECK(tree.nearest(x, least, square_of) == -1);
  const S time = tree.sweep(x, y, reach, [&](int k, const S& latest) {
    ++seen;
    return detail::box_entry<S>(at(boxes, k).grown(reach), x, y, latest);
  });
  CHECK(time == first);

  const BoundingBox<S> around{x, x + Vector3<S>::Constant(S(0.3))};
  std::vector<int> found;
  tree.for_each_overlap(around, [&](int begin, int items) {
    for (int k = begin; k < begin + items; ++k) found.push_back(k);
  });
  CHECK(std::is_sorted(found.begin(), found.end()));
  CHECK(std::adjacent_find(found.begin(), found.end()) == found.end());
  for (int k = 0; k < count; ++k) {
    if (at(boxes, k).overlaps(around)) CHECK(std::binary_search(found.begin(), found.end(), k));
  }
  return seen + static_cast<int>(found.size());
}

/// Compares the pairs of items that overlap with all pairs.
template <class S, int kLeaf>
void compare_pairs(const BoxTree<S, kLeaf>& tree, const Boxes<S>& boxes) {
  std::vector<std::array<int, 2>> found;
  tree.for_each_overlap_within([&](int p, int p_end, int q, int q_end) {
    for (int i = p; i < p_end; ++i) {
      for (int j = std::max(i + 1, q); j < q_end; ++j) found.push_back({i, j});
    }
  });
  std::sort(found.begin(), found.end());
  CHECK(std::adjacent_find(found.begin(), found.end()) == found.end());
  const int count = static_cast<int>(boxes.size());
  int missed = 0;
  for (int i = 0; i < count; ++i) {
    for (int j = i + 1; j < count; ++j) {
      const bool overlap = at(boxes, i).overlaps(at(boxes, j));
      CHECK(detail::boxes_overlap<S>(at(boxes, i), at(boxes, j)) == overlap);
      missed += overlap && !std::binary_search(found.begin(), found.end(), std::array{i, j});
    }
  }
  CHECK(missed == 0);
  if (count > 100) CHECK(static_cast<int>(found.size()) < count * (count - 1) / 4);
}

template <class S, int kLeaf>
void check_tree(int count) {
  std::mt19937 random(static_cast<unsigned>(40 + count));
  CAPTURE(count);
  const Boxes<S> made = random_boxes<S>(count, random);
  BoxTree<S, kLeaf> tree;
  const std::vector<int> order = tree.build(centres_of(made));
  std::vector<int> sorted = order;
  std::sort(sorted.begin(), sorted.end());
  for (int k = 0; k < count; ++k) CHECK(sorted[static_cast<std::size_t>(k)] == k);
  Boxes<S> boxes = detail::in_order(made, order);
  for (int step = 0; step < 4; ++step) {
    const long before = clothctl_test::allocations();
    tree.fit([&boxes](int k) { return at(boxes, k); });
    const long allocated = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(allocated == 0);
    BoundingBox<S> all = boxes.front();
    for (const BoundingBox<S>& box : boxes) all.include(box);
    CHECK((tree.bounds().lower == all.lower && tree.bounds().upper == all.upper));
    int seen = 0;
    for (int i = 0; i < 50; ++i) seen += compare(tree, boxes, random);
    if (count > 100 && step == 0) CHECK(seen < 50 * count);
    compare_pairs(tree, boxes);
    for (BoundingBox<S>& box : boxes) {
      const Vector3<S> by = anywhere<S>(random, -0.2, 0.2);
      box = {box.lower + by, box.upper + by};
    }
  }
}

}  // namespace

TEMPLATE_TEST_CASE("a tree of boxes answers as all of its items", "[contact]", float, double) {
  using S = TestType;
  for (const int count : {1, 2, 3, 4, 5, 9, 137}) {
    check_tree<S, 4>(count);
    check_tree<S, 2>(count);
    check_tree<S, 1>(count);
  }
}

TEST_CASE("equal centres are split like others", "[contact]") {
  BoxTree<double, 1> tree;
  CHECK(tree.build(Points<double>::Zero(3, 9)).size() == 9);
  const BoundingBox<double> box{Vector3<double>(0, 0, 0), Vector3<double>(1, 1, 1)};
  tree.fit([&box](int) { return box; });
  int items = 0;
  tree.for_each_overlap(box, [&](int, int count) { items += count; });
  CHECK(items == 9);
}

TEST_CASE("a tree of nothing finds nothing, and one that is built again is new", "[contact]") {
  BoxTree<double> tree;
  const Vector3<double> x(1, 2, 3), y = -x;
  int visits = 0;
  const auto count_visits = [&] {
    visits = 0;
    CHECK(tree.nearest(x, 9, [&](int, double) { return ++visits; }) == -1);
    CHECK(tree.sweep(x, y, 0.1, [&](int, double) { return double(++visits); }) ==
          no_impact<double>());
    tree.for_each_overlap({y, x}, [&](int, int) { ++visits; });
    tree.for_each_overlap_within([&](int, int, int, int) { ++visits; });
    return visits;
  };
  CHECK(count_visits() == 0);
  CHECK(tree.build(Points<double>::Random(3, 20)).size() == 20);
  CHECK(tree.build(Points<double>(3, 0)).empty());
  tree.fit([&](int) { return BoundingBox<double>{x, x}; });
  CHECK(count_visits() == 0);
}

TEST_CASE("distances and common boxes", "[contact]") {
  using V = Vector3<double>;
  const BoundingBox<double> box{V(0, 0, 0), V(1, 2, 3)};
  CHECK(detail::box_square<double>(box, V(0.5, 0, 3)) == 0);
  CHECK(detail::box_square<double>(box, V(4, 1, 1)) == 9);
  CHECK(detail::box_square<double>(box, V(-1, 4, 5)) == 9);
  const auto common = detail::common_box<double>(box, {V(-1, 1, 1), V(0.5, 5, 2)});
  CHECK(common.lower == V(-1, 0, 0));
  CHECK(common.upper == V(1, 5, 3));
}
