#pragma once

// A plant whose engine steps by another length than the planner's frame.

#include <utility>

#include "clothctl/concepts/cloth.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Advances a plant by steps of one length, as many as are due. Models ClothPlant.
///
/// Driven vertices move evenly from where they are to where the input wants them at the end of the
/// frame; all else of an input is constant over the frame. If the frame is not a whole number of
/// steps, the engine is ahead of or behind the end of a frame by at most half a step, and what is
/// missing is made up for in the next frames.
template <class Plant, RealScalar S = typename Plant::Scalar>
requires ClothPlant<Plant, S>
class SteppedPlant {
 public:
  /// The scalar type.
  using Scalar = S;

  /// Takes a plant and the length of its steps, s. A length that is not positive and finite makes
  /// `advance` refuse.
  SteppedPlant(Plant plant, Scalar step) : plant_(std::move(plant)), step_(std::move(step)) {}

  /// Returns the plant.
  Plant& plant() { return plant_; }
  /// Returns by how much the plant is behind the end of the last frame, s; negative when it is
  /// ahead.
  const Scalar& behind() const { return behind_; }

  /// Returns the number of vertices.
  Index vertex_count() const { return Traits::vertex_count(plant_); }
  /// Returns the vertex positions, 3×n, m.
  decltype(auto) positions() const { return Traits::positions(plant_); }
  /// Returns the vertex velocities, 3×n, m/s.
  decltype(auto) velocities() const { return Traits::velocities(plant_); }
  /// Sets the input of the next frame. Allocates when it has more entries than those before.
  void apply(const ClothInput<Scalar>& input) { input_ = input; }

  /// Advances by the steps that are due after `dt` more seconds, which may be none. Returns the
  /// report of the last one. Allocates what the plant does. Fails when: `dt` or the length of a
  /// step is not positive and finite, a driven vertex is off the mesh, or their numbers differ
  /// (InvalidInput); or a step fails: the plant is then where that step began, and the frame is
  /// lost.
  [[nodiscard]] StepReport<Scalar> advance(Scalar dt) {
    StepReport<Scalar> report;
    report.advanced = good(dt) && good(step_) && take_start();
    if (!report.advanced) {
      report.status = StepStatus::InvalidInput;
      return report;
    }
    Scalar at = -behind_;  // where the plant is, from the start of the frame
    while (step_ <= Scalar(2) * (dt - at)) {
      at += step_;
      const Scalar share = dt < at ? Scalar(1) : at < Scalar(0) ? Scalar(0) : Scalar(at / dt);
      now_.driven_positions = start_ + share * (input_.driven_positions - start_);
      Traits::apply(plant_, now_);
      report = Traits::advance(plant_, step_);
      if (!report.advanced) {
        behind_ = Scalar(0);
        return report;
      }
    }
    behind_ = dt - at;
    return report;
  }

 private:
  using Traits = plant_traits<Plant>;

  static bool good(const Scalar& length) { return is_finite(length) && Scalar(0) < length; }

  /// Stores where the driven vertices are.
  bool take_start() {
    if (static_cast<Index>(input_.driven_vertices.size()) != input_.driven_positions.cols())
      return false;
    now_ = input_;
    start_ = input_.driven_positions;
    decltype(auto) measured = positions();  // a plant may return it by value
    const PointsView<Scalar> x = measured;
    Index column = 0;
    for (const int v : input_.driven_vertices) {
      if (v < 0 || x.cols() <= v) return false;
      start_.col(column++) = x.col(v);
    }
    return true;
  }

  Plant plant_;
  Scalar step_, behind_ = Scalar(0);
  ClothInput<Scalar> input_, now_;
  Points<Scalar> start_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
