// Compares a robot's kinematics and dynamics with the results of another library, and moves all its
// fingertips to targets at once by inverse kinematics.
//
//   hand_reach --model hand.urdf --oracle hand.json          prints the largest differences
//   hand_reach --model hand.urdf --targets 1000 --out out    then open out/player.html

#include <cstdio>
#include <nlohmann/json.hpp>

#include "clothctl/bridge/urdf.hpp"
#include "support/command_line.hpp"
#include "support/hand_figures.hpp"
#include "support/hand_oracle.hpp"
#include "support/hand_targets.hpp"

namespace {

using namespace program;
using clothctl::KinematicTree;

template <class Scalar>
int run(const ReachRequest& o) {
  const clothctl::UrdfModel<Scalar> model = must(clothctl::read_urdf<Scalar>(o.model));
  const KinematicTree<Scalar>& tree = model.tree;
  if (tree.nv() == 0) refuse(o.model + ": no joint moves");
  const std::vector<int> tips = find_tips(tree, o);
  if (!o.out.empty()) make_folder(o.out);
  OracleErrors errors;
  const bool compared = !o.oracle.empty();
  if (compared) errors = compare_with_oracle<Scalar>(tree, o.model, o.oracle);
  const ReachRuns runs = run_targets(tree, tips, o);

  const bool right = !compared || errors.within(o.single ? 1e-4 : 1e-9);
  nlohmann::ordered_json j;
  j["status"] = right ? "ok" : "failed";
  j["fk_error"] = known(errors.fk, compared);
  j["jacobian_error"] = known(errors.jacobian, compared);
  j["mass_error"] = known(errors.mass, compared);
  j["bias_error"] = known(errors.bias, compared);
  add_tally(j, runs.random, "");
  j["gravity_error"] = known(errors.gravity, compared);
  j["rnea_error"] = known(errors.rnea, compared);
  j["fd_error"] = known(errors.fd, compared);
  j["spd_qdd_error"] = known(errors.spd_qdd, compared);
  j["spd_tau_error"] = known(errors.spd_tau, compared);
  j["samples"] = known(errors.samples, compared);
  add_more(j, runs.random, "");
  add_tally(j, runs.near_starts, "_near");
  add_more(j, runs.near_starts, "_near");
  const Tally& beyond = runs.unreachable;
  j["unreachable_local_minima"] = known(
      beyond.solves > 0 ? double(beyond.local_minimum) / beyond.solves : 0, beyond.solves > 0);
  j["targets"] = o.targets;
  j["seed"] = o.seed;
  j["scalar"] = o.single ? "float" : "double";
  j["model"] = model.name;
  j["dof"] = tree.nv();
  j["tips"] = nlohmann::ordered_json::array();
  for (const int tip : tips) j["tips"].push_back(tree.links()[static_cast<std::size_t>(tip)].name);
  if (!o.out.empty()) {
    const auto shown = must(clothctl::read_urdf<double>(o.model));
    write_reach_page(shown.tree, shown.name, tips, o, j);
  }
  print_figures(j, o.json);
  if (!o.out.empty() && !o.json) std::printf("open %s/player.html\n", o.out.c_str());
  return right ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  ReachRequest o;
  CLI::App app{
      "Compares a robot's kinematics and dynamics with reference results, and moves its fingertips "
      "to random targets by inverse kinematics. Exit code 0: all differences are small; 1: some "
      "are not; 2: bad input."};
  app.add_option("--model", o.model, "URDF file")->required();
  app.add_option("--oracle", o.oracle, "JSON file with another library's results")
      ->check([](const std::string& text) {
        return text.empty() ? std::string("is empty") : std::string();
      });
  app.add_option("--targets", o.targets, "Number of random targets")
      ->check(between(0, 1e6))
      ->capture_default_str();
  app.add_option("--seed", o.seed, "Seed of targets and starts")
      ->check(seed_number())
      ->capture_default_str();
  app.add_option("--tips", o.tips,
                 "Links to move to targets, a,b,c (default: the end of each chain)")
      ->delimiter(',');
  app.add_flag("--float", o.single, "Compute in single precision; differences may be 1e-4");
  app.add_option("--out", o.out, "Folder for player.html (made if missing)")
      ->check([](const std::string& text) {
        return text.empty() ? std::string("is empty") : std::string();
      });
  app.add_flag("--json", o.json, "Print the figures as one JSON object");
  parse(app, argc, argv);
  return o.single ? run<float>(o) : run<double>(o);
}
