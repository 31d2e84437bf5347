#include "clothctl/io/obj.hpp"

#include <filesystem>
#include <random>

#include "clothctl/mesh/garment_patterns.hpp"
#include "clothctl/mesh/topology.hpp"
#include "support/catch.hpp"
#include "support/shared_data.hpp"
#include "support/tier.hpp"

using namespace clothctl;

namespace {

using Triangles = std::vector<std::array<int, 3>>;

PatternMesh parsed(std::string_view text) {
  const auto mesh = parse_obj(text, "m.obj");
  INFO((mesh ? std::string() : mesh.error()));
  REQUIRE(mesh);
  return *mesh;
}

std::string error_of(std::string_view text) {
  const auto mesh = parse_obj(text, "m.obj");
  REQUIRE_FALSE(mesh);
  return mesh.error();
}

bool same(const PatternMesh& a, const PatternMesh& b) {
  return a.positions.cols() == b.positions.cols() && a.positions == b.positions &&
         a.triangles == b.triangles && a.pattern.cols() == b.pattern.cols() &&
         a.pattern == b.pattern && a.pattern_triangles == b.pattern_triangles;
}

double area(const PatternMesh& mesh) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    const Vector3<double> u = mesh.positions.col(t[1]) - mesh.positions.col(t[0]),
                          w = mesh.positions.col(t[2]) - mesh.positions.col(t[0]);
    sum += 0.5 * Vector3<double>(u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2],
                                 u[0] * w[1] - u[1] * w[0])
                     .norm();
  }
  return sum;
}

}  // namespace

TEST_CASE("triangles, texture points, normals and negative indices are read", "[io]") {
  const char* text =
      "# a comment\r\n"
      "mtllib m.mtl\r\n"
      "o thing\r\n"
      "v 0 0 0\r\n"
      "v +1e0 0 0  # trailing\r\n"
      "v 0 1 0 1.0\r\n"
      "v 1 1 0.5 0.1 0.2 0.3\r\n"
      "vn 0 0 1\r\n"
      "vt 0 0\r\nvt 1\r\nvt 0 1 0\r\nvt 1 1\r\n"
      "\r\n"
      "g part\r\nusemtl red\r\ns off\r\n"
      "f 1/1/1 2/2/1 3/3/1\r\n"
      "f -2/-2 -3/-3 -1/-1\r\n";
  const PatternMesh mesh = parsed(text);
  REQUIRE(mesh.positions.cols() == 4);
  CHECK(mesh.positions.col(3) == Vector3<double>(1, 1, 0.5));
  CHECK(mesh.triangles == Triangles{{0, 1, 2}, {2, 1, 3}});
  REQUIRE(mesh.pattern.cols() == 4);
  CHECK(mesh.pattern.col(1) == FlatPoint(1, 0));
  CHECK(mesh.pattern_triangles == Triangles{{0, 1, 2}, {2, 1, 3}});
  CHECK(mesh.validate().empty());
  // Without a line break at the end, with a byte order mark, with v//vn and a continued line.
  CHECK(parsed("\xef\xbb\xbfv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1//1 \\\n2//1 \\\n 3//1").triangles ==
        Triangles{{0, 1, 2}});
}

TEST_CASE("a pattern is kept only if all faces have it", "[io]") {
  const std::string points = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n";
  CHECK(parsed(points + "f 1/1 2/2 3/3\n").has_pattern());
  CHECK_FALSE(parsed(points + "f 1/1 2/2 3/3\nf 2 4 3\n").has_pattern());
  CHECK_FALSE(parsed(points + "f 1/1 2 3/3\n").has_pattern());
  CHECK(parsed(points + "f 1 2 3\n").pattern.cols() == 0);
}

TEST_CASE("faces of any shape are divided into triangles of the same total area", "[io]") {
  const auto face = [](const std::vector<std::array<double, 2>>& corners, int axis, bool flip) {
    std::string text, refs = "f";
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const auto& c = flip ? corners[corners.size() - 1 - i] : corners[i];
      std::array<double, 3> p{};
      p[static_cast<std::size_t>(axis)] = 0.3 * c[0];
      p[static_cast<std::size_t>((axis + 1) % 3)] = c[0];
      p[static_cast<std::size_t>((axis + 2) % 3)] = c[1];
      text += "v " + number_text(p[0]) + " " + number_text(p[1]) + " " + number_text(p[2]) + "\n";
      refs += " " + std::to_string(i + 1);
    }
    return text + refs + "\n";
  };
  struct Case {
    std::vector<std::array<double, 2>> corners;
    double area;
  };
  const std::vector<Case> cases{
      {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}, 1},
      {{{0, 0}, {4, 0}, {1, 1}, {0, 4}}, 4},                                  // an arrow head
      {{{0, 0}, {3, 0}, {3, 3}, {2, 3}, {2, 1}, {1, 1}, {1, 3}, {0, 3}}, 7},  // a U
      {{{0, 0}, {1, 0}, {2, 0}, {2, 1}, {1, 1}, {0, 1}}, 2}};                 // corners in a row
  for (const Case& c : cases) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const bool flip : {false, true}) {
        const PatternMesh mesh = parsed(face(c.corners, axis, flip));
        CHECK(mesh.triangles.size() == c.corners.size() - 2);
        CHECK(area(mesh) == Approx(c.area * std::sqrt(1.09)));
        const auto loops = boundary_loops(mesh.positions.cols(), mesh.triangles);
        REQUIRE(loops);  // all triangles have the orientation of the face
        CHECK(loops->size() == 1);
        CHECK((*loops)[0].size() == c.corners.size());
      }
    }
  }
  // A quad is divided along its shorter diagonal.
  CHECK(parsed("v 0 0 0\nv 3 0 0\nv 3 1 0\nv 0 1.5 0\nf 1 2 3 4").triangles.size() == 2);
}

TEST_CASE("a written mesh is read back to the last bit", "[io]") {
  const auto garment = make_garment(*tshirt_pattern(), 0.03);
  REQUIRE(garment);
  const auto sewn = weld_seams(*garment);
  REQUIRE(sewn);
  PatternMesh mesh = sewn->mesh;
  mesh.positions(0, 0) = 1.0 / 3.0;
  mesh.positions(1, 0) = -1e-300;
  mesh.positions(2, 0) = 6.02214076e23;
  const auto text = obj_text(mesh);
  REQUIRE(text);
  CHECK(same(parsed(*text), mesh));
  mesh.pattern_triangles.clear();
  mesh.pattern.resize(2, 0);
  CHECK(same(parsed(*obj_text(mesh)), mesh));
  const auto path = std::filesystem::temp_directory_path() / "clothctl_obj_test.obj";
  REQUIRE(write_obj(path.string(), mesh));
  const auto back = read_obj(path.string());
  REQUIRE(back);
  CHECK(same(*back, mesh));
  std::filesystem::remove(path);
}

TEST_CASE("large meshes are read", "[io]") {
  const auto grid = make_panel(rectangle_outline(1, 1), 0.003);
  REQUIRE(grid);
  PatternMesh mesh;
  mesh.positions = Points<double>::Zero(3, grid->positions.cols());
  mesh.positions.topRows(2) = grid->positions;
  mesh.triangles = grid->triangles;
  CHECK(mesh.positions.cols() > 100000);
  CHECK(same(parsed(*obj_text(mesh)), mesh));
}

TEST_CASE("bad files are refused with file, line and value", "[io]") {
  const std::string three = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  CHECK(error_of("") == "m.obj:1: the file has no faces");
  CHECK(error_of(three) == "m.obj:3: the file has no faces");
  CHECK(error_of("v 0 0\n") == "m.obj:1: 'v' needs 3 to 7 numbers, found 2");
  CHECK(error_of("v 0 0 x\n") == "m.obj:1: 'x' is not a number");
  CHECK(error_of("v 0 0 nan\n") == "m.obj:1: 'nan' is not finite");
  CHECK(error_of("v 0 0 1e999\n") == "m.obj:1: '1e999' is out of the range of a double");
  CHECK(error_of(three + "vt\n") == "m.obj:4: 'vt' needs 1 to 3 numbers, found 0");
  CHECK(error_of(three + "f 1 2\n") == "m.obj:4: a face needs at least 3 corners, found 2");
  CHECK(error_of(three + "f 1 2 4\n") == "m.obj:4: index 4 is off the 3 vertex lines so far");
  CHECK(error_of(three + "f 0 1 2\n") == "m.obj:4: index 0 is off the 3 vertex lines so far");
  CHECK(error_of(three + "f -4 1 2\n") == "m.obj:4: index -4 is off the 3 vertex lines so far");
  CHECK(error_of(three + "f 1/1 2/1 3/1\n") ==
        "m.obj:4: index 1 is off the 0 texture points so far");
  CHECK(error_of(three + "f 1 2 2\n") == "m.obj:4: face holds vertex 2 twice");
  CHECK(error_of(three + "f 1 2 3.5\n") == "m.obj:4: '3.5' is not an index of a vertex");
  CHECK(error_of(three + "f 1 2 99999999999999999999\n") ==
        "m.obj:4: '99999999999999999999' is not an index of a vertex");
  CHECK(error_of(three + "f / 2 3\n") == "m.obj:4: '' is not an index of a vertex");
  CHECK(error_of("hello world\n") == "m.obj:1: 'hello' is no keyword of a mesh");
  CHECK(error_of("v 0 \\\n 0 \\\n0\nw 1\n") == "m.obj:4: 'w' is no keyword of a mesh");
  std::string wide = three + "f";
  for (int i = 0; i < 1001; ++i) wide += " 1";
  CHECK(error_of(wide) == "m.obj:4: a face of 1001 corners is too large, at most 1000 are read");
  CHECK(read_obj("/nowhere/m.obj").error().find("/nowhere/m.obj: cannot be opened") == 0);

  PatternMesh mesh;
  CHECK(obj_text(mesh).error() == "mesh is empty");
  mesh = parsed(three + "f 1 2 3\n");
  mesh.triangles[0] = {0, 1, 1};
  CHECK(write_obj("x.obj", mesh).error() == "x.obj: triangle 0 holds vertex 1 twice");
}

TEST_CASE("spoilt text never does harm", "[io]") {
  const auto garment = make_garment(handkerchief_pattern(), 0.1);
  REQUIRE(garment);
  const std::string good = *obj_text(garment->mesh);
  std::mt19937_64 engine(5);
  int read = 0;
  for (int i = 0; i < clothctl_test::trials(2000, 50000); ++i) {
    std::string text = good;
    for (int k = 0; k < 3; ++k) {
      const std::size_t at = engine() % text.size();
      constexpr std::string_view bytes = "vft/-+.e0129 \n\\#\0\xff";
      switch (engine() % 3) {
        case 0: text[at] = bytes[engine() % bytes.size()]; break;
        case 1: text.erase(at, engine() % 9); break;
        default: text.insert(at, 1, bytes[engine() % bytes.size()]);
      }
    }
    const auto mesh = parse_obj(text, "m.obj");
    if (mesh) CHECK(mesh->validate().empty());
    read += mesh ? 1 : 0;
  }
  CHECK(read > 0);
}

TEST_CASE("shared meshes are read with their counts", "[io]") {
  struct Case {
    const char* name;
    long vertices, triangles, loops, euler;
  };
  // From SOURCES.md of the folder. Quads count twice. The dresses have bow-tie vertices.
  const Case cases[] = {{"dc_tshirt1426", 1426, 2745, 4, -2},
                        {"dc_tshirt1921", 1921, 3726, 4, -2},
                        {"dc_tshirt1921_flattened", 1921, 3726, 4, -2},
                        {"dc_hat579", 579, 1099, 1, 1},
                        {"dc_sock482", 482, 944, 1, 1},
                        {"dc_sock1055", 1055, 2081, 1, 1},
                        {"dc_skirt681", 681, 1252, 2, 0},
                        {"dc_skirt1074", 1074, 2011, 2, 0},
                        {"dc_dress4536", 4536, 8801, -1, -6},
                        {"dc_dress3634_handsup", 3634, 7026, -1, -2},
                        {"dc_flag540", 540, 1026, 1, 1},
                        {"dc_sheet24x24", 576, 1058, 1, 1},
                        {"mh_body_quad", 13380, 2 * 13378, 0, 2},
                        {"mh_skirt_quad", 720, 2 * 684, 2, 0},
                        {"mh_tights_quad", 2674, 2 * 2650, 3, -1},
                        {"spot", 2930, 5856, 0, 2},
                        {"bunny_uniform", 8904, 17804, 0, 2}};
  if (clothctl_test::shared_path("data/meshes").empty()) {
    WARN("skipped: no ../shared/data/meshes");
    return;
  }
  for (const Case& c : cases) {
    INFO(c.name);
    const std::string path =
        clothctl_test::shared_path(std::string("data/meshes/") + c.name + ".obj");
    if (path.empty()) {
      WARN("skipped: no " << c.name);
      continue;
    }
    const auto mesh = read_obj(path);
    REQUIRE(mesh);
    CHECK(mesh->positions.cols() == c.vertices);
    CHECK(static_cast<long>(mesh->triangles.size()) == c.triangles);
    CHECK(mesh->validate().empty());
    const auto topology = make_topology(c.vertices, mesh->triangles);
    REQUIRE(topology);
    CHECK(topology->consistently_oriented);
    CHECK(c.vertices - static_cast<long>(topology->edges.size()) + c.triangles == c.euler);
    const auto loops = boundary_loops(c.vertices, mesh->triangles);
    if (c.loops >= 0) {
      REQUIRE(loops);
      CHECK(static_cast<long>(loops->size()) == c.loops);
    } else {
      CHECK(loops.error().find("the border passes twice through vertex") == 0);
    }
    CHECK(same(parsed(*obj_text(*mesh)), *mesh));
  }
}
