#pragma once

// What the planner asks of a model of the sheet:
//
//   StepResponse   the linearised time step as an operator; implicit models have one
//   Predictor      how linear outputs respond to inputs over a window of K frames
//   FeatureMap     the user's features: sparse weighted sums of vertices
//
// Each is checked through a trait, so that a type of another library takes part unchanged.

#include <concepts>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Number of right-hand sides that predictors solve for side by side, by scalar type.
template <class Scalar>
inline constexpr int kResponseLanes = sizeof(Scalar) <= 4 ? 16 : 8;

/// A block of `kResponseLanes` vectors of 3n degrees of freedom: column 3i + c holds coordinate c
/// of vertex i, and each row (lane) is one of the vectors, so that one SIMD instruction serves all
/// of them.
template <class Scalar>
using ResponseLanes = Lanes<Scalar, kResponseLanes<Scalar>>;

namespace detail {

/// The scalar type of a type that has a member `Scalar`; empty for every other type.
template <class T>
struct scalar_of {};
template <class T>
requires requires { typename T::Scalar; }
struct scalar_of<T> {
  using scalar_type = typename T::Scalar;
};

}  // namespace detail

/// How a type acts as a linearised step. The primary template forwards to members of the same
/// names; `scalar_type` is its member `Scalar`.
template <class Response>
struct step_response_traits : detail::scalar_of<Response> {
  /// Linearises at positions `x` and velocities `v` (3×n) in air of velocity `wind` for a step of
  /// `dt` (s), with the vertices `driven` prescribed. Returns false when the step matrix A (see
  /// StepResponse) is not positive definite.
  template <class Positions, class Wind, class Time>
  requires requires(Response& r, const Positions& x, const Wind& w, const Time& dt,
                    const std::vector<int>& driven) {
    { r.linearise(x, x, w, dt, driven) } -> std::convertible_to<bool>;
  }
  static bool linearise(Response& response, const Positions& x, const Positions& v,
                        const Wind& wind, const Time& dt, const std::vector<int>& driven) {
    return response.linearise(x, v, wind, dt, driven);
  }
  /// Returns the number of vertices n.
  static Index vertex_count(const Response& response) requires requires { response.vertex_count(); }
  { return response.vertex_count(); }
  /// Returns the vertex masses, n, kg.
  static decltype(auto) mass(const Response& response) requires requires { response.mass(); }
  { return response.mass(); }
  /// Returns the mass-proportional damping rate α, 1/s.
  static auto drag(const Response& response) requires requires { response.drag(); }
  { return response.drag(); }
  /// Returns gravity, m/s². Optional.
  static decltype(auto) gravity(const Response& response) requires requires { response.gravity(); }
  { return response.gravity(); }
  /// Returns the net force f at the linearisation, 3×n, N.
  static decltype(auto) force(const Response& response) requires requires { response.force(); }
  { return response.force(); }
  /// Returns 1 for each prescribed or fixed vertex and 0 for each free one, n.
  static decltype(auto) held(const Response& response) requires requires { response.held(); }
  { return response.held(); }
  /// Writes K w to `stiff` and R w to `coupled` for a block w of vectors (K, R: see StepResponse).
  template <class Block>
  requires requires(const Response& r, const Block& w, Block& out) { r.multiply(w, out, out); }
  static void multiply(const Response& response, const Block& w, Block& stiff, Block& coupled) {
    response.multiply(w, stiff, coupled);
  }
  /// Replaces a block of right-hand sides by A⁻¹ times them.
  template <class Block>
  requires requires(Response& r, Block& rhs) { r.solve(rhs); }
  static void solve(Response& response, Block& rhs) { response.solve(rhs); }
  /// Adds the force of air that moves at `wind` relative to a sheet at rest to `out` (3×n, N).
  template <class Wind, class Out>
  requires requires(const Response& r, const Wind& wind, Out& out) { r.add_wind_force(wind, out); }
  static void add_wind_force(const Response& response, const Wind& wind, Out& out) {
    response.add_wind_force(wind, out);
  }
  /// Returns true when a translation of the whole sheet changes no stiffness or damper force.
  /// Optional.
  static bool translation_free(const Response& response) requires requires {
    response.translation_free();
  }
  { return response.translation_free(); }
};

/// A linearised time step A v⁺ = M v + h (f - K q + u), A = (1 + h α) M + R: M masses, h step
/// length, f net force and K stiffness at the linearisation, q the displacement since then, u the
/// input forces, R the coupling of the velocities by stiffness and damping.
///
/// Axioms: `solve` inverts A on the free vertices; A, K and R are symmetric; A is positive
/// definite; right-hand sides and solutions of `solve` are zero at held vertices.
///
/// Optional hooks: `translation_free(response)`, false where it is missing; true makes single
/// precision more accurate. `gravity(response)`: with it, hands lead by known outer forces.
template <class Response>
concept StepResponse = requires {
  typename step_response_traits<Response>::scalar_type;
}
&&RealScalar<typename step_response_traits<Response>::scalar_type>&& requires(
    Response& response, const Response& constant,
    const Points<typename step_response_traits<Response>::scalar_type>& points,
    Vector3<typename step_response_traits<Response>::scalar_type> wind,
    typename step_response_traits<Response>::scalar_type dt, const std::vector<int>& driven,
    ResponseLanes<typename step_response_traits<Response>::scalar_type>& lanes,
    Points<typename step_response_traits<Response>::scalar_type>& out) {
  {
    step_response_traits<Response>::linearise(response, points, points, wind, dt, driven)
    } -> std::convertible_to<bool>;
  { step_response_traits<Response>::vertex_count(constant) } -> std::convertible_to<Index>;
  { step_response_traits<Response>::mass(constant)[0] } -> std::convertible_to<decltype(dt)>;
  { step_response_traits<Response>::drag(constant) } -> std::convertible_to<decltype(dt)>;
  {
    step_response_traits<Response>::force(constant)
    } -> std::convertible_to<const Points<decltype(dt)>&>;
  {
    step_response_traits<Response>::held(constant)
    } -> std::convertible_to<const std::vector<unsigned char>&>;
  step_response_traits<Response>::multiply(constant, lanes, lanes, lanes);
  step_response_traits<Response>::solve(response, lanes);
  step_response_traits<Response>::add_wind_force(constant, wind, out);
};

/// How a type acts as a predictor. The primary template forwards to members of the same names;
/// `scalar_type` is its member `Scalar`.
template <class P>
struct predictor_traits : detail::scalar_of<P> {
  /// Makes room for requests of the size of `request`, and sizes the response. Allocates.
  template <class Request, class Response>
  requires requires(P& p, const Request& q, Response& r) { p.reserve(q, r); }
  static void reserve(P& predictor, const Request& request, Response& response) {
    predictor.reserve(request, response);
  }
  /// Predicts from measured positions and velocities (3×n). Returns false when it cannot.
  template <class Positions, class Request, class Response>
  requires requires(P& p, const Positions& x, const Request& q, Response& r) {
    { p.predict(x, x, q, r) } -> std::convertible_to<bool>;
  }
  static bool predict(P& predictor, const Positions& x, const Positions& v, const Request& request,
                      Response& response) {
    return predictor.predict(x, v, request, response);
  }
  /// `predict` in two parts: the first writes `WindowResponse::air`, the second, which may be left
  /// out, all the rest. Optional.
  template <class Positions, class Request, class Response>
  requires requires(P& p, const Positions& x, const Request& q, Response& r) {
    { p.predict_air(x, x, q, r) } -> std::convertible_to<bool>;
    p.predict_rest(x, q, r);
  }
  static bool predict_air(P& predictor, const Positions& x, const Positions& v,
                          const Request& request, Response& response) {
    return predictor.predict_air(x, v, request, response);
  }
  /// The second part.
  template <class Positions, class Request, class Response>
  requires requires(P& p, const Positions& x, const Request& q, Response& r) {
    p.predict_rest(x, q, r);
  }
  static void predict_rest(P& predictor, const Positions& x, const Request& request,
                           Response& response) {
    predictor.predict_rest(x, request, response);
  }
  /// Forgets everything that the predictor kept from earlier predictions.
  static void reset(P& predictor) requires requires { predictor.reset(); }
  { predictor.reset(); }
  /// Returns the number of vertices that the predictor was made for. Optional.
  static Index vertex_count(const P& predictor) requires requires { predictor.vertex_count(); }
  { return predictor.vertex_count(); }
  /// Returns whether it can predict windows whose raw inputs are of this kind (GripInput).
  /// Optional.
  template <class Kind>
  requires requires(const P& p, const Kind& kind) { p.predicts(kind); }
  static bool predicts(const P& predictor, const Kind& kind) { return predictor.predicts(kind); }
};

/// Predicts how linear outputs of a sheet respond to inputs over a window: `Request` says which
/// outputs and inputs, `Response` holds the prediction (WindowRequest and WindowResponse of
/// prediction/window.hpp).
///
/// Axioms: after `reserve` for a request, predictions of that size never allocate; when `predict`
/// returns false, callers ignore the response; the prediction depends only on state, request and
/// the predictions since the last `reset`; an input changes no output of an earlier
/// frame; a response of another size than `reserve` made is refused by the planner.
///
/// Optional hooks: `vertex_count(predictor)`, checked against the sheet where it exists;
/// `predict_air(predictor, x, v, request, response)` and `predict_rest(predictor, x, request,
/// response)`, which make rollouts of poses faster;
/// `predicts(predictor, kind)`, without which a predictor is taken to predict every kind of input.
template <class P, class Request, class Response>
concept Predictor = requires {
  typename predictor_traits<P>::scalar_type;
}
&&RealScalar<typename predictor_traits<P>::scalar_type>&& requires(
    P& predictor, const PointsView<typename predictor_traits<P>::scalar_type>& points,
    const Request& request, Response& response) {
  predictor_traits<P>::reserve(predictor, request, response);
  {
    predictor_traits<P>::predict(predictor, points, points, request, response)
    } -> std::convertible_to<bool>;
  predictor_traits<P>::reset(predictor);
};

/// How a type acts as a map from vertices to features. The primary template forwards to members of
/// the same names.
template <class Map>
struct feature_traits {
  /// Returns the number of features; each is a point in space.
  static Index count(const Map& map) requires requires { map.count(); }
  { return map.count(); }
  /// Calls `function(vertex, weight)` for each term of feature `feature` = Σ weight · x_vertex.
  template <class Function>
  requires requires(const Map& m, Index i, Function&& f) { m.for_each_term(i, f); }
  static void for_each_term(const Map& map, Index feature, Function&& function) {
    map.for_each_term(feature, function);
  }
};

namespace detail {
template <class Scalar>
struct TermProbe {
  void operator()(int, Scalar) const {}
};
}  // namespace detail

/// A sparse linear map from vertices to points.
///
/// Axiom: the terms of a feature never change.
///
/// Optional hooks: none.
template <class Map, class Scalar = double>
concept FeatureMap = RealScalar<Scalar> &&
    requires(const Map& map, Index feature, detail::TermProbe<Scalar> probe) {
  { feature_traits<Map>::count(map) } -> std::convertible_to<Index>;
  feature_traits<Map>::for_each_term(map, feature, probe);
};

}  // namespace clothctl::inline CLOTHCTL_ABI
