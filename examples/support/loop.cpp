#include "support/loop.hpp"

#include <chrono>
#include <cstdio>
#include <optional>

#include "clothctl/mpc/planner.hpp"
#include "clothctl/mpc/run_frame.hpp"
#include "support/figures.hpp"
#include "support/measured_plant.hpp"
#include "support/pushed_plant.hpp"
#include "support/recorder.hpp"
#include "support/timing.hpp"
#include "support/unknown_gust.hpp"

namespace program {

namespace {

using Planner = clothctl::Planner<AnyPredictor>;

/// Returns the number of frames of a run.
Index run_frames(const Scene& scene) {
  return static_cast<Index>(std::lround(scene.task.duration / scene.settings.dt));
}

void warn_of_weight(const Scene& scene, const Options& o) {
  double grip = 0;
  for (const clothctl::Grip<double>& g : scene.setup.grips) {
    for (const clothctl::Finger<double>& f : g.fingers)
      grip += f.contact.friction * f.max_normal_force;
  }
  const double weight = 9.81 * scene.body.network.mass.sum();
  if (o.grip == "force" && grip < weight)
    std::fprintf(stderr,
                 "warning: friction can carry %.3g N at the --limit, the body weighs %.3g N\n",
                 grip, weight);
}

/// Tells of frames that take seconds.
void warn_of_unknowns(const Scene& scene, const Options& o) {
  if (scene.settings.input != clothctl::GripInput::Force) return;
  Index generators = 0;
  for (const clothctl::Grip<double>& g : scene.setup.grips) {
    for (const clothctl::Finger<double>& f : g.fingers)
      generators += static_cast<Index>(f.vertices.size()) * o.generators;
  }
  const Index unknowns = generators * scene.settings.horizon;
  if (1500 < unknowns)
    std::fprintf(stderr, "warning: a frame plans %ld contact forces, which takes seconds\n",
                 static_cast<long>(unknowns));
}

/// Returns why a frame ended the run, or an empty string. `pushed`: what receives forces for poses,
/// if something does.
std::string reason(const clothctl::FrameReport<double>& report,
                   const clothctl::PlanResult<double>& result,
                   const std::optional<PushedPlant>& pushed, Index frame) {
  const std::string where = " in frame " + std::to_string(frame);
  if (report.status == clothctl::FrameStatus::NotPlanned)
    return "planner " + std::string(to_string(report.plan)) + where + ", qp " +
           std::string(to_string(result.qp_status));
  if (report.status != clothctl::FrameStatus::NotAdvanced) return {};
  if (pushed && !pushed->found_forces()) return "no contact forces follow the poses" + where;
  return "plant " + std::string(to_string(report.step.status)) + where;
}

}  // namespace

Index scored_frames(const Scene& scene, const Options& o) {
  const Index frames = run_frames(scene), scored = frames - scene.settings.horizon + 1;
  if (scored < 2) {
    refuse((o.targets.empty() ? "--task " + o.task : o.targets) + ": lasts " +
           std::to_string(frames) + " frames of 0.02 s, must be over the --horizon of " +
           std::to_string(scene.settings.horizon));
  }
  return scored;
}

Summary run_loop(const Scene& scene, const Options& o, AnyPlant& plant, AnyPredictor predictor,
                 RunRecorder& recorder, Progress& progress) {
  Planner planner =
      must(Planner::create(scene.setup, scene.settings, std::move(predictor), plant.positions()));
  if (const std::string problem = check_plant(planner, plant); !problem.empty()) refuse(problem);
  clothctl::PlanResult<double> result = planner.make_result();
  const double dt = scene.settings.dt;
  const Index frames = run_frames(scene);
  const auto target = [&](Index i, double t) {
    return scene.task.curves[static_cast<std::size_t>(i)].position(t);
  };
  std::optional<MeasuredPlant> measured;
  if (o.measured) measured.emplace(scene, o, plant);
  std::optional<GustyPlant> gusty;
  if (0 < o.unknown) gusty.emplace(scene, o, plant);
  std::optional<PushedPlant> pushed;
  if (follows_poses(o)) {
    if (gusty) refuse("--unknown: cannot be combined with forces that follow poses");
    pushed.emplace(scene, o, plant, result);
  }
  const auto run_one = [&](Index frame) {
    const double t = dt * static_cast<double>(frame);
    if (gusty) {
      const auto report = run_frame(planner, *gusty, t, target, scene.task.wind, result);
      if (report.advanced() && !planner.set_outer_force(gusty->learn()))
        refuse("--unknown: the planner refuses the estimated forces");
      return report;
    }
    if (pushed) return run_frame(planner, *pushed, t, target, scene.task.wind, result);
    if (!measured) return run_frame(planner, plant, t, target, scene.task.wind, result);
    measured->look();
    return run_frame(planner, *measured, measured->time(), target, scene.task.wind, result);
  };
  Figures figures;
  recorder.add_frame(0, plant.positions(),
                     Points::Zero(3, static_cast<Index>(scene.setup.grips.size())), figures);
  for (Index frame = 0; frame < frames; ++frame) {
    progress.show(frame, frames);
    const std::chrono::steady_clock::time_point before = std::chrono::steady_clock::now();
    const clothctl::FrameReport<double> report = run_one(frame);
    const auto& sent = pushed ? pushed->finger_forces() : result.finger_forces;
    const double plant_ms =
        report.status == clothctl::FrameStatus::NotPlanned ? 0.0 : plant.last_step_ms();
    figures.add_times(milliseconds(before) - plant_ms, plant_ms);
    if (can_apply(report.plan)) figures.add_plan(planner.grips(), result, sent);
    if (const std::string why = reason(report, result, pushed, frame); !why.empty()) {
      figures.summary.status = why;
      break;
    }
    ++figures.summary.frames;
    recorder.add_frame(frame + 1, plant.positions(), recorder.arrows(result, sent), figures);
  }
  progress.clear();
  return figures.sum_up(scene.setup.features.count(), frames, o.size);
}

int run(const Scene& scene, const Options& o, AnyPlant plant, AnyPredictor predictor) {
  RunRecorder recorder(scene, o, scored_frames(scene, o));
  warn_of_weight(scene, o);
  warn_of_unknowns(scene, o);
  Progress progress;
  const Summary summary = run_loop(scene, o, plant, std::move(predictor), recorder, progress);
  if (!o.out.empty()) recorder.write(summary);
  if (o.json) {
    std::printf("%s\n", to_json(summary, scene, o, -1).c_str());
  } else {
    print(summary, o);
  }
  return summary.status == "finished" ? 0 : 1;
}

}  // namespace program
