#pragma once

// What the planner asks of a model of the sheet. StepResponse: the linearised step as an operator (implicit models).
// Predictor: how chosen linear outputs answer to chosen inputs over K frames (exact, rolled out, identified …).
// FeatureMap: the user's features as a sparse linear map of vertices.

#include <concepts>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl {

/// Right-hand sides that predictors put side by side, by scalar.
template <class Scalar>
inline constexpr int kResponseLanes = sizeof(Scalar) <= 4 ? 16 : 8;

/// A linearised step A v⁺ = M v + h (f - K q + u) with A = (1 + h α) M + R.
///
/// Axioms: `solve` inverts A on the free vertices; A, K and R are symmetric; A is positive definite; held entries of
/// right-hand sides are zero and stay zero. A response whose K and dampers annihilate translations may say so by an
/// optional `bool translation_free() const`: it makes single precision more accurate.
template <class Response>
concept StepResponse = RealScalar<typename Response::Scalar> &&
    requires(Response& response, const Response& constant, const Points<typename Response::Scalar>& points,
             Vector3<typename Response::Scalar> wind, typename Response::Scalar dt, const std::vector<int>& driven,
             Lanes<typename Response::Scalar, kResponseLanes<typename Response::Scalar>>& lanes,
             Points<typename Response::Scalar>& out) {
  { response.linearise(points, points, wind, dt, driven) } -> std::convertible_to<bool>;
  { constant.vertex_count() } -> std::convertible_to<Index>;
  { constant.mass() } -> std::convertible_to<const VectorX<typename Response::Scalar>&>;
  { constant.drag() } -> std::convertible_to<typename Response::Scalar>;
  { constant.force() } -> std::convertible_to<const Points<typename Response::Scalar>&>;
  { constant.held() } -> std::convertible_to<const std::vector<unsigned char>&>;
  constant.multiply(lanes, lanes, lanes);
  response.solve(lanes);
  constant.add_wind_force(wind, out);
};

/// Predicts how chosen linear outputs of a sheet answer to chosen inputs over a window: `Request` says what is asked,
/// `Response` is the answer (mpc/window.hpp: WindowRequest and WindowResponse).
///
/// Axioms: after `reserve` for a request, predictions of that size never allocate; `predict` answers false when it cannot
/// predict, and then the response holds nothing; what it answers depends on state, request and the predictions since the
/// last `reserve` or `reset` alone; an input changes no output of an earlier frame.
template <class P, class Request, class Response>
concept Predictor = RealScalar<typename P::Scalar> &&
    requires(P& predictor, const PointsView<typename P::Scalar>& points, const Request& request, Response& response) {
  predictor.reserve(request, response);
  { predictor.predict(points, points, request, response) } -> std::convertible_to<bool>;
  predictor.reset();
};

/// How a type acts as a map from vertices to features. The primary forwards to members of the same names.
template <class Map>
struct feature_traits {
  /// Number of features; each is a point in space.
  static Index count(const Map& map) requires requires { map.count(); }
  { return map.count(); }
  /// Calls `function(vertex, weight)` for each term of feature `feature` = Σ weight · x_vertex.
  template <class Function>
  requires requires(const Map& m, Index i, Function&& f) { m.for_each_term(i, f); }
  static void for_each_term(const Map& map, Index feature, Function&& function) { map.for_each_term(feature, function); }
};

namespace detail {
template <class Scalar>
struct TermProbe {
  void operator()(int, Scalar) const {}
};
}  // namespace detail

/// A sparse linear map from vertices to points. Axiom: the terms of a feature do not depend on the state.
template <class Map, class Scalar = double>
concept FeatureMap = RealScalar<Scalar> && requires(const Map& map, Index feature, detail::TermProbe<Scalar> probe) {
  { feature_traits<Map>::count(map) } -> std::convertible_to<Index>;
  feature_traits<Map>::for_each_term(map, feature, probe);
};

}  // namespace clothctl
