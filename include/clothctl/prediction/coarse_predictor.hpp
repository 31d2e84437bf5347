#pragma once

// Predicts a fine sheet by means of a predictor of a coarse sheet, at a cost that hardly depends on
// the number of vertices of the fine one.
//
//   x_c = R x,  v_c = R v     measured, at the places of the coarse vertices (SheetSampling)
//   y_k = y + P (x_c,k - x_c)   outputs move with the coarse sheet around them
//
// Each held vertex goes to the coarse vertex that has the largest weight in it. Where poses are
// planned, a coarse vertex has the mean velocity of the held vertices that went to it; where forces
// are planned, it has the sum of their forces. Wind is the same; outer forces are Pᵀ f.
//
// What is lost are folds that the coarse mesh cannot have, and the place of held vertices within a
// coarse cell. Common vertices are measured as they are (injection): averages over neighbours would
// be shorter than the folded sheet.

#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/prediction/sheet_sampling.hpp"
#include "clothctl/prediction/window.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Predicts a sheet by `Inner`, a predictor of a coarser mesh of it. A RolloutPredictor of a
/// MassSpringRollout with CoarseFactors::fitted() is the predictor for large sheets.
template <WindowPredictor Inner>
class CoarsePredictor {
 public:
  /// The planner's scalar.
  using Scalar = PredictorScalar<Inner>;

  /// Takes the sampling of the two meshes and a predictor for the coarse one. Allocates.
  CoarsePredictor(SheetSampling<Scalar> sampling, Inner inner)
      : sampling_(std::move(sampling)), inner_(std::move(inner)) {}

  /// Makes room for requests of this size. What the inner predictor remembers is kept as far as its
  /// `reserve` keeps it. Allocates. Fails when: a held vertex or output is off the mesh (assert).
  void reserve(const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response);

  /// Predicts the window from positions `x` (3×n, m) and velocities `v` (3×n, m/s) of the fine
  /// sheet. Returns false when they have another size or the inner predictor does. Never allocates
  /// after `reserve`.
  bool predict(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
               const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response);

  /// Returns the number of vertices of the fine sheet.
  Index vertex_count() const { return sampling_.fine_from_coarse.count(); }
  /// Returns whether the inner predictor predicts such inputs: true if it does not say.
  bool predicts(GripInput kind) const { return predicts_input(inner_, kind); }
  /// Forgets earlier predictions. Call it after the plant jumped.
  void reset() { predictor_traits<Inner>::reset(inner_); }
  /// Returns the predictor of the coarse sheet.
  Inner& inner() { return inner_; }

 private:
  using Terms = std::vector<typename PointFeatures<Scalar>::Term>;

  /// Finds the coarse vertices of the held vertices, and their numbers.
  void take_held(const std::vector<int>& held);

  /// Adds the rows of held vertices to those of their coarse vertices; the mean of those of one
  /// coarse vertex if `mean` is set, else their sum.
  template <class From, class To>
  void gather(bool mean, const From& from, To& to) const;

  /// Fills the coarse request.
  void load_request(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                    const WindowRequest<Scalar>& request);
  /// Shares supports among coarse vertices.
  void load_supports(const WindowRequest<Scalar>& request);

  /// Writes the plan of the free response: forces that the coarse sheet needs beyond the request's
  /// are shared by the held vertices of a coarse vertex.
  void write_plan(const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response) const;

  /// Writes the columns of held vertex j of the impulse response.
  void write_impulse_response(Index j, const WindowRequest<Scalar>& request,
                              WindowResponse<Scalar>& response) const;
  /// Writes the response of the features frame by frame, where the coarse prediction has it.
  void write_jacobian(const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response) const;
  /// Writes the free response, moved by what separates the fine outputs from the coarse ones now.
  void write_free_response(const PointsView<Scalar>& x, const WindowRequest<Scalar>& request,
                           WindowResponse<Scalar>& response) const;

  Index slot(Index j) const { return slot_[static_cast<std::size_t>(j)]; }
  Scalar share(Index j) const { return Scalar(1) / count_[static_cast<std::size_t>(slot(j))]; }
  Index held_count() const { return static_cast<Index>(slot_.size()); }
  Index feature(std::size_t f) const { return feature_[f]; }

  SheetSampling<Scalar> sampling_;
  Inner inner_;
  WindowRequest<Scalar> request_;
  WindowResponse<Scalar> response_;
  std::vector<Index> slot_;     // of each held vertex, its coarse vertex among the held ones
  std::vector<Scalar> count_;   // of each coarse held vertex, the number of its held vertices
  std::vector<Index> feature_;  // outputs of the request other than the held vertices
  Points<Scalar> x_, v_;
  std::vector<SupportSum<Scalar>> carried_;  // of each coarse vertex
};

template <WindowPredictor Inner>
void CoarsePredictor<Inner>::take_held(const std::vector<int>& held) {
  request_.held.clear();
  slot_.clear();
  count_.clear();
  for (const int vertex : held) {
    int nearest = 0;
    Scalar most = Scalar(0);
    sampling_.fine_from_coarse.for_each_term(vertex, [&](int c, const Scalar& weight) {
      if (most < weight) {
        most = weight;
        nearest = c;
      }
    });
    std::size_t place = 0;
    while (place < request_.held.size() && request_.held[place] != nearest) ++place;
    if (place == request_.held.size()) {
      request_.held.push_back(nearest);
      count_.push_back(Scalar(0));
    }
    slot_.push_back(static_cast<Index>(place));
    count_[place] += Scalar(1);
  }
}

template <WindowPredictor Inner>
void CoarsePredictor<Inner>::reserve(const WindowRequest<Scalar>& request,
                                     WindowResponse<Scalar>& response) {
  const Index coarse = sampling_.coarse_from_fine.count();
  for (Points<Scalar>* p : {&x_, &v_}) p->setZero(3, coarse);
  carried_.resize(static_cast<std::size_t>(coarse));
  request_ = request;
  request_.outputs = {};
  request_.outer_force.setZero(3, coarse);
  request_.supports.reserve(static_cast<std::size_t>(coarse));
  take_held(request.held);
  feature_.clear();
  for (Index i = 0; i < request.outputs.count(); ++i) {
    if (request.held_outputs <= i && i < request.held_outputs + held_count()) continue;
    feature_.push_back(i);
    Terms terms;
    request.outputs.for_each_term(i, [&](int vertex, const Scalar& weight) {
      sampling_.fine_from_coarse.for_each_term(vertex, [&](int c, const Scalar& part) {
        terms.push_back({c, weight * part});
      });
    });
    request_.outputs.add_sum(std::move(terms));
  }
  request_.held_outputs = static_cast<Index>(feature_.size());
  for (const int c : request_.held) request_.outputs.add_point(c);
  request_.plan.setZero(request_.inputs(), request.horizon);
  request_.path.setZero(request_.inputs(), request.horizon);
  request_.applied.setZero(request_.inputs());
  predictor_traits<Inner>::reserve(inner_, request_, response_);
  response.impulse_response.setZero(request.output_rows(), request.inputs() * request.horizon);
  response.free_response.setZero(request.output_rows(), request.horizon);
  response.plan.setZero(request.inputs(), request.horizon);
  response.air = response_.air;
  response.has_jacobian = false;
  response.jacobian.resize(0, 0);
  if (response_.jacobian.size() > 0)
    response.jacobian.setZero(response_.jacobian.rows(), request.inputs() * request.horizon);
}

template <WindowPredictor Inner>
bool CoarsePredictor<Inner>::predict(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                                     const WindowRequest<Scalar>& request,
                                     WindowResponse<Scalar>& response) {
  if (x.cols() != vertex_count() || v.cols() != vertex_count() ||
      !request.supports_fit(vertex_count()))
    return false;
  load_request(x, v, request);
  response_.plan = request_.plan;
  if (!predictor_traits<Inner>::predict(inner_, x_, v_, request_, response_)) return false;
  write_plan(request, response);
  for (Index j = 0; j < held_count(); ++j) write_impulse_response(j, request, response);
  write_jacobian(request, response);
  write_free_response(x, request, response);
  response.air = response_.air;
  return true;
}

template <WindowPredictor Inner>
template <class From, class To>
void CoarsePredictor<Inner>::gather(bool mean, const From& from, To& to) const {
  to.setZero();
  for (Index j = 0; j < held_count(); ++j) {
    const Scalar part = mean ? share(j) : Scalar(1);
    for (Index k = 0; k < from.cols(); ++k) {
      for (Index c = 0; c < 3; ++c) to(3 * slot(j) + c, k) += part * from(3 * j + c, k);
    }
  }
}

template <WindowPredictor Inner>
void CoarsePredictor<Inner>::load_request(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                                          const WindowRequest<Scalar>& request) {
  evaluate_features<Scalar>(sampling_.coarse_from_fine, x, x_);
  evaluate_features<Scalar>(sampling_.coarse_from_fine, v, v_);
  const bool poses = request.kind == GripInput::Pose;
  gather(poses, request.plan, request_.plan);
  gather(true, request.path, request_.path);
  gather(poses, request.applied, request_.applied);
  request_.has_path = request.has_path;
  request_.has_applied = request.has_applied;
  request_.wind = request.wind;
  request_.drift = request.drift;
  request_.outer_force.setZero();
  for (Index i = 0; i < request.outer_force.cols(); ++i) {
    sampling_.fine_from_coarse.for_each_term(i, [&](int c, const Scalar& weight) {
      for (Index d = 0; d < 3; ++d)
        request_.outer_force(d, c) += weight * request.outer_force(d, i);
    });
  }
  load_supports(request);
}

template <WindowPredictor Inner>
void CoarsePredictor<Inner>::load_supports(const WindowRequest<Scalar>& request) {
  request_.supports.clear();
  if (request.supports.empty()) return;
  carried_.assign(carried_.size(), SupportSum<Scalar>());
  for (const VertexSupport<Scalar>& support : request.supports) {
    sampling_.fine_from_coarse.for_each_term(support.vertex, [&](int c, const Scalar& weight) {
      carried_[static_cast<std::size_t>(c)].add(support, weight);
    });
  }
  for (std::size_t c = 0; c < carried_.size(); ++c) {
    if (!carried_[c].empty()) request_.supports.push_back(carried_[c].of(static_cast<int>(c)));
  }
}

template <WindowPredictor Inner>
void CoarsePredictor<Inner>::write_plan(const WindowRequest<Scalar>& request,
                                        WindowResponse<Scalar>& response) const {
  response.plan = request.plan;
  if (request.kind == GripInput::Pose) return;
  for (Index j = 0; j < held_count(); ++j) {
    for (Index k = 0; k < request.horizon; ++k) {
      for (Index c = 0; c < 3; ++c)
        response.plan(3 * j + c, k) +=
            share(j) * (response_.plan(3 * slot(j) + c, k) - request_.plan(3 * slot(j) + c, k));
    }
  }
}

template <WindowPredictor Inner>
void CoarsePredictor<Inner>::write_impulse_response(Index j, const WindowRequest<Scalar>& request,
                                                    WindowResponse<Scalar>& response) const {
  const bool poses = request.kind == GripInput::Pose;
  const Scalar gain = poses ? share(j) : Scalar(1);
  for (Index m = 0; m < request.horizon; ++m) {
    const auto from =
        response_.impulse_response.template middleCols<3>(m * request_.inputs() + 3 * slot(j));
    auto to = response.impulse_response.template middleCols<3>(m * request.inputs() + 3 * j);
    for (std::size_t f = 0; f < feature_.size(); ++f) {
      to.template middleRows<3>(3 * feature(f)) =
          gain * from.template middleRows<3>(3 * static_cast<Index>(f));
    }
    for (Index i = 0; i < held_count(); ++i) {
      auto block = to.template middleRows<3>(3 * (request.held_outputs + i));
      if (!poses) {
        block = from.template middleRows<3>(3 * (request_.held_outputs + slot(i)));
        continue;
      }
      block.setZero();  // a prescribed motion is exactly that of its own vertex
      for (Index c = 0; i == j && c < 3; ++c) block(c, c) = request.dt;
    }
  }
}

template <WindowPredictor Inner>
void CoarsePredictor<Inner>::write_jacobian(const WindowRequest<Scalar>& request,
                                            WindowResponse<Scalar>& response) const {
  response.has_jacobian = response_.has_jacobian;
  if (!response.has_jacobian) return;
  const bool poses = request.kind == GripInput::Pose;
  for (Index k = 0; k < request.horizon; ++k) {
    for (Index j = 0; j < held_count(); ++j)
      response.jacobian.template middleCols<3>(k * request.inputs() + 3 * j) =
          (poses ? share(j) : Scalar(1)) *
          response_.jacobian.template middleCols<3>(k * request_.inputs() + 3 * slot(j));
  }
}

template <WindowPredictor Inner>
void CoarsePredictor<Inner>::write_free_response(const PointsView<Scalar>& x,
                                                 const WindowRequest<Scalar>& request,
                                                 WindowResponse<Scalar>& response) const {
  for (std::size_t f = 0; f < feature_.size(); ++f) {
    const Index coarse = static_cast<Index>(f);
    Vector3<Scalar> offset = Vector3<Scalar>::Zero();
    request.outputs.for_each_term(
        feature(f), [&](int vertex, const Scalar& weight) { offset += weight * x.col(vertex); });
    request_.outputs.for_each_term(
        coarse, [&](int c, const Scalar& weight) { offset -= weight * x_.col(c); });
    for (Index k = 0; k < request.horizon; ++k) {
      response.free_response.template block<3, 1>(3 * feature(f), k) =
          response_.free_response.template block<3, 1>(3 * coarse, k) + offset;
    }
  }
  for (Index j = 0; j < held_count(); ++j) {
    const std::size_t held = static_cast<std::size_t>(j);
    Vector3<Scalar> place = x.col(request.held[held]);
    const Vector3<Scalar> offset = place - x_.col(request_.held[static_cast<std::size_t>(slot(j))]);
    for (Index k = 0; k < request.horizon; ++k) {
      if (request.kind == GripInput::Pose) {
        place += request.dt * request.plan.template block<3, 1>(3 * j, k);
      } else {
        place = offset + response_.free_response.template block<3, 1>(
                             3 * (request_.held_outputs + slot(j)), k);
      }
      response.free_response.template block<3, 1>(3 * (request.held_outputs + j), k) = place;
    }
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI
