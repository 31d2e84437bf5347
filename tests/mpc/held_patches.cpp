// Patches: the sets of vertices that fingers hold, and their non-affine motion.

#include "clothctl/mpc/detail/held_patches.hpp"

#include "support/catch.hpp"
#include "support/sheets.hpp"

using namespace clothctl;

TEST_CASE("fingers on the same vertices share a patch in any order of vertices", "[mpc]") {
  Grip<double> first;
  first.fingers.push_back({{7, 2, 5}, 1.0});
  first.fingers.push_back({{5, 7, 2}, -1.0});
  first.fingers.push_back({{2, 9}, 1.0});
  Grip<double> second = make_pinch<double>({4}, 0.5, 1.0);
  const detail::GripBasis<double> basis({first, second}, {}, GripInput::Force);
  const auto patches = detail::find_patches(basis);
  REQUIRE(patches.size() == 3);
  CHECK(basis.held().vertices() == std::vector<int>{2, 5, 7, 9, 4});
  CHECK(patches[0].held_slots == std::vector<Index>{0, 1, 2});
  CHECK(patches[1].held_slots == std::vector<Index>{0, 3});
  CHECK(patches[2].held_slots == std::vector<Index>{4});
}

TEST_CASE("non-affine modes are zero for affine motion and span all other motion", "[mpc]") {
  const clothctl_test::HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 5);
  const detail::GripBasis<double> basis({make_pinch<double>(sheet.corner_patch(0, 3), 0.5, 1.0)},
                                        sheet.network.triangles, GripInput::Force);
  auto patches = detail::find_patches(basis);
  Points<double> x(3, 9);
  for (Index j = 0; j < 9; ++j)
    x.col(j) =
        sheet.network.rest_positions.col(basis.held().vertices()[static_cast<std::size_t>(j)]);
  patches[0].affine.update(x);
  REQUIRE(patches[0].affine.rank() == 2);
  REQUIRE(patches[0].affine.non_affine_count() == 6);
  const Matrix3<double> map = Matrix3<double>::Random();
  const Points<double> affine = (map * x).colwise() + Vector3<double>(1.0, 2.0, 3.0);
  Points<double> bump = Points<double>::Zero(3, 9);
  bump(1, 4) = 1.0;
  double seen = 0.0;
  std::vector<detail::OutputTerm<double>> point;
  for (Index i = 0; i < 6; ++i) {
    detail::take_non_affine(patches[0], i, 2, point);
    REQUIRE(point.size() == 9);
    Vector3<double> still = Vector3<double>::Zero(), moved = Vector3<double>::Zero();
    for (const detail::OutputTerm<double>& t : point) {
      still += t.weight * affine.col(t.output - 2);
      moved += t.weight * bump.col(t.output - 2);
    }
    CHECK(still.norm() < 1e-12);
    seen += moved.squaredNorm();
  }
  CHECK(seen > 0.3);
}
