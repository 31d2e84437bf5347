#pragma once

// The least type that satisfies Predictor for a given request and response. It can be moved, since
// a planner owns its predictor.

#include "clothctl/concepts/prediction.hpp"
#include "clothctl/prediction/window.hpp"

namespace clothctl_test {

/// A type with only what Predictor names. Each output stays at its first vertex's measured
/// position, and one input moves all outputs equally, by a thousandth.
template <class S>
class PredictorArchetype {
 public:
  using Scalar = S;
  explicit PredictorArchetype(int) {}
  PredictorArchetype(PredictorArchetype&&) = default;
  PredictorArchetype& operator=(PredictorArchetype&&) = default;

  /// A truth value that only converts to bool.
  struct Answer {
    operator bool() const { return true; }
  };

  void reserve(const clothctl::WindowRequest<S>& request, clothctl::WindowResponse<S>& response) {
    response.impulse_response.setZero(request.output_rows(), request.inputs() * request.horizon);
    response.free_response.setZero(request.output_rows(), request.horizon);
  }
  Answer predict(const clothctl::PointsView<S>& x, const clothctl::PointsView<S>&,
                 const clothctl::WindowRequest<S>& request, clothctl::WindowResponse<S>& response) {
    response.impulse_response.setZero();
    response.free_response.setZero();
    for (clothctl::Index i = 0; i < request.outputs.count(); ++i) {
      for (clothctl::Index k = 0; k < request.horizon; ++k) {
        request.outputs.for_each_term(i, [&](int vertex, const S& weight) {
          response.free_response.template block<3, 1>(3 * i, k) += weight * x.col(vertex);
        });
        for (clothctl::Index j = 0; 3 * j < request.inputs(); ++j) {
          response.impulse_response.template block<3, 3>(3 * i, k * request.inputs() + 3 * j)
              .diagonal()
              .setConstant(S(0.001));
        }
      }
    }
    clothctl::add_plan(request.plan, response);
    return {};
  }
  void reset() {}
};

}  // namespace clothctl_test
