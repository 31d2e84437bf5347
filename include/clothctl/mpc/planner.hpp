#pragma once

// The receding-horizon planner. Each frame: rebuild friction cones and patch modes at the measured state, predict the window
// at the shifted previous plan, stack the cost (planner_settings.hpp), condense it to a QP in the unknowns of grip_basis.hpp,
// solve it warm, and answer with the input of the first frame.
//
// The box QP is tried first. Grip limits of whole fingers and hard patch rows need general rows: they go to the row solver,
// hard rows always, limits only in frames where the box solution breaks one.

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/contact/patch.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/status.hpp"
#include "clothctl/mpc/condense.hpp"
#include "clothctl/mpc/features.hpp"
#include "clothctl/mpc/grip_basis.hpp"
#include "clothctl/mpc/planner_settings.hpp"
#include "clothctl/mpc/term_stack.hpp"
#include "clothctl/mpc/window.hpp"
#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"

namespace clothctl {

/// What a planning frame answers. Made by `Planner::make_result`; reused from frame to frame.
template <RealScalar Scalar>
struct PlanResult {
  /// How the frame ended.
  PlanStatus status = PlanStatus::Failed;
  /// What to apply to the plant during the next frame: forces, or driven positions. Wind is left to the caller.
  ClothInput<Scalar> input;
  /// The force of each finger on each of its vertices; empty for poses.
  std::vector<FingerForce<Scalar>> finger_forces;
  /// Raw inputs over the window, 3·held × K: forces (N) or velocities (m/s).
  MatrixX<Scalar> plan;
  /// Features over the window as predicted, 3·features × K, m.
  MatrixX<Scalar> predicted;
  /// Distance between the features measured now and what the last frame predicted for now, root mean square, m.
  Scalar prediction_error = Scalar(0);
  /// 1 - prediction_error / (how far the features moved in the last frame, at least 1 mm), within [0, 1]. 1: the plant does
  /// what was predicted. 1 in the first frame.
  Scalar agreement = Scalar(1);
  /// Largest predicted non-affine displacement of a held vertex over the window, m.
  Scalar patch_residual = Scalar(0);
  /// QP iterations.
  int qp_iterations = 0;
  /// How the QP ended.
  QpStatus qp_status = QpStatus::Solved;
  /// True when the row solver was used.
  bool used_rows = false;
};

/// What a planner plans for: fixed when it is made.
template <RealScalar Scalar>
struct PlannerSetup {
  /// The features that follow a target.
  PointFeatures<Scalar> features;
  /// Who holds the sheet where.
  std::vector<Grip<Scalar>> grips;
  /// The sheet's triangles, for contact normals; may be empty.
  std::vector<std::array<int, 3>> triangles;
  /// One anchor a grip; empty: made from the start positions (grip i follows feature i if there are as many, else the mean).
  std::vector<HandAnchor<Scalar>> anchors = {};
};

/// Plans contact forces or grip poses over a receding horizon. Reference: paper 000, section 4.1.
template <class Predictor, class BoxSolver = BoxActiveSet<typename Predictor::Scalar>, class RowSolver = ActiveSet<typename Predictor::Scalar>>
class Planner {
 public:
  /// The scalar type.
  using Scalar = typename Predictor::Scalar;

  /// Checks everything and makes a planner for a sheet that stands at `start` (3×n, m). Allocates.
  static Result<Planner> create(PlannerSetup<Scalar> setup, PlannerSettings<Scalar> settings, Predictor predictor, const PointsView<Scalar>& start) {
    std::string problem = settings.check();
    if (problem.empty()) problem = check_features<Scalar>(setup.features, start.cols());
    if (problem.empty()) problem = check_grips(setup.grips, start.cols());
    if (problem.empty() && !all_finite(start)) problem = "the start positions are not finite";
    if (problem.empty() && !setup.anchors.empty() && setup.anchors.size() != setup.grips.size()) {
      problem = "there are " + std::to_string(setup.anchors.size()) + " anchors for " + std::to_string(setup.grips.size()) + " grips";
    }
    for (const HandAnchor<Scalar>& anchor : setup.anchors) {
      if (problem.empty() && static_cast<Index>(anchor.feature_weights.size()) != setup.features.count()) problem = "an anchor has not one weight a feature";
    }
    if (!problem.empty()) return Error{problem};
    return Planner(std::move(setup), std::move(settings), std::move(predictor), start);
  }

  /// The settings.
  const PlannerSettings<Scalar>& settings() const { return settings_; }
  /// The held vertices, grip by grip.
  const std::vector<int>& held() const { return basis_.held(); }
  /// The grips.
  const std::vector<Grip<Scalar>>& grips() const { return basis_.grips(); }
  /// The predictor.
  Predictor& predictor() { return predictor_; }

  /// Makes a result with room for every frame. Allocates.
  PlanResult<Scalar> make_result() const {
    PlanResult<Scalar> result;
    const Index held_count = static_cast<Index>(basis_.held().size());
    if (settings_.input == GripInput::Force && settings_.command == Command::Force) {
      result.input.force_vertices = basis_.held();
      result.input.forces.setZero(3, held_count);
      result.input.driven_positions.setZero(3, 0);
    } else {
      result.input.driven_vertices = basis_.held();
      result.input.driven_positions.setZero(3, held_count);
      result.input.forces.setZero(3, 0);
    }
    result.finger_forces.resize(basis_.contacts().size());
    result.plan.setZero(basis_.inputs(), settings_.horizon);
    result.predicted.setZero(3 * feature_count_, settings_.horizon);
    return result;
  }

  /// Plans from measured positions `x` and velocities `v` (3×n) at time `t` (s). `target(feature, time)` gives a feature's
  /// wanted position; `wind(time)` the air velocity. Never allocates. On InvalidInput planner and result stay as they were.
  template <class Target, class Wind>
  PlanStatus plan(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t, const Target& target, const Wind& wind, PlanResult<Scalar>& result) {
    if (!take_input(x, v, t, target, wind)) return PlanStatus::InvalidInput;
    measure_agreement(x, result);
    shift_plan();
    basis_.update(x);
    if (!predictor_.predict(x, v, request_, window_)) return fail(x, result);
    stack_terms(x, v);
    assemble_qp(x);
    const PlanStatus status = solve_qp(result);
    if (status == PlanStatus::Failed) return fail(x, result);
    extract(x, status, result);
    last_held_velocity_ = held_velocity_;
    has_last_ = true;
    return status;
  }

  /// Plans in still air.
  template <class Target>
  PlanStatus plan(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t, const Target& target, PlanResult<Scalar>& result) {
    return plan(x, v, t, target, [](const Scalar&) { return Vector3<Scalar>(Vector3<Scalar>::Zero()); }, result);
  }

  /// Forces on vertices that the window takes as known and constant (a table's push), 3×n, N; no columns: none. Allocates on change of size.
  void set_outer_force(const PointsView<Scalar>& force) { request_.outer_force = force; }

  /// Forgets plan, active set and measurements, as after a jump of the plant.
  void reset() {
    has_last_ = false;
    request_.plan.setZero();
    start_plan();
    box_.reset();
    rows_.reset();
  }

 private:
  /// A set of vertices that one finger (or several alike) holds.
  struct Patch {
    std::vector<Index> slots;
    PatchModes<Scalar> modes;
  };

  Planner(PlannerSetup<Scalar> setup, PlannerSettings<Scalar> settings, Predictor predictor, const PointsView<Scalar>& start)
      : setup_(std::move(setup)),
        settings_(std::move(settings)),
        predictor_(std::move(predictor)),
        basis_(setup_.grips, setup_.triangles, settings_.input),
        feature_count_(setup_.features.count()) {
    const Index horizon = settings_.horizon;
    const Index held_count = static_cast<Index>(basis_.held().size());
    request_.horizon = horizon;
    request_.dt = settings_.dt;
    request_.kind = settings_.input == GripInput::Force ? InputKind::Force : InputKind::Velocity;
    request_.held = basis_.held();
    request_.outputs = setup_.features;
    for (int vertex : basis_.held()) request_.outputs.add_point(vertex);
    request_.plan.setZero(request_.inputs(), horizon);
    request_.applied.setZero(request_.inputs());
    request_.wind.setZero(3, horizon);
    predictor_.reserve(request_, window_);
    make_patches();
    make_anchors(start);
    Index rows = 3 * feature_count_ + 9 * static_cast<Index>(grip_count());
    for (const Patch& p : patches_) rows += 9 + 3 * p.modes.count();
    stack_.reserve(rows, request_.inputs(), horizon);
    const Index raw = request_.inputs() * horizon;
    unknowns_ = basis_.unknowns() * horizon;
    raw_hessian_.setZero(raw, raw);
    raw_gradient_.setZero(raw);
    plan_product_.setZero(raw);
    hessian_.setZero(unknowns_, unknowns_);
    for (VectorX<Scalar>* p : {&gradient_, &lower_, &upper_, &solution_}) p->setZero(unknowns_);
    column_.setZero(request_.inputs());
    targets_.setZero(3 * feature_count_, horizon);
    anchor_targets_.setZero(3 * static_cast<Index>(grip_count()), horizon);
    for (Points<Scalar>* p : {&held_velocity_, &last_held_velocity_, &reference_}) p->setZero(3, held_count);
    features_.setZero(3, feature_count_);
    last_features_ = features_;
    promised_ = features_;
    box_.reserve(unknowns_);
    Index hard_rows = 0;
    if (settings_.input == GripInput::Force && settings_.patch == PatchMode::Hard) {
      for (const Patch& p : patches_) hard_rows += 3 * p.modes.count();
    }
    max_rows_ = (hard_rows + finger_count()) * horizon;
    if (settings_.input == GripInput::Force) {
      row_matrix_.setZero(max_rows_, unknowns_);
      row_lower_.setZero(max_rows_);
      row_upper_.setZero(max_rows_);
      rows_.reserve(unknowns_, max_rows_);
    }
    start_plan();
  }

  std::size_t grip_count() const { return basis_.grips().size(); }
  Index finger_count() const {
    Index count = 0;
    for (const Grip<Scalar>& g : basis_.grips()) count += static_cast<Index>(g.fingers.size());
    return count;
  }

  void make_patches() {
    for (std::size_t g = 0; g < grip_count(); ++g) {
      std::vector<std::vector<int>> seen;
      for (const Finger<Scalar>& f : basis_.grips()[g].fingers) {
        std::vector<int> vertices = f.vertices;
        std::sort(vertices.begin(), vertices.end());
        if (std::find(seen.begin(), seen.end(), vertices) != seen.end()) continue;
        seen.push_back(vertices);
        std::vector<Index> slots;
        for (std::size_t s = basis_.grip_begin(g); s < basis_.grip_begin(g + 1); ++s) {
          if (std::binary_search(vertices.begin(), vertices.end(), basis_.held()[s])) slots.push_back(static_cast<Index>(s));
        }
        const Index size = static_cast<Index>(slots.size());
        patches_.push_back({std::move(slots), PatchModes<Scalar>(size)});
      }
    }
    std::size_t longest = basis_.held().size();
    point_.reserve(longest);
  }

  void make_anchors(const PointsView<Scalar>& start) {
    anchors_ = setup_.anchors;
    if (!anchors_.empty()) return;
    Points<Scalar> y(3, feature_count_);
    evaluate_features<Scalar>(setup_.features, start, y);
    const bool paired = static_cast<std::size_t>(feature_count_) == grip_count();
    for (std::size_t g = 0; g < grip_count(); ++g) {
      HandAnchor<Scalar> anchor;
      Scalar number = Scalar(0);
      for (Index i = 0; i < feature_count_; ++i) number += Scalar(1);
      Vector3<Scalar> followed = Vector3<Scalar>::Zero();
      for (Index i = 0; i < feature_count_; ++i) {
        const Scalar weight = paired ? Scalar(static_cast<std::size_t>(i) == g ? 1.0 : 0.0) : Scalar(1) / number;
        anchor.feature_weights.push_back(weight);
        followed += weight * y.col(i);
      }
      anchor.offset = basis_.centroid(start, g) - followed;
      anchor.drop = Scalar(0) < anchor.offset[2] ? anchor.offset[2] : Scalar(0);
      anchors_.push_back(std::move(anchor));
    }
  }

  /// The plan before the first frame: the share of the supported force, or standing still.
  void start_plan() {
    reference_.setZero();
    if (settings_.input != GripInput::Force) return;
    Scalar number = Scalar(0);
    for (std::size_t i = 0; i < basis_.held().size(); ++i) number += Scalar(1);
    reference_.colwise() = Vector3<Scalar>(settings_.supported / number);
    for (Index k = 0; k < settings_.horizon; ++k) {
      for (Index j = 0; j < reference_.cols(); ++j) request_.plan.template block<3, 1>(3 * j, k) = reference_.col(j);
    }
    request_.applied = request_.plan.col(0);
  }

  template <class Target, class Wind>
  bool take_input(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t, const Target& target, const Wind& wind) {
    if (!is_finite(t) || !all_finite(x) || !all_finite(v)) return false;
    Scalar time = t;
    for (Index k = 0; k < settings_.horizon; ++k) {
      // The air that acts during frame k+1 is that of its start; the features are wanted at its end.
      const Vector3<Scalar> air = wind(time);
      if (!all_finite(air)) return false;
      request_.wind.col(k) = air;
      time += settings_.dt;
      for (Index i = 0; i < feature_count_; ++i) {
        const Vector3<Scalar> wanted = target(i, time);
        if (!all_finite(wanted)) return false;
        targets_.template block<3, 1>(3 * i, k) = wanted;
      }
      if (!(Scalar(0) < settings_.weights.anchor)) continue;
      for (std::size_t g = 0; g < grip_count(); ++g) {
        const Vector3<Scalar> wanted = anchor_position(anchors_[g], settings_.swing, settings_.gravity, target, time);
        if (!all_finite(wanted)) return false;
        anchor_targets_.template block<3, 1>(3 * static_cast<Index>(g), k) = wanted;
      }
    }
    for (std::size_t j = 0; j < basis_.held().size(); ++j) held_velocity_.col(static_cast<Index>(j)) = v.col(basis_.held()[j]);
    if (!has_last_) last_held_velocity_ = held_velocity_;
    return true;
  }

  void measure_agreement(const PointsView<Scalar>& x, PlanResult<Scalar>& result) {
    using std::sqrt;
    last_features_.swap(features_);
    evaluate_features<Scalar>(setup_.features, x, features_);
    result.prediction_error = Scalar(0);
    result.agreement = Scalar(1);
    if (!has_last_) return;
    Scalar number = Scalar(0);
    for (Index i = 0; i < feature_count_; ++i) number += Scalar(1);
    result.prediction_error = sqrt((features_ - promised_).squaredNorm() / number);
    Scalar moved = sqrt((features_ - last_features_).squaredNorm() / number);
    if (moved < Scalar(1e-3)) moved = Scalar(1e-3);
    result.agreement = Scalar(1) - result.prediction_error / moved;
    if (result.agreement < Scalar(0)) result.agreement = Scalar(0);
  }

  /// Moves the plan one frame on; its last frame is repeated.
  void shift_plan() {
    if (!has_last_) return;
    for (Index k = 0; k + 1 < settings_.horizon; ++k) request_.plan.col(k) = request_.plan.col(k + 1);
    box_.shift(basis_.unknowns());
  }

  void stack_terms(const PointsView<Scalar>& x, const PointsView<Scalar>& v) {
    using std::sqrt;
    const PlannerWeights<Scalar>& w = settings_.weights;
    const auto none = [](Index) { return Vector3<Scalar>(Vector3<Scalar>::Zero()); };
    stack_.clear();
    for (Index i = 0; i < feature_count_; ++i) {
      point_.assign(1, OutputTerm<Scalar>{i, Scalar(1)});
      stack_.add(window_, point_, past_, 0, sqrt(w.feature), [&](Index k) { return Vector3<Scalar>(targets_.template block<3, 1>(3 * i, k)); });
    }
    for (std::size_t g = 0; g < grip_count(); ++g) {
      const std::size_t begin = basis_.grip_begin(g), end = basis_.grip_begin(g + 1);
      Scalar number = Scalar(0);
      for (std::size_t j = begin; j < end; ++j) number += Scalar(1);
      point_.clear();
      Vector3<Scalar> velocity = Vector3<Scalar>::Zero(), before = Vector3<Scalar>::Zero();
      for (std::size_t j = begin; j < end; ++j) {
        const Scalar share = Scalar(1) / number;
        point_.push_back({feature_count_ + static_cast<Index>(j), share});
        velocity += share * v.col(basis_.held()[j]);
        before += share * last_held_velocity_.col(static_cast<Index>(j));
      }
      past_[0] = basis_.centroid(x, g);
      past_[1] = past_[0] - settings_.dt * velocity;
      past_[2] = past_[1] - settings_.dt * before;
      stack_.add(window_, point_, past_, 0, sqrt(w.anchor),
                 [&](Index k) { return Vector3<Scalar>(anchor_targets_.template block<3, 1>(3 * static_cast<Index>(g), k)); });
      stack_.add(window_, point_, past_, 2, sqrt(w.smooth) / settings_.dt, none);
      stack_.add(window_, point_, past_, 3, sqrt(w.jerk) / settings_.dt, none);
    }
    for (Patch& patch : patches_) {
      const Index count = static_cast<Index>(patch.slots.size());
      for (Index j = 0; j < count; ++j) reference_.col(j) = x.col(basis_.held()[static_cast<std::size_t>(patch.slots[static_cast<std::size_t>(j)])]);
      patch.modes.update(reference_.leftCols(count));
      if (patch.modes.rank() == 0) continue;
      for (Index a = 0; a < 3; ++a) {
        point_.clear();
        past_[0].setZero();
        for (Index j = 0; j < count; ++j) {
          point_.push_back({feature_count_ + patch.slots[static_cast<std::size_t>(j)], patch.modes.map()(a, j)});
          past_[0] += patch.modes.map()(a, j) * reference_.col(j);
        }
        stack_.add(window_, point_, past_, 1, sqrt(w.shape), none);
      }
      if (settings_.input != GripInput::Force || settings_.patch != PatchMode::Soft) continue;
      for (Index i = 0; i < patch.modes.non_affine_count(); ++i) {
        take_non_affine(patch, i);
        stack_.add(window_, point_, past_, 0, sqrt(w.patch), none);
      }
    }
  }

  void take_non_affine(const Patch& patch, Index i) {
    point_.clear();
    for (Index j = 0; j < patch.modes.count(); ++j) {
      point_.push_back({feature_count_ + patch.slots[static_cast<std::size_t>(j)], patch.modes.non_affine(i)[j]});
    }
  }

  /// H and g over the unknowns: raw inputs r = B u, δ = B u - ū.
  void assemble_qp(const PointsView<Scalar>& x) {
    const PlannerWeights<Scalar>& w = settings_.weights;
    const Index m = request_.inputs(), horizon = settings_.horizon, p = basis_.unknowns();
    condense<Scalar>(stack_.blocks(), stack_.residual(), raw_hessian_, raw_gradient_);
    const bool force = settings_.input == GripInput::Force;
    start_reference();
    const Scalar effort = force ? w.force : w.velocity;
    for (Index k = 0; k < horizon; ++k) {
      for (Index i = 0; i < m; ++i) {
        const Index row = k * m + i;
        raw_hessian_(row, row) += effort + w.step;
        raw_gradient_[row] += effort * (request_.plan(i, k) - column_[i]);
      }
    }
    // g(B u) with δ = r - ū:  ½ rᵀH r + (g - H ū)ᵀ r
    for (Index k = 0; k < horizon; ++k) {
      plan_product_.segment(k * m, m) = raw_gradient_.segment(k * m, m);
      for (Index j = 0; j < horizon; ++j) {
        plan_product_.segment(k * m, m).noalias() -= raw_hessian_.block(k * m, j * m, m, m) * request_.plan.col(j);
      }
    }
    const MatrixX<Scalar>& b = basis_.matrix();
    for (Index k = 0; k < horizon; ++k) {
      for (Index c = 0; c < p; ++c) {
        const std::pair<Index, Index> rows = basis_.rows(c);
        gradient_[k * p + c] = b.col(c).segment(rows.first, rows.second).dot(plan_product_.segment(k * m + rows.first, rows.second));
      }
    }
    for (Index l = 0; l < horizon; ++l) {
      for (Index d = 0; d < p; ++d) {
        const std::pair<Index, Index> wide = basis_.rows(d);
        for (Index j = l; j < horizon; ++j) {
          column_.noalias() = raw_hessian_.block(j * m, l * m + wide.first, m, wide.second) * b.col(d).segment(wide.first, wide.second);
          for (Index c = 0; c < p; ++c) {
            const std::pair<Index, Index> rows = basis_.rows(c);
            const Scalar value = b.col(c).segment(rows.first, rows.second).dot(column_.segment(rows.first, rows.second));
            hessian_(j * p + c, l * p + d) = value;
            hessian_(l * p + d, j * p + c) = value;
          }
        }
      }
    }
    const Scalar ridge = force ? w.cone : w.velocity;
    for (Index i = 0; i < unknowns_; ++i) hessian_(i, i) += ridge;
    basis_.bounds(x, settings_.max_step, settings_.dt, lower_.head(p), upper_.head(p));
    for (Index k = 1; k < horizon; ++k) {
      lower_.segment(k * p, p) = lower_.head(p);
      upper_.segment(k * p, p) = upper_.head(p);
    }
  }

  /// u_ref of a frame into column_.
  void start_reference() {
    column_.setZero();
    if (settings_.input != GripInput::Force) return;
    Scalar number = Scalar(0);
    for (std::size_t i = 0; i < basis_.held().size(); ++i) number += Scalar(1);
    for (Index j = 0; j < static_cast<Index>(basis_.held().size()); ++j) column_.template segment<3>(3 * j) = settings_.supported / number;
  }

  PlanStatus solve_qp(PlanResult<Scalar>& result) {
    result.used_rows = false;
    const bool force = settings_.input == GripInput::Force;
    const bool hard = force && settings_.patch == PatchMode::Hard && non_affine_rows() > 0;
    if (!hard) {
      if (box_.set_hessian(hessian_) != QpStatus::Solved) return PlanStatus::Failed;
      const QpStatus status = box_.solve(gradient_, lower_, upper_, qp_);
      result.qp_iterations = qp_.iterations;
      result.qp_status = status;
      if (status != QpStatus::Solved && status != QpStatus::SolvedInaccurate && status != QpStatus::IterationLimit) return PlanStatus::Failed;
      solution_ = qp_.x;
      if (!force || limits_hold()) return status == QpStatus::IterationLimit ? PlanStatus::Suboptimal : PlanStatus::Planned;
    }
    result.used_rows = true;
    return solve_rows(hard, result);
  }

  Index non_affine_rows() const {
    Index rows = 0;
    for (const Patch& p : patches_) rows += 3 * p.modes.non_affine_count();
    return rows;
  }

  /// Normal force of a finger in frame k of the solution, N.
  Scalar normal_force(int grip, int finger, Index k) const {
    using std::sqrt;
    Scalar sum = Scalar(0);
    for (const typename GripBasis<Scalar>::Contact& c : basis_.contacts()) {
      if (c.grip != grip || c.finger != finger) continue;
      const Finger<Scalar>& f = basis_.finger(c);
      sum += solution_.segment(k * basis_.unknowns() + c.column, f.generators).sum() / sqrt(Scalar(1) + f.friction * f.friction);
    }
    return sum;
  }

  bool limits_hold() const {
    for (std::size_t g = 0; g < grip_count(); ++g) {
      for (std::size_t f = 0; f < basis_.grips()[g].fingers.size(); ++f) {
        for (Index k = 0; k < settings_.horizon; ++k) {
          if (basis_.grips()[g].fingers[f].limit < normal_force(static_cast<int>(g), static_cast<int>(f), k)) return false;
        }
      }
    }
    return true;
  }

  PlanStatus solve_rows(bool hard, PlanResult<Scalar>& result) {
    using std::sqrt;
    const Index p = basis_.unknowns(), m = request_.inputs(), horizon = settings_.horizon;
    row_matrix_.setZero();
    Index row = 0;
    for (std::size_t g = 0; g < grip_count(); ++g) {
      for (std::size_t f = 0; f < basis_.grips()[g].fingers.size(); ++f) {
        for (Index k = 0; k < horizon; ++k, ++row) {
          for (const typename GripBasis<Scalar>::Contact& c : basis_.contacts()) {
            if (c.grip != static_cast<int>(g) || c.finger != static_cast<int>(f)) continue;
            const Finger<Scalar>& finger = basis_.finger(c);
            row_matrix_.row(row).segment(k * p + c.column, finger.generators).setConstant(Scalar(1) / sqrt(Scalar(1) + finger.friction * finger.friction));
          }
          row_lower_[row] = -scalar_traits<Scalar>::infinity();
          row_upper_[row] = basis_.grips()[g].fingers[f].limit;
        }
      }
    }
    if (hard) {
      const MatrixX<Scalar>& b = basis_.matrix();
      for (const Patch& patch : patches_) {
        for (Index i = 0; i < patch.modes.non_affine_count(); ++i) {
          take_non_affine(patch, i);
          for (Index k = 0; k < horizon; ++k) {
            for (Index c = 0; c < 3; ++c, ++row) {
              Scalar offset = Scalar(0);
              for (const OutputTerm<Scalar>& t : point_) offset -= t.weight * window_.free(3 * t.output + c, k);
              for (Index j = 0; j <= k; ++j) {
                column_.setZero();
                for (const OutputTerm<Scalar>& t : point_) column_ += t.weight * window_.impulse.row(3 * t.output + c).segment((k - j) * m, m).transpose();
                offset += column_.dot(request_.plan.col(j));
                for (Index d = 0; d < p; ++d) {
                  const std::pair<Index, Index> rows = basis_.rows(d);
                  row_matrix_(row, j * p + d) = b.col(d).segment(rows.first, rows.second).dot(column_.segment(rows.first, rows.second));
                }
              }
              row_lower_[row] = offset;
              row_upper_[row] = offset;
            }
          }
        }
      }
    }
    if (rows_.set_hessian(hessian_) != QpStatus::Solved || rows_.set_rows(row_matrix_.topRows(row)) != QpStatus::Solved) return PlanStatus::Failed;
    const QpStatus status = rows_.solve(gradient_, lower_, upper_, row_lower_.head(row), row_upper_.head(row), qp_);
    result.qp_iterations += qp_.iterations;
    result.qp_status = status;
    if (status != QpStatus::Solved && status != QpStatus::SolvedInaccurate) return PlanStatus::Failed;
    solution_ = qp_.x;
    return PlanStatus::Planned;
  }

  void extract(const PointsView<Scalar>& x, PlanStatus status, PlanResult<Scalar>& result) {
    using std::abs;
    const Index p = basis_.unknowns(), m = request_.inputs(), horizon = settings_.horizon;
    Scalar scale = Scalar(1);
    for (Index k = 0; k < horizon; ++k) {
      result.plan.col(k).noalias() = basis_.matrix() * solution_.segment(k * p, p);
      if (!(Scalar(0) < settings_.max_change) || settings_.input == GripInput::Force) continue;
      for (Index i = 0; i < m; ++i) {
        const Scalar change = abs(result.plan(i, k) - request_.plan(i, k));
        if (settings_.max_change < scale * change) scale = settings_.max_change / change;
      }
    }
    if (scale < Scalar(1)) result.plan = request_.plan + scale * (result.plan - request_.plan);
    for (Index k = 0; k < horizon; ++k) {
      for (Index j = 0; j <= k; ++j) {
        column_ = result.plan.col(j) - request_.plan.col(j);
        window_.free.col(k).noalias() += window_.impulse.middleCols((k - j) * m, m) * column_;
      }
    }
    result.predicted = window_.free.topRows(3 * feature_count_);
    for (Index i = 0; i < feature_count_; ++i) promised_.col(i) = result.predicted.template block<3, 1>(3 * i, 0);
    result.patch_residual = Scalar(0);
    for (const Patch& patch : patches_) {
      for (Index i = 0; i < patch.modes.non_affine_count(); ++i) {
        take_non_affine(patch, i);
        for (Index k = 0; k < horizon; ++k) {
          Vector3<Scalar> sum = Vector3<Scalar>::Zero();
          for (const OutputTerm<Scalar>& t : point_) sum += t.weight * window_.free.template block<3, 1>(3 * t.output, k);
          const Scalar size = sum.cwiseAbs().maxCoeff();
          if (result.patch_residual < size) result.patch_residual = size;
        }
      }
    }
    request_.plan = result.plan;
    request_.applied = result.plan.col(0);
    if (settings_.input == GripInput::Force) {
      basis_.finger_forces(solution_.head(p), result.finger_forces);
      if (settings_.command == Command::Force) {
        for (Index j = 0; j < result.input.forces.cols(); ++j) result.input.forces.col(j) = result.plan.template block<3, 1>(3 * j, 0);
      } else {
        for (Index j = 0; j < result.input.driven_positions.cols(); ++j) {
          result.input.driven_positions.col(j) = window_.free.template block<3, 1>(3 * (feature_count_ + j), 0);
        }
      }
    } else {
      command_poses(x, scale, result);
    }
    result.status = status;
  }

  /// Moves each grip rigidly: by v h, and by the rotation exp(h ω) about its centroid.
  void command_poses(const PointsView<Scalar>& x, Scalar scale, PlanResult<Scalar>& result) {
    using std::cos;
    using std::sin;
    using std::sqrt;
    Index column = 0;
    for (std::size_t g = 0; g < grip_count(); ++g) {
      const std::size_t begin = basis_.grip_begin(g), end = basis_.grip_begin(g + 1);
      const Vector3<Scalar> c = basis_.centroid(x, g);
      Vector3<Scalar> velocity = Vector3<Scalar>::Zero();
      Scalar number = Scalar(0);
      for (std::size_t j = begin; j < end; ++j, number += Scalar(1)) velocity += result.plan.template block<3, 1>(3 * static_cast<Index>(j), 0);
      velocity /= number;
      Matrix3<Scalar> turn = Matrix3<Scalar>::Identity();
      if (end - begin > 1) {
        const Vector3<Scalar> omega = scale * settings_.dt * solution_.template segment<3>(column + 3);
        const Scalar angle = sqrt(omega.squaredNorm());
        if (Scalar(0) < angle) {
          const Vector3<Scalar> axis = omega / angle;
          const Scalar s = sin(angle), versine = Scalar(1) - cos(angle), zero = Scalar(0);
          Matrix3<Scalar> cross;
          cross << zero, -axis[2], axis[1], axis[2], zero, -axis[0], -axis[1], axis[0], zero;
          turn += s * cross + versine * (cross * cross);
        }
        column += 6;
      } else {
        column += 3;
      }
      for (std::size_t j = begin; j < end; ++j) {
        const Vector3<Scalar> arm = x.col(basis_.held()[j]) - c;
        result.input.driven_positions.col(static_cast<Index>(j)) = c + settings_.dt * velocity + turn * arm;
      }
    }
  }

  /// Falls back on the previous plan, shifted by a frame.
  PlanStatus fail(const PointsView<Scalar>& x, PlanResult<Scalar>& result) {
    result.status = PlanStatus::Failed;
    result.plan = request_.plan;
    request_.applied = result.plan.col(0);
    for (Index j = 0; j < result.input.forces.cols(); ++j) result.input.forces.col(j) = result.plan.template block<3, 1>(3 * j, 0);
    for (Index j = 0; j < result.input.driven_positions.cols(); ++j) {
      result.input.driven_positions.col(j) = x.col(basis_.held()[static_cast<std::size_t>(j)]);
      if (settings_.input == GripInput::Pose) result.input.driven_positions.col(j) += settings_.dt * result.plan.template block<3, 1>(3 * j, 0);
    }
    has_last_ = false;
    box_.reset();
    rows_.reset();
    return PlanStatus::Failed;
  }

  PlannerSetup<Scalar> setup_;
  PlannerSettings<Scalar> settings_;
  Predictor predictor_;
  GripBasis<Scalar> basis_;
  Index feature_count_;
  WindowRequest<Scalar> request_;
  WindowResponse<Scalar> window_;
  TermStack<Scalar> stack_;
  std::vector<Patch> patches_;
  std::vector<HandAnchor<Scalar>> anchors_;
  std::vector<OutputTerm<Scalar>> point_;
  std::array<Vector3<Scalar>, 3> past_{Vector3<Scalar>::Zero(), Vector3<Scalar>::Zero(), Vector3<Scalar>::Zero()};
  MatrixX<Scalar> raw_hessian_, hessian_, targets_, anchor_targets_, row_matrix_;
  VectorX<Scalar> raw_gradient_, plan_product_, gradient_, lower_, upper_, solution_, column_, row_lower_, row_upper_;
  Points<Scalar> held_velocity_, last_held_velocity_, reference_, features_, last_features_, promised_;
  BoxSolver box_;
  RowSolver rows_;
  QpResult<Scalar> qp_;
  Index unknowns_ = 0, max_rows_ = 0;
  bool has_last_ = false;
};

}  // namespace clothctl
