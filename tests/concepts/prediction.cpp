// Foreign feature maps join by a trait alone; step responses are recognised by what they offer; everything else gets a "no".

#include "clothctl/concepts/prediction.hpp"

#include <string>
#include <utility>
#include <vector>

#include "clothctl/mpc/features.hpp"
#include "support/catch.hpp"

namespace other_engine {

// Another engine's tracked points: each hangs on one triangle by barycentric weights.
struct Marker {
  int corner[3];
  float weight[3];
};
struct MarkerSet {
  std::vector<Marker> markers;
};

}  // namespace other_engine

template <>
struct clothctl::feature_traits<other_engine::MarkerSet> {
  static Index count(const other_engine::MarkerSet& set) { return static_cast<Index>(set.markers.size()); }
  template <class Function>
  static void for_each_term(const other_engine::MarkerSet& set, Index feature, Function&& function) {
    const other_engine::Marker& m = set.markers[static_cast<std::size_t>(feature)];
    for (int i = 0; i < 3; ++i) function(m.corner[i], static_cast<double>(m.weight[i]));
  }
};

using namespace clothctl;

namespace {

// Masses without springs: the simplest linear step, A = (1 + h α) M.
template <class S>
struct FreeMasses {
  using Scalar = S;
  VectorX<S> masses;
  Points<S> gravity_force;
  std::vector<unsigned char> flags;
  bool linearise(const Points<S>&, const Points<S>&, const Vector3<S>&, S, const std::vector<int>&) { return true; }
  Index vertex_count() const { return masses.size(); }
  const VectorX<S>& mass() const { return masses; }
  S drag() const { return S(0); }
  const Points<S>& force() const { return gravity_force; }
  const std::vector<unsigned char>& held() const { return flags; }
  template <int kLanes>
  void multiply(const Lanes<S, kLanes>&, Lanes<S, kLanes>&, Lanes<S, kLanes>&) const {}
  template <int kLanes>
  void solve(Lanes<S, kLanes>&) const {}
  void add_wind_force(const Vector3<S>&, Points<S>&) const {}
};

// As above, but `linearise` cannot say that it failed.
struct Silent : FreeMasses<double> {
  void linearise(const Points<double>&, const Points<double>&, const Vector3<double>&, double, const std::vector<int>&) {}
};

struct CountOnly {
  Index count() const { return 1; }
};
// Calls back with the weight first: the arguments do not fit.
struct Swapped {
  Index count() const { return 1; }
  void for_each_term(Index, void (*)(const std::string&)) const {}
};

}  // namespace

static_assert(StepResponse<FreeMasses<float>> && StepResponse<FreeMasses<double>>);
static_assert(!StepResponse<int> && !StepResponse<CountOnly> && !StepResponse<Silent>);
static_assert(FeatureMap<PointFeatures<float>, float> && FeatureMap<PointFeatures<double>, double>);
static_assert(FeatureMap<other_engine::MarkerSet>);
static_assert(!FeatureMap<int> && !FeatureMap<CountOnly> && !FeatureMap<Swapped> && !FeatureMap<std::string>);

TEST_CASE("a foreign set of markers is evaluated as features", "[concepts]") {
  const other_engine::MarkerSet set{{{{0, 1, 2}, {0.5f, 0.25f, 0.25f}}, {{2, 1, 0}, {1.0f, 0.0f, 0.0f}}}};
  Points<double> x(3, 3);
  x << 0.0, 4.0, 0.0, 0.0, 0.0, 8.0, 1.0, 1.0, 1.0;
  Points<double> features(3, 2);
  evaluate_features<double>(set, x, features);
  CHECK(features.col(0).isApprox(Vector3<double>(1.0, 2.0, 1.0)));
  CHECK(features.col(1).isApprox(Vector3<double>(0.0, 8.0, 1.0)));
  CHECK(check_features<double>(set, 3).empty());
  CHECK_FALSE(check_features<double>(set, 2).empty());
}
