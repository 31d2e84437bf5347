// The robot library: kinematics, Jacobians, dynamics, stable PD and inverse kinematics, in double
// and float, for the library's 34-joint hand, and with --models=DIR also for the Shadow hand on its
// arm (sia10d_shadow.urdf).

#include <benchmark/benchmark.h>

#include <cstdio>
#include <memory>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "clothctl/bridge/urdf.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "clothctl/robot/stable_pd.hpp"

namespace {

using namespace clothctl;
using namespace clothctl;

constexpr std::size_t kSamples = 32;

/// A robot, its tips, all memory, and inputs: positions within the limits, all else normally
/// distributed.
template <class Scalar>
struct Robot {
  using Vector = VectorX<Scalar>;

  KinematicTree<Scalar> tree;
  std::vector<int> tips;
  KinematicTreeWorkspace<Scalar> work;
  MassMatrixWorkspace<Scalar> mass;
  std::vector<Vector> q, qd, qdd, torques;
  Vector none, diagonal, out, more;
  MatrixX<Scalar> J, M;
  std::mt19937_64 engine{1};

  explicit Robot(KinematicTree<Scalar> t) : tree(std::move(t)), work(tree), mass(tree) {
    for (std::size_t k = 0; k < tree.links().size(); ++k) {
      const Link<Scalar>& link = tree.links()[k];
      if (link.body >= 0 && link.name.find("tip") != std::string::npos)
        tips.push_back(static_cast<int>(k));
    }
    const Index n = tree.nv();
    for (std::size_t k = 0; k < kSamples; ++k) {
      q.push_back(anywhere());
      for (std::vector<Vector>* v : {&qd, &qdd, &torques}) v->push_back(normal(n));
    }
    diagonal = Vector::Constant(n, Scalar(1));
    out = more = Vector::Constant(n, Scalar(0));
    J.setZero(6, n);
    M.setZero(n, n);
  }

  double uniform() { return std::uniform_real_distribution<double>(0.0, 1.0)(engine); }
  Vector normal(Index n) {
    std::normal_distribution<double> draw;
    Vector v(n);
    for (Index i = 0; i < n; ++i) v[i] = static_cast<Scalar>(draw(engine));
    return v;
  }
  Vector anywhere() {
    Vector v(tree.nq());
    for (Index i = 0; i < v.size(); ++i) {
      const Scalar low = tree.lower()[i], high = tree.upper()[i];
      v[i] = low + static_cast<Scalar>(uniform()) * (high - low);
    }
    return v;
  }
};

/// Calls f with the number of a sample, a different one each time.
template <class F>
void each(benchmark::State& state, const F& f) {
  std::size_t k = 0;
  for (auto _ : state) {
    f(k);
    k = (k + 1) % kSamples;
  }
}

template <class Scalar>
using Shared = std::shared_ptr<Robot<Scalar>>;

template <class Scalar>
void poses(benchmark::State& state, const Shared<Scalar>& r) {
  each(state, [&](std::size_t k) {
    forward_kinematics<Scalar>(r->tree, r->q[k], r->work.body_poses);
    benchmark::ClobberMemory();
  });
}

template <class Scalar>
void jacobians(benchmark::State& state, const Shared<Scalar>& r) {
  each(state, [&](std::size_t k) {
    forward_kinematics<Scalar>(r->tree, r->q[k], r->work.body_poses);
    for (const int tip : r->tips) {
      link_jacobian<Scalar>(r->tree, r->work.body_poses, tip, r->J);
      benchmark::ClobberMemory();
    }
  });
}

template <class Scalar>
void inverse(benchmark::State& state, const Shared<Scalar>& r) {
  each(state, [&](std::size_t k) {
    forward_kinematics<Scalar>(r->tree, r->q[k], r->work.body_poses);
    inverse_dynamics<Scalar>(r->tree, r->work.body_poses, r->qd[k], r->qdd[k], r->work.gravity,
                             r->work.inverse, r->out);
    benchmark::ClobberMemory();
  });
}

template <class Scalar>
void mass(benchmark::State& state, const Shared<Scalar>& r) {
  each(state, [&](std::size_t k) {
    forward_kinematics<Scalar>(r->tree, r->q[k], r->work.body_poses);
    mass_matrix<Scalar>(r->tree, r->work.body_poses, r->mass, r->M);
    benchmark::ClobberMemory();
  });
}

template <class Scalar>
void forward(benchmark::State& state, const Shared<Scalar>& r, bool damped) {
  const VectorX<Scalar>& diagonal = damped ? r->diagonal : r->none;
  each(state, [&](std::size_t k) {
    forward_kinematics<Scalar>(r->tree, r->q[k], r->work.body_poses);
    const DynamicsReport report =
        forward_dynamics<Scalar>(r->tree, r->work.body_poses, r->qd[k], r->torques[k], diagonal,
                                 r->work.gravity, r->work.forward, r->out);
    if (report.status != DynamicsStatus::Solved)
      state.SkipWithError(std::string(to_string(report.status)).c_str());
  });
}

/// A whole control step. Without torque limits it takes one solve; with limits, some joints reach
/// them and it takes more.
template <class Scalar>
void pd(benchmark::State& state, const Shared<Scalar>& r, bool limited) {
  StablePdSettings<Scalar> settings = StablePdSettings<Scalar>::uniform(r->tree.nv());
  settings.dt = Scalar(0.005);
  settings.limit_torques = limited;
  auto made = StablePd<KinematicTree<Scalar>>::create(r->tree, settings);
  if (!made) return state.SkipWithError(made.error().c_str());
  StablePd<KinematicTree<Scalar>> control = std::move(made).value();
  double solves = 0;
  std::vector<VectorX<Scalar>> targets;
  for (std::size_t k = 0; k < kSamples; ++k) targets.push_back(r->q[k] + Scalar(0.01) * r->qdd[k]);
  each(state, [&](std::size_t k) {
    const PdReport report = control.solve(r->tree, r->q[k], r->qd[k], targets[k], r->qdd[k],
                                          r->none, r->work, r->out, r->more);
    if (report.status == PdStatus::NoInertia || report.status == PdStatus::InvalidInput) {
      state.SkipWithError(std::string(to_string(report.status)).c_str());
    }
    solves += report.solves;
  });
  state.counters["solves"] = benchmark::Counter(solves, benchmark::Counter::kAvgIterations);
}

/// Brings all tips to within 1 mm, from starts within 10 % of each range, or from anywhere with up
/// to 20 restarts. Times of targets differ widely, so these are means over 32 targets.
template <class Scalar>
void reach(benchmark::State& state, const Shared<Scalar>& r, bool near) {
  InverseKinematics<KinematicTree<Scalar>> ik(r->tree, static_cast<int>(r->tips.size()));
  std::vector<std::vector<IkTask<Scalar>>> tasks(kSamples);
  std::vector<VectorX<Scalar>> starts;
  r->engine.seed(2);
  for (std::size_t k = 0; k < kSamples; ++k) {
    forward_kinematics<Scalar>(r->tree, r->q[k], r->work.body_poses);
    for (const int tip : r->tips) {
      tasks[k].push_back(IkTask<Scalar>::position(tip, Vector3<Scalar>::Zero(),
                                                  link_pose(r->tree, r->work.body_poses, tip).p));
    }
    const VectorX<Scalar> other = r->anywhere();
    const VectorX<Scalar> middle = Scalar(0.5) * (r->tree.lower() + r->tree.upper());
    const VectorX<Scalar> close = (r->q[k] + Scalar(0.2) * (other - middle))
                                      .cwiseMax(r->tree.lower())
                                      .cwiseMin(r->tree.upper());
    starts.push_back(near ? close : other);
  }
  double reached = 0, iterations = 0;
  VectorX<Scalar> q(r->tree.nq());
  const VectorX<Scalar> none;
  each(state, [&](std::size_t k) {
    q = starts[k];
    const IkReport<Scalar> report =
        ik.solve(r->tree, tasks[k], none, q, near ? 0 : 20, [&] { return r->uniform(); });
    reached += report.status == IkStatus::Reached ? 1 : 0;
    iterations += report.iterations;
  });
  state.counters["reached"] = benchmark::Counter(reached, benchmark::Counter::kAvgIterations);
  state.counters["iterations"] = benchmark::Counter(iterations, benchmark::Counter::kAvgIterations);
}

template <class Scalar>
void add(const std::string& name, KinematicTree<Scalar> tree) {
  const auto robot = std::make_shared<Robot<Scalar>>(std::move(tree));
  const std::string kind = name + (sizeof(Scalar) == 4 ? "/float/" : "/double/");
  const auto one = [&](const char* what, auto function, auto... choice) {
    benchmark::RegisterBenchmark(
        (kind + what).c_str(), [=](benchmark::State& state) { function(state, robot, choice...); });
  };
  one("forward_kinematics", poses<Scalar>);
  one("kinematics_and_jacobians_of_tips", jacobians<Scalar>);
  one("inverse_dynamics", inverse<Scalar>);
  one("mass_matrix", mass<Scalar>);
  one("forward_dynamics", forward<Scalar>, false);
  one("forward_dynamics_with_diagonal", forward<Scalar>, true);
  one("stable_pd", pd<Scalar>, false);
  one("stable_pd_with_limits", pd<Scalar>, true);
  one("reach_near", reach<Scalar>, true);
  one("reach_random", reach<Scalar>, false);
}

template <class Scalar>
bool add_file(const std::string& folder, const std::string& name) {
  Result<UrdfModel<Scalar>> model = read_urdf<Scalar>(folder + "/" + name + ".urdf");
  if (!model) {
    std::fprintf(stderr, "bench_robot: %s\n", model.error().c_str());
    return false;
  }
  add<Scalar>(name, std::move(model->tree));
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  std::string models;
  int kept = 1;
  for (int k = 1; k < argc; ++k) {
    const std::string_view word = argv[k], key = "--models=";
    if (word.substr(0, key.size()) == key) {
      models = word.substr(key.size());
    } else {
      argv[kept++] = argv[k];
    }
  }
  benchmark::Initialize(&kept, argv);
  if (benchmark::ReportUnrecognizedArguments(kept, argv)) return 2;
  add<double>("hand34", hand34<double>());
  add<float>("hand34", hand34<float>());
  if (!models.empty() &&
      !(add_file<double>(models, "sia10d_shadow") && add_file<float>(models, "sia10d_shadow")))
    return 2;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}
