// Colliders: queries a second of each shape, meshes by their tree and by a grid, sweeps, and the
// contacts of a sheet. `items_per_second` counts points. Then the contact solver.

#include <benchmark/benchmark.h>

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "clothctl/collision/collider_union.hpp"
#include "clothctl/collision/mesh_collider.hpp"
#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/collision/shapes.hpp"
#include "clothctl/collision/sheet_contacts.hpp"
#include "clothctl/contact/contact_solver.hpp"
#include "clothctl/contact/impulse_responses.hpp"

namespace {

using namespace clothctl;

constexpr Index kPoints = 1000;

/// Random points in a cube of half width 0.6 m.
template <class S>
Points<S> cloud(unsigned seed) {
  std::mt19937 random(seed);
  Points<S> x(3, kPoints);
  for (Index i = 0; i < x.size(); ++i)
    x(i) = static_cast<S>(1.2 * static_cast<double>(random()) / 4294967296.0 - 0.6);
  return x;
}

/// Random points at most about 2 cm from the surface of the torus below, where contacts are.
template <class S>
Points<S> torus_skin(unsigned seed) {
  const Points<S> draw = cloud<S>(seed);
  Points<S> x(3, kPoints);
  for (Index i = 0; i < kPoints; ++i) {
    const double u = 5.236 * static_cast<double>(draw(0, i)),
                 v = 5.236 * static_cast<double>(draw(1, i));
    const double r = 0.15 + static_cast<double>(draw(2, i)) / 30, out = 0.35 + r * std::cos(v);
    x.col(i) =
        Vector3<double>(out * std::cos(u), out * std::sin(u), r * std::sin(v)).template cast<S>();
  }
  return x;
}

/// A torus of `around` × `around`/2 × 2 triangles.
template <class S>
MeshCollider<S> torus(int around) {
  const int across = around / 2;
  Points<S> x(3, around * across);
  std::vector<std::array<int, 3>> triangles;
  const double turn = 2 * std::acos(-1.0);
  for (int i = 0; i < around; ++i) {
    for (int j = 0; j < across; ++j) {
      const double u = turn * i / around, v = turn * j / across, out = 0.35 + 0.15 * std::cos(v);
      x.col(i * across + j) =
          Vector3<double>(out * std::cos(u), out * std::sin(u), 0.15 * std::sin(v))
              .template cast<S>();
      const int a = i * across + j, b = (i + 1) % around * across + j;
      const int c = (i + 1) % around * across + (j + 1) % across, d = i * across + (j + 1) % across;
      triangles.push_back({a, b, c});
      triangles.push_back({a, c, d});
    }
  }
  return MeshCollider<S>::create(x, triangles).value();
}

template <class S>
struct Shapes {
  using V = Vector3<S>;
  PlaneCollider<S> plane = PlaneCollider<S>::create(V(0, 0, 0), V(1, 2, 3)).value();
  SphereCollider<S> sphere = SphereCollider<S>::create(V(0, 0, 0), S(0.4)).value();
  CapsuleCollider<S> capsule =
      CapsuleCollider<S>::create(V(S(-0.3), 0, 0), V(S(0.3), S(0.1), 0), S(0.2)).value();
  BoxCollider<S> box = BoxCollider<S>::create(V(0, 0, 0), V(S(0.4), S(0.3), S(0.2))).value();
  CylinderCollider<S> cylinder =
      CylinderCollider<S>::create(V(0, 0, S(-0.3)), V(0, S(0.1), S(0.3)), S(0.3)).value();
  HullCollider<S> hull = [] {
    Points<S> x = cloud<S>(3).leftCols(200);
    return HullCollider<S>::create(x).value();
  }();
  MovingCollider<S, CapsuleCollider<S>> moving = [this] {
    RigidMotion<S> m;
    m.velocity = V(1, 0, 0);
    m.angular_velocity = V(0, 2, 1);
    return MovingCollider<S, CapsuleCollider<S>>::create(capsule, m).value();
  }();
};

template <class S, class C>
void run_distance(benchmark::State& state, const C& collider) {
  const Points<S> x = cloud<S>(1);
  VectorX<S> d(kPoints);
  for (auto _ : state) {
    benchmark::DoNotOptimize(collider.distance(x, d));
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * kPoints);
}

template <class S, class C>
void run_closest(benchmark::State& state, const C& collider, const Points<S>& x = cloud<S>(1)) {
  std::vector<SurfacePoint<S>> out(static_cast<std::size_t>(kPoints));
  for (auto _ : state) {
    benchmark::DoNotOptimize(collider.closest(x, out));
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * kPoints);
}

template <class S, class C>
void run_sweep(benchmark::State& state, const C& collider) {
  const Points<S> x = cloud<S>(1);
  Points<S> y = x;
  y += S(0.1) * cloud<S>(2);  // up to 0.1 m in the step
  VectorX<S> t(kPoints);
  for (auto _ : state) {
    benchmark::DoNotOptimize(collider.sweep(x, y, S(0.001), S(0.02), t));
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * kPoints);
}

#define SHAPE(name)                               \
  template <class S>                              \
  void distance_##name(benchmark::State& state) { \
    run_distance<S>(state, Shapes<S>().name);     \
  }                                               \
  template <class S>                              \
  void closest_##name(benchmark::State& state) {  \
    run_closest<S>(state, Shapes<S>().name);      \
  }                                               \
  template <class S>                              \
  void sweep_##name(benchmark::State& state) {    \
    run_sweep<S>(state, Shapes<S>().name);        \
  }                                               \
  BENCHMARK(distance_##name<double>);             \
  BENCHMARK(closest_##name<double>);              \
  BENCHMARK(closest_##name<float>);               \
  BENCHMARK(sweep_##name<double>);
SHAPE(plane)
SHAPE(sphere)
SHAPE(capsule)
SHAPE(box)
SHAPE(cylinder)
SHAPE(hull)
SHAPE(moving)

/// Triangles: around². Points near the surface.
template <class S>
void mesh_tree(benchmark::State& state) {
  run_closest<S>(state, torus<S>(static_cast<int>(state.range(0))), torus_skin<S>(1));
}
/// Points anywhere, many of which have many triangles at nearly the same distance.
template <class S>
void mesh_tree_anywhere(benchmark::State& state) {
  run_closest<S>(state, torus<S>(static_cast<int>(state.range(0))));
}
template <class S>
void mesh_grid(benchmark::State& state) {
  const auto mesh = torus<S>(static_cast<int>(state.range(0)));
  run_closest<S>(state, GridCollider<S>::create(mesh, 64, S(0.05)).value(), torus_skin<S>(1));
}
template <class S>
void mesh_grid_distance(benchmark::State& state) {
  const auto mesh = torus<S>(static_cast<int>(state.range(0)));
  run_distance<S>(state, GridCollider<S>::create(mesh, 64, S(0.5)).value());
}
void mesh_sweep(benchmark::State& state) {
  run_sweep<double>(state, torus<double>(static_cast<int>(state.range(0))));
}
void make_mesh(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(torus<double>(static_cast<int>(state.range(0))));
}
void make_grid(benchmark::State& state) {
  const auto mesh = torus<double>(100);
  for (auto _ : state)
    benchmark::DoNotOptimize(
        GridCollider<double>::create(mesh, static_cast<int>(state.range(0)), 0.1));
}
BENCHMARK(mesh_tree<double>)->Arg(20)->Arg(100)->Arg(320);
BENCHMARK(mesh_tree<float>)->Arg(100);
BENCHMARK(mesh_tree_anywhere<double>)->Arg(100);
BENCHMARK(mesh_grid<double>)->Arg(100);
BENCHMARK(mesh_grid<float>)->Arg(100);
BENCHMARK(mesh_grid_distance<double>)->Arg(100);
BENCHMARK(mesh_sweep)->Arg(20)->Arg(100)->Arg(320);
BENCHMARK(make_mesh)->Arg(100)->Unit(benchmark::kMillisecond);
BENCHMARK(make_grid)->Arg(32)->Arg(64)->Unit(benchmark::kMillisecond);

/// A sheet of n×n vertices, 0.5 m wide, that lies over a ball of 0.15 m like a cap.
void sheet_contacts(benchmark::State& state, const ColliderRef<double>& collider) {
  const int n = static_cast<int>(state.range(0));
  Points<double> x(3, n * n);
  std::vector<std::array<int, 3>> triangles;
  for (int r = 0; r < n; ++r) {
    for (int c = 0; c < n; ++c) {
      const double u = 0.5 * c / (n - 1) - 0.25, v = 0.5 * r / (n - 1) - 0.25;
      const double rest = 0.1505 * 0.1505 - u * u - v * v;
      x.col(r * n + c) << u, v, rest > 0 ? std::sqrt(rest) : 0.0;
      if (r + 1 == n || c + 1 == n) continue;
      const int a = r * n + c;
      triangles.push_back({a, a + 1, a + n});
      triangles.push_back({a + 1, a + n + 1, a + n});
    }
  }
  auto finder = SheetContactFinder<double>::create(x, triangles).value();
  for (auto _ : state) {
    benchmark::DoNotOptimize(finder.update(x));
    benchmark::DoNotOptimize(finder.find(collider, 0.002, 0.02));
  }
  state.counters["contacts"] = static_cast<double>(finder.contacts().size());
}
void sheet_on_ball(benchmark::State& state) {
  const auto ball = SphereCollider<double>::create(Vector3<double>::Zero(), 0.15).value();
  sheet_contacts(state, ColliderRef<double>(ball));
}
void sheet_on_finger(benchmark::State& state) {
  const auto finger = CapsuleCollider<double>::create(Vector3<double>(0, 0, 0.145),
                                                      Vector3<double>(0, 0, 0.1), 0.008)
                          .value();
  sheet_contacts(state, ColliderRef<double>(finger));
}
/// The hull of 500 points of that ball, and the same as a mesh and as a grid.
HullCollider<double> rough_ball() {
  Points<double> x = cloud<double>(4).leftCols(500);
  for (Index i = 0; i < x.cols(); ++i) x.col(i) *= 0.15 / std::sqrt(x.col(i).squaredNorm());
  return HullCollider<double>::create(x).value();
}
void sheet_on_hull(benchmark::State& state) {
  const auto hull = rough_ball();
  sheet_contacts(state, ColliderRef<double>(hull));
}
void sheet_on_mesh(benchmark::State& state) {
  const auto hull = rough_ball();
  const auto mesh = MeshCollider<double>::create(hull.vertices(), hull.triangles()).value();
  sheet_contacts(state, ColliderRef<double>(mesh));
}
void sheet_on_grid(benchmark::State& state) {
  const auto hull = rough_ball();
  const auto mesh = MeshCollider<double>::create(hull.vertices(), hull.triangles()).value();
  const auto grid = GridCollider<double>::create(mesh, 64, 0.1).value();
  sheet_contacts(state, ColliderRef<double>(grid));
}
BENCHMARK(sheet_on_hull)->Arg(33)->Arg(65)->Unit(benchmark::kMicrosecond);
BENCHMARK(sheet_on_mesh)->Arg(33)->Arg(65)->Unit(benchmark::kMicrosecond);
BENCHMARK(sheet_on_grid)->Arg(33)->Arg(65)->Unit(benchmark::kMicrosecond);
BENCHMARK(sheet_on_ball)->Arg(33)->Arg(65)->Unit(benchmark::kMicrosecond);
BENCHMARK(sheet_on_finger)->Arg(33)->Arg(65)->Unit(benchmark::kMicrosecond);

/// A light plate (20 g) between two fingers (0.4 kg each, as under PD control) with c contacts,
/// half on each finger; soft as fingertips of 2000 N/m. Gaps, velocities and places are random.
struct Squeeze {
  RigidBodyResponse<double> plate = body(0.02, 1e-6), lower = body(0.4, 1e-4),
                            upper = body(0.4, 1e-4);
  std::vector<ContactSample<double>> contacts;

  static RigidBodyResponse<double> body(double mass, double inertia) {
    return RigidBodyResponse<double>::create(mass, inertia * Matrix3<double>::Identity()).value();
  }
  Squeeze(int c, unsigned seed) {
    std::mt19937 random(seed);
    const auto draw = [&] { return static_cast<double>(random()) / 2147483648.0 - 1; };
    Points<double> x(3, c);
    for (int i = 0; i < c; ++i) x.col(i) << 0.006 * draw(), 0.006 * draw(), 0;
    const int half = c / 2;
    RigidMotion<double> m;
    m.velocity << 0.2 * draw(), 0.2 * draw(), 0.24;
    bool good = lower.set_motion(m).empty();
    m.velocity << 0.2 * draw(), 0.2 * draw(), -0.24;
    good = upper.set_motion(m).empty() && good;
    for (RigidBodyResponse<double>* side : {&plate, &lower, &upper})
      good = side->set_points(x) == QueryStatus::Answered && good;
    for (int i = 0; i < c && good; ++i) {
      ContactSample<double> contact;
      contact.a.side = 0;
      contact.b.side = i < half ? 1 : 2;
      contact.a.point[0] = contact.b.point[0] = i;
      contact.normal[2] = i < half ? 1 : -1;
      contact.friction = 0.6;
      contact.gap = 1e-4 * draw();
      contact.compliance = contact.tangential_compliance = half / 2000.0;
      contact.offset << 1e-4 * draw(), 1e-4 * draw(), 0;
      contacts.push_back(contact);
    }
  }
};
void solve_contacts(benchmark::State& state, bool warm) {
  const int c = static_cast<int>(state.range(0));
  std::vector<Squeeze> all;
  for (unsigned seed = 1; seed <= 20; ++seed) all.emplace_back(c, seed);
  ContactSolver<double> solver;
  solver.reserve(c, c);
  const auto solve = [&](Squeeze& s, std::vector<ContactSample<double>>& contacts) {
    return solver.solve(contacts, 0.02, s.plate, s.lower, s.upper);
  };
  std::vector<std::vector<ContactSample<double>>> start;
  for (Squeeze& s : all) {
    start.push_back(s.contacts);
    if (!warm) continue;
    benchmark::DoNotOptimize(solve(s, s.contacts));
    // The next step is nearly the same.
    for (std::size_t i = 0; i < s.contacts.size(); ++i) {
      start.back()[i].impulse = s.contacts[i].impulse;
      start.back()[i].gap -= 1e-6;
    }
  }
  std::size_t k = 0;
  double steps = 0, solves = 0;
  std::vector<ContactSample<double>> contacts;
  for (auto _ : state) {
    contacts = start[k];
    const ContactReport<double> report = solve(all[k], contacts);
    steps += report.newton_steps;
    solves += 1;
    k = (k + 1) % all.size();
  }
  state.counters["newton_steps"] = steps / solves;
}
void solve_contacts_cold(benchmark::State& state) { solve_contacts(state, false); }
void solve_contacts_warm(benchmark::State& state) { solve_contacts(state, true); }
BENCHMARK(solve_contacts_cold)->Arg(4)->Arg(8)->Arg(14)->Arg(30)->Arg(60);
BENCHMARK(solve_contacts_warm)->Arg(4)->Arg(8)->Arg(14)->Arg(30)->Arg(60);

}  // namespace
