// A hand follows a path by stable PD control: the base moves along a loop at 0.3 m/s while the
// fingers open and close. The control loop is in support/hand_run.hpp.
//
//   hand_track --step 0.02 --out out    then open out/player.html
//   hand_track --form paper             without feed-forward, as [Bai 2016] prints it

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "clothctl/bridge/urdf.hpp"
#include "clothctl/robot/hand34.hpp"
#include "support/command_line.hpp"
#include "support/hand_run.hpp"

using namespace program;
using clothctl::Index;
using clothctl::KinematicTree;
using Points = Eigen::Matrix3Xd;

int main(int argc, char** argv) {
  TrackRequest o;
  CLI::App app{
      "A hand follows keyframes by stable PD control, in a simulation of its bodies. Exit code 0: "
      "finished; 1: it diverged; 2: "
      "bad input."};
  const auto named = [](const std::string& text) {
    return text.empty() ? std::string("is empty") : std::string();
  };
  app.add_option("--model", o.model, "URDF file (default: the library's own hand of 34 joints)")
      ->check(named);
  app.add_option("--step", o.step, "Time step, s")->check(between(1e-5, 1))->capture_default_str();
  app.add_option("--kp", o.kp, "Stiffness of every joint, N/m or N m/rad")
      ->check(between(0, 1e9))
      ->capture_default_str();
  app.add_option("--kd", o.kd, "Damping of every joint, N s/m or N m s/rad")
      ->check(between(0, 1e9))
      ->capture_default_str();
  app.add_option("--form", o.form,
                 "stable; implicit; or paper: stable without feed-forward of velocity and gravity")
      ->check(CLI::IsMember({"stable", "implicit", "paper"}))
      ->capture_default_str();
  app.add_option("--seconds", o.seconds, "Length of the motion, s")
      ->check(between(0.01, 1000))
      ->capture_default_str();
  app.add_flag("--no-gravity", o.no_gravity, "Switch gravity off");
  app.add_flag("--hold", o.hold, "Hold still; the hand starts 0.1 rad and 0.1 m away");
  app.add_option("--out", o.out, "Folder for player.html (made if missing)")->check(named);
  app.add_flag("--json", o.json, "Print the figures as one JSON object");
  parse(app, argc, argv);
  if (o.seconds / o.step > 2e7) refuse("--seconds: more than 20000000 steps");

  std::string name = "hand34";
  KinematicTree<double> tree;
  if (o.model.empty()) {
    tree = clothctl::hand34<double>();
  } else {
    clothctl::UrdfModel<double> model = must(clothctl::read_urdf<double>(o.model));
    name = model.name;
    tree = std::move(model.tree);
  }
  if (tree.nv() == 0) refuse(o.model + ": no joint moves");
  if (!o.out.empty()) make_folder(o.out);
  TrackRun run(tree, find_home(tree), o);
  const std::vector<std::string> unstable = run.unstable();
  if (!unstable.empty())
    std::fprintf(stderr,
                 "warning: kd is below 1.5 kp h - 2 m/h for %zu joints, first %s: expect growing "
                 "oscillation\n",
                 unstable.size(), unstable[0].c_str());

  Points first;
  run.marks().place(run.position(), first);
  const HandShape shape = make_hand_shape(tree, run.marks().body_poses());
  const Index every = std::max<Index>(1, std::lround(1.0 / 30 / o.step));
  clothctl::PlayerScene scene;
  scene.mesh_name = "Robot";
  scene.title = name + " follows keyframes";
  scene.subtitle = std::to_string(tree.nv()) + " joints, " + o.form + " PD control, kp " +
                   clothctl::number_text(o.kp) + ", kd " + clothctl::number_text(o.kd) + ", step " +
                   clothctl::number_text(o.step) + " s";
  scene.dt = o.step * static_cast<double>(every);
  scene.triangles = shape.triangles;
  scene.feature_names = run.marks().names();
  clothctl::PlayerRecorder recorder(scene, shape.vertices.cols(), run.marks().count(), 0);
  const TrackFigures f = run.run(o.out.empty() ? nullptr : &recorder, shape, every);

  const bool finished = f.status == "finished";
  nlohmann::ordered_json j;
  j["status"] = f.status;
  j["lag_m"] = known(f.lag);
  j["lag_at_speed_m"] = known(f.straight_lag, f.has_straight);
  j["speed_m_per_s"] = known(HandPath::kSpeed, f.has_straight);
  j["energy_start_j"] = known(f.start);
  j["energy_end_j"] = known(f.end);
  j["energy_max_j"] = known(f.largest);
  j["energy_rise_j"] = known(f.largest_rise);
  j["saturated_steps"] = f.saturated_steps;
  j["clipped_steps"] = f.clipped_steps;
  j["steps"] = f.steps;
  j["microseconds_median"] = known(quantile(f.microseconds, 0.5), !f.microseconds.empty());
  j["unstable_joints"] = unstable.size();
  j["model"] = name;
  j["dof"] = tree.nv();
  j["form"] = o.form;
  j["step_s"] = o.step;
  j["kp"] = o.kp;
  j["kd"] = o.kd;
  if (!o.out.empty()) {
    auto& figures = recorder.scene().figures;
    figures = {{"Status", f.status}, {"Largest lag", millimetres(f.lag)}};
    if (f.has_straight) figures.emplace_back("Lag at 0.3 m/s", millimetres(f.straight_lag));
    figures.emplace_back("Steps with saturated torques",
                         std::to_string(f.saturated_steps) + " of " + std::to_string(f.steps));
    must(recorder.write(o.out + "/player.html"));
  }
  if (!finished) std::fprintf(stderr, "%s\n", f.status.c_str());
  print_figures(j, o.json);
  if (!o.out.empty() && !o.json) std::printf("open %s/player.html\n", o.out.c_str());
  return finished ? 0 : 1;
}
