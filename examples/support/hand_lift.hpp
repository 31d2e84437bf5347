#pragma once

// Thumb and index of a hand34 push a flat sheet on a table into a bulge by friction, pinch it, and
// lift it.

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "clothctl/collision/shapes.hpp"
#include "clothctl/grasp/grasp_controller.hpp"
#include "clothctl/grasp/hand_geometry.hpp"
#include "clothctl/grasp/robot_clearance.hpp"
#include "clothctl/grasp/static_contacts.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/sim/world.hpp"
#include "support/hand_page.hpp"

namespace program {

/// The task.
struct LiftOptions {
  int cols = 61, rows = 72;  ///< vertices
  double width = 0.5;        ///< of a row, m
  clothctl::Material<double> material;
  double friction = 0.8, table_friction = 0.3;  ///< of fingertips and of the table on the sheet
  double press = 1.5, pinch = 3;                ///< normal force of each finger, N
  double height = 0.12;                         ///< to lift, m
  double dt = 0.02;
  long horizon = 10;
  int attempts = 2;  ///< after a lost or weak grasp the hand opens and tries again
  /// Of perturbations: friction and stiffness by up to 20 %, where the hand goes by up to 5 mm; 0:
  /// none.
  std::uint64_t seed = 0;
};

/// What came of it.
struct LiftFigures {
  std::string phase;          ///< the last one
  double lift_height_m = 0;   ///< of the held vertices at the end, above where they lay
  double bulge_height_m = 0;  ///< when the fingers begin to pinch it
  int attempts = 1;
  int firm = 0;  ///< grasps of two that became firm, in the last attempt
  int slips = 0;
  double force_sum = 0, ik_error_max_m = 0, rectify_residual_max_m = 0, torque_max_share = 0;
  double penetration_max_m = 0;        ///< of links into the table
  double sheet_penetration_max_m = 0;  ///< of the sheet into the table
  double feature_error_m = 0;          ///< mean distance of the features from their targets
  long held_steps = 0;
  std::vector<double> hand_ms, plan_ms;
};

/// The world and the run.
class TableLift {
 public:
  using Hand = clothctl::KinematicTree<double>;
  using Points = clothctl::Points<double>;

  /// Lays the sheet and brings the hand over it. `page`: whether frames are recorded.
  static clothctl::Result<std::unique_ptr<TableLift>> create(const LiftOptions& options, bool page);

  /// Presses, pushes, pinches and lifts. Returns what went wrong.
  std::string run();

  const LiftFigures& figures() const { return figures_; }
  clothctl::Index vertex_count() const { return grid_.positions.cols(); }
  /// Writes player.html to a folder. Returns what went wrong.
  std::string write_page(const std::string& folder,
                         std::vector<std::pair<std::string, std::string>> figures);

 private:
  explicit TableLift(const LiftOptions& options) : options_(options) {}
  std::string add_sheet();
  std::string add_hand();
  void begin_page();
  /// There are features only while the planner plans.
  void hide_features() { features_ = targets_ = Points::Constant(3, 6, std::nan("")); }
  /// Both fingers grasp along `press_`, and hold for `rest` s once that is firm.
  std::string take(clothctl::Grasp<double> grasp, double rest);
  /// The fingers press down, each by itself.
  std::string press();
  /// They follow planned motions of what they hold, towards each other.
  std::string push();
  /// They pinch the bulge between them.
  std::string pinch();
  std::string lift();
  /// All of that once.
  std::string attempt();
  /// The fingers let go.
  std::string open();
  /// One step of hand and world. Returns what went wrong.
  std::string step();
  std::string steps(double seconds);
  void measure(const clothctl::WorldReport<double>& report);
  /// The centre of a fingertip, m.
  clothctl::Vector3<double> tip(int finger) const;
  /// Moves a finger by what is planned for its vertices, but along the table only.
  void follow(int finger, const std::vector<int>& held, const Points& next);

  LiftOptions options_;
  clothctl::GridMesh<double> grid_;
  clothctl::World<double> world_;
  std::unique_ptr<clothctl::BoxCollider<double>> table_;
  Hand tree_;
  clothctl::HandGeometry<double> geometry_;
  clothctl::HandInWorld parts_;
  clothctl::Vector3<double> middle_;  // between the fingertips, on the table
  std::unique_ptr<clothctl::GraspController<Hand>> controller_;
  std::unique_ptr<clothctl::StaticContacts<double>> contacts_;
  std::unique_ptr<clothctl::RobotClearance<Hand>> links_;
  std::array<clothctl::Vector3<double>, 2> press_;  // the way that each finger presses
  clothctl::VectorX<double> wait_, touch_;          // positions before and where they touch
  clothctl::GraspReport<double> report_;
  std::string stage_;  // what the hand does
  LiftFigures figures_;
  Points features_{3, 0}, targets_{3, 0};  // for the page
  std::unique_ptr<HandView> view_;
  std::unique_ptr<HandPage> page_;
};

}  // namespace program
