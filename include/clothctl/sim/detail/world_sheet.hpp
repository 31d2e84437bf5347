#pragma once

// A sheet of any model within a world: the model, its state, and the memory of its steps.

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/contact/obstacle_contacts.hpp"
#include "clothctl/contact/obstacle_guard.hpp"
#include "clothctl/contact/sheet_impacts.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/network/spring_network.hpp"
#include "clothctl/sim/detail/sheet_side.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A sheet whose model is not known.
template <RealScalar Scalar>
class WorldSheet {
 public:
  virtual ~WorldSheet() = default;
  /// Makes a step with `contacts`, and keeps the sheet out of what is thin.
  virtual StepReport<Scalar> step(const Scalar& dt, const ClothInput<Scalar>& now) = 0;
  /// The network of the model, and its pinned vertices.
  virtual const SpringNetwork<Scalar>& network() const = 0;
  virtual const std::vector<int>& pinned() const = 0;

  /// Makes room for vertices that pads touch. Allocates. Returns an empty string, or why it cannot.
  virtual std::string reserve_touched(Index vertices) = 0;
  /// Prepares `side` for the vertices, after a step.
  virtual StepStatus attach(std::span<const int> vertices) = 0;
  /// The answer to impulses at the vertices, and the number of a vertex there.
  virtual ImpulseResponseRef<Scalar> side() = 0;
  virtual int point(int vertex) const = 0;
  /// What the patches that pads hold are found by; null where the answer does not need them.
  virtual const VertexNeighbours<Scalar>* neighbours() const = 0;
  /// Takes what impulses changed in `side` within a step of `dt` s.
  virtual void take_side(const Scalar& dt) = 0;

  /// Lists the contacts of a step of `dt` s.
  QueryStatus find_contacts(const Scalar& dt) {
    const QueryStatus status = finder.update(state.positions);
    if (status != QueryStatus::Answered) return status;
    return contacts.update(obstacles, state.velocities, dt, finder);
  }
  /// Whether a vertex touches an obstacle, or did in the last step; `counts(k)` says which
  /// obstacles count, by their number in the world.
  template <class Counts>
  bool lies(int v, Counts counts) const {
    const Scalar most = Scalar(2) * contacts.settings().thickness;
    for (const ObstacleContact<Scalar>& c : contacts.contacts()) {
      const auto& on = c.point.vertex;
      if (std::find(on.begin(), on.end(), v) == on.end() ||
          !counts(obstacle_number[static_cast<std::size_t>(c.obstacle)]))
        continue;
      if (c.state != ContactState::Open || c.point.surface.distance < most) return true;
    }
    return false;
  }
  /// Writes the inverse masses (n, 1/kg): 0 for what is prescribed.
  template <class Out>
  void write_inverse_masses(Out&& out) const {
    const VectorX<Scalar>& mass = network().mass;
    for (Index v = 0; v < mass.size(); ++v) out[v] = Scalar(1) / mass[v];
    for (const int v : pinned()) out[v] = Scalar(0);
    for (const int v : input.driven_vertices) out[v] = Scalar(0);
  }
  /// Adds what the obstacles of a step of `dt` s hold up.
  void add_supports(const Scalar& dt, std::vector<SheetSupport<Scalar>>& list) const {
    const Scalar thickness = contacts.settings().thickness;
    for (const ObstacleContact<Scalar>& c : contacts.contacts()) {
      if (list.size() == list.capacity()) return;
      SheetSupport<Scalar> support;
      const SurfacePoint<Scalar>& there = c.point.surface;
      for (std::size_t k = 0; k < 3; ++k)
        support.vertex[k] =
            c.point.vertex[k] < 0 ? -1 : static_cast<int>(first) + c.point.vertex[k];
      support.weight = c.point.weight;
      support.normal = there.normal;
      support.level = there.normal.dot(Vector3<Scalar>(there.point + dt * there.velocity)) +
                      thickness - c.point.slack;
      list.push_back(support);
    }
  }

  ClothState<Scalar> state;
  /// The input as the user gives it, and that of a part of a step.
  ClothInput<Scalar> input, part;
  SheetContactFinder<Scalar> finder;
  ObstacleContacts<Scalar> contacts;
  /// The obstacles that it may touch, and the number of each in the world's list.
  std::vector<ColliderRef<Scalar>> obstacles;
  std::vector<int> obstacle_number;
  /// What pads hold, without pinned and driven vertices; empty where `neighbours` returns null.
  GripPatches<Scalar> grip;
  /// Number of its first vertex among those of all sheets that meet each other; -1 if it does not.
  Index first = -1;

 protected:
  WorldSheet(ClothState<Scalar> s, SheetContactFinder<Scalar> f, ObstacleContacts<Scalar> c)
      : state(std::move(s)), finder(std::move(f)), contacts(std::move(c)) {
    input.clear();
    part.clear();
  }
};

/// Returns the segments of ropes in a network: springs, other than those of bending, with an end on
/// no triangle that at most two of them have. Allocates.
template <RealScalar Scalar>
std::vector<std::array<int, 2>> thread_edges(const SpringNetwork<Scalar>& network) {
  std::vector<bool> on_surface(static_cast<std::size_t>(network.vertex_count()), false);
  for (const std::array<int, 3>& t : network.triangles) {
    for (const int v : t) on_surface[static_cast<std::size_t>(v)] = true;
  }
  std::vector<int> springs(on_surface.size(), 0);
  for (const Spring<Scalar>& s : network.springs) {
    if (s.kind == SpringKind::Bend) continue;
    for (const int v : {s.a, s.b}) ++springs[static_cast<std::size_t>(v)];
  }
  const auto of_rope = [&](int v) {
    const std::size_t i = static_cast<std::size_t>(v);
    return !on_surface[i] && springs[i] <= 2;
  };
  std::vector<std::array<int, 2>> out;
  for (const Spring<Scalar>& s : network.springs) {
    if (s.kind != SpringKind::Bend && (of_rope(s.a) || of_rope(s.b))) out.push_back({s.a, s.b});
  }
  return out;
}

/// A sheet of a model.
template <class Model>
class WorldSheetOf : public WorldSheet<typename Model::Scalar> {
 public:
  using Scalar = typename Model::Scalar;

  WorldSheetOf(Model m, ClothState<Scalar> s, SheetContactFinder<Scalar> f,
               ObstacleContacts<Scalar> c, Index room)
      : WorldSheet<Scalar>(std::move(s), std::move(f), std::move(c)),
        model_(std::move(m)),
        ws_(model_.make_workspace(room)),
        guard_(ObstacleGuard<Scalar>::create(model_.vertex_count(), model_.network().triangles)),
        inverse_mass_(model_.network().mass) {}

  StepReport<Scalar> step(const Scalar& dt, const ClothInput<Scalar>& now) override {
    side_.carry(this->grip, this->state, ws_);
    StepReport<Scalar> report = model_.step(this->state, now, this->contacts, dt, ws_);
    if (!report.advanced) return report;
    this->write_inverse_masses(inverse_mass_);
    side_.hold(inverse_mass_);
    const ObstacleGuardReport kept = guard_.resolve(this->obstacles, this->finder.positions(),
                                                    inverse_mass_, dt, this->contacts, this->state);
    this->write_inverse_masses(inverse_mass_);
    side_.release(model_, now, dt, ws_);
    if (0 < kept.left) report.status = StepStatus::IterationLimit;
    return report;
  }
  const SpringNetwork<Scalar>& network() const override { return model_.network(); }
  const std::vector<int>& pinned() const override { return model_.settings().pinned; }

  std::string reserve_touched(Index vertices) override { return side_.create(model_, vertices); }
  StepStatus attach(std::span<const int> vertices) override {
    return side_.attach(vertices, this->state, ws_, inverse_mass_);
  }
  ImpulseResponseRef<Scalar> side() override { return side_.side(); }
  int point(int vertex) const override { return side_.point(vertex); }
  const VertexNeighbours<Scalar>* neighbours() const override { return side_.neighbours(); }
  void take_side(const Scalar& dt) override {
    side_.take(dt, 0 < this->contacts.report().closed, ws_);
  }

 private:
  Model model_;
  typename Model::Workspace ws_;
  SheetSide<Model> side_;
  ObstacleGuard<Scalar> guard_;
  VectorX<Scalar> inverse_mass_;  // in the last step
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
