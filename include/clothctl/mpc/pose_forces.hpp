#pragma once

// The contact forces with which fingers make held vertices follow planned poses, for sheets on
// which forces cannot be planned (prediction/simulator_predictor.hpp).
//
// A model of the sheet takes one frame from the measured state, with forces r on the held vertices.
// They end at positions p(r) with velocities w(r). The coefficients d of the fingers' generators,
// r = B d + r0 as in the planner, are those of
//
//   min ½ |p(r̄) + J_p (r - r̄) - p*|² + ½ (γ h)² |w(r̄) + J_w (r - r̄) - w*|² + ½ ρ |d|²
//
// with bounds, and a limit on the normal force of each finger. Positions alone would be followed by
// forces that swing from frame to frame: a vertex that is late needs a velocity that is too large
// for the next frame. J = ∂(p, w)/∂r at r̄ is known in one of two ways:
//
//   implicit model   r̄: the forces that hold the vertices at p* in a step. J_p = h² W, J_w = h W
//                    with the mobility W of the held vertices (concepts/impulse_response.hpp)
//   other models     r̄: the forces of the last frame, then those that were found. Differences, one
//                    step of the model for each coordinate
//
// Forces cannot hold cloth that is pushed together: it buckles between the vertices. So p* of a
// grip of several vertices is not the pose itself, but the undeformed cloth there, spread a little
// and fitted to the pose (math/horn.hpp).

#include <concepts>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/concepts/impulse_response.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/math/horn.hpp"
#include "clothctl/mpc/detail/grip_basis.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/qp/active_set.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of PoseForces.
struct PoseForcesSettings {
  /// Weight γ of velocities: that of positions is 1, that of velocities γ times the frame, squared.
  double velocity = 0.7;
  /// Change of a force for differences, N: it should move a vertex by less than the folds of the
  /// sheet.
  double difference = 1e-4;
  /// Number of linearisations by differences in a frame.
  int newton_steps = 3;
  /// Share by which a grip of several vertices spreads the cloth that it holds.
  double spread = 0.03;
  /// ρ, as a share of the largest diagonal entry of the Hessian without it. It divides the load
  /// among the fingers.
  double ridge = 1e-9;

  /// Returns an empty string, or a line that names the first bad setting and its value.
  std::string validate() const {
    const std::pair<const char*, double> positive[] = {{"difference", difference},
                                                       {"ridge", ridge}};
    for (const auto& [name, value] : positive) {
      if (!is_finite(value) || !(0 < value))
        return std::string(name) + " is " + number_text(value) + ", must be positive";
    }
    const std::pair<const char*, double> not_negative[] = {{"velocity", velocity},
                                                           {"spread", spread}};
    for (const auto& [name, value] : not_negative) {
      if (!is_finite(value) || value < 0)
        return std::string(name) + " is " + number_text(value) +
               ", must be finite and not negative";
    }
    if (newton_steps < 1)
      return "newton_steps is " + std::to_string(newton_steps) + ", must be at least 1";
    return {};
  }
};

namespace detail {

/// What tells how the step of a model answers to impulses: its type `Impulses`, as MassSpring has
/// one, or nothing.
template <class Model>
struct StepImpulses {
  struct type {};
};

template <class Model>
requires requires { typename Model::Impulses; }
struct StepImpulses<Model> {
  using type = typename Model::Impulses;
};

}  // namespace detail

/// Finds finger forces that make held vertices follow planned poses. `Model` is a model of the
/// sheet, `Setup` the PlannerSetup of the planner. A ClothRollout with a type `Impulses`, such as
/// MassSpring, counts as an implicit model, unless it solves by conjugate gradients.
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
  /// that order), and what else acts on the sheet. Of a grip of several vertices only place and
  /// turn count: what it holds has its rest shape, spread. `velocities`: how they shall then move
  /// (3×held, m/s), such as in the next frame of the plan. Returns false, and keeps the forces of
  /// the last frame, when an argument does not fit or is not finite, a step of the model fails, or
  /// no forces are found. Allocates in the first call, and when `poses` has another number of
  /// forces or attachments than before. Complexity: two or three steps of an implicit model and one
  /// MassSpringImpulses `attach`, or 1 + 3·held steps for each linearisation by differences.
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
  /// Writes p and w of `state_`.
  void read(Eigen::Ref<VectorX<Scalar>> out) const;
  /// Writes where the held vertices shall be: what a grip of several vertices holds keeps its rest
  /// shape, spread, and moves onto the poses.
  void place(const PointsView<Scalar>& poses);
  /// Linearises around the forces `trial_`, which it may replace.
  bool linearise(const Scalar& dt);
  /// Linearises around the forces that hold the sheet where it shall be.
  bool linearise_held(const Scalar& dt);
  /// Writes those forces to `trial_`, and to `guess_` how the sheet moves under them.
  bool hold(const Scalar& dt);
  /// Replaces `trial_` by the forces of the quadratic program.
  bool improve(const PointsView<Scalar>& velocities, const Scalar& dt);

  using Impulses = typename detail::StepImpulses<Model>::type;
  using Workspace = decltype(cloth_traits<Model>::make_workspace(std::declval<const Model&>()));
  static constexpr bool kHoldsPoses =
      ClothRollout<Model, Scalar> && ImpulseResponse<Impulses, Scalar> &&
      requires(Impulses & impulses, const Model& model, std::span<const int> vertices,
               ClothState<Scalar>& state, Workspace& workspace) {
    { Impulses::create(model, Index(1)) } -> std::same_as<Result<Impulses>>;
    { impulses.attach(vertices, state, workspace) } -> std::same_as<StepStatus>;
  };

  std::shared_ptr<const Model> model_;  // shared, since `impulses_` refers to it
  Basis basis_;
  PoseForcesSettings settings_;
  Workspace workspace_;
  std::optional<Impulses> impulses_;
  ClothState<Scalar> start_, state_;
  ClothInput<Scalar> input_, probe_, goal_;  // goal_: as poses
  std::vector<FingerForce<Scalar>> finger_forces_;
  Points<Scalar> rest_;                       // 3×held, spread
  Points<Scalar> holding_, guess_;            // forces that hold the poses; velocities under them
  Scalar same_ = Scalar(0);                   // positions closer than this are the same, m
  int solves_ = 0;                            // of the last step
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
    : model_(std::make_shared<const Model>(std::move(model))),
      basis_(std::move(basis)),
      settings_(settings),
      workspace_(cloth_traits<Model>::make_workspace(*model_)),
      start_(cloth_traits<Model>::rest_state(*model_)),
      state_(start_) {
  const Index inputs = basis_.inputs(), unknowns = basis_.unknowns();
  if constexpr (kHoldsPoses) {
    holding_.setZero(3, inputs / 3);
    guess_ = start_.velocities;
    same_ =
        Scalar(1e-5) *
        (start_.positions.rowwise().maxCoeff() - start_.positions.rowwise().minCoeff()).maxCoeff();
    if (auto made = Impulses::create(*model_, inputs / 3)) impulses_ = std::move(made).value();
  }
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
  rest_.setZero(3, inputs / 3);
  for (Index j = 0; j < inputs / 3; ++j)
    rest_.col(j) =
        Scalar(1 + settings_.spread) * start_.positions.col(held()[static_cast<std::size_t>(j)]);
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
  goal_ = poses;
  place(poses.driven_positions);
  trial_ = forces_;
  const int steps = impulses_ ? 1 : settings_.newton_steps;
  for (int step = 0; step < steps; ++step) {
    if (!linearise(dt) || !improve(velocities, dt)) return false;
  }
  forces_ = trial_;
  input_ = probe_;
  for (Index j = 0; j < count; ++j) input_.forces.col(j) = forces_.template segment<3>(3 * j);
  basis_.finger_forces(result_.x, finger_forces_);
  return true;
}

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type>
void PoseForces<Model, Setup>::place(const PointsView<Scalar>& poses) {
  for (std::size_t g = 0; g < basis_.held().grip_count(); ++g) {
    const Index begin = static_cast<Index>(basis_.held().grip_begin(g));
    const Index count = static_cast<Index>(basis_.held().grip_size(g));
    if (count == 1) continue;
    const HornResult<Scalar> fit =
        horn<Scalar>(rest_.middleCols(begin, count), poses.middleCols(begin, count));
    if (fit.status == HornStatus::InvalidInput) continue;  // too far away
    for (Index j = begin; j < begin + count; ++j) {
      const Vector3<Scalar> turned = fit.R * rest_.col(j);
      goal_.driven_positions.col(j) = turned + fit.t;
    }
  }
}

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type>
bool PoseForces<Model, Setup>::simulate(const VectorX<Scalar>& r, const Scalar& dt,
                                        Eigen::Ref<VectorX<Scalar>> out) {
  const Index count = static_cast<Index>(held().size());
  for (Index j = 0; j < count; ++j) probe_.forces.col(j) = r.template segment<3>(3 * j);
  state_ = start_;
  const StepReport<Scalar> report =
      cloth_traits<Model>::step(*model_, state_, probe_, dt, workspace_);
  if (!report.advanced) return false;
  solves_ = static_cast<int>(report.iterations);
  read(out);
  return true;
}

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type>
void PoseForces<Model, Setup>::read(Eigen::Ref<VectorX<Scalar>> out) const {
  const Index count = static_cast<Index>(held().size());
  for (Index j = 0; j < count; ++j) {
    const int vertex = held()[static_cast<std::size_t>(j)];
    out.template segment<3>(3 * j) = state_.positions.col(vertex);
    out.template segment<3>(3 * (count + j)) = state_.velocities.col(vertex);
  }
}

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type>
bool PoseForces<Model, Setup>::linearise(const Scalar& dt) {
  if constexpr (kHoldsPoses) {
    if (impulses_) return linearise_held(dt);
  }
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
bool PoseForces<Model, Setup>::hold(const Scalar& dt) {
  if constexpr (kHoldsPoses) {
    state_ = start_;
    if (!cloth_traits<Model>::step(*model_, state_, goal_, dt, workspace_).advanced) return false;
    cloth_rollout_traits<Model>::holding_forces(*model_, std::span<const int>(held()), workspace_,
                                                holding_);
    // The velocities of the state may have been calmed.
    guess_ = (state_.positions - start_.positions) / dt;
    for (std::size_t j = 0; j < held().size(); ++j) {
      Vector3<Scalar> force = holding_.col(static_cast<Index>(j));
      for (std::size_t i = 0; i < goal_.attached_vertices.size(); ++i) {
        if (goal_.attached_vertices[i] != held()[j]) continue;  // pulls only what is not driven
        const Index a = static_cast<Index>(i);
        force -=
            goal_.attachment_stiffness[a] *
            (goal_.attached_positions.col(a) - goal_.driven_positions.col(static_cast<Index>(j)));
      }
      trial_.template segment<3>(3 * static_cast<Index>(j)) = force;
    }
  }
  return all_finite(trial_);
}

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type>
bool PoseForces<Model, Setup>::linearise_held(const Scalar& dt) {
  if constexpr (kHoldsPoses) {
    using Rollout = cloth_rollout_traits<Model>;
    const Index inputs = basis_.inputs();
    if (!hold(dt) || !simulate(trial_, dt, reached_)) return false;
    // A step of several solves may end in another fold than the one that is held. One that is a
    // single solve is linear in the forces.
    changed_ = reached_.head(inputs) - goal_.driven_positions.reshaped();
    if (1 < solves_ && !(changed_.cwiseAbs().maxCoeff() < same_)) {
      state_ = start_;
      if (!Rollout::step_from(*model_, guess_, 1, state_, probe_, dt, workspace_, Scalar(0))
               .advanced)
        return false;
      read(reached_);
    }
    if (impulses_->attach(held(), state_, workspace_) != StepStatus::Converged) return false;
    auto positions = jacobian_.topRows(inputs);
    positions.setZero();
    impulses_->add_mobility(positions);
    // A force r is the impulse h r, and what moves faster by w moves further by h w.
    jacobian_.bottomRows(inputs) = dt * positions;
    positions *= dt * dt;
  }
  return all_finite(jacobian_);
}

template <class Model, class Setup>
requires ClothModel<Model, typename Setup::scalar_type>
bool PoseForces<Model, Setup>::improve(const PointsView<Scalar>& velocities, const Scalar& dt) {
  const Index inputs = basis_.inputs(), count = inputs / 3;
  const Scalar weight = Scalar(settings_.velocity) * dt;
  VectorX<Scalar>& residual = reached_;
  for (Index j = 0; j < count; ++j) {
    residual.template segment<3>(3 * j) -= goal_.driven_positions.col(j);
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
