// A sheet is held along two sides, cut along a drawn line, and pulled apart until it tears.
//
//   tear --out out                              then open out/player.html
//   tear --cut 0.2,0.5,0.8,0.5 --limit 0.1      a slit across the middle

#include <cmath>
#include <nlohmann/json.hpp>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/cloth/tearable_sheet.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/hand_figures.hpp"
#include "support/inputs.hpp"
#include "support/options.hpp"
#include "support/tear_history.hpp"
#include "support/tear_request.hpp"
#include "support/timing.hpp"

namespace {

using namespace program;
using clothctl::Index;
using Points = clothctl::Points<double>;

constexpr double kStep = 1.0 / 60;

double rest_area(const clothctl::SpringNetwork<double>& network) {
  double sum = 0;
  for (const auto& t : network.triangles) {
    const clothctl::Vector3<double> x = network.rest_positions.col(t[0]);
    sum +=
        0.5 *
        (network.rest_positions.col(t[1]) - x).cross(network.rest_positions.col(t[2]) - x).norm();
  }
  return sum;
}

/// What a run counts.
struct Counts {
  Index tears = 0, cut_vertices = 0, nonfinite = 0;
  bool failed = false;
};

/// Pulls the sides of a sheet apart, and cuts it after a tenth of the run.
template <class Sheet>
Counts pull_apart(const TearRequest& o, Sheet& sheet, std::vector<int> held, TearHistory& history) {
  Counts counts;
  const auto take = [&](const clothctl::Remap<double>& remap) {
    held = remap.all_copies(held);
    history.add_change(remap);
    return remap.vertex_count() - remap.old_vertex_count();
  };
  Progress progress;
  const long frames = std::lround(o.seconds / kStep);
  for (long frame = 0; frame < frames && !counts.failed; ++frame) {
    if (frame == frames / 10 && !o.whole) {
      counts.cut_vertices += take(must(sheet.cut_at_rest(cut_line(o))));
      if (counts.cut_vertices == 0) refuse("--cut: the line opens no edge of the sheet");
    }
    const double share = static_cast<double>(frame + 1) / static_cast<double>(frames);
    const double moved = 0.5 * o.pull * o.size * smooth_share(share);
    clothctl::ClothInput<double> input;
    input.driven_vertices = held;
    input.driven_positions.resize(3, static_cast<Index>(held.size()));
    for (std::size_t i = 0; i < held.size(); ++i) {
      clothctl::Vector3<double> end = sheet.network().rest_positions.col(held[i]);
      end[0] += end[0] < 0 ? -moved : moved;
      input.driven_positions.col(static_cast<Index>(i)) = end;
    }
    sheet.apply(input);
    counts.failed = !sheet.advance(kStep).advanced;
    if (!clothctl::all_finite(sheet.positions())) ++counts.nonfinite;
    history.add_frame(sheet.positions());
    if (sheet.torn_count() > 0) counts.tears += take(must(sheet.apply_topology_changes()));
    progress.show(frame + 1, frames);
  }
  return counts;
}

template <class Model, class Settings>
int run(const TearRequest& o) {
  const clothctl::Material<double> material = read_material(o.material);
  const auto grid = must(clothctl::make_grid<double>(o.cloth, o.cloth, o.size, o.size));
  const auto network = must(clothctl::sheet_network(grid, material));
  clothctl::TearSettings<double> limits;
  limits.structural = limits.shear = o.limit;
  auto sheet = must(clothctl::TearableSheet<Model>::create(
      must(Model::create(network, Settings::of(material))), limits));
  std::vector<int> held;
  for (int row = 0; row < grid.rows; ++row) {
    held.push_back(grid.vertex(row, 0));
    held.push_back(grid.vertex(row, grid.cols - 1));
  }
  TearHistory history;
  const Counts counts = pull_apart(o, sheet, held, history);
  nlohmann::ordered_json j;
  j["status"] = counts.failed ? "failed" : "finished";
  j["vertices"] = sheet.vertex_count();
  j["tears"] = counts.tears;
  j["area_error"] = std::abs(rest_area(sheet.network()) / rest_area(network) - 1);
  j["nonfinite"] = counts.nonfinite;
  j["mass_error"] = std::abs(sheet.network().mass.sum() / network.mass.sum() - 1);
  j["cut_vertices"] = counts.cut_vertices;
  j["frames"] = history.frame_count();
  j["material"] = material.name;
  j["model"] = o.model;
  if (!o.out.empty()) {
    clothctl::PlayerScene scene;
    scene.title = "A sheet that tears";
    scene.dt = kStep;
    scene.triangles = sheet.network().triangles;
    history.write(scene, sheet.vertex_count(), o.out, j);
  }
  print_figures(j, o.json);
  if (!o.out.empty() && !o.json) std::printf("open %s/player.html\n", o.out.c_str());
  return counts.failed || counts.nonfinite > 0 ? 1 : 0;
}

}  // namespace

int main(int argc, char** argv) {
  const TearRequest o = read_tear_request(argc, argv);
  make_folder(o.out);  // before the work, since it may fail
  return o.model == "pbd"
             ? run<clothctl::PositionBased<double>, clothctl::PositionBasedSettings<double>>(o)
             : run<clothctl::MassSpring<double>, clothctl::MassSpringSettings<double>>(o);
}
