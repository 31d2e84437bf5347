// Sews a T-shirt (or a tank top) from its flat panels: springs pull the seams together, the closed
// seams are welded, and the shirt then hangs from two pins at its shoulders.
//
//   sew_tshirt --out out          then open out/player.html

#include <algorithm>
#include <cmath>
#include <numeric>

#include "clothctl/mesh/garment_patterns.hpp"
#include "clothctl/network/garment.hpp"
#include "support/command_line.hpp"
#include "support/inputs.hpp"
#include "support/workshop.hpp"

namespace {

using namespace program;
using Network = Workshop::Network;
using Points = clothctl::Points<double>;

constexpr double kFrame = 0.02;  // s

struct Request {
  std::string garment = "tshirt", material = "cotton", out;
  double edge_length = clothctl::kTshirtEdgeLength, sew = 1.2, hang = 2;
  bool json = false;
};

Request read_request(int argc, char** argv) {
  Request r;
  CLI::App app{"Sews a shirt from flat panels and hangs it from two pins at its shoulders."};
  const auto add = [&](const char* name, auto& value, const char* help) {
    return app.add_option(name, value, help)->capture_default_str();
  };
  add("--garment", r.garment, "What is sewn")->check(CLI::IsMember({"tshirt", "tank-top"}));
  add("--edge-length", r.edge_length, "Edge length of the triangles, m")->check(between(3e-3, 0.1));
  add("--material", r.material, "Preset name or JSON file");
  add("--sew", r.sew, "Time in which the seams close, s")->check(between(0.1, 60));
  add("--hang", r.hang, "Time that the shirt hangs, s")->check(between(0, 60));
  app.add_flag("--json", r.json, "Print the figures as one JSON object on the last line");
  app.add_option("--out", r.out, "Folder for player.html and shirt.obj (made if missing)")
      ->check([](const std::string& t) { return std::string(t.empty() ? "is empty" : ""); });
  parse(app, argc, argv);
  return r;
}

/// Closes the seams without gravity, stage by stage. Returns the largest gap that is left, m.
double sew(const Request& r, const clothctl::Garment& garment,
           const clothctl::Material<double>& material, Workshop& shop) {
  const clothctl::SeamSettings<double> seams;
  Network network = must(clothctl::sewing_network(garment, material, seams));
  const Points start = network.rest_positions;
  std::vector<int> same(static_cast<std::size_t>(start.cols()));
  std::iota(same.begin(), same.end(), 0);
  Workshop::Settings settings;
  settings.gravity.setZero();
  settings.drag = 6;
  const auto gap = [&] {
    return clothctl::largest_seam_gap<double>(garment, shop.state.positions);
  };
  const int stages = static_cast<int>(std::ceil(r.sew / (4 * kFrame)));
  // The rest lengths fall to the thickness of a seam; then there is time to settle.
  for (int stage = 1; stage <= 4 * stages && (stage <= stages || gap() > 9e-4); ++stage) {
    const double share = std::max(0.0, 1 - static_cast<double>(stage) / stages);
    clothctl::set_seam_lengths<double>(network, start, share, seams.thickness);
    if (!shop.advance(network, settings, 4, same)) return HUGE_VAL;
  }
  return gap();
}

/// Welds the seams where they are and hangs the shirt from the middle of each shoulder. Returns its
/// mesh.
clothctl::PatternMesh hang(const Request& r, const clothctl::Garment& garment,
                           const clothctl::Material<double>& material, Workshop& shop) {
  clothctl::SewnGarment sewn = must(clothctl::weld_seams(garment));
  clothctl::PatternMesh& mesh = sewn.mesh;
  mesh.positions = clothctl::merge_points(sewn.vertex_of, shop.state.positions);
  shop.state = {mesh.positions, Points::Zero(3, mesh.positions.cols())};
  const Network network = must(clothctl::pattern_network(mesh, material));
  Workshop::Settings settings = Workshop::Settings::of(material);
  settings.drag = 2;  // comes to rest sooner
  settings.substeps = 10;
  settings.stretch_limit = 0.03;
  for (const std::size_t side : {3, 5}) {
    const std::vector<int>& seam = garment.panels[0].sides[side];
    settings.pinned.push_back(sewn.vertex_of[static_cast<std::size_t>(seam[seam.size() / 2])]);
  }
  const int count = static_cast<int>(std::lround(r.hang / kFrame));
  if (!shop.advance(network, settings, count, sewn.vertex_of))
    shop.figures["status"] = "the step failed";
  mesh.positions = shop.state.positions;
  double worst = 0, sum = 0;
  for (const auto& s : network.springs) {
    const double length = (mesh.positions.col(s.b) - mesh.positions.col(s.a)).norm();
    worst = std::max(worst, length / s.rest_length - 1);
    sum += std::max(0.0, length / s.rest_length - 1);
  }
  const auto loops = must(clothctl::boundary_loops(network.vertex_count(), mesh.triangles));
  shop.figures["vertices_sewn"] = network.vertex_count();
  shop.figures["boundary_loops"] = loops.size();
  shop.figures["mass_kg"] = network.mass.sum();
  shop.figures["stretch_max"] = worst;
  shop.figures["stretch_mean"] = sum / static_cast<double>(network.springs.size());
  shop.figures["speed_max"] = shop.state.velocities.colwise().norm().maxCoeff();
  return mesh;
}

}  // namespace

int main(int argc, char** argv) {
  const Request r = read_request(argc, argv);
  make_folder(r.out);  // before the work, since it may fail
  const clothctl::Material<double> material = read_material(r.material);
  const bool sleeves = r.garment == "tshirt";
  const auto pattern = must(sleeves ? clothctl::tshirt_pattern() : clothctl::tank_top_pattern());
  const clothctl::Garment garment = must(clothctl::make_garment(pattern, r.edge_length));
  clothctl::PlayerScene scene;
  scene.title = sleeves ? "T-shirt, sewn from four panels" : "Tank top, sewn from two panels";
  scene.subtitle = material.name;
  scene.mesh_name = "Shirt";
  Workshop shop(garment, scene, kFrame, std::lround((r.sew + r.hang) / kFrame), !r.out.empty());
  shop.figures["status"] = "sewn";
  const double gap = sew(r, garment, material, shop);
  shop.figures["vertices"] = garment.mesh.positions.cols();
  shop.figures["sew_frames"] = shop.frames;
  shop.figures["seam_gap_mm"] = 1000 * gap;
  const bool closed = gap < 1e-3;
  if (!closed) shop.figures["status"] = "seams are open";
  shop.finish(r.out, r.json, closed ? hang(r, garment, material, shop) : garment.mesh);
  return shop.figures["status"] == "sewn" ? 0 : 1;
}
