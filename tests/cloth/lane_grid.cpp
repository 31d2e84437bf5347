#include "clothctl/cloth/detail/lane_grid.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <vector>

#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

constexpr std::array<bool, kGridEdges> kAllKinds{true, true, true, true};

/// A layout as LaneSheet chooses it, with strips of at least `least` rows.
template <class Scalar>
LaneLayout<Scalar> layout_of(int rows, int cols, int least) {
  constexpr int kLanes = LaneLayout<Scalar>::kLanes;
  int strip = least;
  while (kLanes * strip + 1 < rows) ++strip;
  return {rows, cols, strip, std::min((rows - 1) / strip, kLanes - 1)};
}

/// The ends of an edge by its kind, upper row and left column.
std::array<std::array<int, 2>, 2> ends_of(std::size_t kind, int row, int col) {
  if (kind == kAlong) return {{{row, col}, {row, col + 1}}};
  if (kind == kDown) return {{{row, col}, {row + 1, col}}};
  if (kind == kFalling) return {{{row, col}, {row + 1, col + 1}}};
  return {{{row, col + 1}, {row + 1, col}}};
}

/// Counts the visits of each edge, and checks that blocks hold the ends that belong to it. The
/// points hold the number of their vertex in all coordinates.
template <class Scalar>
struct Counter {
  static constexpr std::size_t kLanes = std::size_t(grid_lanes<Scalar>());
  /// By kind and entry, the numbers of both ends.
  std::array<std::map<std::size_t, std::array<int, 2>>, kGridEdges> expected;
  std::array<std::map<std::size_t, int>, kGridEdges> visits;
  bool masked = false;
  std::size_t lanes_parity = 0;
  int wrong = 0;

  Counter(const LaneLayout<Scalar>& layout, const std::array<bool, kGridEdges>& present) {
    for (std::size_t kind = 0; kind < kGridEdges; ++kind) {
      for (int row = 0; row < layout.rows; ++row) {
        for (int col = 0; col < layout.cols; ++col) {
          const auto ends = ends_of(kind, row, col);
          const int last_row = std::max(ends[0][0], ends[1][0]),
                    last_col = std::max(ends[0][1], ends[1][1]);
          if (!present[kind] || last_row >= layout.rows || last_col >= layout.cols) continue;
          const std::size_t at = layout.offset(row, col);
          const std::size_t entry = at / (4 * kLanes) * kLanes + at % (4 * kLanes);
          REQUIRE(expected[kind].count(entry) == 0);
          expected[kind][entry] = {ends[0][0] * layout.cols + ends[0][1],
                                   ends[1][0] * layout.cols + ends[1][1]};
        }
      }
    }
  }
  void only_lanes(std::size_t parity) {
    masked = true;
    lanes_parity = parity;
  }
  void all_lanes() { masked = false; }
  template <std::size_t kind>
  void edge(std::size_t at, const Scalar* first, const Scalar* second) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (masked && lane % 2 != lanes_parity) continue;
      const auto edge = expected[kind].find(at + lane);
      if (edge == expected[kind].end()) continue;
      ++visits[kind][at + lane];
      for (std::size_t c = 0; c < 3; ++c) {
        if (int(first[c * kLanes + lane]) != edge->second[0]) ++wrong;
        if (int(second[c * kLanes + lane]) != edge->second[1]) ++wrong;
      }
    }
  }
  /// Visits that are missing or too many.
  int errors() const {
    int sum = wrong;
    for (std::size_t kind = 0; kind < kGridEdges; ++kind) {
      for (const auto& [entry, ends] : expected[kind]) {
        const auto found = visits[kind].find(entry);
        if (found == visits[kind].end() || found->second != 1) ++sum;
      }
    }
    return sum;
  }
};

/// Records the edges of lane 0 in the order of the visits: kind and both vertices.
template <class Scalar>
struct Recorder {
  std::vector<std::array<int, 3>> visits;
  void only_lanes(std::size_t) {}
  void all_lanes() {}
  template <std::size_t kind>
  void edge(std::size_t, const Scalar* first, const Scalar* second) {
    visits.push_back({int(kind), int(first[0]), int(second[0])});
  }
};

/// A buffer in which each vertex holds its number; lanes without a vertex hold -1.
template <class Scalar>
std::vector<Scalar> numbered(const LaneLayout<Scalar>& layout) {
  constexpr std::size_t kLanes = std::size_t(grid_lanes<Scalar>());
  std::vector<Scalar> points(layout.buffer_size(), Scalar(-1));
  for (int row = 0; row < layout.rows; ++row) {
    for (int col = 0; col < layout.cols; ++col) {
      for (std::size_t c = 0; c < 4; ++c)
        points[layout.offset(row, col) + c * kLanes] = Scalar(row * layout.cols + col);
    }
  }
  return points;
}

}  // namespace

TEMPLATE_TEST_CASE("lane grid: each vertex has its own place", "[lane_grid]", float, double,
                   long double) {
  using Scalar = TestType;
  constexpr std::size_t kLanes = std::size_t(grid_lanes<Scalar>());
  for (int rows = 2; rows <= 140; rows += clothctl_test::kSanitized ? 9 : 1) {
    for (const int cols : {2, 8, 40}) {
      for (const int least : {1, 3, 4}) {
        const auto layout = layout_of<Scalar>(rows, cols, least);
        std::set<std::size_t> taken;
        std::vector<int> in_lane(kLanes, 0);
        bool good = true;
        for (int row = 0; row < rows; ++row) {
          good = good && layout.lane(row) * layout.strip + layout.local_row(row) == row &&
                 layout.lane(row) >= 0 && layout.lane(row) < int(kLanes) &&
                 layout.local_row(row) >= 0 && layout.local_row(row) < layout.local_rows;
          ++in_lane[std::size_t(layout.lane(row))];
          for (int col = 0; col < cols; ++col) {
            const std::size_t at = layout.offset(row, col);
            for (std::size_t c = 0; c < 4; ++c) {
              good = good && at + c * kLanes < layout.size();
              good = taken.insert(at + c * kLanes).second && good;
            }
          }
        }
        for (std::size_t k = 0; k < kLanes; ++k)
          good = good && in_lane[k] == layout.rows_in_lane(int(k));
        if (!good) FAIL(rows << " × " << cols << ", strips of " << least);
        CHECK(layout.local_rows - layout.strip <= 1);
        CHECK(layout.buffer_size() == layout.size() + 2 * layout.row_size());
      }
    }
  }
}

TEMPLATE_TEST_CASE("lane grid: a sweep visits each edge once, with its two ends", "[lane_grid]",
                   float, double, long double) {
  using Scalar = TestType;
  constexpr int kLanes = grid_lanes<Scalar>();
  for (const int strip : {1, 2, 3, 4, 7}) {
    // Whole strips, the extra row, one row less, and a few lanes only.
    for (const int rows : {kLanes * strip, kLanes * strip + 1, kLanes * strip - 1, 3 * strip + 1,
                           3 * strip, 2 * strip + 2}) {
      for (const int cols : {2, 3, 8, 9}) {
        if (rows < 2) continue;
        const int last = std::min((rows - 1) / strip, kLanes - 1);
        if (rows - last * strip > strip + 1) continue;
        const LaneLayout<Scalar> layout(rows, cols, strip, last);
        for (const bool diagonals : {true, false}) {
          const std::array<bool, kGridEdges> present{true, true, diagonals, diagonals};
          std::vector<Scalar> points = numbered(layout);
          const std::vector<Scalar> before = points;
          Counter<Scalar> counter(layout, present);
          sweep_grid(layout, present, layout.whole(), points.data(), points.data() + layout.size(),
                     counter);
          if (counter.errors() > 0)
            FAIL(counter.errors() << " errors: " << rows << " × " << cols << ", strips " << strip);
          CHECK_FALSE(counter.masked);
          // Nothing moved, so the ghost row must have been written back where it came from.
          CHECK(std::equal(points.begin(), points.begin() + std::ptrdiff_t(layout.size()),
                           before.begin()));
        }
      }
    }
  }
}

TEMPLATE_TEST_CASE("lane grid: bands and seams together visit each edge once", "[lane_grid]", float,
                   double) {
  using Scalar = TestType;
  constexpr int kLanes = grid_lanes<Scalar>();
  for (const int strip : {1, 2, 4}) {
    for (const int rows : {kLanes * strip + 1, 2 * strip + 2}) {
      for (const int cols : {127, 128, 129, 200, 320}) {
        const LaneLayout<Scalar> layout(rows, cols, strip,
                                        std::min((rows - 1) / strip, kLanes - 1));
        CHECK(layout.band_count() == cols / 64);
        std::vector<Scalar> points = numbered(layout);
        const std::vector<Scalar> before = points;
        Counter<Scalar> counter(layout, kAllKinds);
        int runs = 0;
        for_each_band(layout, {}, 1, [&](const ColumnBand& band, int i) {
          CHECK(i == runs++);
          CHECK(band.seam == (i >= layout.band_count()));
          sweep_grid(layout, kAllKinds, band, points.data(), points.data() + layout.size(),
                     counter);
        });
        CHECK(runs == 2 * layout.band_count() - 1);
        Counter<Scalar> back(layout, kAllKinds);
        const auto go_back = [&](const ColumnBand& band, int) {
          CHECK(band.seam == (runs-- > layout.band_count()));
          sweep_grid(layout, kAllKinds, band, points.data(), points.data() + layout.size(), back,
                     SweepOrder::Backward);
        };
        for_each_band(layout, {}, 1, go_back, SweepOrder::Backward);
        CHECK(runs == 0);
        CHECK(back.errors() == 0);
        if (counter.errors() > 0)
          FAIL(counter.errors() << " errors: " << rows << " × " << cols << ", strips " << strip);
        CHECK(std::equal(points.begin(), points.begin() + std::ptrdiff_t(layout.size()),
                         before.begin()));
      }
    }
  }
}

TEMPLATE_TEST_CASE("lane grid: the ghost row is the row below and is written back", "[lane_grid]",
                   float, double) {
  using Scalar = TestType;
  constexpr int kLanes = grid_lanes<Scalar>();
  for (const int strip : {1, 2, 5}) {
    for (const int extra : {0, 1}) {
      for (const int last : {1, 2, kLanes - 1}) {
        const LaneLayout<Scalar> layout((last + 1) * strip + extra, 5, strip, last);
        std::vector<Scalar> points = numbered(layout);
        const std::vector<Scalar> before = points;
        Scalar* ghost = points.data() + layout.size();
        read_ghost_row(layout, layout.whole(), points.data(), ghost);
        for (int lane = 0; lane <= last; ++lane) {
          const int row = (lane + 1) * strip;  // below the last row of the lane
          if (row >= layout.rows) continue;
          for (int col = 0; col < 5; ++col) {
            for (int c = 0; c < 4; ++c) {
              Scalar& value = ghost[(col * 4 + c) * kLanes + lane];
              CHECK(value == Scalar(row * 5 + col));
              value += Scalar(1000);
            }
          }
        }
        write_ghost_row(layout, layout.whole(), ghost, points.data());
        for (int row = 0; row < layout.rows; ++row) {
          for (int col = 0; col < 5; ++col) {
            const std::size_t at = layout.offset(row, col);
            const bool below = row > 0 && row % strip == 0 && (row / strip <= last || extra == 1);
            CHECK(points[at] == before[at] + (below ? Scalar(1000) : Scalar(0)));
          }
        }
      }
    }
  }
}

TEMPLATE_TEST_CASE("lane grid: every other lane of the ghost row can be written alone",
                   "[lane_grid]", float, double) {
  using Scalar = TestType;
  constexpr int kLanes = grid_lanes<Scalar>();
  const LaneLayout<Scalar> layout(kLanes + 1, 4, 1, kLanes - 1);
  for (const std::size_t parity : {std::size_t(0), std::size_t(1)}) {
    std::vector<Scalar> points = numbered(layout);
    const std::vector<Scalar> before = points;
    Scalar* ghost = points.data() + layout.size();
    read_ghost_row(layout, layout.whole(), points.data(), ghost);
    for (std::size_t at = 0; at < layout.row_size(); ++at) ghost[at] += Scalar(1000);
    write_ghost_row(layout, layout.whole(), ghost, points.data(), parity, 2);
    for (int row = 0; row < layout.rows; ++row) {
      // Lane k of the ghost row is row k + 1.
      const bool written = row > 0 && std::size_t(row - 1) % 2 == parity;
      for (int col = 0; col < 4; ++col) {
        const std::size_t at = layout.offset(row, col);
        CHECK(points[at] == before[at] + (written ? Scalar(1000) : Scalar(0)));
      }
    }
  }
}

TEMPLATE_TEST_CASE("lane grid: edges that share a vertex follow each other in the order described",
                   "[lane_grid]", float, double) {
  using Scalar = TestType;
  constexpr std::size_t kLanes = std::size_t(grid_lanes<Scalar>());
  const LaneLayout<Scalar> layout(int(kLanes) * 3, 7, 3, int(kLanes) - 1);
  std::vector<Scalar> points = numbered(layout);
  Recorder<Scalar> rule;
  sweep_grid(layout, kAllKinds, layout.whole(), points.data(), points.data() + layout.size(), rule);
  REQUIRE(rule.visits.size() == std::size_t(3 * (3 * 6 + 7)));
  // Row by row; in a row, those of a kind come before those of the next kind that they touch.
  for (std::size_t i = 0; i < rule.visits.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const auto &late = rule.visits[i], &early = rule.visits[j];
      const bool shared =
          late[1] == early[1] || late[1] == early[2] || late[2] == early[1] || late[2] == early[2];
      if (!shared) continue;
      const auto upper = [](const std::array<int, 3>& edge) {
        return std::min(edge[1], edge[2]) / 7;
      };
      const auto key = [&](const std::array<int, 3>& edge) {
        return std::array<int, 3>{upper(edge), edge[0], std::min(edge[1], edge[2]) % 7};
      };
      if (upper(late) < 3 && upper(early) < 3) CHECK(key(early) < key(late));
    }
  }
}
