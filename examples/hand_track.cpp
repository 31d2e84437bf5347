// A hand follows a path by stable PD control: the base goes around at 0.3 m/s while the fingers open and close. Torques go to
// the articulated-body simulator and symplectic Euler steps.
//
//   hand_track --step 0.02 --out folder      lag, energy, saturation, and a page that shows the hand
//   hand_track --form paper                  without feed-forward, as the paper prints it

#include <algorithm>
#include <cmath>

#include "clothctl/bridge/urdf.hpp"
#include "clothctl/io/html_player.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/mass_matrix.hpp"
#include "clothctl/robot/stable_pd.hpp"
#include "clothctl/robot/tree_model.hpp"
#include "support/hand_figures.hpp"
#include "support/hand_path.hpp"
#include "support/hand_shape.hpp"
#include "support/options.hpp"
#include "support/timing.hpp"

namespace {

using namespace program;
using clothctl::Index;
using clothctl::robot::Body;
using clothctl::robot::Kinematics;
using clothctl::robot::PdReport;
using clothctl::robot::PdStatus;
using clothctl::robot::Tree;
using Vector = Eigen::VectorXd;
using Points = Eigen::Matrix3Xd;
using Controller = clothctl::robot::StablePd<Tree<double>>;

struct Request {
  std::string model, out, form = "stable";
  double step = 0.01, kp = 800, kd = 100, seconds = 8;
  bool no_gravity = false, hold = false, json = false;
};

/// Places that are compared: the palm's origin and the finger tips.
class Marks {
 public:
  explicit Marks(const Tree<double>& tree) : tree_(tree), tips_(chain_ends(tree)), kinematics_(tree) {
    // The palm is the body on which most others hang.
    std::vector<int> hanging(tree.bodies().size(), 0);
    for (const Body<double>& body : tree.bodies()) {
      if (body.parent >= 0) ++hanging[static_cast<std::size_t>(body.parent)];
    }
    const auto most = std::max_element(hanging.begin(), hanging.end());
    if (*most > 1) palm_ = static_cast<int>(most - hanging.begin());
  }

  Index count() const { return static_cast<Index>(tips_.size()) + (palm_ >= 0 ? 1 : 0); }
  std::vector<std::string> names() const {
    std::vector<std::string> names;
    for (const int tip : tips_) names.push_back(tree_.links()[static_cast<std::size_t>(tip)].name);
    if (palm_ >= 0) names.push_back("palm");
    return names;
  }
  const Kinematics<double>& kinematics() const { return kinematics_; }

  /// Places the robot at q and writes where the marks are.
  void place(const Vector& q, Points& out) {
    clothctl::robot::forward_kinematics<double>(tree_, q, kinematics_);
    out.resize(3, count());
    for (std::size_t k = 0; k < tips_.size(); ++k) {
      out.col(static_cast<Index>(k)) = clothctl::robot::link_pose(tree_, kinematics_, tips_[k]).p;
    }
    if (palm_ >= 0) out.col(count() - 1) = kinematics_.places[static_cast<std::size_t>(palm_)].p;
  }

 private:
  const Tree<double>& tree_;
  std::vector<int> tips_;
  Kinematics<double> kinematics_;
  int palm_ = -1;
};

/// What a run came to.
struct Figures {
  std::string status = "finished";
  Index steps = 0, clipped_steps = 0, saturated_steps = 0;
  double lag = 0, straight_lag = 0, speed = 0;               // m, m/s
  double start = 0, end = 0, largest = 0, largest_rise = 0;  // energies (J); the rise over 0.1 s
  bool has_straight = false;
  std::vector<double> microseconds;
};

class Run {
 public:
  Run(const Tree<double>& tree, const Vector& home, const Request& o)
      : tree_(tree), o_(o), path_(tree, home, o.hold), marks_(tree), work_(tree), mass_work_(tree) {
    const Index n = tree.velocities();
    auto settings = clothctl::robot::StablePdSettings<double>::uniform(n, o.kp, o.kd);
    if (o.form == "paper") settings.feed_gravity = settings.feed_velocity = false;
    if (o.form == "implicit") settings.form = clothctl::robot::PdForm::Implicit;
    settings.step = o.step;
    pd_.push_back(must(Controller::make(tree, settings)));
    if (o.no_gravity) work_.gravity.setZero();
    M_.resize(n, n);
    for (Vector* v : {&torques_, &planned_, &acceleration_, &error_, &step_}) v->setZero(n);
    path_.at(0, q_, qd_);
    if (o.hold) {
      tree.advance(q_, Vector::Constant(n, 0.1), q_);
      q_ = q_.cwiseMax(tree.lower()).cwiseMin(tree.upper());
    }
    qd_.setZero();
  }

  /// Coordinates whose gains are outside the stable range at the start.
  std::vector<std::string> unstable() {
    std::vector<std::string> names;
    for (const Index i : pd_[0].unstable_at(tree_, q_, work_)) {
      for (const Body<double>& body : tree_.bodies()) {
        if (body.velocity <= i && i < body.velocity + (body.type == clothctl::robot::JointType::Free ? 6 : 1) && !body.follows)
          names.push_back(body.name);
      }
    }
    return names;
  }

  Figures run(clothctl::PlayerRecorder* recorder, const HandShape& shape, Index every) {
    Figures f;
    const Index steps = static_cast<Index>(std::lround(o_.seconds / o_.step));
    const std::size_t window = static_cast<std::size_t>(std::max(1L, std::lround(0.1 / o_.step)));
    std::vector<double> energies;
    Progress progress;
    Vector wanted = q_, wanted_speed = qd_;
    path_.at(0, wanted, wanted_speed);
    for (Index k = 0;; ++k) {
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
        f.largest_rise = std::max(f.largest_rise, energies.back() - energies[energies.size() - 1 - window]);
      if (!clothctl::is_finite(energies.back()) || !clothctl::is_finite(lag) || lag > 1 || qd_.cwiseAbs().maxCoeff() > 1e6) {
        f.status = "diverged at " + clothctl::number_text(now) + " s";
        f.lag = std::max(f.lag, lag);
        break;
      }
      if (recorder != nullptr && k % every == 0) {
        place_hand(shape, marks_.kinematics(), vertices_);
        recorder->add_frame(vertices_, places_, wanted_places_, Points(3, 0), Points(3, 0));
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
  const Vector& position() const { return q_; }

 private:
  /// Kinetic energy, and the spring's to where the robot should be.
  double energy(const Vector& wanted) {
    clothctl::robot::mass_matrix<double>(tree_, marks_.kinematics(), mass_work_, M_);
    tree_.difference(q_, wanted, error_);
    return 0.5 * qd_.dot(M_ * qd_) + 0.5 * o_.kp * error_.squaredNorm();
  }

  /// One step of controller and simulator; answers what went wrong, or "".
  std::string step(const Vector& wanted, const Vector& wanted_speed, Figures& f) {
    const Vector none;
    const double before = thread_seconds();
    const PdReport report = pd_[0].solve(tree_, q_, qd_, wanted, wanted_speed, none, work_, torques_, planned_);
    f.microseconds.push_back(1e6 * (thread_seconds() - before));
    if (report.status != PdStatus::Solved && report.status != PdStatus::Clipped)
      return "controller: " + std::string(to_string(report.status)) + at_joint(report.coordinate);
    f.clipped_steps += report.status == PdStatus::Clipped ? 1 : 0;
    f.saturated_steps += report.saturated > 0 ? 1 : 0;
    using Traits = clothctl::articulated_traits<Tree<double>>;
    Traits::place(tree_, q_, work_);
    const Index missing = Traits::forward_dynamics(tree_, qd_, torques_, none, work_, acceleration_);
    if (missing >= 0) return "simulator: no finite acceleration" + at_joint(missing);
    qd_ += o_.step * acceleration_;
    step_ = o_.step * qd_;
    tree_.advance(q_, step_, q_);
    return {};
  }

  std::string at_joint(Index coordinate) const {
    for (const Body<double>& body : tree_.bodies()) {
      if (body.velocity == coordinate) return " of joint '" + body.name + "'";
    }
    return {};
  }

  const Tree<double>& tree_;
  const Request& o_;
  HandPath path_;
  Marks marks_;
  clothctl::robot::TreeWorkspace<double> work_;
  clothctl::robot::MassMatrixWorkspace<double> mass_work_;
  std::vector<Controller> pd_;
  Eigen::MatrixXd M_;
  Vector q_, qd_, torques_, planned_, acceleration_, error_, step_;
  Points places_, wanted_places_, vertices_;
};

/// Where the hand starts from: our own hand's home, or as far from its lower limits as a relaxed finger is.
Vector find_home(const Tree<double>& tree) {
  if (tree.find_joint("index_mcp_flex") >= 0) return clothctl::robot::hand34_home<double>(tree);
  Vector home = tree.neutral();
  for (const Body<double>& body : tree.bodies()) {
    const Index i = body.position;
    if (body.type != clothctl::robot::JointType::Revolute || body.follows) continue;
    const double low = tree.lower()[i], high = tree.upper()[i];
    if (high - low < 2.5 && high > 2 * std::abs(low)) home[i] = low + 0.3 * (high - low);
  }
  return home;
}

}  // namespace

int main(int argc, char** argv) {
  Request o;
  CLI::App app{
      "A hand follows keyframes by stable PD control, in a simulation of its bodies. Exit code 0: finished; 1: it diverged; 2: "
      "bad input."};
  const auto named = [](const std::string& text) { return text.empty() ? std::string("is empty") : std::string(); };
  app.add_option("--model", o.model, "URDF file (default: the library's own hand of 34 joints)")->check(named);
  app.add_option("--step", o.step, "Time step, s")->check(between(1e-5, 1))->capture_default_str();
  app.add_option("--kp", o.kp, "Stiffness of every joint, N/m or N m/rad")->check(between(0, 1e9))->capture_default_str();
  app.add_option("--kd", o.kd, "Damping of every joint, N s/m or N m s/rad")->check(between(0, 1e9))->capture_default_str();
  app.add_option("--form", o.form, "stable; implicit; or paper: stable without feed-forward of velocity and gravity")
      ->check(CLI::IsMember({"stable", "implicit", "paper"}))
      ->capture_default_str();
  app.add_option("--seconds", o.seconds, "Length of the motion, s")->check(between(0.01, 1000))->capture_default_str();
  app.add_flag("--no-gravity", o.no_gravity, "Switch gravity off");
  app.add_flag("--hold", o.hold, "Hold still; the hand starts 0.1 rad and 0.1 m away");
  app.add_option("--out", o.out, "Folder for track.html (made if missing)")->check(named);
  app.add_flag("--json", o.json, "Print the figures as one JSON object");
  parse(app, argc, argv);
  if (o.seconds / o.step > 2e7) refuse("--seconds: more than 20000000 steps");

  std::string name = "hand34";
  Tree<double> tree;
  if (o.model.empty()) {
    tree = clothctl::robot::hand34<double>();
  } else {
    clothctl::robot::UrdfModel<double> model = must(clothctl::robot::read_urdf<double>(o.model));
    name = model.name;
    tree = std::move(model.tree);
  }
  if (tree.velocities() == 0) refuse(o.model + ": has no joint that moves");
  if (!o.out.empty()) make_folder(o.out);
  Run run(tree, find_home(tree), o);
  const std::vector<std::string> unstable = run.unstable();
  if (!unstable.empty())
    std::fprintf(stderr, "warning: kd is below 1.5 kp h - 2 m/h for %zu joints, first %s: expect growing oscillation\n",
                 unstable.size(), unstable[0].c_str());

  Points first;
  run.marks().place(run.position(), first);
  const HandShape shape = make_hand_shape(tree, run.marks().kinematics());
  const Index every = std::max<Index>(1, std::lround(1.0 / 30 / o.step));
  clothctl::PlayerScene scene;
  scene.mesh_name = "Robot";
  scene.title = name + " follows keyframes";
  scene.subtitle = std::to_string(tree.velocities()) + " joints, " + o.form + " PD control, kp " + clothctl::number_text(o.kp) +
                   ", kd " + clothctl::number_text(o.kd) + ", step " + clothctl::number_text(o.step) + " s";
  scene.dt = o.step * static_cast<double>(every);
  scene.triangles = shape.triangles;
  scene.feature_names = run.marks().names();
  clothctl::PlayerRecorder recorder(scene, shape.vertices.cols(), run.marks().count(), 0);
  const Figures f = run.run(o.out.empty() ? nullptr : &recorder, shape, every);

  const bool finished = f.status == "finished";
  nlohmann::ordered_json j;
  j["status"] = f.status;
  j["lag_m"] = known(f.lag);
  j["lag_at_speed_m"] = known(f.straight_lag, f.has_straight);
  j["speed"] = known(HandPath::kSpeed, f.has_straight);
  j["energy_start"] = known(f.start);
  j["energy_end"] = known(f.end);
  j["energy_max"] = known(f.largest);
  j["energy_rise"] = known(f.largest_rise);
  j["saturated_steps"] = f.saturated_steps;
  j["clipped_steps"] = f.clipped_steps;
  j["steps"] = f.steps;
  j["microseconds_median"] = known(quantile(f.microseconds, 0.5), !f.microseconds.empty());
  j["unstable_joints"] = unstable.size();
  j["model"] = name;
  j["dof"] = tree.velocities();
  j["form"] = o.form;
  j["step"] = o.step;
  j["kp"] = o.kp;
  j["kd"] = o.kd;
  if (!o.out.empty()) {
    auto& figures = recorder.scene().figures;
    figures = {{"Status", f.status}, {"Largest lag", millimetres(f.lag)}};
    if (f.has_straight) figures.emplace_back("Lag at 0.3 m/s", millimetres(f.straight_lag));
    figures.emplace_back("Steps with saturated torques", std::to_string(f.saturated_steps) + " of " + std::to_string(f.steps));
    must(recorder.write(o.out + "/track.html"));
  }
  if (!finished) std::fprintf(stderr, "%s\n", f.status.c_str());
  print_figures(j, o.json);
  return finished ? 0 : 1;
}
