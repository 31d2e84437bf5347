#pragma once

// What a world (world.hpp) is made with, and what a step of it reports.

#include <array>
#include <string>
#include <vector>

#include "clothctl/contact/contact_solver.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/status.hpp"
#include "clothctl/sim/hand_setup.hpp"
#include "clothctl/sim/rigid_setup.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a sheet lives in a world.
template <RealScalar Scalar>
struct WorldSheetSetup {
  /// Thickness, m, 1e-6 to 1: layers rest that far from each other, and half as far from obstacles.
  /// Of sheets that meet each other, the largest counts for their layers.
  Scalar thickness = Scalar(2e-3);
  /// Whether it meets itself, and other sheets that have this set.
  bool meets_sheets = false;
  /// Pairs of vertices that count as one for that: seams, stitched layers.
  std::vector<std::array<int, 2>> joined = {};
  /// Equal parts that a step of the world is divided into, at least, 1 to 1000; those of the sheet
  /// that asks for most count. A thin sheet that a thin obstacle hits fast may need 2 to 4.
  int substeps = 1;
  /// Which obstacles and bodies it touches.
  CollisionGroups groups = {};
  /// Room for contacts, up to 1000000; 0: 4 for each vertex.
  Index contacts = 0;

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    if (!is_finite(thickness) || thickness < Scalar(1e-6) || Scalar(1) < thickness)
      return "the thickness " + number_text(thickness) + " m, must be from 1e-6 to 1";
    if (substeps < 1 || substeps > 1000)
      return std::to_string(substeps) + " substeps, must be 1 to 1000";
    if (contacts < 0 || contacts > 1000000)
      return "room for " + std::to_string(contacts) + " contacts, must be 0 to 1000000";
    return {};
  }
};

/// Settings of a world.
template <RealScalar Scalar>
struct WorldSettings {
  /// Settings of the rigid bodies. Gravity acts on bodies only: sheets have that of their models.
  RigidBodiesSettings<Scalar> bodies = {};
  /// Friction of sheets on sheets.
  Scalar sheet_friction = Scalar(0.3);

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    if (!is_finite(sheet_friction) || sheet_friction < Scalar(0))
      return "the sheet_friction " + number_text(sheet_friction) +
             ", must be finite and not negative";
    return bodies.validate();
  }
};

/// What a step of a world did.
template <RealScalar Scalar>
struct WorldReport {
  /// Converged; IterationLimit: advanced, but a sheet, a pad, a body or the layers have not
  /// settled: see the other entries. InvalidInput: `World::check_input` says why. Any other status
  /// is that of sheet `sheet`, of hand `hand`, of the pads where `pads` says so, else of the
  /// bodies; everything then is as before the step, but contacts of sheets with obstacles are
  /// forgotten.
  StepStatus status = StepStatus::Converged;
  /// The sheet or the hand that `status` is about.
  int sheet = -1, hand = -1;
  /// Whether the world was advanced.
  bool advanced = false;
  /// Equal or nearly equal parts that the step was divided into. Torques of hands and contacts of
  /// sheets with obstacles are those of the last part.
  int parts = 0;
  /// Contacts of sheets with obstacles and bodies that transmit a force, and pairs of layers.
  Index contacts = 0, layers = 0;
  /// Largest depth of a sheet below its distance from obstacles, m.
  Scalar penetration = Scalar(0);
  /// Largest residual of the contacts of sheets, N.
  Scalar force_residual = Scalar(0);
  /// Edges that cross a triangle of a sheet.
  int crossings = 0;
  /// False when contacts of a sheet may be missing: there was not room for all, or sheet and
  /// obstacle can get farther in a part of the step than contacts are looked for (0.2 m). A step is
  /// divided into up to 16 parts so that sheets do not.
  bool complete = true;
  /// The contacts of pads.
  ContactReport<Scalar> pads = {};
  /// The last hand whose controller did not end with PdStatus::Solved, and how it ended.
  PdReport control = {};
  /// The bodies.
  RigidStepReport<Scalar> bodies = {};
};

}  // namespace clothctl::inline CLOTHCTL_ABI
