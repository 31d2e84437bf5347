// How the error of each cloth model falls with the time step and with the edge length, and what a
// simulated second costs. Prints rows "study,model,x,error,seconds"; plot.py draws them.
//
//   bench_order > order.csv && bench/order/plot.py order.csv docs/images/cloth_order.svg
//
// Study "step": a curtain, pinned along its upper edge and lifted by 30°, swings for 0.4 s. x is
// the step (s). The reference integrates the same network by velocity Verlet with steps of 4 µs, in
// plain loops that share no code with the models. The error is the root mean square distance of the
// vertices, over the side of the sheet.
//
// Study "mesh": the same curtain on coarser and finer meshes, with steps of 0.625 ms. x is the
// length of an edge (m). The error is that at the 5×5 vertices that all meshes share, against
// velocity Verlet on the finest mesh with steps of 2 µs.

#include <time.h>

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"

namespace {

using clothctl::ClothState;
using clothctl::Index;
using clothctl::Integration;
using clothctl::MassSpring;
using clothctl::PositionBased;
using Vec = clothctl::Vector3<double>;
using Network = clothctl::SpringNetwork<double>;
using Points = clothctl::Points<double>;

constexpr double kSide = 0.5;

double thread_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

void print_row(const char* study, const std::string& model, double x, double error,
               double seconds) {
  std::printf("%s,%s,%.6g,%.6g,%.6g\n", study, model.c_str(), x, error, seconds);
  std::fflush(stdout);
}

struct Scene {
  int n = 0;
  Network network;
  std::vector<int> pinned;
  ClothState<double> start;
};

Scene sheet(int n) {
  const auto grid = clothctl::make_grid<double>(n, n, kSide, kSide).value();
  Scene scene;
  scene.n = n;
  scene.network =
      clothctl::sheet_network(grid, clothctl::material_preset<double>("handkerchief").value())
          .value();
  scene.start = {grid.positions, Points::Zero(3, grid.positions.cols())};
  return scene;
}

Scene lifted_curtain(int n) {
  Scene scene = sheet(n);
  for (int col = 0; col < scene.n; ++col) scene.pinned.push_back((scene.n - 1) * scene.n + col);
  const double top = scene.start.positions(2, scene.pinned.front());
  const double angle = 3.14159265358979323846 / 6;
  for (Index v = 0; v < scene.start.positions.cols(); ++v) {
    const double down = top - scene.start.positions(2, v);
    scene.start.positions(1, v) = down * std::sin(angle);
    scene.start.positions(2, v) = top - down * std::cos(angle);
  }
  return scene;
}

/// The accelerations of a network under gravity.
Points accelerations(const Network& network, const std::vector<int>& pinned, const Points& x,
                     const Points& v) {
  Points f = Points::Zero(3, x.cols());
  for (const auto& s : network.springs) {
    const Vec d = x.col(s.b) - x.col(s.a), u = v.col(s.b) - v.col(s.a);
    const double length = d.norm();
    const Vec n = d / length;
    const Vec pull = (s.stiffness * (length - s.rest_length) + s.damping * n.dot(u)) * n;
    f.col(s.a) += pull;
    f.col(s.b) -= pull;
  }
  for (const auto& b : network.bends) {
    Vec k = Vec::Zero();
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i)
      k += b.weight[i] * x.col(b.vertex[i]);
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i)
      f.col(b.vertex[i]) -= b.stiffness * b.weight[i] * k;
  }
  for (Index i = 0; i < x.cols(); ++i) f.col(i) = f.col(i) / network.mass[i] + Vec(0, 0, -9.81);
  for (int p : pinned) f.col(p).setZero();
  return f;
}

Points reference(const Scene& scene, double seconds, double h) {
  Points x = scene.start.positions, v = scene.start.velocities;
  Points a = accelerations(scene.network, scene.pinned, x, v);
  for (long k = std::lround(seconds / h); k > 0; --k) {
    v += 0.5 * h * a;
    x += h * v;
    a = accelerations(scene.network, scene.pinned, x, v);
    v += 0.5 * h * a;
  }
  return x;
}

/// Makes the models that take part, by name.
template <class Visit>
void for_each_model(const Scene& scene, double drag, Visit visit) {
  for (const bool newton : {false, true}) {
    clothctl::MassSpringSettings<double> settings;
    settings.integration = newton ? Integration::Newton : Integration::LinearlyImplicit;
    settings.drag = drag;
    settings.pinned = scene.pinned;
    visit(newton ? "Newton" : "one linear solve",
          MassSpring<double>::create(scene.network, settings).value());
  }
  for (const int substeps : {1, 20}) {
    clothctl::PositionBasedSettings<double> settings;
    settings.substeps = substeps;
    settings.iterations = substeps == 1 ? 200 : 2;
    settings.drag = drag;
    settings.pinned = scene.pinned;
    visit("XPBD " + std::to_string(substeps) + " x " + std::to_string(settings.iterations),
          PositionBased<double>::create(scene.network, settings).value());
  }
}

void step_study() {
  constexpr double seconds = 0.4;
  const Scene scene = lifted_curtain(17);
  const Points exact = reference(scene, seconds, 4e-6);
  const Points half = reference(scene, seconds, 8e-6);
  const double count = static_cast<double>(exact.cols());
  print_row("step", "reference", 8e-6, (half - exact).norm() / std::sqrt(count) / kSide, 0);
  for_each_model(scene, 0.0, [&](const std::string& name, auto model) {
    for (const int frames : {10, 20, 40, 80, 160, 320, 640}) {
      auto workspace = model.make_workspace();
      ClothState<double> state = scene.start;
      const clothctl::ClothInput<double> input;
      const double begin = thread_seconds();
      for (int k = 0; k < frames; ++k) {
        if (!model.step(state, input, seconds / frames, workspace).advanced) return;
      }
      const double spent = (thread_seconds() - begin) / seconds;
      const double error = (state.positions - exact).norm() / std::sqrt(count) / kSide;
      print_row("step", name, seconds / frames, error, spent);
    }
  });
}

/// The vertices that a sheet of n×n vertices shares with one of 5×5.
Points shared_vertices(const Points& x, int n) {
  Points shared(3, 25);
  for (int v = 0; v < 25; ++v) shared.col(v) = x.col((v / 5 * n + v % 5) * ((n - 1) / 4));
  return shared;
}

void mesh_study() {
  constexpr double seconds = 0.4;
  constexpr int frames = 640, finest = 65;
  const Points exact = shared_vertices(reference(lifted_curtain(finest), seconds, 2e-6), finest);
  for (const int n : {5, 9, 17, 33, finest}) {
    const Scene scene = lifted_curtain(n);
    for_each_model(scene, 0.0, [&](const std::string& name, auto model) {
      if (name == "XPBD 1 x 200") return;
      auto workspace = model.make_workspace();
      ClothState<double> state = scene.start;
      const double begin = thread_seconds();
      for (int k = 0; k < frames; ++k) {
        if (!model.step(state, {}, seconds / frames, workspace).advanced) return;
      }
      const double spent = (thread_seconds() - begin) / seconds;
      const double error = (shared_vertices(state.positions, n) - exact).norm() / 5 / kSide;
      print_row("mesh", name, kSide / (n - 1), error, spent);
    });
  }
}

}  // namespace

int main() {
  std::printf("study,model,x,error,seconds\n");
  step_study();
  mesh_study();
}
