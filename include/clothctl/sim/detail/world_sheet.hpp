#pragma once

// A sheet of any model within a world: the model, its state, and the memory of its steps.

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/colliding_cloth.hpp"
#include "clothctl/contact/obstacle_contacts.hpp"
#include "clothctl/contact/obstacle_guard.hpp"
#include "clothctl/contact/sheet_impacts.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/sim/detail/sheet_side.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What a world reads of a model, once.
template <RealScalar Scalar>
struct SheetMesh {
  Points<Scalar> rest_positions;
  VectorX<Scalar> mass;
  std::vector<std::array<int, 3>> triangles;
  std::vector<int> pinned;
  std::vector<std::array<int, 2>> rope_segments;

  template <class Model>
  static SheetMesh of(const Model& model) {
    using Traits = colliding_cloth_traits<Model>;
    SheetMesh out;
    out.rest_positions = ClothState<Scalar>(cloth_traits<Model>::rest_state(model)).positions;
    out.mass = VectorX<Scalar>(Traits::masses(model));
    out.triangles = std::vector<std::array<int, 3>>(Traits::triangles(model));
    if constexpr (requires { Traits::pinned(model); })
      out.pinned = std::vector<int>(Traits::pinned(model));
    if constexpr (requires { Traits::rope_segments(model); })
      out.rope_segments = std::vector<std::array<int, 2>>(Traits::rope_segments(model));
    return out;
  }
  Index vertex_count() const { return rest_positions.cols(); }
  /// Returns an empty string, or what is wrong with the masses or the pinned vertices.
  std::string validate() const {
    const Index n = vertex_count();
    if (mass.size() != n)
      return std::to_string(mass.size()) + " masses for " + std::to_string(n) + " vertices";
    for (Index v = 0; v < n; ++v) {
      if (!is_finite(mass[v]) || !(Scalar(0) < mass[v]))
        return "mass of vertex " + std::to_string(v) + " must be positive and finite, got " +
               number_text(mass[v]) + " kg";
    }
    return find_bad_vertex(pinned, n, false, "pinned vertex");
  }
};

/// A sheet whose model is not known.
template <RealScalar Scalar>
class WorldSheet {
 public:
  virtual ~WorldSheet() = default;
  /// Makes a step with `contacts`, and keeps the sheet out of what is thin.
  virtual StepReport<Scalar> step(const Scalar& dt, const ClothInput<Scalar>& now) = 0;

  /// Makes room for vertices that pads touch. Allocates. Returns an empty string, or why it cannot.
  virtual std::string reserve_touched(Index vertices) = 0;
  /// Tells, before a step, which impulses (N s) `side` is likely to receive after it.
  virtual void expect(std::span<const int> vertices, const PointsView<Scalar>& impulses) = 0;
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
  /// Returns the gap of a contact of a step of `dt` s at its end, m, from the state that the sheet
  /// has now.
  Scalar gap_after(const ObstacleContact<Scalar>& c, const Scalar& dt) const {
    const SurfacePoint<Scalar>& there = c.point.surface;
    Vector3<Scalar> way = (Scalar(0) - dt) * there.velocity;
    for (std::size_t k = 0; k < 3 && 0 <= c.point.vertex[k]; ++k)
      way += c.point.weight[static_cast<Index>(k)] *
             (state.positions.col(c.point.vertex[k]) - finder.positions().col(c.point.vertex[k]));
    return there.distance + c.point.slack - contacts.settings().thickness + there.normal.dot(way);
  }
  /// Returns the largest depth of the contacts of a step of `dt` s below the thickness at its end,
  /// m; 0 if none.
  Scalar depth(const Scalar& dt) const {
    Scalar least = Scalar(0);
    for (const ObstacleContact<Scalar>& c : contacts.contacts()) {
      const Scalar gap = gap_after(c, dt);
      if (gap < least) least = gap;
    }
    return Scalar(0) - least;
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
    for (Index v = 0; v < mesh.mass.size(); ++v) out[v] = Scalar(1) / mesh.mass[v];
    for (const int v : mesh.pinned) out[v] = Scalar(0);
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

  SheetMesh<Scalar> mesh;
  ClothState<Scalar> state;
  /// The input as the user gives it, and that of a part of a step.
  ClothInput<Scalar> input, part;
  SheetContactFinder<Scalar> finder;
  ObstacleContacts<Scalar> contacts;
  /// The obstacles that it may touch, and the number of each in the world's list.
  std::vector<ColliderRef<Scalar>> obstacles;
  std::vector<int> obstacle_number;
  /// Sum of the magnitudes of what the sheet expects of pads in its step, N s.
  Scalar expected_impulse = Scalar(0);
  /// The part of each contact's impulse that a body received (body_coupling.hpp).
  std::vector<Scalar> shares;
  /// What the last `take_side` changed in the impulse of each contact, N s; empty before.
  std::vector<Vector3<Scalar>> strained;
  /// What pads hold, without pinned and driven vertices; empty where `neighbours` returns null.
  GripPatches<Scalar> grip;
  /// Number of its first vertex among those of all sheets that meet each other; -1 if it does not.
  Index first = -1;

 protected:
  WorldSheet(SheetMesh<Scalar> m, ClothState<Scalar> s, SheetContactFinder<Scalar> f,
             ObstacleContacts<Scalar> c)
      : mesh(std::move(m)), state(std::move(s)), finder(std::move(f)), contacts(std::move(c)) {
    input.clear();
    part.clear();
    strained.reserve(contacts.capacity());
    shares.reserve(contacts.capacity());
  }
};

/// A sheet of a model.
template <class Model, RealScalar Scalar>
class WorldSheetOf : public WorldSheet<Scalar> {
 public:
  using Traits = colliding_cloth_traits<Model>;

  WorldSheetOf(Model m, SheetMesh<Scalar> parts, ClothState<Scalar> s, SheetContactFinder<Scalar> f,
               ObstacleContacts<Scalar> c, Index room)
      : WorldSheet<Scalar>(std::move(parts), std::move(s), std::move(f), std::move(c)),
        model_(std::move(m)),
        ws_(Traits::make_workspace(model_, room)),
        guard_(ObstacleGuard<Scalar>::create(this->mesh.vertex_count(), this->mesh.triangles)),
        inverse_mass_(this->mesh.mass) {}

  StepReport<Scalar> step(const Scalar& dt, const ClothInput<Scalar>& now) override {
    side_.carry(this->grip, this->state, ws_);
    StepReport<Scalar> report = Traits::step(model_, this->state, now, this->contacts, dt, ws_);
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

  std::string reserve_touched(Index vertices) override { return side_.create(model_, vertices); }
  void expect(std::span<const int> vertices, const PointsView<Scalar>& impulses) override {
    using std::sqrt;
    if constexpr (requires { side_.expect(vertices, impulses, ws_); }) {
      side_.expect(vertices, impulses, ws_);
      this->expected_impulse = Scalar(0);
      for (Index k = 0; k < impulses.cols(); ++k)
        this->expected_impulse += sqrt(impulses.col(k).squaredNorm());
    }
  }
  StepStatus attach(std::span<const int> vertices) override {
    return side_.attach(vertices, this->state, ws_, inverse_mass_);
  }
  ImpulseResponseRef<Scalar> side() override { return side_.side(); }
  int point(int vertex) const override { return side_.point(vertex); }
  const VertexNeighbours<Scalar>* neighbours() const override { return side_.neighbours(); }
  void take_side(const Scalar& dt) override {
    side_.take(dt, 0 < this->contacts.report().closed, ws_);
    const auto note = [this](std::size_t i, const Vector3<Scalar>& q) { this->strained[i] = q; };
    if constexpr (requires { side_.update_contacts(this->contacts, note); }) {
      this->strained.assign(this->contacts.contacts().size(), Vector3<Scalar>::Constant(Scalar(0)));
      side_.update_contacts(this->contacts, note);
    }
  }

 private:
  Model model_;
  decltype(Traits::make_workspace(std::declval<const Model&>(), Index())) ws_;
  SheetSide<Model, Scalar> side_;
  ObstacleGuard<Scalar> guard_;
  VectorX<Scalar> inverse_mass_;  // in the last step
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
