#pragma once

// Inverse kinematics under inequality constraints: points x of the robot stay on one side of
// planes, n·x ≥ offset. A collision detector gives such planes for obstacles and for other links.
// Each step is a quadratic program (QP),
//
//   min ½ |J dq - e|² + ½ dqᵀ D dq - rᵀ dq,   below ≤ dq ≤ above,   n·J_x dq ≥ offset - n·x
//
// with e, J and D as in inverse_kinematics.hpp, r = w (q_ref - q), the distances `below` and
// `above` to the joint limits, and the Jacobian J_x of x. A step is accepted when it lowers the
// merit function
//
//   cost + ρ Σ max(0, offset - n·x)
//
// with ρ above the multipliers of the planes; otherwise μ grows. Where the planes contradict each
// other, the sum of their violations is made small.
//
// Reference: Nocedal, Wright, Numerical Optimization (2006) ch. 18.

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "clothctl/concepts/qp_solver.hpp"
#include "clothctl/robot/detail/ik_problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A point of the robot and the half-space in which it shall stay.
template <RealScalar Scalar>
struct HalfSpace {
  /// Index of the frame that carries the point. For a KinematicTree it is a link number.
  int frame = 0;
  /// The point, in the frame (m).
  Vector3<Scalar> point = Vector3<Scalar>::Constant(Scalar(0));
  /// Unit normal of the plane (world). It points to the allowed side.
  Vector3<Scalar> normal = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1));
  /// The constraint is n·x ≥ offset (m). Add the radius of the body that the point stands for.
  Scalar offset = Scalar(0);
};

namespace detail {

/// Returns what is wrong with a plane for a robot; empty if it is good.
template <class Model, RealScalar Scalar>
std::string_view find_bad_plane(const Model& model, const HalfSpace<Scalar>& plane) {
  using std::abs;
  if (!has_frame(model, plane.frame)) return "a plane's frame does not exist";
  if (!all_finite(plane.point) || !all_finite(plane.normal) || !is_finite(plane.offset))
    return "a plane's point, normal or offset holds NaN or an infinity";
  if (!(abs(plane.normal.squaredNorm() - Scalar(1)) < Scalar(1e-3)))
    return "a plane's normal is not a unit vector";
  return {};
}

}  // namespace detail

/// Inverse kinematics of one robot under planes, with a QP solver of the caller's choice, for
/// instance `ActiveSet`.
template <class Model, class Qp,
          RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedModel<Model, Scalar> && QpSolver<Qp, Scalar>
class ConstrainedIk {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// Several tasks.
  using Tasks = std::span<const IkTask<Scalar>>;
  /// Several planes.
  using HalfSpaces = std::span<const HalfSpace<Scalar>>;

  /// Makes room for `most_tasks` tasks and `most_planes` planes; a negative number counts as 0.
  /// Allocates.
  ConstrainedIk(const Model& model, int most_tasks, int most_planes,
                IkSettings<Scalar> settings = {}, Qp qp = Qp())
      : settings_(settings),
        problem_(model, most_tasks),
        qp_(std::move(qp)),
        most_planes_((std::max)(most_planes, 0)) {
    n_ = Traits::nv(model);
    QpTraits::reserve(qp_, n_ + most_planes_, most_planes_);
    resize(most_planes_);
    twist_.setZero(6, n_);
    step_.setZero(n_);
    trial_.setZero(Traits::nq(model));
  }

  /// Moves q (nq) from its value, clamped to the limits, to a minimum of the tasks' residuals
  /// within limits and planes. `reference` is as in `InverseKinematics`. The status means
  ///
  /// * Reached: every task and every plane is met to the tolerance.
  /// * LocalMinimum: limits and planes balance the whole gradient.
  /// * Stalled: no step lowers the merit function.
  ///
  /// Allocates when the number of planes changes. Fails when: see IkStatus.
  IkReport<Scalar> solve(const Model& model, Tasks tasks, HalfSpaces planes, const View& reference,
                         Eigen::Ref<VectorX<Scalar>> q) {
    IkReport<Scalar> report;
    report.message = validate(model, tasks, planes, reference, q);
    if (!report.message.empty()) {
      report.status = IkStatus::InvalidInput;
      return report;
    }
    resize(static_cast<Index>(planes.size()));
    problem_.clamp(q);
    problem_.start(tasks, reference.size() > 0 ? reference : View(q), settings_.posture_weight);
    if (!evaluate_start(model, tasks, planes, q, report)) return report;
    Scalar mu = settings_.damping;
    for (;;) {
      report.error = problem_.largest_residual();
      const bool reached = report.error <= settings_.tolerance && violation_ <= settings_.tolerance;
      report.status = reached ? IkStatus::Reached : IkStatus::Stalled;
      if ((reached && !(problem_.weight() > Scalar(0))) || n_ == 0) return report;
      problem_.linearise(model, tasks, q);
      linearise_planes(model, planes);
      if (!descend(model, tasks, planes, q, mu, report)) return report;
    }
  }

  /// Returns the sum of the planes' violations after the last solve (m).
  const Scalar& violation() const { return violation_; }

 private:
  using Traits = articulated_traits<Model>;
  using QpTraits = qp_solver_traits<Qp>;

  std::string_view validate(const Model& model, Tasks tasks, HalfSpaces planes,
                            const View& reference, const View& q) const {
    using std::abs;
    if (const std::string_view fault = settings_.validate(); !fault.empty()) return fault;
    if (static_cast<Index>(planes.size()) > most_planes_)
      return "there are more planes than memory was made for";
    for (const HalfSpace<Scalar>& plane : planes) {
      if (const std::string_view fault = detail::find_bad_plane(model, plane); !fault.empty())
        return fault;
    }
    return problem_.validate(model, tasks, reference, q);
  }

  /// Evaluates tasks and planes at the first q, and sets the initial price ρ. Returns false when
  /// cost or violation is not finite.
  bool evaluate_start(const Model& model, Tasks tasks, HalfSpaces planes, const View& q,
                      IkReport<Scalar>& report) {
    report.cost = problem_.evaluate(model, tasks, q);
    const Scalar violation = total_violation(model, planes);
    if (!is_finite(report.cost) || !is_finite(violation)) {
      report.status = IkStatus::InvalidInput;
      report.message = problem_.kNoPose;
      return false;
    }
    violation_ = violation;
    price_ = Scalar(1) + Scalar(10) * problem_.current_residuals().cwiseAbs().sum();
    return true;
  }

  /// Moves q by one step that lowers the merit function. Increases μ, or the price ρ, until it
  /// finds such a step. Returns false when the solve ends here; the report says how.
  bool descend(const Model& model, Tasks tasks, HalfSpaces planes, Eigen::Ref<VectorX<Scalar>> q,
               Scalar& mu, IkReport<Scalar>& report) {
    const bool reached = report.status == IkStatus::Reached;
    for (;;) {
      if (report.iterations == settings_.max_iterations) {
        if (!reached) report.status = IkStatus::IterationLimit;
        return false;
      }
      ++report.iterations;
      if (!find_step(mu)) {
        if (!increase_damping(mu)) return false;
        continue;
      }
      report.gradient = projected_gradient();
      if (report.gradient <= settings_.gradient_tolerance) {
        if (!reached) report.status = IkStatus::LocalMinimum;
        return false;
      }
      if (QpTraits::solution(answer_).tail(planes_).sum() > settings_.tolerance &&
          price_ < Scalar(1e6)) {
        // The QP violates planes. A higher price shows whether it can satisfy them.
        price_ *= Scalar(10);
        continue;
      }
      if (accept_step(model, tasks, planes, q, report)) {
        mu = (std::max)(scalar_traits<Scalar>::epsilon(), Scalar(mu / Scalar(5)));
        return true;
      }
      if (!increase_damping(mu)) return false;
    }
  }

  /// Moves q by the step when that lowers the merit function. Returns true when it did.
  bool accept_step(const Model& model, Tasks tasks, HalfSpaces planes,
                   Eigen::Ref<VectorX<Scalar>> q, IkReport<Scalar>& report) {
    Traits::advance(model, q, step_, trial_);
    problem_.clamp(trial_);
    const Scalar cost = problem_.evaluate(model, tasks, trial_);
    const Scalar violation = total_violation(model, planes);
    if (!(cost + price_ * violation < report.cost + price_ * violation_)) return false;
    q = trial_;
    report.cost = cost;
    violation_ = violation;
    return true;
  }

  /// Increases μ. Returns false when it is too large to go on.
  static bool increase_damping(Scalar& mu) {
    mu *= Scalar(4);
    return mu < Scalar(1e12);
  }

  Vector3<Scalar> point_of(const Model& model, const HalfSpace<Scalar>& plane) const {
    Matrix3<Scalar> R;
    Vector3<Scalar> p;
    Traits::frame_pose(model, problem_.workspace(), plane.frame, R, p);
    return p + R * plane.point;
  }

  /// Resizes the QP for a number of planes. Each plane has a slack, so that every QP has a
  /// solution.
  void resize(Index planes) {
    planes_ = planes;
    const Index columns = n_ + planes;
    if (A_.rows() == planes && A_.cols() == columns) return;
    H_.setZero(columns, columns);
    A_.setZero(planes, columns);
    for (VectorX<Scalar>* v : {&g_, &lower_, &upper_}) v->setZero(columns);
    for (VectorX<Scalar>* v : {&row_lower_, &row_upper_}) v->setZero(planes);
    row_upper_.setConstant(scalar_traits<Scalar>::infinity());
  }

  /// Returns the sum of the planes' violations after the last `evaluate`.
  Scalar total_violation(const Model& model, HalfSpaces planes) {
    Scalar sum(0);
    for (const HalfSpace<Scalar>& plane : planes) {
      const Scalar violation = plane.offset - plane.normal.dot(point_of(model, plane));
      if (!(violation <= Scalar(0))) sum += violation;  // NaN stays
    }
    return sum;
  }

  /// Fills what does not depend on μ: JᵀJ, whose diagonal `find_step` sets, and the planes' rows.
  void linearise_planes(const Model& model, HalfSpaces planes) {
    H_.setConstant(Scalar(0));
    H_.topLeftCorner(n_, n_) = problem_.jacobian().transpose().lazyProduct(problem_.jacobian());
    lower_.head(n_) = problem_.below();
    upper_.head(n_) = problem_.above();
    upper_.tail(planes_).setConstant(scalar_traits<Scalar>::infinity());
    Index row = 0;
    for (const HalfSpace<Scalar>& plane : planes) {
      const Vector3<Scalar> x = point_of(model, plane);
      Traits::point_jacobian(model, problem_.workspace(), plane.frame, x, twist_);
      A_.row(row).setConstant(Scalar(0));
      A_.row(row).head(n_).noalias() = plane.normal.transpose() * twist_.template topRows<3>();
      A_(row, n_ + row) = Scalar(1);
      row_lower_[row] = plane.offset - plane.normal.dot(x);
      ++row;
    }
  }

  /// Solves the QP for μ. Returns true on success.
  bool find_step(const Scalar& mu) {
    const VectorX<Scalar>& squares = problem_.squares();
    const Scalar steepest = (std::max)(squares.maxCoeff(), scalar_traits<Scalar>::epsilon());
    for (Index i = 0; i < n_; ++i)
      H_(i, i) = squares[i] + problem_.weight() + mu * (squares[i] + Scalar(1e-3) * steepest);
    for (Index k = 0; k < planes_; ++k) H_(n_ + k, n_ + k) = Scalar(1e-3) * steepest;
    g_.head(n_) = -problem_.direction();
    g_.tail(planes_).setConstant(price_);
    // The Hessian first: it tells the solver the number of columns that rows must have.
    if (QpTraits::set_hessian(qp_, H_) != QpStatus::Solved) return false;
    if (QpTraits::set_rows(qp_, A_) != QpStatus::Solved) return false;
    const QpStatus status =
        QpTraits::solve(qp_, g_, lower_, upper_, row_lower_, row_upper_, answer_);
    if (status != QpStatus::Solved && status != QpStatus::SolvedInaccurate) return false;
    step_ = QpTraits::solution(answer_).head(n_);
    for (Index i = 0; i < n_; ++i)
      step_[i] = (std::min)((std::max)(step_[i], problem_.below()[i]), problem_.above()[i]);
    return all_finite(step_);
  }

  /// Returns the largest |entry i| of (JᵀJ + D) dq, relative to |J_i| |e| + |r_i| with J_i column i
  /// of J. These entries are the part of the gradient that limits and planes do not balance.
  Scalar projected_gradient() const {
    using std::abs;
    using std::sqrt;
    const Scalar length = sqrt(problem_.residuals().squaredNorm());
    Scalar worst(0);
    for (Index i = 0; i < n_; ++i) {
      const Scalar terms = sqrt(problem_.squares()[i]) * length + abs(problem_.pull()[i]);
      const Scalar force = abs(H_.col(i).head(n_).dot(step_));
      if (terms > Scalar(0)) {
        worst = (std::max)(worst, Scalar(force / terms));
      } else if (abs(step_[i]) > Scalar(64) * scalar_traits<Scalar>::epsilon()) {
        worst = (std::max)(worst, Scalar(1));  // no task moves this joint, a plane does
      }
    }
    return worst;
  }

  IkSettings<Scalar> settings_;
  detail::IkProblem<Model, Scalar> problem_;
  Qp qp_;
  typename QpTraits::result_type answer_;
  MatrixX<Scalar> H_, A_, twist_;
  VectorX<Scalar> g_, lower_, upper_, row_lower_, row_upper_, step_, trial_;
  Scalar price_ = Scalar(1), violation_ = Scalar(0);
  Index n_ = 0, planes_ = -1, most_planes_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
