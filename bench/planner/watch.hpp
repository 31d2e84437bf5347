#pragma once

// Watches the parts of a frame of planning from outside: a response, a predictor and a QP solver
// that pass on every call and take its time. A planner makes its solver itself, so what is watched
// is global; one frame at a time, in one thread.

#include <memory>
#include <utility>

#include "../versus/support/timing.hpp"
#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/prediction/window.hpp"
#include "clothctl/qp/box_active_set.hpp"

namespace planner_bench {

using namespace clothctl;

/// Thread CPU time of the parts of a frame, s.
struct Phases {
  /// Assembly and factor of the linearised step.
  double linearise = 0;
  /// The solves of the impulse response, or of the whole map.
  double response = 0;
  /// The rollout of the nonlinear model, and the sampling of a coarse one.
  double rollout = 0;
  /// Targets, rows of the cost, normal matrix, and what follows from a solution.
  double stack = 0;
  /// The QP.
  double qp = 0;
  /// All of it.
  double total = 0;
};

/// Adds the time of its life to a sum.
class Stopwatch {
 public:
  explicit Stopwatch(double& sum) : sum_(sum), start_(versus::thread_seconds()) {}
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;
  ~Stopwatch() { sum_ += versus::thread_seconds() - start_; }

 private:
  double& sum_;
  double start_;
};

/// What was seen of a frame.
struct Seen {
  /// Times of linearisation and QP; `predict` and `inner` are those of nested predictors.
  double linearise = 0, qp = 0, predict = 0, inner = 0;
  /// The solution of the last QP and the multipliers of its bounds.
  VectorX<double> d, z;
};

inline Seen& seen() {
  static Seen value;
  return value;
}

/// A response whose linearisation is timed.
template <class Scalar>
class WatchedResponse : public MassSpringResponse<Scalar> {
 public:
  using MassSpringResponse<Scalar>::MassSpringResponse;

  bool linearise(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                 const Vector3<Scalar>& wind, Scalar dt, const std::vector<int>& driven) {
    const Stopwatch watch(seen().linearise);
    return MassSpringResponse<Scalar>::linearise(x, v, wind, dt, driven);
  }
};

/// The QP solver of the planner, timed; its solution is kept.
class WatchedBox : public BoxActiveSet<double> {
 public:
  using BoxActiveSet<double>::BoxActiveSet;

  QpStatus set_hessian(const Eigen::Ref<const MatrixX<double>>& H) {
    const Stopwatch watch(seen().qp);
    return BoxActiveSet<double>::set_hessian(H);
  }

  QpStatus solve(const VectorView& g, const VectorView& lb, const VectorView& ub,
                 QpResult<double>& result) {
    QpStatus status;
    {
      const Stopwatch watch(seen().qp);
      status = BoxActiveSet<double>::solve(g, lb, ub, result);
    }
    seen().d = result.x;
    seen().z = result.bound_multipliers;
    return status;
  }
};

/// Any predictor, timed. One type, so that one planner serves all.
class AnyPredictor {
 public:
  using Scalar = double;

  /// Times go to `sum`.
  template <class P>
  AnyPredictor(P predictor, double& sum)
      : held_(std::make_shared<Held<P>>(std::move(predictor))), sum_(&sum) {}

  void reserve(const WindowRequest<double>& request, WindowResponse<double>& response) {
    held_->reserve(request, response);
  }
  bool predict(const PointsView<double>& x, const PointsView<double>& v,
               const WindowRequest<double>& request, WindowResponse<double>& response) {
    const Stopwatch watch(*sum_);
    return held_->predict(x, v, request, response);
  }
  void reset() { held_->reset(); }

 private:
  struct Base {
    virtual ~Base() = default;
    virtual void reserve(const WindowRequest<double>& q, WindowResponse<double>& r) = 0;
    virtual bool predict(const PointsView<double>& x, const PointsView<double>& v,
                         const WindowRequest<double>& q, WindowResponse<double>& r) = 0;
    virtual void reset() = 0;
  };
  template <class P>
  struct Held final : Base {
    explicit Held(P p) : predictor(std::move(p)) {}
    void reserve(const WindowRequest<double>& q, WindowResponse<double>& r) override {
      predictor.reserve(q, r);
    }
    bool predict(const PointsView<double>& x, const PointsView<double>& v,
                 const WindowRequest<double>& q, WindowResponse<double>& r) override {
      return predictor.predict(x, v, q, r);
    }
    void reset() override { predictor.reset(); }
    P predictor;
  };

  std::shared_ptr<Base> held_;
  double* sum_;
};

}  // namespace planner_bench
