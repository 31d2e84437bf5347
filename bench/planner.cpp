// One frame of planning at 17×17 and 33×33 vertices (predictor in single precision), and the
// paper's own procedure at 17×17 as a baseline. The baseline integrates every pair of frames (j, k)
// and every generator separately, with one right-hand side at a time: no Toeplitz structure, no
// lanes, one factorisation. It stores the whole map from coefficients to positions, forms the dense
// normal matrix by a product and solves the QP cold. Both must plan the same first force to 1e-6;
// otherwise the baseline fails.

#include "clothctl/mpc/planner.hpp"

#include <benchmark/benchmark.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"

namespace {

using namespace clothctl;
using V = Vector3<double>;

constexpr double kDt = 0.02;

// A sheet that hangs from its upper corners, and targets of its lower corners.
struct Scene {
  GridMesh<double> grid;
  MassSpring<double> model;
  ClothState<double> state;
  PlannerSetup<double> setup;

  static Scene make(int n) {
    const GridMesh<double> grid = make_grid<double>(n, n, 0.5, 0.5).value();
    const Material<double> material;
    MassSpringSettings<double> settings;
    settings.drag = material.drag;
    Scene scene{grid,
                MassSpring<double>::create(sheet_network(grid, material).value(), settings).value(),
                {},
                {}};
    scene.state = scene.model.rest_state();
    const std::vector<int> hands{grid.vertex(n - 1, 0), grid.vertex(n - 1, n - 1)};
    ClothInput<double> input;
    input.driven_vertices = hands;
    input.driven_positions.resize(3, 2);
    for (Index j = 0; j < 2; ++j)
      input.driven_positions.col(j) =
          0.9 * scene.state.positions.col(hands[static_cast<std::size_t>(j)]);
    auto workspace = scene.model.make_workspace();
    for (int k = 0; k < 60; ++k) (void)scene.model.step(scene.state, input, kDt, workspace);
    for (int i : {0, n - 1}) scene.setup.features.add_point(grid.vertex(0, i));
    scene.setup.triangles = grid.triangles;
    for (int v : hands) scene.setup.grips.push_back(make_pinch<double>({v}, 0.5, 20.0));
    return scene;
  }

  PlannerSettings<double> settings(GripInput input) const {
    PlannerSettings<double> s;
    s.input = input;
    if (input == GripInput::Force) s.gravity_load = V(0.0, 0.0, 9.81 * model.network().mass.sum());
    return s;
  }

  V target(Index i, double t) const {
    const V start = state.positions.col(grid.vertex(0, i == 0 ? 0 : grid.cols - 1));
    const double ramp = t > 0 ? 1.0 - std::exp(-t * t / 0.3) : 0.0;
    return start + ramp * V(0.02 * std::sin(3.0 * t), 0.06 * std::sin(2.5 * t),
                            0.04 * (1.0 - std::cos(2.0 * t)));
  }
};

template <class Inner>
using Frozen = LinearisedPredictor<MassSpringResponse<Inner>, double>;

template <class Inner>
Planner<Frozen<Inner>> make_planner(const Scene& scene, GripInput input) {
  return Planner<Frozen<Inner>>::create(scene.setup, scene.settings(input),
                                        Frozen<Inner>(MassSpringResponse<Inner>(scene.model)),
                                        scene.state.positions)
      .value();
}

void frame(benchmark::State& bench, GripInput input) {
  const Scene scene = Scene::make(static_cast<int>(bench.range(0)));
  auto planner = make_planner<float>(scene, input);
  auto result = planner.make_result();
  ClothState<double> state = scene.state;
  auto workspace = scene.model.make_workspace();
  const auto target = [&](Index i, double t) { return scene.target(i, t); };
  double t = 0.0;
  for (auto _ : bench) {
    if (planner.plan(state.positions, state.velocities, t, target, result) != PlanStatus::Planned)
      return bench.SkipWithError("not planned");
    bench.PauseTiming();
    if (!scene.model.step(state, result.input, kDt, workspace).advanced)
      return bench.SkipWithError("plant failed");
    t += kDt;
    bench.ResumeTiming();
  }
}

// The paper's procedure for the first frame of the force planner.
class PaperBaseline {
 public:
  explicit PaperBaseline(const Scene& scene)
      : scene_(scene),
        settings_(scene.settings(GripInput::Force)),
        response_(scene.model),
        basis_(scene.setup.grips, scene.setup.triangles, GripInput::Force) {}

  VectorX<double> first_input() {
    const Index horizon = settings_.horizon, n3 = scene_.state.positions.size(),
                p = basis_.unknowns();
    const ClothState<double>& state = scene_.state;
    if (!response_.linearise(state.positions, state.velocities, V::Zero(), kDt, {})) return {};
    basis_.update(state.positions);
    const Eigen::Map<const VectorX<double>> x0(state.positions.data(), n3),
        v0(state.velocities.data(), n3);
    const Eigen::Map<const VectorX<double>> f(response_.force().data(), n3);
    std::vector<MatrixX<double>> map(static_cast<std::size_t>(horizon),
                                     MatrixX<double>::Zero(n3, p * horizon));
    MatrixX<double> free(n3, horizon);
    integrate(
        v0, f, 0, [&](Index k, const VectorX<double>& q) { free.col(k) = x0 + q; }, true);
    VectorX<double> push(n3);
    for (Index j = 0; j < horizon; ++j) {
      for (Index c = 0; c < p; ++c) {
        push.setZero();
        for (std::size_t s = 0; s < basis_.held().vertices().size(); ++s) {
          push.segment<3>(3 * basis_.held().vertices()[s]) =
              basis_.matrix().block<3, 1>(3 * static_cast<Index>(s), c);
        }
        integrate(
            VectorX<double>::Zero(n3), push, j,
            [&](Index k, const VectorX<double>& q) {
              map[static_cast<std::size_t>(k)].col(j * p + c) = q;
            },
            false);
      }
    }
    return solve(map, free);
  }

 private:
  // Eq. 5-6: one right-hand side, with forces in frame `first` only or in all frames.
  template <class Take>
  void integrate(const VectorX<double>& v0, const VectorX<double>& force, Index first,
                 const Take& take, bool always) {
    const Index n3 = v0.size();
    Lanes<double, 1> w = v0.transpose(), q = Lanes<double, 1>::Zero(1, n3), stiff = q, coupled = q;
    for (Index k = first; k < settings_.horizon; ++k) {
      response_.multiply<1>(q, stiff, coupled);
      for (Index i = 0; i < n3; ++i) {
        const double pushed = always || k == first ? force[i] : 0.0;
        w(0, i) = response_.mass()[i / 3] * w(0, i) + kDt * (pushed - stiff(0, i));
      }
      response_.solve<1>(w);
      q += kDt * w;
      take(k, q.transpose());
    }
  }

  VectorX<double> solve(const std::vector<MatrixX<double>>& map, const MatrixX<double>& free) {
    const Index horizon = settings_.horizon, p = basis_.unknowns(), n = p * horizon;
    const PlannerWeights<double>& w = settings_.weights;
    MatrixX<double> rows(24 * horizon, n);
    VectorX<double> rest(24 * horizon);
    const auto position = [&](Index k, int v, MatrixX<double>& of_d, V& now) {
      if (k < 0) {
        of_d.setZero(3, n);
        now = scene_.state.positions.col(v) +
              static_cast<double>(k + 1) * kDt * scene_.state.velocities.col(v);
      } else {
        of_d = map[static_cast<std::size_t>(k)].middleRows(3 * v, 3);
        now = free.block<3, 1>(3 * v, k);
      }
    };
    MatrixX<double> z0, z1, z2;
    V c0, c1, c2;
    Index row = 0;
    const auto target = [&](Index i, double t) { return scene_.target(i, t); };
    for (Index k = 0; k < horizon; ++k) {
      const double t = static_cast<double>(k + 1) * kDt;
      for (Index i = 0; i < 2; ++i) {
        const int feature = scene_.grid.vertex(0, i == 0 ? 0 : scene_.grid.cols - 1),
                  hand = basis_.held().vertices()[static_cast<std::size_t>(i)];
        position(k, feature, z0, c0);
        add(rows, rest, row, std::sqrt(w.feature), z0, c0 - scene_.target(i, t));
        position(k, hand, z0, c0);
        HandAnchor<double> anchor;
        anchor.feature_weights = {i == 0 ? 1.0 : 0.0, i == 0 ? 0.0 : 1.0};
        anchor.offset = scene_.state.positions.col(hand) - scene_.state.positions.col(feature);
        anchor.hanging_length = anchor.offset[2];
        add(rows, rest, row, std::sqrt(w.anchor), z0,
            c0 - anchor_position(anchor, settings_.heavy_chain_axes, settings_.gravity, target, t));
        position(k - 1, hand, z1, c1);
        position(k - 2, hand, z2, c2);
        add(rows, rest, row, std::sqrt(w.smooth) / kDt, z0 - 2.0 * z1 + z2, c0 - 2.0 * c1 + c2);
        MatrixX<double> effort = MatrixX<double>::Zero(3, n);
        effort.middleCols(k * p, p) = basis_.matrix().middleRows(3 * i, 3);
        add(rows, rest, row, std::sqrt(w.force), effort, -0.5 * settings_.gravity_load);
      }
    }
    MatrixX<double> H = rows.transpose() * rows;
    H.diagonal().array() += w.cone;
    const VectorX<double> g = rows.transpose() * rest;
    VectorX<double> lower(n), upper(n);
    for (Index k = 0; k < horizon; ++k)
      basis_.bounds(scene_.state.positions, settings_.max_step, kDt, lower.segment(k * p, p),
                    upper.segment(k * p, p));
    BoxActiveSet<double> solver;
    QpResult<double> answer;
    solver.reserve(n);
    if (solver.set_hessian(H) != QpStatus::Solved ||
        solver.solve(g, lower, upper, answer) != QpStatus::Solved)
      return {};
    return basis_.matrix() * answer.x.head(p);
  }

  static void add(MatrixX<double>& rows, VectorX<double>& rest, Index& row, double scale,
                  const MatrixX<double>& of_d, const V& now) {
    rows.middleRows(row, 3) = scale * of_d;
    rest.segment<3>(row) = scale * now;
    row += 3;
  }

  const Scene& scene_;
  PlannerSettings<double> settings_;
  MassSpringResponse<double> response_;
  detail::GripBasis<double> basis_;
};

void paper_baseline(benchmark::State& bench) {
  const Scene scene = Scene::make(static_cast<int>(bench.range(0)));
  auto planner = make_planner<double>(scene, GripInput::Force);
  auto result = planner.make_result();
  const auto target = [&](Index i, double t) { return scene.target(i, t); };
  if (planner.plan(scene.state.positions, scene.state.velocities, 0.0, target, result) !=
      PlanStatus::Planned)
    return bench.SkipWithError("not planned");
  PaperBaseline baseline(scene);
  double difference = 0.0;
  for (auto _ : bench) {
    const VectorX<double> first = baseline.first_input();
    if (first.size() != result.plan.rows()) return bench.SkipWithError("the baseline failed");
    difference = (first - result.plan.col(0)).norm() / first.norm();
  }
  bench.counters["difference"] = difference;
  if (!(difference < 1e-6))
    bench.SkipWithError(("first input differs by " + std::to_string(difference)).c_str());
}

void force_frame(benchmark::State& bench) { frame(bench, GripInput::Force); }
void pose_frame(benchmark::State& bench) { frame(bench, GripInput::Pose); }

BENCHMARK(force_frame)->Arg(17)->Arg(33)->Unit(benchmark::kMillisecond);
BENCHMARK(pose_frame)->Arg(17)->Arg(33)->Unit(benchmark::kMillisecond);
BENCHMARK(paper_baseline)->Arg(17)->Unit(benchmark::kMillisecond)->Iterations(1);

}  // namespace
