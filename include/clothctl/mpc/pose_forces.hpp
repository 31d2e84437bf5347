#pragma once

// The contact forces with which fingers make held vertices follow planned poses, for sheets on
// which forces cannot be planned (prediction/simulator_predictor.hpp).
//
// A model of the sheet takes one frame from the measured state, with forces r on the held vertices.
// They end at positions p(r) with velocities w(r). J = ∂(p, w)/∂r around the forces r̄ of the last
// frame comes from differences, one step of the model for each coordinate. The coefficients d of
// the fingers' generators, r = B d + r0 as in the planner, are those of
//
//   min ½ |p(r̄) + J_p (r - r̄) - p*|² + ½ (γ h)² |w(r̄) + J_w (r - r̄) - w*|² + ½ ρ |d|²
//
// with bounds, and a limit on the normal force of each finger. Positions alone would be followed by
// forces that swing from frame to frame: a vertex that is late needs a velocity that is too large
// for the next frame.

#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/mpc/detail/grip_basis.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/qp/active_set.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of PoseForces.
struct PoseForcesSettings {
  /// Weight γ of velocities: that of positions is 1, that of velocities γ times the frame, squared.
  double velocity = 0.7;
  /// Change of a force for the differences, N: it should move a vertex by less than the folds of
  /// the sheet.
  double difference = 1e-4;
  /// Number of linearisations in a frame.
  int newton_steps = 1;
  /// ρ, as a share of the largest diagonal entry of the Hessian without it. It spreads the load
  /// over the fingers.
  double ridge = 1e-6;

  /// Returns an empty string, or a line that names the first bad setting and its value.
  std::string validate() const {
    const std::pair<const char*, double> positive[] = {{"difference", difference},
                                                       {"ridge", ridge}};
    for (const auto& [name, value] : positive) {
      if (!is_finite(value) || !(0 < value))
        return std::string(name) + " is " + number_text(value) + ", must be positive";
    }
    if (!is_finite(velocity) || velocity < 0)
      return "velocity is " + number_text(velocity) + ", must be finite and not negative";
    if (newton_steps < 1)
      return "newton_steps is " + std::to_string(newton_steps) + ", must be at least 1";
    return {};
  }
};

/// Finds finger forces that make held vertices follow planned poses. `Model` is a model of the
/// sheet, `Setup` the PlannerSetup of the planner.
template <class Model, class Setup = PlannerSetup<typename Model::Scalar>>
requires ClothModel<Model, typename Setup::scalar_type>
class PoseForces {
 public:
  /// The scalar type.
  using Scalar = typename Setup::scalar_type;
  /// The contact model of the fingers.
  using Contact = typename Setup::contact_type;

  /// Takes a model, and grips and triangles of a set-up. Returns an error that names what is wrong
  /// with set-up or settings. Allocates.
  static Result<PoseForces> create(Model model, const Setup& setup,
                                   PoseForcesSettings settings = {});

  /// Returns the held vertices, grip by grip.
  const std::vector<int>& held() const { return basis_.held().vertices(); }

  /// Finds the forces for a frame of `dt` (s) from positions `x` and velocities `v` (3×n, m, m/s).
  /// `poses`: where the held vertices shall be at its end (driven_vertices: those of `held`, in
  /// that order), and what else acts on the sheet. `velocities`: how they shall then move (3×held,
  /// m/s), such as in the next frame of the plan. Returns false, and keeps the forces of the last
  /// frame, when an argument does not fit or is not finite, a step of the model fails, or no forces
  /// are found. Allocates only when `poses` has another number of forces or attachments than
  /// before. Complexity: 1 + 3·held steps of the model for each linearisation.
  [[nodiscard]] bool solve(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                           const ClothInput<Scalar>& poses, const PointsView<Scalar>& velocities,
                           Scalar dt);

  /// What to apply in place of the poses: the forces of the held vertices, and what else acts.
  const ClothInput<Scalar>& input() const { return input_; }
  /// The force of each finger on each of its vertices. The contact law holds.
  const std::vector<FingerForce<Scalar>>& finger_forces() const { return finger_forces_; }
  /// Forgets the forces of the last frame. Call it after the plant jumped.
  void reset() {
    forces_.setZero();
    qp_.reset();
  }

 private:
  using Basis = detail::GripBasis<Scalar, Contact>;

  PoseForces(Model model, Basis basis, PoseForcesSettings settings);

  /// Returns whether the arguments of `solve` fit.
  bool fits(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
            const ClothInput<Scalar>& poses, const PointsView<Scalar>& velocities,
            const Scalar& dt) const;
  /// Writes p and w at the end of a frame with forces `r` on the held vertices (3·held, N).
  bool simulate(const VectorX<Scalar>& r, const Scalar& dt, Eigen::Ref<VectorX<Scalar>> out);
  /// Linearises around the forces `trial_`.
  bool linearise(const Scalar& dt);
  /// Replaces `trial_` by the forces of the quadratic program.
  bool improve(const ClothInput<Scalar>& poses, const PointsView<Scalar>& velocities,
               const Scalar& dt);

  Model model_;
  Basis basis_;
  PoseForcesSettings settings_;
  decltype(cloth_traits<Model>::make_workspace(std::declval<const Model&>())) workspace_;
  ClothState<Scalar> start_, state_;
  ClothInput<Scalar> input_, probe_;
  std::vector<FingerForce<Scalar>> finger_forces_;
  VectorX<Scalar> forces_, trial_, changed_;  // 3·held
  VectorX<Scalar> reached_;                   // 6·held: positions, then velocities
  MatrixX<Scalar> jacobian_, by_coefficients_, hessian_, rows_;
  VectorX<Scalar> gradient_, lower_, upper_, row_lower_, row_upper_;
  ActiveSet<Scalar> qp_;
  QpResult<Scalar> result_;
};

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type>
auto PoseForces<Model, Setup>::create(Model model, const Setup& setup, PoseForcesSettings settings)
    -> Result<PoseForces> {
  std::string problem = settings.validate();
  if (problem.empty()) problem = setup.validate(cloth_traits<Model>::vertex_count(model));
  if (!problem.empty()) return Error{problem};
  return PoseForces(std::move(model), Basis(setup.grips, setup.triangles, GripInput::Force),
                    settings);
}

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type> PoseForces<Model, Setup>::PoseForces(
    Model model, Basis basis, PoseForcesSettings settings)
    : model_(std::move(model)),
      basis_(std::move(basis)),
      settings_(settings),
      workspace_(cloth_traits<Model>::make_workspace(model_)),
      start_(cloth_traits<Model>::rest_state(model_)),
      state_(start_) {
  const Index inputs = basis_.inputs(), unknowns = basis_.unknowns();
  const Index fingers = static_cast<Index>(basis_.fingers().size());
  for (VectorX<Scalar>* each : {&forces_, &trial_, &changed_}) each->setZero(inputs);
  reached_.setZero(2 * inputs);
  for (VectorX<Scalar>* each : {&gradient_, &lower_, &upper_}) each->setZero(unknowns);
  jacobian_.setZero(2 * inputs, inputs);
  by_coefficients_.setZero(2 * inputs, unknowns);
  hessian_.setZero(unknowns, unknowns);
  rows_.setZero(fingers, unknowns);
  row_lower_.setConstant(fingers, -scalar_traits<Scalar>::infinity());
  row_upper_.setZero(fingers);
  for (Index f = 0; f < fingers; ++f) {
    const auto& columns = basis_.fingers()[static_cast<std::size_t>(f)];
    for (Index i = 0; i < columns.count; ++i)
      rows_(f, columns.column + i) = basis_.normal_share(columns, i);
    row_upper_[f] = basis_.most_pressed(columns);
  }
  basis_.bounds(start_.positions, Scalar(1), Scalar(1), lower_, upper_);
  for (ClothInput<Scalar>* input : {&input_, &probe_}) {
    input->force_vertices = held();
    input->forces.setZero(3, inputs / 3);
    input->driven_positions.setZero(3, 0);
  }
  finger_forces_.resize(static_cast<std::size_t>(basis_.force_count()));
  (void)qp_.reserve(unknowns, fingers);
}

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type>
bool PoseForces<Model, Setup>::fits(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                                    const ClothInput<Scalar>& poses,
                                    const PointsView<Scalar>& velocities, const Scalar& dt) const {
  const Index n = start_.positions.cols(), count = static_cast<Index>(held().size());
  return x.cols() == n && v.cols() == n && all_finite(x) && all_finite(v) &&
         poses.driven_vertices == held() && poses.driven_positions.cols() == count &&
         all_finite(poses.driven_positions) && velocities.cols() == count &&
         all_finite(velocities) && is_finite(dt) && Scalar(0) < dt &&
         static_cast<Index>(poses.force_vertices.size()) == poses.forces.cols();
}

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type>
bool PoseForces<Model, Setup>::solve(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                                     const ClothInput<Scalar>& poses,
                                     const PointsView<Scalar>& velocities, Scalar dt) {
  if (!fits(x, v, poses, velocities, dt)) return false;
  start_.positions = x;
  start_.velocities = v;
  basis_.update(x);
  const Index count = static_cast<Index>(held().size());
  probe_.wind = poses.wind;
  probe_.force_vertices.resize(held().size());
  probe_.force_vertices.insert(probe_.force_vertices.end(), poses.force_vertices.begin(),
                               poses.force_vertices.end());
  probe_.forces.resize(3, count + poses.forces.cols());
  probe_.forces.rightCols(poses.forces.cols()) = poses.forces;
  probe_.attached_vertices = poses.attached_vertices;
  probe_.attached_positions = poses.attached_positions;
  probe_.attachment_stiffness = poses.attachment_stiffness;
  trial_ = forces_;
  for (int step = 0; step < settings_.newton_steps; ++step) {
    if (!linearise(dt) || !improve(poses, velocities, dt)) return false;
  }
  forces_ = trial_;
  input_ = probe_;
  for (Index j = 0; j < count; ++j) input_.forces.col(j) = forces_.template segment<3>(3 * j);
  basis_.finger_forces(result_.x, finger_forces_);
  return true;
}

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type>
bool PoseForces<Model, Setup>::simulate(const VectorX<Scalar>& r, const Scalar& dt,
                                        Eigen::Ref<VectorX<Scalar>> out) {
  const Index count = static_cast<Index>(held().size());
  for (Index j = 0; j < count; ++j) probe_.forces.col(j) = r.template segment<3>(3 * j);
  state_ = start_;
  if (!cloth_traits<Model>::step(model_, state_, probe_, dt, workspace_).advanced) return false;
  for (Index j = 0; j < count; ++j) {
    const int vertex = held()[static_cast<std::size_t>(j)];
    out.template segment<3>(3 * j) = state_.positions.col(vertex);
    out.template segment<3>(3 * (count + j)) = state_.velocities.col(vertex);
  }
  return true;
}

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type>
bool PoseForces<Model, Setup>::linearise(const Scalar& dt) {
  if (!simulate(trial_, dt, reached_)) return false;
  const Scalar change = Scalar(settings_.difference);
  for (Index j = 0; j < trial_.size(); ++j) {
    changed_ = trial_;
    changed_[j] += change;
    if (!simulate(changed_, dt, jacobian_.col(j))) return false;
    jacobian_.col(j) = (jacobian_.col(j) - reached_) / change;
  }
  return all_finite(jacobian_);
}

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type>
bool PoseForces<Model, Setup>::improve(const ClothInput<Scalar>& poses,
                                       const PointsView<Scalar>& velocities, const Scalar& dt) {
  const Index inputs = basis_.inputs(), count = inputs / 3;
  const Scalar weight = Scalar(settings_.velocity) * dt;
  VectorX<Scalar>& residual = reached_;
  for (Index j = 0; j < count; ++j) {
    residual.template segment<3>(3 * j) -= poses.driven_positions.col(j);
    residual.template segment<3>(inputs + 3 * j) -= velocities.col(j);
  }
  changed_ = basis_.offset() - trial_;
  residual += jacobian_.lazyProduct(changed_);  // lazy products never allocate
  by_coefficients_ = jacobian_.lazyProduct(basis_.matrix());
  residual.tail(inputs) *= weight;
  by_coefficients_.bottomRows(inputs) *= weight;
  hessian_ = by_coefficients_.transpose().lazyProduct(by_coefficients_);
  gradient_ = by_coefficients_.transpose().lazyProduct(residual);
  Scalar largest = Scalar(0);
  for (Index i = 0; i < hessian_.rows(); ++i) {
    if (largest < hessian_(i, i)) largest = hessian_(i, i);
  }
  if (!(Scalar(0) < largest) || !is_finite(largest)) return false;
  // The unit of a program is free: this one keeps its numbers near one.
  hessian_ /= largest;
  gradient_ /= largest;
  hessian_.diagonal().array() += Scalar(settings_.ridge);
  if (qp_.set_hessian(hessian_) != QpStatus::Solved || qp_.set_rows(rows_) != QpStatus::Solved ||
      qp_.solve(gradient_, lower_, upper_, row_lower_, row_upper_, result_) != QpStatus::Solved)
    return false;
  basis_.keep_limits(result_.x);
  trial_ = basis_.offset();
  trial_ += basis_.matrix().lazyProduct(result_.x);
  return true;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
