#include "support/hand_loop.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/grasp/rectify.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/mpc/run_frame.hpp"
#include "support/figure_text.hpp"
#include "support/hand_figures.hpp"
#include "support/hand_grasp.hpp"
#include "support/hand_page.hpp"

namespace program {

namespace {

using Planner = clothctl::Planner<AnyPredictor>;
constexpr double kDt = 0.02;

/// Distances of the features from their targets in a run, m.
struct Errors {
  double sum = 0, most = 0;
  long frames = 0;
  void add(double mean_of_frame, double most_of_frame) {
    sum += mean_of_frame;
    most = std::max(most, most_of_frame);
    ++frames;
  }
  double mean() const { return sum / static_cast<double>(std::max(1L, frames)); }
};

long scored_frames(const Scene& scene) {
  return std::lround(scene.task.duration / kDt) - scene.settings.horizon + 1;
}

auto targets(const Scene& scene) {
  return [&scene](Index i, double t) {
    return scene.task.curves[static_cast<std::size_t>(i)].position(t);
  };
}

/// The task with bare forces on the vertices of the grips.
Errors run_bare(Scene scene, const Options& o, const clothctl::ClothState<double>& state,
                const FitTask& fit_task) {
  fit_task(state.positions, scene);
  AnyPlant plant = plant_in_state(o.plant, scene.body, state);
  AnyPredictor predictor = make_predictor(o, scene.body, scene.settings);
  Planner planner =
      must(Planner::create(scene.setup, scene.settings, std::move(predictor), plant.positions()));
  auto plan = planner.make_result();
  Errors errors;
  for (long frame = 0; frame < scored_frames(scene); ++frame) {
    const double t = kDt * static_cast<double>(frame);
    const auto report = run_frame(planner, plant, t, targets(scene), scene.task.wind, plan);
    if (!report.advanced()) break;
    errors.add(report.mean_error, report.max_error);
  }
  return errors;
}

/// The world of sheet and hands.
class HandsRun {
 public:
  HandsRun(Scene scene, const Options& o, const clothctl::ClothState<double>& state,
           const clothctl::GridMesh<double>& grid, const HandMaker& make_hand)
      : scene_(std::move(scene)), options_(o) {
    add_sheet(state);
    for (int side : {0, 1}) add_hand(grid, side, make_hand);
    std::vector<int> segments;
    for (const auto& hand : hands_)
      segments.insert(segments.end(), hand->parts().segments.begin(),
                      hand->parts().segments.begin() + 2);
    contacts_ = std::make_unique<clothctl::StaticContacts<double>>(
        must(clothctl::StaticContacts<double>::create(world_, 0, segments)));
    clothctl::PlayerScene page;
    page.title = "Two hands move a handkerchief: " + o.task;
    page.dt = kDt;
    page.triangles = scene_.body.network.triangles;
    page_ = std::make_unique<HandPage>(
        page, state.positions.cols(), scene_.setup.features.count(),
        std::vector<const HandView*>{&hands_[0]->view(), &hands_[1]->view()});
  }

  /// Both hands grasp; the sheet is taken off its pins and comes to rest. Returns what went wrong.
  std::string grasp() {
    for (int i = 0; i < 300 && !(hands_[0]->holds() && hands_[1]->holds()); ++i) {
      if (std::string bad = step(); !bad.empty()) return bad;
    }
    world_.input(0).clear();
    for (int i = 0; i < 100; ++i) {
      if (std::string bad = step(); !bad.empty()) return bad;
    }
    return {};
  }
  /// Runs the task. Returns what went wrong.
  std::string follow(const FitTask& fit_task) {
    fit_task(x(), scene_);
    const bool choose = options_.predictor == "auto";
    if (choose) options_.predictor = suits_rollouts() ? "rollout" : "linearised";
    if (std::string bad = take_grips(); !bad.empty()) return bad;
    scene_.settings.command = clothctl::PlantCommand::Position;
    Planner planner = make_planner();
    auto plan = planner.make_result();
    for (long frame = 0; frame < scored_frames(scene_); ++frame) {
      const double t = kDt * static_cast<double>(frame);
      const bool runs_away = choose && rolls_out() && turns_ >= 2;
      if (runs_away) {
        options_.predictor = "linearised";
        linearised_from_s = t;
      }
      // Where a hand holds nothing firmly for a moment, the old grips stay until it does.
      stale_ = stale_ || contacts_->changed() || runs_away;
      const bool taken = stale_ && take_grips().empty();
      if (taken) stale_ = false;
      if (runs_away) {
        planner = make_planner();
      } else if (taken) {
        if (std::string bad = planner.set_grips(scene_.setup.grips, x()); !bad.empty()) return bad;
        ++grip_changes;
      }
      if (runs_away || taken) plan = planner.make_result();
      if (std::string bad = limit_reach(planner); !bad.empty()) return bad;
      const auto status =
          planner.plan(x(), world_.state(0).velocities, t, targets(scene_), scene_.task.wind, plan);
      if (!can_apply(status)) return "planner " + std::string(to_string(status));
      move_hands(plan);
      world_.input(0).wind = scene_.task.wind(t);
      time_ = t + kDt;
      if (std::string bad = step(); !bad.empty()) return bad;
      const clothctl::VectorX<double> distance = (features() - wanted()).colwise().norm();
      errors.add(distance.mean(), distance.maxCoeff());
    }
    return {};
  }

  const std::string& predictor() const { return options_.predictor; }
  std::vector<std::unique_ptr<GraspingHand>>& hands() { return hands_; }
  HandPage& page() { return *page_; }
  Errors errors;
  double rectify_residual = 0;
  int grip_changes = 0;
  /// When plans with rollouts ran away, s.
  double linearised_from_s = std::nan("");

 private:
  const Points& x() const { return world_.state(0).positions; }
  /// The features, and where they shall be now.
  Points features() const {
    Points out(3, scene_.setup.features.count());
    clothctl::evaluate_features<double>(scene_.setup.features, x(), out);
    return out;
  }
  Points wanted() const {
    Points out = Points::Constant(3, scene_.setup.features.count(), std::nan(""));
    for (std::size_t i = 0; i < scene_.task.curves.size(); ++i)
      out.col(static_cast<Index>(i)) = scene_.task.curves[i].position(time_);
    return out;
  }

  /// Makes a planner of the grips. Hands lag behind plans, so plans must be slow and smooth.
  Planner make_planner() {
    clothctl::PlannerSettings<double>& settings = scene_.settings;
    AnyPredictor predictor = make_predictor(options_, scene_.body, settings);
    settings.max_step = std::min(settings.max_step, 0.75 * kDt);  // m
    settings.max_change = 0;
    if (options_.profile != "paper") {
      settings.weights.jerk = rolls_out() ? 0.005 : 0.03;
      settings.weights.step = rolls_out() ? 0.005 : 0;
    }
    turns_ = 0;
    return must(Planner::create(scene_.setup, settings, std::move(predictor), x()));
  }
  /// Rollouts are better where hands follow at once and the sheet's edges are short beside a pinch;
  /// with an arm, in wind, or on coarse sheets, plans run away.
  bool suits_rollouts() const {
    const double edge = options_.size / (options_.cloth - 1);  // m
    return edge < 0.035 && !scene_.body.air.enabled() && hands_[0]->floats() && hands_[1]->floats();
  }
  bool rolls_out() const { return options_.predictor == "rollout"; }

  void add_sheet(const clothctl::ClothState<double>& state) {
    clothctl::MassSpringSettings<double> settings;
    if (options_.plant == "newton") settings.integration = clothctl::Integration::Newton;
    settings.drag = scene_.body.drag;
    settings.air = scene_.body.air;
    must(world_.add_sheet(must(clothctl::MassSpring<double>::create(scene_.body.network, settings)),
                          state));
    std::vector<int> pins;
    for (const auto& grip : scene_.setup.grips) {
      for (const int v : grip.vertices()) pins.push_back(v);
    }
    world_.input(0).driven_vertices = pins;
    world_.input(0).driven_positions = state.positions(Eigen::all, pins);
  }
  /// The right one with `side` 1 holds the sheet at a vertex about 20 mm inside its upper corner:
  /// planners move vertices.
  void add_hand(const clothctl::GridMesh<double>& grid, int side, const HandMaker& make_hand) {
    const long in = std::max(1L, std::lround(0.02 * (grid.cols - 1) / options_.size));
    const auto at = [&](int down, int across) {
      const int row = grid.rows - 1 - static_cast<int>(in) - down;
      const int col = static_cast<int>(in) + across;
      return Vec(x().col(grid.vertex(row, side == 0 ? col : grid.cols - 1 - col)));
    };
    const Vec across = (1 - 2 * side) * (at(0, 1) - at(0, 0)), down = at(1, 0) - at(0, 0);
    GraspOptions options;
    options.friction = scene_.setup.grips.front().fingers.front().contact.friction;
    options.most_force = std::min(options.most_force, options_.limit);
    options.force = std::min(options.force, options.most_force);
    const GraspPlace place{at(0, 0), down.cross(across).normalized(), Vec(0, 0, -1)};
    hands_.push_back(must(GraspingHand::create(world_, make_hand(place),
                                               scene_.body.network.triangles, {}, place, options)));
  }
  /// Makes the grips of the planner from what the fingers hold.
  std::string take_grips() {
    std::vector<clothctl::Grip<double>> grips;
    for (int k = 0; k < 2; ++k) {
      auto grip = clothctl::make_held_grip<double>(*contacts_,
                                                   hands_[static_cast<std::size_t>(k)]->holding(k),
                                                   x(), scene_.body.network.triangles);
      if (!grip) return grip.error();
      if (rolls_out()) clothctl::keep_middle<double>(*grip, x());
      grips.push_back(std::move(*grip));
    }
    scene_.setup.grips = std::move(grips);
    return {};
  }
  /// Plans go no farther than the hands reach.
  std::string limit_reach(Planner& planner) {
    std::array<clothctl::GripLimit<double>, 12> limits;
    std::size_t count = 0;
    for (int k = 0; k < 2; ++k) {
      const std::span<clothctl::GripLimit<double>> rest = std::span(limits).subspan(count);
      GraspingHand& hand = *hands_[static_cast<std::size_t>(k)];
      // A redundant arm goes round a joint at its limit, which to first order blocks its way.
      if (!hand.floats()) continue;
      const Points held =
          x()(Eigen::all, scene_.setup.grips[static_cast<std::size_t>(k)].vertices());
      count += hand.controller().tracker().reach(k, held.rowwise().mean(), rest.first(6));
    }
    return planner.set_limits(std::span(limits).first(count));
  }
  /// Each hand makes the rigid motion nearest to what is planned for its vertices.
  void move_hands(const clothctl::PlanResult<double>& plan) {
    Index first = 0;
    bool turns = false;
    for (std::size_t k = 0; k < 2; ++k) {
      const std::vector<int> held = scene_.setup.grips[k].vertices();
      const Points now = x()(Eigen::all, held);
      const Points next =
          plan.input.driven_positions.middleCols(first, static_cast<Index>(held.size()));
      first += static_cast<Index>(held.size());
      const Vec step = (next - now).rowwise().mean();
      const double change = (step - planned_step_[k]).cwiseAbs().maxCoeff();
      turns = turns || change > 1.25 * scene_.settings.max_step;
      planned_step_[k] = step;
      const auto moved = clothctl::rectify<double>(now, next, clothctl::VectorX<double>(),
                                                   clothctl::Matrix3<double>::Identity());
      if (!moved.found()) continue;
      rectify_residual = std::max(rectify_residual, moved.largest_residual);
      (void)hands_[k]->controller().move_by(moved.R_world_frame, moved.position);
    }
    turns_ = turns ? turns_ + 1 : std::max(0.0, turns_ - 0.5);
  }
  std::string phases() const {
    std::string out;
    for (const auto& hand : hands_)
      out.append(out.empty() ? "" : ", ").append(to_string(hand->figures().last.phase));
    return out;
  }
  /// One step of hands and world. Returns what went wrong.
  std::string step() {
    for (auto& hand : hands_) {
      hand->drive(time_, kDt);
      if (!hand->figures().fault.empty()) return hand->figures().fault;
    }
    const auto report = world_.step(kDt);
    if (!report.advanced) return "the world did not advance";
    contacts_->update(world_);
    for (auto& hand : hands_) hand->measure(report, kDt);
    if (!options_.out.empty()) page_->add_frame(x(), features(), wanted(), kDt, phases());
    return {};
  }

  Scene scene_;
  Options options_;
  clothctl::World<double> world_;
  std::vector<std::unique_ptr<GraspingHand>> hands_;
  std::unique_ptr<clothctl::StaticContacts<double>> contacts_;
  std::unique_ptr<HandPage> page_;
  double time_ = 0;
  bool stale_ = false;  // the grips are not what is held
  // Where the last plan moved each grip, m, and how many plans have turned back, less half of those
  // that have not since.
  std::array<Vec, 2> planned_step_ = {Vec::Zero(), Vec::Zero()};
  double turns_ = 0;
};

}  // namespace

int run_hands(Scene scene, const Options& o, const clothctl::GridMesh<double>& grid,
              const clothctl::ClothState<double>& state, const FitTask& fit_task,
              const HandMaker& make_hand) {
  if (!is_implicit(o.plant)) refuse("--hands: --plant must be newton or linear-implicit");
  if (o.cloth < 4 || o.size < 0.15)
    refuse("--hands: the sheet is too coarse or too small (--cloth 4, --size 0.15 at least)");
  if (o.grip != "force") refuse("--hands: --grip must be force");
  if (o.patch_size != 1) refuse("--hands: --patch-size must be 1, fingers say what they hold");
  if (!(scene.setup.grips.front().fingers.front().contact.friction > 0))
    refuse("--hands: --friction must be positive, fingers hold by it");
  make_folder(o.out);  // before the work, since it may fail
  HandsRun run(scene, o, state, grid, make_hand);
  std::string bad = run.grasp();
  const Errors bare = bad.empty() ? run_bare(std::move(scene), o, state, fit_task) : Errors();
  if (bad.empty()) bad = run.follow(fit_task);
  const GraspFigures& a = run.hands()[0]->figures();
  const GraspFigures& b = run.hands()[1]->figures();
  std::vector<double> ms;  // of both hands
  for (std::size_t i = 0; i < std::min(a.ms.size(), b.ms.size()); ++i)
    ms.push_back(a.ms[i] + b.ms[i]);
  const auto most = [&](double GraspFigures::*figure) { return larger(a.*figure, b.*figure); };
  nlohmann::ordered_json j;
  j["status"] = bad.empty() ? "finished" : bad;
  j["vertices"] = state.positions.cols();
  j["predictor"] = run.predictor();
  j["linearised_from_s"] = known(run.linearised_from_s);
  j["mean_error_m"] = known(run.errors.mean(), run.errors.frames > 0);
  j["max_error_m"] = known(run.errors.most, run.errors.frames > 0);
  j["bare_mean_error_m"] = known(bare.mean(), bare.frames > 0);
  j["bare_max_error_m"] = known(bare.most, bare.frames > 0);
  j["grasp_firm_share"] = 0.5 * ((a.firm_s >= 0 ? 1 : 0) + (b.firm_s >= 0 ? 1 : 0));
  j["slips"] = a.last.slips + b.last.slips;
  j["grip_force_mean_N"] =
      known((a.force_sum + b.force_sum) / static_cast<double>(a.held_steps + b.held_steps),
            a.held_steps + b.held_steps > 0);
  j["grip_changes"] = run.grip_changes;
  j["ik_error_max_m"] = most(&GraspFigures::ik_error_max_m);
  j["rectify_residual_max_m"] = run.rectify_residual;
  j["penetration_max_m"] = known(most(&GraspFigures::penetration_max_m));
  j["torque_max_share"] = most(&GraspFigures::torque_max_share);
  j["momentum_residual"] = known(most(&GraspFigures::momentum_residual));
  j["hand_frame_ms"] = quantile(ms, 0.5);
  j["hand_frame_ms_p99"] = quantile(ms, 0.99);
  if (!o.out.empty()) {
    for (const auto& [key, value] : j.items())
      run.page().scene().figures.emplace_back(key, figure_text(value));
    if (const std::string error = run.page().write(o.out); !error.empty()) refuse(error);
  }
  print_figures(j, o.json);
  if (!o.out.empty() && !o.json) std::printf("open %s/player.html\n", o.out.c_str());
  return bad.empty() ? 0 : 1;
}

}  // namespace program
