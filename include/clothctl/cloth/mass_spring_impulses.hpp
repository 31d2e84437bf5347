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

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "clothctl/cloth/detail/contact_springs.hpp"
#include "clothctl/cloth/detail/factor_changes.hpp"
#include "clothctl/cloth/mass_spring_settings.hpp"
#include "clothctl/concepts/impulse_response.hpp"
#include "clothctl/contact/obstacle_contacts.hpp"
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
  /// this. Allocates, 9 times vertices times (`capacity` + 48) scalars. Fails when: the model
  /// solves by conjugate gradients, or `capacity` is negative.
  static Result<MassSpringImpulses> create(const Model& model, Index capacity);

  /// Announces, before a step with `ws`, that `attach` and `apply` (if only of zeros) will follow
  /// it, and the impulses (N s) that are expected then: impulse k at vertex `vertices[k]`; a vertex
  /// may occur more than once. The step is made with them, so that contacts with obstacles are
  /// found where the sheet will be. `velocities` are those without them, and `apply` replaces them:
  /// after a single linear solve what they were does not matter, apart from these contacts and from
  /// what bounds the energy; after Newton's method they matter to second order. Steps expect them
  /// until the next `attach` or `expect`. Never allocates. Returns false, and expects nothing,
  /// where a vertex is off the mesh, an impulse is not finite, the numbers of both differ, or `ws`
  /// is another model's.
  [[nodiscard]] bool expect(std::span<const int> vertices, const PointsView<Scalar>& impulses,
                            typename Model::Workspace& ws) const;

  /// Takes the step that `model.step` has just made of `state` with `ws`; both must stay until the
  /// next call. `vertices`: the touched vertices, each once. Never allocates. Complexity: see
  /// BlockCholesky::inverse_block; after Newton's method one more factorisation. Converged: the
  /// points are there. InvalidInput: a vertex is off the mesh or named twice, there are more than
  /// there is room for, or an impulse was expected at another vertex. InvalidState: the sizes are
  /// not those of the model. InvalidWorkspace: it is another model's or has made no step.
  /// NumericalFailure: the step matrix is not positive definite; take a smaller step. On failure
  /// there are no points.
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
    u.noalias() -= mobility_.topLeftCorner(u.size(), u.size()) * expected_.head(u.size());
  }
  /// Adds the mobility to `W` (3n×3n, 1/kg).
  void add_mobility(Eigen::Ref<MatrixX<Scalar>> W) const {
    assert(W.rows() == 3 * point_count() && W.cols() == 3 * point_count());
    W += mobility_.topLeftCorner(W.rows(), W.cols());
  }
  /// Changes velocities and positions of the whole sheet by the impulses p (3n, N s). Complexity:
  /// one solve with the factor.
  void apply(const Eigen::Ref<const VectorX<Scalar>>& p);
  /// Gives the contacts of the step (those that `model.step` got, in front of any others) what they
  /// exert since the last `apply`: what touched within the step is a spring, which the impulses
  /// strain. It stays one, so that an impulse that lifts the sheet leaves a contact that pulls, for
  /// this step. Calls more(i, q) for contact i whose impulse on the sheet has changed by q (N s).
  /// After Newton's method contacts are constant forces: nothing changes. Never allocates.
  template <class More>
  void update_contacts(ObstacleContacts<Scalar>& contacts, More more) const;

 private:
  MassSpringImpulses(const Model& model, const typename Model::Workspace& ws, Index capacity)
      : model_(&model),
        memory_(ws.factor.make_inverse_block_memory(capacity + kRoomForChanges)),
        capacity_(static_cast<std::size_t>(capacity)),
        mobility_(MatrixX<Scalar>::Zero(3 * (capacity + kRoomForChanges),
                                        3 * (capacity + kRoomForChanges))),
        rows_(Points<Scalar>::Zero(3, 3 * (capacity + kRoomForChanges))),
        answer_(VectorX<Scalar>::Zero(3 * (capacity + kRoomForChanges))),
        expected_(VectorX<Scalar>::Zero(3 * capacity)),
        more_(VectorX<Scalar>::Zero(3 * capacity)),
        point_(static_cast<std::size_t>(model.vertex_count()), -1),
        change_(Lanes<Scalar, 1>::Zero(1, 3 * model.vertex_count())) {
    vertices_.reserve(static_cast<std::size_t>(capacity));
    all_.reserve(static_cast<std::size_t>(capacity + kRoomForChanges));
  }

  /// Vertices of contacts with obstacles that are points of the inverse, too, at most.
  static constexpr Index kRoomForChanges =
      3 * static_cast<Index>(detail::FactorChanges<Scalar>::kMost);

  /// Computes the inverse between the touched vertices, and those of contacts with obstacles that
  /// have changed since the factorisation. Returns false where it is not finite.
  bool find_mobility();
  /// Number of a vertex in all_.
  Index place(int vertex) const {
    if (const int i = point(vertex); i >= 0) return static_cast<Index>(i);
    return std::find(all_.begin() + static_cast<std::ptrdiff_t>(vertices_.size()), all_.end(),
                     vertex) -
           all_.begin();
  }
  Vector3<Scalar> change_of(int vertex) const {
    const Index at = 3 * static_cast<Index>(vertex);
    if (ws_->is_held(vertex)) return Vector3<Scalar>::Constant(Scalar(0));
    return Vector3<Scalar>(change_[at], change_[at + 1], change_[at + 2]);
  }
  void add_to_change(int vertex, const Vector3<Scalar>& impulse) {
    if (ws_->is_held(vertex)) return;
    for (Index c = 0; c < 3; ++c) change_[3 * static_cast<Index>(vertex) + c] += impulse[c];
  }
  /// Takes what was expected. Returns false where there is no such point.
  bool take_expected(typename Model::Workspace& ws);
  /// Lists the vertices. Returns false where one is off the mesh or named twice.
  bool list(std::span<const int> vertices);
  void clear() {
    for (const int v : vertices_) point_[static_cast<std::size_t>(v)] = -1;
    vertices_.clear();
    ws_ = nullptr;
  }

  const Model* model_;
  typename BlockCholesky<Scalar>::InverseBlockMemory memory_;
  std::size_t capacity_;
  /// The inverse between `all_`: the touched vertices, then those of changed contacts.
  MatrixX<Scalar> mobility_;
  Points<Scalar> rows_;
  VectorX<Scalar> answer_, expected_, more_;
  std::vector<int> vertices_, point_, all_;
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
bool MassSpringImpulses<S>::expect(std::span<const int> vertices,
                                   const PointsView<Scalar>& impulses,
                                   typename Model::Workspace& ws) const {
  const Index n = model_->vertex_count();
  if (!model_->fits(ws)) return false;
  ws.expects = false;
  ws.expected.setZero();
  bool good = impulses.cols() == static_cast<Index>(vertices.size()) && all_finite(impulses);
  for (const int v : vertices) good = good && 0 <= v && v < n;
  if (!good) return false;
  for (std::size_t k = 0; k < vertices.size(); ++k)
    ws.expected.col(vertices[k]) += impulses.col(static_cast<Index>(k));
  ws.expects = !vertices.empty();
  return true;
}

template <RealScalar S>
bool MassSpringImpulses<S>::take_expected(typename Model::Workspace& ws) {
  expected_.setZero();
  bool all = true;
  for (Index v = 0; ws.holds_expected && v < model_->vertex_count(); ++v) {
    if (ws.is_held(v) || !(Scalar(0) < ws.expected.col(v).squaredNorm())) continue;
    const int i = point(static_cast<int>(v));
    if (0 <= i)
      expected_.template segment<3>(3 * i) = ws.expected.col(v);
    else
      all = false;
  }
  return all;
}

template <RealScalar S>
StepStatus MassSpringImpulses<S>::attach(std::span<const int> vertices, ClothState<Scalar>& state,
                                         typename Model::Workspace& ws) {
  clear();
  change_.setZero();
  ws.expects = false;
  StepStatus status = StepStatus::InvalidInput;
  if (vertices.size() <= capacity_ && list(vertices)) status = model_->factorize_step(state, ws);
  if (status == StepStatus::Converged && !take_expected(ws)) status = StepStatus::InvalidInput;
  if (status != StepStatus::Converged) {
    clear();
    return status;
  }
  state_ = &state;
  ws_ = &ws;
  if (find_mobility()) return StepStatus::Converged;
  clear();
  return StepStatus::NumericalFailure;
}

template <RealScalar S>
bool MassSpringImpulses<S>::find_mobility() {
  all_.assign(vertices_.begin(), vertices_.end());
  const auto changes = ws_->factor_changes.list();
  for (const detail::FactorChange<Scalar>& change : changes) {
    for (std::size_t k = 0; k < 3 && change.vertex[k] >= 0; ++k) {
      if (place(change.vertex[k]) == static_cast<Index>(all_.size()))
        all_.push_back(change.vertex[k]);
    }
  }
  const Index n = 3 * static_cast<Index>(all_.size());
  auto W = mobility_.topLeftCorner(n, n);
  if (!ws_->factor.inverse_block(all_, memory_, W)) return false;
  for (std::size_t i = 0; i < all_.size(); ++i) {
    if (!ws_->is_held(all_[i])) continue;
    W.template middleRows<3>(3 * static_cast<Index>(i)).setZero();
    W.template middleCols<3>(3 * static_cast<Index>(i)).setZero();
  }
  const auto number = [this](int vertex) { return place(vertex); };
  bool good = true;
  for (const detail::FactorChange<Scalar>& change : changes)
    good = good && detail::add_change<Scalar>(change, number, W, rows_);
  return good;
}

template <RealScalar S>
void MassSpringImpulses<S>::apply(const Eigen::Ref<const VectorX<Scalar>>& p) {
  assert(p.size() == 3 * point_count());
  change_.setZero();
  if (vertices_.empty()) return;
  auto more = more_.head(p.size());
  more = p - expected_.head(p.size());
  expected_.setZero();
  ws_->holds_expected = false;
  for (Index i = 0; i < point_count(); ++i)
    add_to_change(vertices_[static_cast<std::size_t>(i)], more.template segment<3>(3 * i));
  // The factor does not know of the changes: A u = p - Σ Gᵀ D G u.
  const Index n = 3 * static_cast<Index>(all_.size());
  answer_.head(n).noalias() = mobility_.topLeftCorner(n, p.size()) * more;
  for (const detail::FactorChange<Scalar>& c : ws_->factor_changes.list()) {
    const Vector3<Scalar> back =
        c.block * detail::at_contact(c, answer_, [this](int vertex) { return place(vertex); });
    for (std::size_t k = 0; k < 3 && c.vertex[k] >= 0; ++k)
      add_to_change(c.vertex[k], Vector3<Scalar>(-c.weight[static_cast<Index>(k)] * back));
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

template <RealScalar S>
template <class More>
void MassSpringImpulses<S>::update_contacts(ObstacleContacts<Scalar>& contacts, More more) const {
  if (ws_ == nullptr || !ws_->linear) return;
  const std::span<ObstacleContact<Scalar>> list = contacts.contacts();
  const auto& springs = ws_->contact_springs;
  // What keeps the sheet out of thin obstacles adds contacts behind those of the step.
  if (list.size() < springs.size()) return;
  for (std::size_t i = 0; i < springs.size(); ++i) {
    if (!springs[i].closed) continue;
    ObstacleContact<Scalar>& c = list[i];
    Vector3<Scalar> way = Vector3<Scalar>::Constant(Scalar(0));
    for (int k = 0; k < c.point.vertex_count(); ++k)
      way += c.point.weight[k] * change_of(c.point.vertex[static_cast<std::size_t>(k)]);
    const Vector3<Scalar> impulse = Scalar(-1) * (springs[i].block * way);
    c.impulse += impulse;
    c.carried += Scalar(detail::ContactSprings<Scalar>::kCarry) *
                 c.point.surface.normal.dot(impulse) / ws_->dt;
    more(i, impulse);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI
