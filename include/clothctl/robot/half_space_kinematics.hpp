#pragma once

// Inverse kinematics that keeps points of the robot on their side of planes, n·x ≥ offset: what a broad phase makes of
// obstacles and of other links. Each step is a quadratic program,
//
//   min ½ |J dq - e|² + ½ dqᵀ D dq - rᵀ dq,   below ≤ dq ≤ above,   n·J_x dq ≥ offset - n·x,
//
// D, r as in inverse_kinematics.hpp. A step is kept if it lowers cost + ρ Σ (what is missing to the planes), ρ above the rows'
// multipliers; else μ grows. Where the planes cannot all be kept, what is missing is made small. Reference: Nocedal, Wright,
// Numerical Optimization (2006) ch. 18 for the merit function.

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "clothctl/concepts/qp_solver.hpp"
#include "clothctl/robot/ik_problem.hpp"

namespace clothctl::robot {

/// A point of the robot and the side of a plane where it is to stay.
template <RealScalar Scalar>
struct HalfSpace {
  /// The frame that the point is fixed on: a link number of a tree.
  int frame = 0;
  /// The point, in the frame (m).
  Vector3<Scalar> point = Vector3<Scalar>::Constant(Scalar(0));
  /// The plane's unit normal (world), to the side where the point may be.
  Vector3<Scalar> normal = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1));
  /// n·x ≥ offset (m): add the radius of what the point stands for.
  Scalar offset = Scalar(0);
};

/// Inverse kinematics of one robot for up to so many tasks and planes, with a QP solver of the caller's choice (`ActiveSet`).
template <class Model, class Qp, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedModel<Model, Scalar> && QpSolver<Qp, Scalar>
class HalfSpaceKinematics {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// Several tasks.
  using Tasks = std::span<const IkTask<Scalar>>;
  /// Several planes.
  using HalfSpaces = std::span<const HalfSpace<Scalar>>;

  /// Makes room for so many tasks and planes. Allocates.
  HalfSpaceKinematics(const Model& model, int most_tasks, int most_planes, IkSettings<Scalar> settings = {}, Qp qp = Qp())
      : settings_(settings), problem_(model, most_tasks), qp_(std::move(qp)), most_planes_(most_planes) {
    n_ = Traits::velocities(model);
    QpTraits::reserve(qp_, n_ + most_planes, most_planes);
    size(most_planes);
    twist_.setZero(6, n_);
    step_.setZero(n_);
    trial_.setZero(Traits::positions(model));
    reference_ = trial_;
  }

  /// Moves q to a minimum of the tasks' residuals within limits and planes, from q (moved into its limits first). Reached:
  /// every task is, and every plane is kept to the tolerance. LocalMinimum: the gradient is zero, but for what
  /// limits and planes hold. Stalled: no step helps. `reference` as in
  /// `InverseKinematics`. Allocates only what the QP solver does when the number of planes changes.
  IkReport<Scalar> solve(const Model& model, Tasks tasks, HalfSpaces planes, const View& reference,
                         Eigen::Ref<VectorX<Scalar>> q) {
    IkReport<Scalar> report;
    report.message = check(model, tasks, planes, reference, q);
    if (!report.message.empty()) {
      report.status = IkStatus::InvalidInput;
      return report;
    }
    size(static_cast<Index>(planes.size()));
    problem_.limit(q);
    if (reference.size() > 0) {
      reference_ = reference;
    } else {
      reference_ = q;
    }
    problem_.start(tasks, reference_, settings_.posture_weight);
    Scalar mu = settings_.damping;
    report.cost = problem_.place(model, tasks, q);
    if (!is_finite(report.cost)) {
      report.status = IkStatus::InvalidInput;
      report.message = "q has no finite pose: a quaternion of zero, or numbers that overflow";
      return report;
    }
    price_ = Scalar(1) + Scalar(10) * problem_.placed_residuals().cwiseAbs().sum();
    Scalar missing = measure(model, planes);
    for (;;) {
      report.error = problem_.largest_residual();
      violation_ = missing;
      const bool reached = report.error <= settings_.tolerance && missing <= settings_.tolerance;
      report.status = reached ? IkStatus::Reached : IkStatus::Stalled;
      if ((reached && !(problem_.weight() > Scalar(0))) || n_ == 0) return report;
      problem_.linearise(model, tasks, q);
      linearise_planes(model, planes);
      for (bool better = false; !better;) {
        if (report.iterations == settings_.max_iterations) {
          if (!reached) report.status = IkStatus::IterationLimit;
          return report;
        }
        ++report.iterations;
        if (!find_step(mu)) {
          mu *= Scalar(4);
          if (!(mu < Scalar(1e12))) return report;
          continue;
        }
        report.gradient = stillness();
        if (report.gradient <= settings_.gradient_tolerance) {
          if (!reached) report.status = IkStatus::LocalMinimum;
          return report;
        }
        if (QpTraits::solution(answer_).tail(planes_).sum() > settings_.tolerance && price_ < Scalar(1e6)) {
          price_ *= Scalar(10);  // planes were given up: is that for want of room or of price?
          continue;
        }
        Traits::advance(model, q, step_, trial_);
        problem_.limit(trial_);
        const Scalar cost = problem_.place(model, tasks, trial_);
        const Scalar next = measure(model, planes);
        better = cost + price_ * next < report.cost + price_ * missing;
        if (better) {
          q = trial_;
          report.cost = cost;
          missing = next;
          mu = (std::max)(scalar_traits<Scalar>::epsilon(), Scalar(mu / Scalar(5)));
        } else {
          mu *= Scalar(4);
          if (!(mu < Scalar(1e12))) return report;
        }
      }
    }
  }

  /// The sum of what the points were short of their planes after the last solve (m).
  const Scalar& violation() const { return violation_; }

 private:
  using Traits = articulated_traits<Model>;
  using QpTraits = qp_solver_traits<Qp>;

  std::string_view check(const Model& model, Tasks tasks, HalfSpaces planes, const View& reference, const View& q) const {
    using std::abs;
    if (const std::string_view fault = settings_.check(); !fault.empty()) return fault;
    if (static_cast<Index>(planes.size()) > most_planes_) return "there are more planes than memory was made for";
    for (const HalfSpace<Scalar>& plane : planes) {
      if (!IkProblem<Model, Scalar>::has_frame(model, plane.frame)) return "a plane's frame does not exist";
      if (!all_finite(plane.point) || !all_finite(plane.normal) || !is_finite(plane.offset)) {
        return "a plane's point, normal or offset holds NaN or an infinity";
      }
      if (!(abs(plane.normal.squaredNorm() - Scalar(1)) < Scalar(1e-3))) return "a plane's normal is not a unit vector";
    }
    return problem_.check(model, tasks, reference, q);
  }

  Vector3<Scalar> place_of(const Model& model, const HalfSpace<Scalar>& plane) const {
    Matrix3<Scalar> R;
    Vector3<Scalar> p;
    Traits::frame_pose(model, problem_.workspace(), plane.frame, R, p);
    return p + R * plane.point;
  }

  /// Makes the program fit a number of planes, each with a slack, which keeps every program solvable.
  void size(Index planes) {
    planes_ = planes;
    const Index columns = n_ + planes;
    if (A_.rows() == planes && A_.cols() == columns) return;
    H_.setZero(columns, columns);
    A_.setZero(planes, columns);
    for (VectorX<Scalar>* v : {&g_, &lower_, &upper_}) v->setZero(columns);
    for (VectorX<Scalar>* v : {&row_lower_, &row_upper_}) v->setZero(planes);
    row_upper_.setConstant(scalar_traits<Scalar>::infinity());
  }

  /// What is missing to each plane where the robot was put last; answers the sum.
  Scalar measure(const Model& model, HalfSpaces planes) {
    Scalar sum(0);
    for (const HalfSpace<Scalar>& plane : planes) {
      sum += (std::max)(Scalar(0), Scalar(plane.offset - plane.normal.dot(place_of(model, plane))));
    }
    return sum;
  }

  void linearise_planes(const Model& model, HalfSpaces planes) {
    Index row = 0;
    for (const HalfSpace<Scalar>& plane : planes) {
      const Vector3<Scalar> x = place_of(model, plane);
      Traits::point_jacobian(model, problem_.workspace(), plane.frame, x, twist_);
      A_.row(row).setConstant(Scalar(0));
      A_.row(row).head(n_).noalias() = plane.normal.transpose() * twist_.template topRows<3>();
      A_(row, n_ + row) = Scalar(1);
      row_lower_[row] = plane.offset - plane.normal.dot(x);
      ++row;
    }
  }

  /// Solves the program for μ. Answers whether it could.
  bool find_step(const Scalar& mu) {
    const VectorX<Scalar>& squares = problem_.squares();
    const Scalar steepest = (std::max)(squares.maxCoeff(), scalar_traits<Scalar>::epsilon());
    H_.setConstant(Scalar(0));
    H_.topLeftCorner(n_, n_) = problem_.jacobian().transpose().lazyProduct(problem_.jacobian());
    for (Index i = 0; i < n_; ++i) H_(i, i) += problem_.weight() + mu * (squares[i] + Scalar(1e-3) * steepest);
    for (Index k = 0; k < planes_; ++k) H_(n_ + k, n_ + k) = Scalar(1e-3) * steepest;
    g_.head(n_) = -problem_.direction();
    g_.tail(planes_).setConstant(price_);
    lower_.head(n_) = problem_.below();
    upper_.head(n_) = problem_.above();
    upper_.tail(planes_).setConstant(scalar_traits<Scalar>::infinity());
    if (QpTraits::set_hessian(qp_, H_) != QpStatus::Solved || QpTraits::set_rows(qp_, A_) != QpStatus::Solved) return false;
    const QpStatus status = QpTraits::solve(qp_, g_, lower_, upper_, row_lower_, row_upper_, answer_);
    if (status != QpStatus::Solved && status != QpStatus::SolvedInaccurate) return false;
    step_ = QpTraits::solution(answer_).head(n_);
    for (Index i = 0; i < n_; ++i) step_[i] = (std::min)((std::max)(step_[i], problem_.below()[i]), problem_.above()[i]);
    return all_finite(step_);
  }

  /// The largest entry of (JᵀJ + D) dq, the part of the gradient that limits and planes do not hold, over what its terms can
  /// be.
  Scalar stillness() const {
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
        worst = (std::max)(worst, Scalar(1));  // planes alone move it
      }
    }
    return worst;
  }

  IkSettings<Scalar> settings_;
  IkProblem<Model, Scalar> problem_;
  Qp qp_;
  typename QpTraits::result_type answer_;
  MatrixX<Scalar> H_, A_, twist_;
  VectorX<Scalar> g_, lower_, upper_, row_lower_, row_upper_, step_, trial_, reference_;
  Scalar price_ = Scalar(1), violation_ = Scalar(0);
  Index n_ = 0, planes_ = -1, most_planes_;
};

}  // namespace clothctl::robot
