#pragma once

// How a sheet that MassSpring has moved answers to impulses within that step (concept
// ImpulseResponse). The points are the touched vertices V. With the step matrix A, its factor L and
// the unit vectors E of their coordinates,
//
//   W = Eᵀ A⁻¹ E = (L⁻¹E)ᵀ (L⁻¹E),     v⁺ = v + A⁻¹ E p,     x⁺ = x + h A⁻¹ E p
//
// v and x are the sheet's velocities and positions after the step without the impulses p. So forces
// of contact act as implicitly as all others, at the cost of one solve with the factor that the
// step has made. After a single linear solve this is exact: it is the step with the input forces
// p/h. After Newton's method A is the exact step matrix at the end of the step, or its projection
// where that is not definite, and the answer is one Newton step from there.

#include <cassert>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "clothctl/cloth/mass_spring_settings.hpp"
#include "clothctl/concepts/impulse_response.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/linalg/block_cholesky.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

template <RealScalar S>
class MassSpring;  // its header includes this one

/// The answer of a mass-spring sheet to impulses at its touched vertices. Models ImpulseResponse.
/// Driven and pinned vertices do not move. What the step did to bound the energy does not take the
/// impulses into account; after a single linear solve, `holding_forces` does.
template <RealScalar S>
class MassSpringImpulses {
 public:
  /// The scalar type.
  using Scalar = S;
  /// The model of the sheet.
  using Model = MassSpring<Scalar>;

  /// Makes room for up to `capacity` touched vertices of a sheet of `model`, which must outlive
  /// this. Allocates, 9 times vertices times `capacity` scalars. Fails when: the model solves by
  /// conjugate gradients, or `capacity` is negative.
  static Result<MassSpringImpulses> create(const Model& model, Index capacity);

  /// Takes the step that `model.step` has just made of `state` with `ws`; both must stay until the
  /// next call. `vertices`: the touched vertices, each once. Never allocates. Complexity: see
  /// BlockCholesky::inverse_block; after Newton's method one more factorisation. Converged: the
  /// points are there. InvalidInput: a vertex is off the mesh or named twice, or there are more
  /// than there is room for. InvalidState: the sizes are not those of the model. InvalidWorkspace:
  /// it is another model's or has made no step. NumericalFailure: the step matrix is not positive
  /// definite; take a smaller step. On failure there are no points.
  [[nodiscard]] StepStatus attach(std::span<const int> vertices, ClothState<Scalar>& state,
                                  typename Model::Workspace& ws);

  /// The touched vertices; point i is vertices()[i].
  std::span<const int> vertices() const { return vertices_; }
  /// Returns the point of a vertex, or -1 where it is not touched.
  int point(int vertex) const {
    const bool on_mesh = vertex >= 0 && static_cast<std::size_t>(vertex) < point_.size();
    return on_mesh ? point_[static_cast<std::size_t>(vertex)] : -1;
  }

  /// Returns the number of points.
  Index point_count() const { return static_cast<Index>(vertices_.size()); }
  /// Writes the velocities (3n, m/s) with which the vertices move during the step.
  void velocities(Eigen::Ref<VectorX<Scalar>> u) const {
    assert(u.size() == 3 * point_count());
    for (Index i = 0; i < point_count(); ++i)
      u.template segment<3>(3 * i) = ws_->velocity.col(vertices_[static_cast<std::size_t>(i)]);
  }
  /// Adds the mobility to `W` (3n×3n, 1/kg).
  void add_mobility(Eigen::Ref<MatrixX<Scalar>> W) const {
    assert(W.rows() == 3 * point_count() && W.cols() == 3 * point_count());
    W += mobility_.topLeftCorner(W.rows(), W.cols());
  }
  /// Changes velocities and positions of the whole sheet by the impulses p (3n, N s). Complexity:
  /// one solve with the factor.
  void apply(const Eigen::Ref<const VectorX<Scalar>>& p);

 private:
  MassSpringImpulses(const Model& model, const typename Model::Workspace& ws, Index capacity)
      : model_(&model),
        memory_(ws.factor.make_inverse_block_memory(capacity)),
        capacity_(static_cast<std::size_t>(capacity)),
        mobility_(MatrixX<Scalar>::Zero(3 * capacity, 3 * capacity)),
        point_(static_cast<std::size_t>(model.vertex_count()), -1),
        change_(Lanes<Scalar, 1>::Zero(1, 3 * model.vertex_count())) {
    vertices_.reserve(static_cast<std::size_t>(capacity));
  }

  /// Lists the vertices. Returns false where one is off the mesh or named twice.
  bool list(std::span<const int> vertices);
  void clear() {
    for (const int v : vertices_) point_[static_cast<std::size_t>(v)] = -1;
    vertices_.clear();
  }

  const Model* model_;
  typename BlockCholesky<Scalar>::InverseBlockMemory memory_;
  std::size_t capacity_;
  MatrixX<Scalar> mobility_;
  std::vector<int> vertices_, point_;
  Lanes<Scalar, 1> change_;
  ClothState<Scalar>* state_ = nullptr;
  typename Model::Workspace* ws_ = nullptr;
};

template <RealScalar S>
auto MassSpringImpulses<S>::create(const Model& model, Index capacity)
    -> Result<MassSpringImpulses> {
  if (capacity < 0) return Error{"room for " + std::to_string(capacity) + " touched vertices"};
  if (model.settings().linear_solver != LinearSolver::Factor)
    return Error{"the model solves by conjugate gradients, which make no factor of its step"};
  return MassSpringImpulses(model, model.make_workspace(), capacity);
}

template <RealScalar S>
bool MassSpringImpulses<S>::list(std::span<const int> vertices) {
  for (const int v : vertices) {
    if (v < 0 || v >= model_->vertex_count() || point_[static_cast<std::size_t>(v)] >= 0)
      return false;
    point_[static_cast<std::size_t>(v)] = static_cast<int>(vertices_.size());
    vertices_.push_back(v);
  }
  return true;
}

template <RealScalar S>
StepStatus MassSpringImpulses<S>::attach(std::span<const int> vertices, ClothState<Scalar>& state,
                                         typename Model::Workspace& ws) {
  clear();
  StepStatus status = StepStatus::InvalidInput;
  if (vertices.size() <= capacity_ && list(vertices)) status = model_->factorize_step(state, ws);
  if (status != StepStatus::Converged) {
    clear();
    return status;
  }
  const Index n = 3 * point_count();
  if (!ws.factor.inverse_block(vertices_, memory_, mobility_.topLeftCorner(n, n))) {
    clear();
    return StepStatus::InvalidWorkspace;
  }
  for (Index i = 0; i < point_count(); ++i) {
    if (!ws.is_held(vertices_[static_cast<std::size_t>(i)])) continue;
    mobility_.block(3 * i, 0, 3, n).setZero();
    mobility_.block(0, 3 * i, n, 3).setZero();
  }
  state_ = &state;
  ws_ = &ws;
  return StepStatus::Converged;
}

template <RealScalar S>
void MassSpringImpulses<S>::apply(const Eigen::Ref<const VectorX<Scalar>>& p) {
  assert(p.size() == 3 * point_count());
  if (vertices_.empty()) return;
  change_.setZero();
  for (Index i = 0; i < point_count(); ++i) {
    const int v = vertices_[static_cast<std::size_t>(i)];
    if (ws_->is_held(v)) continue;
    for (Index c = 0; c < 3; ++c) change_[3 * static_cast<Index>(v) + c] = p[3 * i + c];
  }
  ws_->factor.template solve<1>(change_);
  for (Index v = 0; v < model_->vertex_count(); ++v) {
    if (ws_->is_held(v)) continue;
    for (Index c = 0; c < 3; ++c) {
      ws_->velocity(c, v) += change_[3 * v + c];
      state_->velocities(c, v) += change_[3 * v + c];
      state_->positions(c, v) += ws_->dt * change_[3 * v + c];
    }
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI
