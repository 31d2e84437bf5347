#include "clothctl/cloth/detail/mesh_parts.hpp"

#include <array>
#include <vector>

#include "support/catch.hpp"
#include "support/sweeps.hpp"
#include "support/thread_executor.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

Points<double> cloud(int n, unsigned seed) {
  clothctl_test::Numbers random(seed);
  Points<double> points(3, n);
  for (Index i = 0; i < points.size(); ++i) points(i) = random(-1, 1);
  points.row(1) *= 0.3;
  points.row(2).setZero();
  return points;
}

}  // namespace

TEST_CASE("mesh parts: as many as the size allows, of equal size", "[mesh_parts]") {
  for (const auto& [n, count] : {std::pair{1, 1},
                                 {2999, 1},
                                 {3000, 2},
                                 {5999, 2},
                                 {6000, 4},
                                 {12811, 8},
                                 {24000, 16},
                                 {200000, 16}}) {
    const MeshParts parts = divide_mesh(cloud(n, 3));
    CAPTURE(n);
    REQUIRE(parts.count == count);
    if (count == 1) continue;
    std::vector<int> size(static_cast<std::size_t>(count), 0);
    REQUIRE(parts.of.size() == static_cast<std::size_t>(n));
    for (const int p : parts.of) ++size[static_cast<std::size_t>(p)];
    for (const int s : size) {
      CHECK(s >= n / count - 1);
      CHECK(s <= n / count + 1);
    }
  }
}

TEST_CASE("mesh parts: parts are boxes that do not overlap", "[mesh_parts]") {
  const Points<double> points = cloud(12000, 5);
  const MeshParts parts = divide_mesh(points);
  std::vector<std::array<double, 4>> box(8, {9, -9, 9, -9});
  for (Index v = 0; v < points.cols(); ++v) {
    auto& b = box[static_cast<std::size_t>(parts.of[static_cast<std::size_t>(v)])];
    b = {std::min(b[0], points(0, v)), std::max(b[1], points(0, v)), std::min(b[2], points(1, v)),
         std::max(b[3], points(1, v))};
  }
  for (std::size_t i = 0; i < 8; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const auto &a = box[i], &b = box[j];
      CHECK((a[1] < b[0] || b[1] < a[0] || a[3] < b[2] || b[3] < a[2]));
    }
  }
}

TEST_CASE("mesh parts: equal positions give the same parts each time", "[mesh_parts]") {
  const Points<double> points = Points<double>::Zero(3, 7000);
  const MeshParts parts = divide_mesh(points);
  CHECK(parts.count == 4);
  CHECK(parts.of == divide_mesh(points).of);
}

TEST_CASE("mesh parts: a constraint is in a part if all its vertices are", "[mesh_parts]") {
  MeshParts parts;
  CHECK(parts.group(std::array<int, 2>{0, 5}) == 0);
  parts.count = 2;
  parts.of = {0, 0, 1, 1};
  CHECK(parts.group(std::array<int, 2>{0, 1}) == 0);
  CHECK(parts.group(std::array<int, 3>{3, 2, 2}) == 1);
  CHECK(parts.group(std::array<int, 3>{0, 1, 2}) == 2);
  std::vector<std::array<int, 2>> items{{0, 2}, {3, 2}, {1, 0}, {1, 3}, {2, 3}};
  const GroupBounds bounds = sort_by_group(parts, items, [](const auto& item) { return item; });
  CHECK(bounds == GroupBounds{0, 1, 3, 5});
  CHECK(items == std::vector<std::array<int, 2>>{{1, 0}, {3, 2}, {2, 3}, {0, 2}, {1, 3}});
}

TEST_CASE("mesh parts: those of some vertices are joined while they are small", "[mesh_parts]") {
  const MeshParts parts = divide_mesh(cloud(24000, 7));
  REQUIRE(parts.count == 16);
  std::vector<int> some;
  for (int v = 0; v < 24000; v += 4) some.push_back(v);
  const MeshParts fewer = parts.of_some(some);
  REQUIRE(fewer.count == 4);
  for (std::size_t i = 0; i < some.size(); ++i)
    REQUIRE(fewer.of[i] == parts.of[static_cast<std::size_t>(some[i])] / 4);
  CHECK(parts.of_some({1, 2, 3}).count == 1);
}

TEST_CASE("mesh parts: the border group follows the parts, or they follow it", "[mesh_parts]") {
  clothctl_test::ThreadExecutor team{3};
  std::array<int, 3> seen{};
  for_each_group({0, 4, 9, 11}, ExecutorRef(team),
                 [&](std::size_t g, std::size_t begin, std::size_t end) {
                   if (g == 2) CHECK((seen[0] == 4 && seen[1] == 5));
                   seen[g] = static_cast<int>(end - begin);
                 });
  CHECK(seen == std::array<int, 3>{4, 5, 2});
  seen = {};
  std::array<int, 2> border{};  // what each part saw of it
  const auto back = [&](std::size_t g, std::size_t begin, std::size_t end) {
    if (g < 2) border[g] = seen[2];
    seen[g] = static_cast<int>(end - begin);
  };
  for_each_group({0, 4, 9, 11}, ExecutorRef(team), back, SweepOrder::Backward);
  CHECK(seen == std::array<int, 3>{4, 5, 2});
  CHECK(border == std::array<int, 2>{2, 2});
  team.loops = 0;
  for_each_group({0, 0, 0, 0}, ExecutorRef(team),
                 [](std::size_t, std::size_t, std::size_t) { FAIL("there are no items"); });
  CHECK(team.loops == 0);
  std::vector<int> visits(10000, 0);
  for_each_range(visits.size(), ExecutorRef(team), [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) ++visits[i];
  });
  CHECK(visits == std::vector<int>(10000, 1));
}
