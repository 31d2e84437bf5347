#include "support/workshop.hpp"

#include <algorithm>
#include <cstdio>

#include "clothctl/io/obj.hpp"
#include "support/figure_text.hpp"
#include "support/options.hpp"

namespace program {

namespace {

using Points = clothctl::Points<double>;

/// Gives a scene the mesh of a garment and the time between recorded frames.
clothctl::PlayerScene shown(clothctl::PlayerScene scene, const clothctl::Garment& garment,
                            double dt) {
  scene.triangles = garment.mesh.triangles;
  scene.dt = 2 * dt;
  return scene;
}

}  // namespace

Workshop::Workshop(const clothctl::Garment& garment, clothctl::PlayerScene scene, double dt,
                   long all, bool record)
    : state{garment.mesh.positions, Points::Zero(3, garment.mesh.positions.cols())},
      page_(shown(std::move(scene), garment, dt), garment.mesh.positions.cols(), 0, 0),
      dt_(dt),
      all_(all),
      record_(record) {}

bool Workshop::advance(const Network& network, const Settings& settings, int count,
                       const std::vector<int>& vertex_of) {
  const auto model = must(clothctl::PositionBased<double>::create(network, settings));
  auto workspace = model.make_workspace();
  for (int i = 0; i < count; ++i) {
    const double before = thread_seconds();
    if (!model.step(state, {}, dt_, workspace).advanced) return false;
    seconds_ += thread_seconds() - before;
    progress_.show(++frames, all_);
    if (!record_ || frames % 2 == 1) continue;
    const Points x = state.positions(Eigen::all, vertex_of), none(3, 0);
    page_.add_frame(x, none, none, none, none);
  }
  return true;
}

void Workshop::finish(const std::string& out, bool json, const clothctl::PatternMesh& mesh) {
  progress_.clear();
  figures["frame_ms"] = 1000 * seconds_ / static_cast<double>(std::max(1L, frames));
  figures["real_time_factor"] = dt_ * static_cast<double>(frames) / std::max(seconds_, 1e-9);
  for (const auto& [key, value] : figures.items()) {
    const std::string text = figure_text(value);
    page_.scene().figures.emplace_back(key, text);
    if (!json) std::printf("%-18s %s\n", key.c_str(), text.c_str());
  }
  if (!out.empty()) {
    must(page_.write(out + "/player.html"));
    must(clothctl::write_obj(out + "/shirt.obj", mesh));
  }
  if (json) std::printf("%s\n", figures.dump().c_str());
}

}  // namespace program
