#include "support/loop.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>

#include "clothctl/cloth/settle.hpp"
#include "clothctl/io/csv.hpp"
#include "clothctl/io/html_player.hpp"
#include "clothctl/mpc/planner.hpp"
#include "support/timing.hpp"

namespace program {

namespace {

using Planner = clothctl::Planner<AnyPredictor>;

/// The figures of a run, in the order of summary.json.
struct Summary {
  std::string status = "finished";
  Index frames = 0, scored_frames = 0, suboptimal_frames = 0, relaxed_frames = 0;
  double patch_residual_max_m = 0;
  double mean_error_m = 0, p95_error_m = 0, max_error_m = 0;
  double frame_ms_median = 0, frame_ms_p99 = 0, plant_ms_median = 0;
  double agreement = 0, prediction_error_m = 0, qp_iterations_median = 0, cone_violation_max = 0, hand_speed_max = 0;
};

nlohmann::ordered_json to_json(const Summary& s, const Scene& scene, const Options& o) {
  nlohmann::ordered_json j;
  j["status"] = s.status;
  j["frames"] = s.frames;
  j["mean_error_m"] = s.mean_error_m;
  j["p95_error_m"] = s.p95_error_m;
  j["max_error_m"] = s.max_error_m;
  j["frame_ms_median"] = s.frame_ms_median;
  j["frame_ms_p99"] = s.frame_ms_p99;
  j["plant_ms_median"] = s.plant_ms_median;
  j["agreement"] = s.agreement;
  j["prediction_error_m"] = s.prediction_error_m;
  j["qp_iterations_median"] = s.qp_iterations_median;
  j["cone_violation_max"] = s.cone_violation_max;
  j["hand_speed_max"] = s.hand_speed_max;
  j["patch_residual_max_m"] = s.patch_residual_max_m;
  j["suboptimal_frames"] = s.suboptimal_frames;
  j["relaxed_frames"] = s.relaxed_frames;
  j["scored_frames"] = s.scored_frames;
  j["setup"] = {{o.targets.empty() ? "task" : "targets", o.targets.empty() ? o.task : o.targets},
                {"material", scene.material},
                {"plant", o.plant},
                {"grip", o.grip},
                {"patch", o.patch},
                {"horizon", o.horizon},
                {"vertices", scene.body.network.vertex_count()},
                {"size_m", o.size},
                {"patch_size", o.patch_size},
                {"predictor", chosen_predictor(o, scene.body)},
                {"profile", o.profile},
                {"spread", o.spread},
                {"friction", scene.setup.grips.front().fingers.front().friction},
                {"limit_N", o.limit},
                {"seed", o.seed}};
  return j;
}

}  // namespace

int run(const Scene& scene, const Options& o, AnyPlant plant, AnyPredictor predictor) {
  Planner planner = must(Planner::create(scene.setup, scene.settings, std::move(predictor), plant.positions()));
  clothctl::PlanResult<double> result = planner.make_result();
  const double dt = scene.settings.dt;
  const Index frames = static_cast<Index>(std::lround(scene.task.duration / dt));
  const Index features = scene.setup.features.count();
  const Index scored = frames - scene.settings.horizon + 1;
  if (scored < 2) {
    refuse((o.targets.empty() ? "--task " + o.task : o.targets) + ": lasts " + std::to_string(frames) +
           " frames of 0.02 s, must be over the --horizon of " + std::to_string(scene.settings.horizon));
  }
  const std::size_t hands = planner.grips().size();
  double grip = 0;
  for (const clothctl::Grip<double>& g : planner.grips()) {
    for (const clothctl::Finger<double>& f : g.fingers) grip += f.friction * f.limit;
  }
  const double weight = 9.81 * scene.body.network.mass.sum();
  if (o.grip == "force" && grip < weight)
    std::fprintf(stderr, "warning: friction can carry %.3g N at the --limit, the body weighs %.3g N\n", grip, weight);
  const auto target = [&](Index i, double t) { return scene.task.curves[static_cast<std::size_t>(i)].position(t); };

  clothctl::PlayerScene page;
  page.title = scene.title;
  page.subtitle =
      scene.material + ", " + std::to_string(plant.vertex_count()) + " vertices, " + o.plant + " plant, " + o.grip + " grips";
  page.dt = dt;
  page.triangles = scene.body.network.triangles;
  page.segments = scene.segments;
  page.feature_names = scene.task.names;
  page.scored_frames = scored;
  page.arrow_name = o.grip == "position" ? "Hand velocities" : "Contact forces";
  page.arrow_unit = o.grip == "position" ? "m/s" : "N";
  clothctl::PlayerRecorder recorder(page, plant.vertex_count(), features, static_cast<Index>(hands));

  std::vector<std::string> columns{"t"};
  for (const std::string& name : scene.task.names) {
    for (const char* part : {"_target_x", "_target_y", "_target_z", "_x", "_y", "_z", "_error"}) columns.push_back(name + part);
  }
  for (std::size_t g = 0; g < hands; ++g) {
    for (const char* part : {"_x", "_y", "_z", "_force_x", "_force_y", "_force_z"})
      columns.push_back("hand" + std::to_string(g) + part);
  }
  clothctl::CsvWriter csv(columns);

  std::vector<double> errors, frame_ms, plant_ms, agreement, prediction, iterations;
  Points actual(3, features), wanted(3, features), hand(3, static_cast<Index>(hands)), arrow(3, static_cast<Index>(hands)),
      last_hand;
  Summary summary;
  const auto hand_positions = [&](Points& out) {
    std::size_t slot = 0;
    for (std::size_t g = 0; g < hands; ++g) {
      const std::size_t count = planner.grips()[g].vertices().size();
      Vec sum = Vec::Zero();
      for (std::size_t j = 0; j < count; ++j) sum += plant.positions().col(planner.held()[slot++]);
      out.col(static_cast<Index>(g)) = sum / static_cast<double>(count);
    }
  };
  const auto record = [&](Index frame) {
    const double t = dt * static_cast<double>(frame);
    clothctl::evaluate_features<double>(scene.setup.features, plant.positions(), actual);
    std::vector<double> row{t};
    for (Index i = 0; i < features; ++i) {
      wanted.col(i) = target(i, t);
      const double error = (actual.col(i) - wanted.col(i)).norm();
      if (0 < frame && frame < scored) errors.push_back(error);  // curves start at the features
      for (const Vec& p : {Vec(wanted.col(i)), Vec(actual.col(i))}) row.insert(row.end(), {p[0], p[1], p[2]});
      row.push_back(error);
    }
    hand_positions(hand);
    for (Index g = 0; g < hand.cols(); ++g) {
      row.insert(row.end(), {hand(0, g), hand(1, g), hand(2, g), arrow(0, g), arrow(1, g), arrow(2, g)});
      if (last_hand.cols() > 0)
        summary.hand_speed_max = std::max(summary.hand_speed_max, (hand.col(g) - last_hand.col(g)).norm() / dt);
    }
    last_hand = hand;
    csv.add_row(row);
    recorder.add_frame(plant.positions(), actual, wanted, hand, arrow);
  };

  Progress progress;
  clothctl::ClothInput<double> input;
  arrow.setZero();
  record(0);
  for (Index frame = 0; frame < frames; ++frame) {
    const double t = dt * static_cast<double>(frame);
    progress.show(frame, frames);
    const std::chrono::steady_clock::time_point before = std::chrono::steady_clock::now();
    const clothctl::PlanStatus status = planner.plan(plant.positions(), plant.velocities(), t, target, scene.task.wind, result);
    frame_ms.push_back(milliseconds(before));
    if (status == clothctl::PlanStatus::InvalidInput || status == clothctl::PlanStatus::Failed) {
      summary.status = "planner " + std::string(to_string(status)) + " in frame " + std::to_string(frame) + ", qp " +
                       std::string(to_string(result.qp_status));
      break;
    }
    agreement.push_back(result.agreement);
    prediction.push_back(result.prediction_error);
    iterations.push_back(result.qp_iterations);
    arrow.setZero();
    if (o.grip == "position") {
      hand_positions(hand);
      std::size_t slot = 0;
      for (std::size_t g = 0; g < hands; ++g) {
        const std::size_t count = planner.grips()[g].vertices().size();
        for (std::size_t j = 0; j < count; ++j, ++slot) {
          arrow.col(static_cast<Index>(g)) +=
              result.plan.block<3, 1>(3 * static_cast<Index>(slot), 0) / static_cast<double>(count);
        }
      }
    }
    double patch_normal = 0;  // of the finger at hand; its vertices follow one another
    for (std::size_t i = 0; i < result.finger_forces.size(); ++i) {
      const clothctl::FingerForce<double>& f = result.finger_forces[i];
      const clothctl::Finger<double>& finger =
          planner.grips()[static_cast<std::size_t>(f.grip)].fingers[static_cast<std::size_t>(f.finger)];
      const bool same = i > 0 && result.finger_forces[i - 1].grip == f.grip && result.finger_forces[i - 1].finger == f.finger;
      patch_normal = (same ? patch_normal : 0) + f.force.dot(f.normal);
      const double violation = clothctl::cone_violation<double>(f.force, f.normal, finger.friction, finger.limit);
      summary.cone_violation_max = std::max({summary.cone_violation_max, violation, patch_normal - finger.limit});
      arrow.col(f.grip) += f.force;
    }
    summary.suboptimal_frames += status == clothctl::PlanStatus::Suboptimal ? 1 : 0;
    summary.relaxed_frames += status == clothctl::PlanStatus::Relaxed ? 1 : 0;
    summary.patch_residual_max_m = std::max(summary.patch_residual_max_m, result.patch_residual);
    input = result.input;
    input.wind = scene.task.wind(t);
    plant.apply(input);
    const std::chrono::steady_clock::time_point stepped = std::chrono::steady_clock::now();
    const clothctl::StepReport<double> report = plant.advance(dt);
    plant_ms.push_back(milliseconds(stepped));
    if (!report.advanced) {
      summary.status = "plant " + std::string(to_string(report.status)) + " in frame " + std::to_string(frame);
      break;
    }
    ++summary.frames;
    record(frame + 1);
  }
  progress.clear();
  summary.scored_frames = static_cast<Index>(errors.size()) / features;
  double total = 0;
  for (double e : errors) total += e;
  const double unknown = std::numeric_limits<double>::quiet_NaN();  // "null" in the summary
  summary.mean_error_m = errors.empty() ? unknown : total / static_cast<double>(errors.size());
  summary.p95_error_m = errors.empty() ? unknown : quantile(errors, 0.95);
  summary.max_error_m = errors.empty() ? unknown : *std::max_element(errors.begin(), errors.end());
  if (summary.frames == frames && summary.mean_error_m > 0.5 * o.size) summary.status = "lost the track";
  summary.frame_ms_median = quantile(frame_ms, 0.5);
  summary.frame_ms_p99 = quantile(frame_ms, 0.99);
  summary.plant_ms_median = quantile(plant_ms, 0.5);
  summary.agreement = quantile(agreement, 0.5);
  summary.prediction_error_m = quantile(prediction, 0.5);
  summary.qp_iterations_median = quantile(iterations, 0.5);

  const bool done = summary.status == "finished";
  const nlohmann::ordered_json json = to_json(summary, scene, o);
  const auto json_text = [&json](int indent) {
    return json.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
  };
  if (!o.out.empty()) {
    std::error_code failure;
    std::filesystem::create_directories(o.out, failure);
    if (failure) refuse(o.out + ": " + failure.message());
    const auto millimetres = [](double metres) {
      char text[32];
      std::snprintf(text, sizeof text, "%.2f mm", 1000 * metres);
      return std::string(text);
    };
    char number[64];
    std::snprintf(number, sizeof number, "%.2f ms (p99 %.2f)", summary.frame_ms_median, summary.frame_ms_p99);
    recorder.scene().figures = {{"Status", summary.status},
                                {"Mean error", millimetres(summary.mean_error_m)},
                                {"95 % below", millimetres(summary.p95_error_m)},
                                {"Largest error", millimetres(summary.max_error_m)},
                                {"Planning, a frame", number}};
    std::snprintf(number, sizeof number, "%.2f m/s", summary.hand_speed_max);
    recorder.scene().figures.push_back({"Fastest hand", number});
    must(recorder.write(o.out + "/player.html"));
    must(csv.write(o.out + "/trajectory.csv"));
    must(clothctl::write_file(o.out + "/summary.json", json_text(2) + "\n"));
  }
  if (!o.json) {
    std::printf("%s: %ld frames, mean error %.2f mm, 95 %% below %.2f mm, max %.2f mm\n", summary.status.c_str(),
                static_cast<long>(summary.frames), 1000 * summary.mean_error_m, 1000 * summary.p95_error_m,
                1000 * summary.max_error_m);
    std::printf("planning %.2f ms a frame (p99 %.2f), plant %.2f ms, agreement %.3f\n", summary.frame_ms_median,
                summary.frame_ms_p99, summary.plant_ms_median, summary.agreement);
    if (!o.out.empty()) std::printf("open %s/player.html\n", o.out.c_str());
  } else {
    std::printf("%s\n", json_text(-1).c_str());
  }
  return done ? 0 : 1;
}

clothctl::PlannerSettings<double> planner_settings(const Options& o, double weight) {
  clothctl::PlannerSettings<double> s =
      o.profile == "paper" ? clothctl::PlannerSettings<double>::paper() : clothctl::PlannerSettings<double>();
  s.horizon = o.horizon;
  s.input = o.grip == "position" ? clothctl::GripInput::Pose : clothctl::GripInput::Force;
  s.command = o.grip == "planned-position" ? clothctl::Command::Position : clothctl::Command::Force;
  s.patch = o.patch == "hard" ? clothctl::PatchMode::Hard : clothctl::PatchMode::Soft;
  s.max_step = o.max_step_mm / 1000;
  if (o.profile != "paper") s.supported = Vec(0, 0, weight);
  return s;
}

clothctl::ClothState<double> settle(const Options& o, const Body& body, clothctl::ClothState<double> state,
                                    const std::vector<int>& held, double seconds) {
  // One-solve and Newton steps have the same equilibria; the converged step finds them from any start.
  AnyPlant plant = make_plant(is_implicit(o.plant) ? "newton" : o.plant, body, 3.0);
  plant.set_state(state);
  const clothctl::SettleReport<double> report = clothctl::settle(plant, held, 0.02, seconds);
  if (!report.advanced) refuse("the sheet does not settle: " + std::string(to_string(report.status)));
  state.positions = plant.positions();
  state.velocities.setZero();
  return state;
}

}  // namespace program
