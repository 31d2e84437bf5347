#pragma once

// Two pads of four samples that pinch a sheet near its upper left corner, from both sides.

#include <array>
#include <vector>

#include "clothctl/cloth/mass_spring_impulses.hpp"
#include "clothctl/contact/impulse_responses.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/sim/pad_contacts.hpp"

namespace program {

/// How the pads move and press.
struct PinchMotion {
  double force = 3.3;    ///< of each pad on the sheet, N
  double amplitude = 0;  ///< of a shake of 2 Hz along x, m
  double twist = 0;      ///< about their normals, rad/s
};

/// The pads, their contacts with the sheet and the solver.
class PinchPads {
 public:
  /// Number of samples of both pads.
  static constexpr clothctl::Index kSamples = 8;
  using Vector = clothctl::Vector3<double>;
  using Points = clothctl::Points<double>;
  using Model = clothctl::MassSpring<double>;

  static clothctl::Result<PinchPads> create(const clothctl::GridMesh<double>& grid,
                                            const clothctl::SpringNetwork<double>& network,
                                            const PinchMotion& motion,
                                            const clothctl::PadSettings<double>& pad);

  /// Finds the contacts with the sheet at `x` at time t, for a step of `dt`. Returns whether the
  /// sheet and the pads are finite.
  bool find(const Points& x, double t, double dt);
  /// Solves the contacts within the step that the model has just made of `state`, and applies the
  /// impulses. Returns whether they could be applied.
  bool solve(double dt, clothctl::ClothState<double>& state, Model::Workspace& ws,
             clothctl::MassSpringImpulses<double>& response);
  /// Remembers the points of the sheet that the samples touch now, for `slip`.
  void mark();
  /// Returns the way of the sheet between the pads from where it was marked: the mean of the
  /// samples' ways on the undeformed sheet, and the change of their mean spring; m. 0 before
  /// `mark`.
  double slip() const;
  /// Returns the largest way of the sheet under a single sample, m.
  double sample_slip() const;

  const clothctl::ContactReport<double>& report() const { return report_; }
  clothctl::Index contact_count() const { return static_cast<clothctl::Index>(count_); }
  /// Mean normal force of a pad in the last step, N.
  double normal_force(double dt) const;
  /// Share of the friction that is used: sum of tangential impulses / (μ sum of normal ones).
  double friction_use() const;
  /// Places of the samples, and the forces on the sheet there in the last step, N.
  Points places() const;
  Points forces(double dt) const;

 private:
  PinchPads() = default;

  /// The mean stretch of the samples' springs, m.
  Vector mean_offset() const;
  /// The points at rest that the samples touch; not finite for a sample that touches nothing.
  Points touched_at_rest() const;
  clothctl::RigidMotion<double> pose(std::size_t pad, double t, double dt) const;

  PinchMotion motion_;
  clothctl::PadSettings<double> settings_;
  std::vector<std::array<int, 3>> triangles_;
  Points rest_, marked_;
  Vector marked_offset_ = Vector::Zero();
  Vector inside_ = Vector::Zero();
  std::vector<clothctl::SheetContactFinder<double>> finder_;
  std::vector<clothctl::PadContacts<double>> pads_;
  std::vector<clothctl::KinematicResponse<double>> bodies_;
  clothctl::ContactSolver<double> solver_;
  clothctl::ContactReport<double> report_;
  std::vector<clothctl::ContactSample<double>> contacts_;
  std::vector<std::array<int, 3>> vertices_;  // of each contact
  std::vector<int> touched_;
  std::size_t count_ = 0;
};

}  // namespace program
