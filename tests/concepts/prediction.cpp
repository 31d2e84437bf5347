// Foreign feature maps, step responses and predictors satisfy their concepts by a trait alone. For
// other types the concepts are false instead of a compile error.

#include "clothctl/concepts/prediction.hpp"

#include <string>
#include <utility>
#include <vector>

#include "clothctl/prediction/features.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"
#include "clothctl/prediction/window.hpp"
#include "support/catch.hpp"

namespace other_engine {

// Another engine's tracked points, each given by barycentric weights in a triangle.
struct Marker {
  int corner[3];
  float weight[3];
};
struct MarkerSet {
  std::vector<Marker> markers;
};

// Another engine's dust, with its own names: independent grains without springs that fall in still
// air.
struct Dust {
  std::vector<double> kilograms;
  double friction = 0.5;  // 1/s
  double step = 0;
  Eigen::Matrix3Xd gravity = {};
  std::vector<unsigned char> stuck = {};
};

// A predictor that predicts no motion, whatever the hands do.
struct Statue {
  int asked = 0;
};

}  // namespace other_engine

template <>
struct clothctl::step_response_traits<other_engine::Dust> {
  using Dust = other_engine::Dust;
  using Block = ResponseLanes<double>;
  using scalar_type = double;
  static bool linearise(Dust& dust, const Points<double>&, const Points<double>&,
                        const Vector3<double>&, double dt, const std::vector<int>& driven) {
    dust.step = dt;
    dust.stuck.assign(dust.kilograms.size(), 0);
    for (int v : driven) dust.stuck[static_cast<std::size_t>(v)] = 1;
    dust.gravity.setZero(3, vertex_count(dust));
    dust.gravity.row(2) = -9.81 * mass(dust).transpose();
    return true;
  }
  static Index vertex_count(const Dust& dust) { return static_cast<Index>(dust.kilograms.size()); }
  static Eigen::Map<const VectorX<double>> mass(const Dust& dust) {
    return {dust.kilograms.data(), vertex_count(dust)};
  }
  static double drag(const Dust& dust) { return dust.friction; }
  static const Points<double>& force(const Dust& dust) { return dust.gravity; }
  static const std::vector<unsigned char>& held(const Dust& dust) { return dust.stuck; }
  static void multiply(const Dust&, const Block&, Block& stiff, Block& coupled) {
    stiff.setZero();
    coupled.setZero();
  }
  static void solve(Dust& dust, Block& rhs) {
    for (Index c = 0; c < rhs.cols(); ++c)
      rhs.col(c) /= (1 + dust.step * dust.friction) * mass(dust)[c / 3];
  }
  static void add_wind_force(const Dust&, const Vector3<double>&, Points<double>&) {}
};

template <>
struct clothctl::predictor_traits<other_engine::Statue> {
  using Statue = other_engine::Statue;
  using scalar_type = double;
  static void reserve(Statue&, const WindowRequest<double>& request,
                      WindowResponse<double>& response) {
    response.impulse_response.setZero(request.output_rows(), request.inputs() * request.horizon);
    response.free_response.setZero(request.output_rows(), request.horizon);
  }
  static bool predict(Statue& statue, const PointsView<double>& x, const PointsView<double>&,
                      const WindowRequest<double>& request, WindowResponse<double>& response) {
    ++statue.asked;
    for (Index i = 0; i < request.outputs.count(); ++i) {
      Vector3<double> stands = Vector3<double>::Zero();
      request.outputs.for_each_term(i, [&](int v, double weight) { stands += weight * x.col(v); });
      for (Index k = 0; k < request.horizon; ++k)
        response.free_response.block<3, 1>(3 * i, k) = stands;
    }
    return true;
  }
  static void reset(Statue& statue) { statue.asked = 0; }
};

template <>
struct clothctl::feature_traits<other_engine::MarkerSet> {
  static Index count(const other_engine::MarkerSet& set) {
    return static_cast<Index>(set.markers.size());
  }
  template <class Function>
  static void for_each_term(const other_engine::MarkerSet& set, Index feature,
                            Function&& function) {
    const other_engine::Marker& m = set.markers[static_cast<std::size_t>(feature)];
    for (int i = 0; i < 3; ++i) function(m.corner[i], static_cast<double>(m.weight[i]));
  }
};

using namespace clothctl;

namespace {

// Masses without springs, with the simplest linear step: A = (1 + h α) M.
template <class S>
struct FreeMasses {
  using Scalar = S;
  VectorX<S> masses;
  Points<S> gravity_force;
  std::vector<unsigned char> flags;
  bool linearise(const Points<S>&, const Points<S>&, const Vector3<S>&, S,
                 const std::vector<int>&) {
    return true;
  }
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

// The same, but `linearise` cannot report failure.
struct Silent : FreeMasses<double> {
  void linearise(const Points<double>&, const Points<double>&, const Vector3<double>&, double,
                 const std::vector<int>&) {}
};

struct CountOnly {
  Index count() const { return 1; }
};
// A map that passes the weight first, so that the arguments do not fit.
struct Swapped {
  Index count() const { return 1; }
  void for_each_term(Index, void (*)(const std::string&)) const {}
};

}  // namespace

static_assert(StepResponse<other_engine::Dust> && !StepResponse<other_engine::Statue>);
static_assert(Predictor<other_engine::Statue, WindowRequest<double>, WindowResponse<double>> &&
              !Predictor<other_engine::Statue, WindowRequest<float>, WindowResponse<float>> &&
              !Predictor<other_engine::Dust, WindowRequest<double>, WindowResponse<double>> &&
              !Predictor<int, WindowRequest<double>, WindowResponse<double>>);
static_assert(StepResponse<FreeMasses<float>> && StepResponse<FreeMasses<double>>);
static_assert(!StepResponse<int> && !StepResponse<CountOnly> && !StepResponse<Silent>);
static_assert(FeatureMap<PointFeatures<float>, float> && FeatureMap<PointFeatures<double>, double>);
static_assert(FeatureMap<other_engine::MarkerSet>);
static_assert(!FeatureMap<int> && !FeatureMap<CountOnly> && !FeatureMap<Swapped> &&
              !FeatureMap<std::string>);

TEST_CASE("a foreign set of markers is evaluated as features", "[concepts]") {
  const other_engine::MarkerSet set{
      {{{0, 1, 2}, {0.5f, 0.25f, 0.25f}}, {{2, 1, 0}, {1.0f, 0.0f, 0.0f}}}};
  Points<double> x(3, 3);
  x << 0.0, 4.0, 0.0, 0.0, 0.0, 8.0, 1.0, 1.0, 1.0;
  Points<double> features(3, 2);
  evaluate_features<double>(set, x, features);
  CHECK(features.col(0).isApprox(Vector3<double>(1.0, 2.0, 1.0)));
  CHECK(features.col(1).isApprox(Vector3<double>(0.0, 8.0, 1.0)));
  CHECK(validate_features<double>(set, 3).empty());
  CHECK_FALSE(validate_features<double>(set, 2).empty());
}

namespace {

WindowRequest<double> two_grains() {
  WindowRequest<double> request;
  request.horizon = 4;
  request.dt = 0.05;
  request.held = {1};
  request.outputs.add_point(0);
  request.outputs.add_point(1);
  request.held_outputs = 1;
  request.plan.setZero(3, 4);
  request.plan.row(0).setConstant(0.6);
  request.applied.setZero(3);
  request.wind.setZero(3, 4);
  return request;
}

}  // namespace

TEST_CASE("a foreign step response drives the linearised predictor", "[concepts]") {
  const WindowRequest<double> request = two_grains();
  LinearisedPredictor<other_engine::Dust> predictor(other_engine::Dust{{0.1, 0.3}});
  WindowResponse<double> window;
  predictor.reserve(request, window);
  Points<double> x(3, 2), v(3, 2);
  x << 0.1, 0.4, 0.0, 0.2, -0.3, -0.5;
  v << 1.0, 0.3, -0.2, 0.0, 0.4, 0.1;
  REQUIRE(predictor.predict(x, v, request, window));
  const double h = request.dt;
  Points<double> at = x, speed = v;
  for (Index k = 0; k < 4; ++k) {
    // (1 + h α) v⁺ = v + h (g + u/m)
    speed.row(2).array() -= 9.81 * h;
    speed(0, 1) += h * 0.6 / 0.3;
    speed /= 1 + h * 0.5;
    at += h * speed;
    CHECK((window.free_response.col(k).head<3>() - at.col(0)).norm() <= 1e-13);
    CHECK((window.free_response.col(k).tail<3>() - at.col(1)).norm() <= 1e-13);
  }
  // A unit force during one frame moves its own grain by h² / ((1 + h α) m) in that frame.
  CHECK(window.impulse_response(3, 0) == Approx(h * h / (1.025 * 0.3)));
  CHECK(window.impulse_response(0, 0) == 0.0);
}

TEST_CASE("a foreign predictor is used through its trait", "[concepts]") {
  using Traits = predictor_traits<other_engine::Statue>;
  const WindowRequest<double> request = two_grains();
  other_engine::Statue statue;
  WindowResponse<double> window;
  Traits::reserve(statue, request, window);
  Points<double> x(3, 2);
  x << 0.1, 0.4, 0.0, 0.2, -0.3, -0.5;
  REQUIRE(Traits::predict(statue, x, x, request, window));
  CHECK(statue.asked == 1);
  CHECK(window.free_response.col(3).head<3>() == x.col(0));
  Traits::reset(statue);
  CHECK(statue.asked == 0);
}
