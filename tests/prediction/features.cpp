// Features as sums of vertices, refused features, and foreign feature maps.

#include "clothctl/prediction/features.hpp"

#include <limits>

#include "clothctl/mesh/mesh_editor.hpp"
#include "clothctl/mesh/stitch.hpp"
#include "laws/feature_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("points, centroids and sums obey the laws of feature maps", "[mpc]", float,
                   double) {
  PointFeatures<TestType> features;
  features.add_point(3);
  features.add_centroid({0, 1, 5, 7});
  features.add_sum({{2, TestType(0.5)}, {2, TestType(0.25)}, {4, TestType(-1)}});
  CHECK(features.count() == 3);
  clothctl_test::check_feature_laws<TestType>(features, 8);
}

TEST_CASE("features have the values that they were added with", "[mpc]") {
  PointFeatures<double> features;
  features.add_point(2);
  features.add_centroid({0, 1, 2});
  features.add_sum({{0, 2.0}, {1, -1.0}});
  Points<double> x(3, 3);
  x << 1.0, 2.0, 6.0, 0.0, 3.0, 0.0, -1.0, -1.0, 5.0;
  Points<double> y(3, 3);
  evaluate_features<double>(features, x, y);
  CHECK(y.col(0) == x.col(2));
  CHECK((y.col(1) - Vector3<double>(3.0, 1.0, 1.0)).norm() < 1e-15);
  CHECK((y.col(2) - Vector3<double>(0.0, -3.0, -1.0)).norm() < 1e-15);
}

TEST_CASE("features off the mesh, without terms or without weight are refused with a message",
          "[mpc]") {
  PointFeatures<double> none;
  CHECK(validate_features<double>(none, 5) == "there are no features");
  PointFeatures<double> off;
  off.add_point(4);
  CHECK(validate_features<double>(off, 5).empty());
  off.add_centroid({1, 5});
  CHECK(validate_features<double>(off, 5).find("feature 1 uses vertex 5") != std::string::npos);
  PointFeatures<double> negative;
  negative.add_point(-1);
  CHECK(validate_features<double>(negative, 5).find("feature 0 uses vertex -1") !=
        std::string::npos);
  PointFeatures<double> empty;
  empty.add_point(0);
  empty.add_centroid({});
  CHECK(validate_features<double>(empty, 5).find("feature 1 has no vertices") != std::string::npos);
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    PointFeatures<double> weightless;
    weightless.add_sum({{3, 1.0}, {2, bad}});
    CHECK(validate_features<double>(weightless, 5).find("non-finite weight at vertex 2") !=
          std::string::npos);
  }
}

TEST_CASE("features follow the first copies of their vertices", "[mpc]") {
  const Points<double> x = Points<double>::Random(3, 4);
  auto editor = MeshEditor<double>::create(x, {{0, 1, 2}, {1, 3, 2}}).value();
  editor.mark(1, 2);
  REQUIRE(editor.open_marked() == 2);
  const Remap<double> remap = editor.change().remap;
  PointFeatures<double> map;
  map.add_point(2);
  map.add_sum({{1, 0.25}, {3, 0.75}});
  const PointFeatures<double> next = remap_features(map, remap);
  CHECK(next.count() == 2);
  Points<double> before(3, 2), after(3, 2);
  evaluate_features<double>(map, x, before);
  evaluate_features<double>(next, remap.interpolate(x), after);
  CHECK(before == after);
  const Remap<double> other =
      stitch_vertices<double>(6, editor.triangles(), {{1, 4}, {2, 5}})->remap;
  CHECK(validate_features<double>(remap_features(next, other), 4) == "");
}
