#include "support/cloth_scene.hpp"

#include <algorithm>
#include <charconv>
#include <random>
#include <string_view>
#include <system_error>
#include <utility>

#include "clothctl/cloth/position_based.hpp"
#include "clothctl/cloth/settle.hpp"
#include "clothctl/core/quoted_text.hpp"
#include "clothctl/io/obj.hpp"
#include "clothctl/mesh/garment_patterns.hpp"
#include "clothctl/network/garment.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/inputs.hpp"

namespace program {

namespace {

/// Reads a number that ends at `end`; moves behind it.
template <class Number>
bool read_number(std::string_view& text, Number& value) {
  const std::from_chars_result read =
      std::from_chars(text.data(), text.data() + text.size(), value);
  if (read.ec != std::errc()) return false;
  text.remove_prefix(static_cast<std::size_t>(read.ptr - text.data()));
  return true;
}

/// Moves behind `head`. Returns false where the text starts otherwise.
bool skip(std::string_view& text, std::string_view head) {
  if (!text.starts_with(head)) return false;
  text.remove_prefix(head.size());
  return true;
}

clothctl::SpringNetwork<double> grid_network(const ClothOptions& o,
                                             const clothctl::Material<double>& material) {
  std::string_view text = o.mesh;
  int rows = 0, cols = 0;
  const bool read = skip(text, "grid:") && read_number(text, rows) && skip(text, "x") &&
                    read_number(text, cols) && text.empty();
  if (!read || rows < 2 || cols < 2 || rows > 1000 || cols > 1000)
    refuse("--mesh: " + clothctl::quoted_text(o.mesh) +
           ", expected grid:ROWSxCOLUMNS with 2 to 1000 vertices each");
  const double height = o.size * (rows - 1) / (cols - 1);
  return must(clothctl::sheet_network(must(clothctl::make_grid<double>(rows, cols, o.size, height)),
                                      material));
}

double largest_extent(const Points& x) {
  return (x.rowwise().maxCoeff() - x.rowwise().minCoeff()).maxCoeff();
}

/// Leaves the vertices at the middles of the shoulder seams of a shirt in `shoulders`.
clothctl::SpringNetwork<double> mesh_network(const ClothOptions& o,
                                             const clothctl::Material<double>& material,
                                             std::vector<int>& shoulders) {
  if (o.mesh.starts_with("grid:")) return grid_network(o, material);
  clothctl::PatternMesh mesh;
  if (o.mesh == "tshirt") {
    const clothctl::Garment panels =
        must(clothctl::make_garment(must(clothctl::tshirt_pattern()), clothctl::kTshirtEdgeLength));
    clothctl::SewnGarment sewn = must(clothctl::weld_seams(panels));
    for (const std::size_t side : {3, 5}) {
      const std::vector<int>& seam = panels.panels[0].sides[side];
      shoulders.push_back(sewn.vertex_of[static_cast<std::size_t>(seam[seam.size() / 2])]);
    }
    mesh = std::move(sewn.mesh);
  } else if (o.mesh.ends_with(".obj")) {
    mesh = must(clothctl::read_obj(o.mesh));
  } else {
    refuse("--mesh: " + clothctl::quoted_text(o.mesh) +
           " is neither grid:ROWSxCOLUMNS nor tshirt nor FILE.obj");
  }
  if (o.size_given) {
    const double scale = o.size / largest_extent(mesh.positions);
    mesh.positions *= scale;
    mesh.pattern *= scale;
  }
  auto network = mesh.has_pattern()
                     ? clothctl::pattern_network(mesh, material)
                     : clothctl::sheet_network<double>(mesh.positions, mesh.triangles, material);
  if (!network) refuse(o.mesh + ": " + network.error());
  return std::move(network).value();
}

/// Lets a sewn garment come to rest: its panels were cut flat and placed around a body, so that the
/// cloth near its seams is strained. It hangs from its pins with little stretch, slowed by strong
/// drag.
void relax(ClothScene& scene) {
  auto settings = clothctl::PositionBasedSettings<double>::of(scene.material, false);
  settings.drag = 10;
  settings.substeps = 10;
  settings.stretch_limit = 0.01;
  settings.pinned = scene.pinned;
  AnyPlant plant(must(clothctl::PositionBased<double>::create(scene.network, settings)));
  plant.set_state(scene.state);
  if (!clothctl::settle(plant, scene.pinned, 1.0 / 60, 3.0, 0.02).advanced)
    refuse("--mesh: the garment does not settle");
  scene.state.positions = plant.positions();
}

/// Returns the vertices that --pin names: words by their places in the hanging mesh, or indices.
std::vector<int> read_pins(const ClothOptions& o, const Points& x,
                           const std::vector<int>& shoulders) {
  std::vector<int> pins;
  if (o.pin == "none") return pins;
  if (o.pin == "top") {
    const double top = x.row(2).maxCoeff(),
                 close = 1e-9 * (std::abs(top) + top - x.row(2).minCoeff());
    for (Index i = 0; i < x.cols(); ++i) {
      if (x(2, i) >= top - close) pins.push_back(static_cast<int>(i));
    }
    return pins;
  }
  if (o.pin == "corners" && !shoulders.empty()) return shoulders;
  if (o.pin == "corners") {
    for (const double side : {-1.0, 1.0}) {
      Index highest = 0;
      (x.row(2) + side * x.row(0)).maxCoeff(&highest);
      pins.push_back(static_cast<int>(highest));
    }
    return pins;
  }
  pins = read_vertices(o.pin, "--pin");
  for (const int v : pins) {
    if (v < 0 || v >= x.cols())
      refuse("--pin: vertex " + std::to_string(v) + " is off the mesh of " +
             std::to_string(x.cols()) + " vertices");
  }
  return pins;
}

}  // namespace

Vec read_triple(const std::string& text, const std::string& option) {
  std::string_view rest = text;
  Vec out;
  for (Index c = 0; c < 3; ++c) {
    if ((c > 0 && !skip(rest, ",")) || !read_number(rest, out[c]) || !(std::abs(out[c]) <= 1000))
      refuse(option + ": " + clothctl::quoted_text(text) +
             ", expected three numbers X,Y,Z within ±1000");
  }
  if (!rest.empty())
    refuse(option + ": " + clothctl::quoted_text(text) +
           ", expected three numbers X,Y,Z within ±1000");
  return out;
}

ClothScene make_cloth_scene(const ClothOptions& o) {
  ClothScene scene;
  scene.material = read_material(o.material);
  std::vector<int> shoulders;
  scene.network = mesh_network(o, scene.material, shoulders);
  if (!o.wind.empty()) scene.wind = read_triple(o.wind, "--wind");
  const Points& rest = scene.network.rest_positions;
  scene.extent = largest_extent(rest);
  scene.pinned = read_pins(o, rest, shoulders);
  scene.state = {rest, Points::Zero(3, rest.cols())};
  if (o.mesh == "tshirt") relax(scene);
  Points& x = scene.state.positions;
  if (o.start == "level") {  // turn about the x axis, so that what was low comes to the front
    const Points hanging = x;
    const double top = hanging.row(2).maxCoeff();
    x.row(1) = hanging.row(2).array() - top;
    x.row(2) = top - hanging.row(1).array();
  }
  std::mt19937_64 random(o.seed);
  std::vector<bool> held(static_cast<std::size_t>(x.cols()), false);
  for (const int v : scene.pinned) held[static_cast<std::size_t>(v)] = true;
  for (Index i = 0; i < x.cols(); ++i) {
    for (Index c = 0; c < 3; ++c) {
      const double unit = static_cast<double>(random() >> 11) * 0x1p-53;  // 0 to 1
      if (!held[static_cast<std::size_t>(i)]) x(c, i) += 1e-6 * scene.extent * (2 * unit - 1);
    }
  }
  return scene;
}

}  // namespace program
