#pragma once

// The simulation of hand_track: a robot follows a path by stable PD control. Forward dynamics turns
// torques into accelerations, and symplectic Euler steps advance the state.

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/io/html_player.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "clothctl/robot/stable_pd.hpp"
#include "support/hand_figures.hpp"
#include "support/hand_path.hpp"
#include "support/hand_shape.hpp"
#include "support/options.hpp"
#include "support/timing.hpp"

namespace program {

/// The user's options.
struct TrackRequest {
  std::string model, out, form = "stable";
  double step = 0.01, kp = 800, kd = 100, seconds = 8;
  bool no_gravity = false, hold = false, json = false;
};

/// The points that are compared with the path: the palm's origin and the fingertips.
class Marks {
 public:
  explicit Marks(const clothctl::KinematicTree<double>& tree)
      : tree_(tree), tips_(chain_ends(tree)), body_poses_(tree) {
    // The palm is the body with the most children.
    std::vector<int> hanging(tree.bodies().size(), 0);
    for (const clothctl::Body<double>& body : tree.bodies()) {
      if (body.parent >= 0) ++hanging[static_cast<std::size_t>(body.parent)];
    }
    const auto most = std::max_element(hanging.begin(), hanging.end());
    if (*most > 1) palm_ = static_cast<int>(most - hanging.begin());
  }

  clothctl::Index count() const {
    return static_cast<clothctl::Index>(tips_.size()) + (palm_ >= 0 ? 1 : 0);
  }
  std::vector<std::string> names() const {
    std::vector<std::string> names;
    for (const int tip : tips_) names.push_back(tree_.links()[static_cast<std::size_t>(tip)].name);
    if (palm_ >= 0) names.push_back("palm");
    return names;
  }
  const clothctl::BodyPoses<double>& body_poses() const { return body_poses_; }

  /// Places the robot at q and writes the positions of these points.
  void place(const Eigen::VectorXd& q, Eigen::Matrix3Xd& out) {
    clothctl::forward_kinematics<double>(tree_, q, body_poses_);
    out.resize(3, count());
    for (std::size_t k = 0; k < tips_.size(); ++k) {
      out.col(static_cast<clothctl::Index>(k)) =
          clothctl::link_pose(tree_, body_poses_, tips_[k]).p;
    }
    if (palm_ >= 0) out.col(count() - 1) = body_poses_.poses[static_cast<std::size_t>(palm_)].p;
  }

 private:
  const clothctl::KinematicTree<double>& tree_;
  std::vector<int> tips_;
  clothctl::BodyPoses<double> body_poses_;
  int palm_ = -1;
};

/// Results of a run.
struct TrackFigures {
  std::string status = "finished";
  clothctl::Index steps = 0, clipped_steps = 0, saturated_steps = 0;
  double lag = 0, straight_lag = 0, speed = 0;               // m, m/s
  double start = 0, end = 0, largest = 0, largest_rise = 0;  // energies (J); the rise over 0.1 s
  bool has_straight = false;
  std::vector<double> microseconds;
};

/// A robot, its controller and its simulation.
class TrackRun {
 public:
  TrackRun(const clothctl::KinematicTree<double>& tree, const Eigen::VectorXd& home,
           const TrackRequest& o)
      : tree_(tree), o_(o), path_(tree, home, o.hold), marks_(tree), work_(tree), mass_work_(tree) {
    const clothctl::Index n = tree.nv();
    auto settings = clothctl::StablePdSettings<double>::uniform(n, o.kp, o.kd);
    if (o.form == "paper") settings.feed_gravity = settings.feed_velocity = false;
    if (o.form == "implicit") settings.form = clothctl::PdForm::Implicit;
    settings.dt = o.step;
    pd_.push_back(
        must(clothctl::StablePd<clothctl::KinematicTree<double>>::create(tree, settings)));
    if (o.no_gravity) work_.gravity.setZero();
    M_.resize(n, n);
    for (Eigen::VectorXd* v : {&torques_, &planned_, &acceleration_, &error_, &step_})
      v->setZero(n);
    path_.at(0, q_, qd_);
    if (o.hold) {
      tree.advance(q_, Eigen::VectorXd::Constant(n, 0.1), q_);
      q_ = q_.cwiseMax(tree.lower()).cwiseMin(tree.upper());
    }
    qd_.setZero();
  }

  /// Coordinates whose gains are outside the stable range at the start.
  std::vector<std::string> unstable() {
    std::vector<std::string> names;
    const std::vector<clothctl::Index> found = must(pd_[0].unstable_at(tree_, q_, work_));
    for (const clothctl::Index i : found) {
      for (const clothctl::Body<double>& body : tree_.bodies()) {
        if (body.velocity <= i &&
            i < body.velocity + (body.type == clothctl::JointType::Free ? 6 : 1) && !body.follows)
          names.push_back(body.name);
      }
    }
    return names;
  }

  TrackFigures run(clothctl::PlayerRecorder* recorder, const HandShape& shape,
                   clothctl::Index every) {
    TrackFigures f;
    const clothctl::Index steps = static_cast<clothctl::Index>(std::lround(o_.seconds / o_.step));
    const std::size_t window = static_cast<std::size_t>(std::max(1L, std::lround(0.1 / o_.step)));
    std::vector<double> energies;
    Progress progress;
    Eigen::VectorXd wanted = q_, wanted_speed = qd_;
    path_.at(0, wanted, wanted_speed);
    for (clothctl::Index k = 0;; ++k) {
      const double now = o_.step * static_cast<double>(k);
      marks_.place(wanted, wanted_places_);
      marks_.place(q_, places_);
      const double lag = (places_ - wanted_places_).colwise().norm().maxCoeff();
      if (now >= 0.5) f.lag = std::max(f.lag, lag);
      if (now >= 0.5 && path_.is_straight(now - o_.step, now)) {
        f.straight_lag = std::max(f.straight_lag, lag);
        f.has_straight = true;
      }
      energies.push_back(energy(wanted));
      if (energies.size() > window)
        f.largest_rise =
            std::max(f.largest_rise, energies.back() - energies[energies.size() - 1 - window]);
      if (!clothctl::is_finite(energies.back()) || !clothctl::is_finite(lag) || lag > 1 ||
          qd_.cwiseAbs().maxCoeff() > 1e6) {
        f.status = "diverged at " + clothctl::number_text(now) + " s";
        f.lag = std::max(f.lag, lag);
        break;
      }
      if (recorder != nullptr && k % every == 0) {
        place_hand(shape, marks_.body_poses(), vertices_);
        recorder->add_frame(vertices_, places_, wanted_places_, Eigen::Matrix3Xd(3, 0),
                            Eigen::Matrix3Xd(3, 0));
      }
      if (k == steps) break;
      progress.show(k, steps);
      path_.at(now + o_.step, wanted, wanted_speed);
      if (std::string fault = step(wanted, wanted_speed, f); !fault.empty()) {
        f.status = fault + " at " + clothctl::number_text(now) + " s";
        break;
      }
      ++f.steps;
    }
    f.start = energies.front();
    f.end = energies.back();
    f.largest = *std::max_element(energies.begin(), energies.end());
    return f;
  }

  const HandPath& path() const { return path_; }
  Marks& marks() { return marks_; }
  const Eigen::VectorXd& position() const { return q_; }

 private:
  /// Kinetic energy plus the energy of the springs to the commanded position.
  double energy(const Eigen::VectorXd& wanted) {
    clothctl::mass_matrix<double>(tree_, marks_.body_poses(), mass_work_, M_);
    tree_.difference(q_, wanted, error_);
    return 0.5 * qd_.dot(M_ * qd_) + 0.5 * o_.kp * error_.squaredNorm();
  }

  /// Advances controller and simulator by one step. Returns an error message, or "".
  std::string step(const Eigen::VectorXd& wanted, const Eigen::VectorXd& wanted_speed,
                   TrackFigures& f) {
    const Eigen::VectorXd none;
    const double before = thread_seconds();
    const clothctl::PdReport report =
        pd_[0].solve(tree_, q_, qd_, wanted, wanted_speed, none, work_, torques_, planned_);
    f.microseconds.push_back(1e6 * (thread_seconds() - before));
    if (report.status != clothctl::PdStatus::Solved && report.status != clothctl::PdStatus::Clipped)
      return "controller: " + std::string(to_string(report.status)) + at_joint(report.coordinate);
    f.clipped_steps += report.status == clothctl::PdStatus::Clipped ? 1 : 0;
    f.saturated_steps += report.saturated > 0 ? 1 : 0;
    using Traits = clothctl::articulated_traits<clothctl::KinematicTree<double>>;
    Traits::forward_kinematics(tree_, q_, work_);
    const clothctl::Index missing =
        Traits::forward_dynamics(tree_, qd_, torques_, none, work_, acceleration_);
    if (missing >= 0) return "simulator: no finite acceleration" + at_joint(missing);
    qd_ += o_.step * acceleration_;
    step_ = o_.step * qd_;
    tree_.advance(q_, step_, q_);
    return {};
  }

  std::string at_joint(clothctl::Index coordinate) const {
    for (const clothctl::Body<double>& body : tree_.bodies()) {
      if (body.velocity == coordinate) return " of joint '" + body.name + "'";
    }
    return {};
  }

  const clothctl::KinematicTree<double>& tree_;
  const TrackRequest& o_;
  HandPath path_;
  Marks marks_;
  clothctl::KinematicTreeWorkspace<double> work_;
  clothctl::MassMatrixWorkspace<double> mass_work_;
  std::vector<clothctl::StablePd<clothctl::KinematicTree<double>>> pd_;
  Eigen::MatrixXd M_;
  Eigen::VectorXd q_, qd_, torques_, planned_, acceleration_, error_, step_;
  Eigen::Matrix3Xd places_, wanted_places_, vertices_;
};

/// Returns the positions at the start: hand34_home for the library's own hand; in other hands,
/// joints that bend like fingers are at 0.3 of their range.
inline Eigen::VectorXd find_home(const clothctl::KinematicTree<double>& tree) {
  if (tree.find_joint("index_mcp_flex") >= 0) return clothctl::hand34_home<double>(tree);
  Eigen::VectorXd home = tree.neutral();
  for (const clothctl::Body<double>& body : tree.bodies()) {
    const clothctl::Index i = body.position;
    if (body.type != clothctl::JointType::Revolute || body.follows) continue;
    const double low = tree.lower()[i], high = tree.upper()[i];
    if (high - low < 2.5 && high > 2 * std::abs(low)) home[i] = low + 0.3 * (high - low);
  }
  return home;
}

}  // namespace program
