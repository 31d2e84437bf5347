// Sampling of two meshes of one sheet: exact for positions that vary linearly, injection where
// vertices are shared.

#include "clothctl/prediction/sheet_sampling.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class S>
Points<S> sampled(const PointFeatures<S>& map, const Points<S>& from) {
  Points<S> out(3, map.count());
  evaluate_features<S>(map, from, out);
  return out;
}

template <class S>
int terms(const PointFeatures<S>& map, Index i) {
  int count = 0;
  map.for_each_term(i, [&](int, const S&) { ++count; });
  return count;
}

}  // namespace

TEMPLATE_TEST_CASE("grids sample each other exactly in the flat sheet", "[mpc]", float, double) {
  using S = TestType;
  const S tolerance = S(16) * scalar_traits<S>::epsilon();
  for (const int count : {2, 5, 9, 12}) {
    CAPTURE(count);
    const GridMesh<S> fine = make_grid<S>(17, 13, S(0.4), S(0.5)).value();
    const GridMesh<S> coarse = make_grid<S>(count, count, S(0.4), S(0.5)).value();
    const SheetSampling<S> sampling = sample_grids(fine, coarse);
    REQUIRE(sampling.coarse_from_fine.count() == count * count);
    REQUIRE(sampling.fine_from_coarse.count() == 17 * 13);
    const Points<S> down = sampled<S>(sampling.coarse_from_fine, fine.positions);
    const Points<S> up = sampled<S>(sampling.fine_from_coarse, coarse.positions);
    CHECK((down - coarse.positions).cwiseAbs().maxCoeff() < tolerance);
    CHECK((up - fine.positions).cwiseAbs().maxCoeff() < tolerance);
    for (const int corner : {0, count - 1, count * count - 1})
      CHECK(terms<S>(sampling.coarse_from_fine, corner) == 1);
  }
}

TEST_CASE("vertices that both grids have are taken as they are", "[mpc]") {
  const GridMesh<double> fine = make_grid<double>(65, 65, 0.5, 0.5).value();
  const GridMesh<double> coarse = make_grid<double>(17, 17, 0.5, 0.5).value();
  const SheetSampling<double> sampling = sample_grids(fine, coarse);
  for (int row = 0; row < 17; ++row) {
    for (int col = 0; col < 17; ++col) {
      int vertex = -1;
      sampling.coarse_from_fine.for_each_term(coarse.vertex(row, col), [&](int v, double weight) {
        vertex = v;
        CHECK(weight == 1.0);
      });
      CHECK(vertex == fine.vertex(4 * row, 4 * col));
      CHECK(terms<double>(sampling.coarse_from_fine, coarse.vertex(row, col)) == 1);
    }
  }
}

TEMPLATE_TEST_CASE("triangle meshes sample each other exactly in the flat sheet", "[mpc]", float,
                   double) {
  using S = TestType;
  const GridMesh<S> fine = make_grid<S>(9, 12, S(0.4), S(0.5)).value();
  const GridMesh<S> coarse = make_grid<S>(4, 5, S(0.4), S(0.5)).value();
  const SheetSampling<S> sampling =
      sample_meshes<S>(fine.positions, fine.triangles, coarse.positions, coarse.triangles).value();
  const S tolerance = S(64) * scalar_traits<S>::epsilon();
  CHECK((sampled<S>(sampling.coarse_from_fine, fine.positions) - coarse.positions)
            .cwiseAbs()
            .maxCoeff() < tolerance);
  CHECK((sampled<S>(sampling.fine_from_coarse, coarse.positions) - fine.positions)
            .cwiseAbs()
            .maxCoeff() < tolerance);
  for (Index i = 0; i < sampling.fine_from_coarse.count(); ++i) {
    S sum = S(0);
    sampling.fine_from_coarse.for_each_term(i, [&](int, const S& weight) {
      CHECK(S(0) < weight);
      sum += weight;
    });
    CHECK(std::abs(sum - S(1)) < tolerance);
  }
}

TEST_CASE("a vertex beside the other mesh goes to its border", "[mpc]") {
  const GridMesh<double> mesh = make_grid<double>(3, 3, 0.2, 0.2).value();
  Points<double> outside = mesh.positions;
  outside.col(0) += Vector3<double>(-0.05, 0.01, -0.05);
  const SheetSampling<double> sampling =
      sample_meshes<double>(outside, mesh.triangles, mesh.positions, mesh.triangles).value();
  sampling.fine_from_coarse.for_each_term(0, [&](int vertex, double weight) {
    CHECK(vertex == 0);
    CHECK(weight == 1.0);
  });
  CHECK(terms<double>(sampling.fine_from_coarse, 0) == 1);
}

TEST_CASE("meshes that cannot be sampled are refused", "[mpc]") {
  const GridMesh<double> mesh = make_grid<double>(3, 3, 0.2, 0.2).value();
  const auto error = [&](const Points<double>& fine, const auto& fine_triangles,
                         const Points<double>& coarse, const auto& coarse_triangles) {
    const auto made = sample_meshes<double>(fine, fine_triangles, coarse, coarse_triangles);
    return made.has_value() ? std::string() : made.error();
  };
  const std::vector<std::array<int, 3>> none, off{{0, 1, 9}};
  Points<double> broken = mesh.positions;
  broken(1, 4) = std::numeric_limits<double>::infinity();
  CHECK(error(mesh.positions, none, mesh.positions, mesh.triangles) ==
        "the fine mesh has no triangles");
  CHECK(error(mesh.positions, mesh.triangles, mesh.positions, off) ==
        "the coarse mesh has vertex 9 in triangle 0, off 9 vertices");
  CHECK(error(mesh.positions, mesh.triangles, broken, mesh.triangles) ==
        "the coarse mesh has a vertex that is not finite");
}
