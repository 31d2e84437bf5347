#include "support/recorder.hpp"

#include <algorithm>
#include <cstdio>

#include "clothctl/io/file.hpp"

namespace program {

namespace {

clothctl::PlayerScene make_page(const Scene& scene, const Options& o, Index scored) {
  clothctl::PlayerScene page;
  page.title = scene.title;
  page.subtitle = scene.material + ", " + std::to_string(scene.body.network.vertex_count()) +
                  " vertices, " + o.plant + " plant, " + o.grip + " grips";
  page.dt = scene.settings.dt;
  page.triangles = scene.body.network.triangles;
  page.segments = scene.segments;
  page.feature_names = scene.task.names;
  page.scored_frames = scored;
  page.arrow_name = o.grip == "position" ? "Hand velocities" : "Contact forces";
  page.arrow_unit = o.grip == "position" ? "m/s" : "N";
  return page;
}

std::vector<std::string> column_names(const Scene& scene) {
  std::vector<std::string> columns{"t"};
  for (const std::string& name : scene.task.names) {
    for (const char* part : {"_target_x", "_target_y", "_target_z", "_x", "_y", "_z", "_error"})
      columns.push_back(name + part);
  }
  for (std::size_t g = 0; g < scene.setup.grips.size(); ++g) {
    for (const char* part : {"_x", "_y", "_z", "_force_x", "_force_y", "_force_z"})
      columns.push_back("hand" + std::to_string(g) + part);
  }
  return columns;
}

std::string formatted(const char* format, double a, double b = 0) {
  char text[64];
  std::snprintf(text, sizeof text, format, a, b);
  return text;
}

}  // namespace

RunRecorder::RunRecorder(const Scene& scene, const Options& o, Index scored)
    : scene_(scene),
      options_(o),
      scored_(scored),
      page_(make_page(scene, o, scored), scene.body.network.vertex_count(),
            scene.setup.features.count(), static_cast<Index>(scene.setup.grips.size())),
      table_(column_names(scene)) {
  for (const clothctl::Grip<double>& grip : scene.setup.grips) hands_.push_back(grip.vertices());
}

void RunRecorder::add_frame(Index frame, const Points& x, const Points& arrows, Figures& figures) {
  const double t = scene_.settings.dt * static_cast<double>(frame);
  const Index features = scene_.setup.features.count();
  Points actual(3, features), wanted(3, features), hands(3, arrows.cols());
  clothctl::evaluate_features<double>(scene_.setup.features, x, actual);
  std::vector<double> row{t};
  for (Index i = 0; i < features; ++i) {
    wanted.col(i) = scene_.task.curves[static_cast<std::size_t>(i)].position(t);
    const double error = (actual.col(i) - wanted.col(i)).norm();
    if (0 < frame && frame < scored_)
      figures.errors.push_back(error);  // at frame 0 curves start at the features
    for (const Vec& p : {Vec(wanted.col(i)), Vec(actual.col(i))})
      row.insert(row.end(), {p[0], p[1], p[2]});
    row.push_back(error);
  }
  for (Index g = 0; g < hands.cols(); ++g) {
    const std::vector<int>& held = hands_[static_cast<std::size_t>(g)];
    Vec sum = Vec::Zero();
    for (int v : held) sum += x.col(v);
    hands.col(g) = sum / static_cast<double>(held.size());
    row.insert(row.end(),
               {hands(0, g), hands(1, g), hands(2, g), arrows(0, g), arrows(1, g), arrows(2, g)});
    if (last_hands_.cols() == 0) continue;
    const double speed = (hands.col(g) - last_hands_.col(g)).norm() / scene_.settings.dt;
    figures.summary.hand_speed_max = std::max(figures.summary.hand_speed_max, speed);
  }
  last_hands_ = hands;
  table_.add_row(row);
  page_.add_frame(x, actual, wanted, hands, arrows);
}

Points RunRecorder::arrows(const clothctl::PlanResult<double>& result,
                           const std::vector<clothctl::FingerForce<double>>& forces) const {
  Points out = Points::Zero(3, static_cast<Index>(hands_.size()));
  if (options_.grip != "position") {
    for (const clothctl::FingerForce<double>& f : forces) out.col(f.grip) += f.force;
    return out;
  }
  Index slot = 0;
  for (std::size_t g = 0; g < hands_.size(); ++g) {
    for (std::size_t j = 0; j < hands_[g].size(); ++j, ++slot) {
      out.col(static_cast<Index>(g)) +=
          result.plan.block<3, 1>(3 * slot, 0) / static_cast<double>(hands_[g].size());
    }
  }
  return out;
}

void RunRecorder::write(const Summary& s) {
  make_folder(options_.out);
  page_.scene().figures = {
      {"Status", s.status},
      {"Mean error", formatted("%.2f mm", 1000 * s.mean_error_m)},
      {"95 % below", formatted("%.2f mm", 1000 * s.p95_error_m)},
      {"Largest error", formatted("%.2f mm", 1000 * s.max_error_m)},
      {"Planning, a frame", formatted("%.2f ms (p99 %.2f)", s.frame_ms_median, s.frame_ms_p99)},
      {"Fastest hand", formatted("%.2f m/s", s.hand_speed_max)}};
  must(page_.write(options_.out + "/player.html"));
  must(table_.write(options_.out + "/trajectory.csv"));
  must(
      clothctl::write_file(options_.out + "/summary.json", to_json(s, scene_, options_, 2) + "\n"));
}

}  // namespace program
