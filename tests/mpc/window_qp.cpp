// The QP of a planning frame, compared with its cost, which is written once more and simulated.

#include "clothctl/mpc/detail/window_qp.hpp"

#include <random>

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"
#include "clothctl/qp/kkt.hpp"
#include "mpc/instances.hpp"
#include "prediction/dense_step.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"

using namespace clothctl;
using clothctl_test::HangingSheet;
using V = Vector3<double>;

namespace {

constexpr double kDt = clothctl_test::kFrame;

// The planner's solvers, which record problems and answers.
struct Told {
  MatrixX<double> H, A;
  VectorX<double> g, lb, ub, rl, ru;
  QpResult<double> answer;
  int solves = 0, iterations = 0;  // since the last reset of the counters

  void take(const QpResult<double>& result) {
    answer = result;
    ++solves;
    iterations += static_cast<int>(result.iterations);
  }
};
Told told;

struct TellingBox : BoxActiveSet<double> {
  QpStatus set_hessian(const Eigen::Ref<const MatrixX<double>>& H) {
    told.H = H;
    return BoxActiveSet<double>::set_hessian(H);
  }
  QpStatus solve(const VectorView& g, const VectorView& lb, const VectorView& ub,
                 QpResult<double>& result) {
    told.g = g;
    told.lb = lb;
    told.ub = ub;
    told.A.resize(0, g.size());
    told.rl.resize(0);
    told.ru.resize(0);
    const QpStatus status = BoxActiveSet<double>::solve(g, lb, ub, result);
    told.take(result);
    return status;
  }
};

struct TellingRows : ActiveSet<double> {
  QpStatus set_hessian(const MatrixView& H) {
    told.H = H;
    return ActiveSet<double>::set_hessian(H);
  }
  QpStatus set_rows(const MatrixView& A) {
    told.A = A;
    return ActiveSet<double>::set_rows(A);
  }
  QpStatus solve(const VectorView& g, const VectorView& lb, const VectorView& ub,
                 const VectorView& rl, const VectorView& ru, QpResult<double>& result) {
    told.g = g;
    told.lb = lb;
    told.ub = ub;
    told.rl = rl;
    told.ru = ru;
    const QpStatus status = ActiveSet<double>::solve(g, lb, ub, rl, ru, result);
    told.take(result);
    return status;
  }
};

using Predicting = LinearisedPredictor<MassSpringResponse<double>, double>;
template <class Contact>
using TellingPlanner = Planner<Predicting, PlannerSetup<double, Contact>, TellingBox, TellingRows>;

// A planner's frame with everything that its cost depends on.
template <class Contact = HardFinger<double>>
struct Frame {
  const HangingSheet& sheet;
  MassSpring<double> model;
  PlannerSetup<double, Contact> setup;
  PlannerSettings<double> settings;
  clothctl_test::AsyncTarget target;
  ClothState<double> state;
  Points<double> before;    // velocities of all vertices in the previous frame
  MatrixX<double> shifted;  // the plan that the frame started from
  double t = 0;
  PlanResult<double> result = {};

  Frame(const HangingSheet& sheet_, PlannerSettings<double> settings_, int patch, double limit,
        double friction)
      : Frame(sheet_, settings_, patch, limit, HardFinger<double>{friction}) {}
  Frame(const HangingSheet& sheet_, PlannerSettings<double> settings_, int patch, double limit,
        const Contact& contact)
      : sheet(sheet_),
        model(sheet_.model(Integration::LinearlyImplicit, true)),
        settings(settings_),
        target(sheet_) {
    setup.features.add_point(sheet.lower_left());
    setup.features.add_centroid({sheet.lower_right(), sheet.grid.vertex(1, sheet.grid.cols - 1)});
    setup.triangles = sheet.network.triangles;
    for (int side : {0, 1})
      setup.grips.push_back(make_pinch<double>(sheet.corner_patch(side, patch), contact, limit));
    if (settings.input == GripInput::Force) settings.gravity_load = sheet.gravity_load();
    settings.horizon = 6;
  }

  V wind(double s) const { return V(0.5, 2.0 * std::sin(3.0 * s), 0.1); }
  V wanted(Index i, double s) const { return target(i, s); }

  // Plans `frames` frames of a closed loop and keeps the last one.
  void run(int frames) {
    auto made = TellingPlanner<Contact>::create(
        setup, settings, Predicting(MassSpringResponse<double>(model)), sheet.state.positions);
    REQUIRE(made.has_value());
    TellingPlanner<Contact> planner = std::move(made).value();
    result = planner.make_result();
    ModelPlant<MassSpring<double>> plant(model);
    ClothState<double> start = sheet.state;
    start.velocities = clothctl_test::shaken(start, 4, 0.0, 0.05).velocities;
    plant.set_state(start);
    MatrixX<double> last;
    for (int k = 0; k < frames; ++k) {
      told.solves = told.iterations = 0;
      before = k == 0 ? plant.velocities() : state.velocities;
      state = plant.state();
      t = k * kDt;
      const PlanStatus status = planner.plan(
          state.positions, state.velocities, t, [&](Index i, double s) { return wanted(i, s); },
          [&](double s) { return wind(s); }, result);
      INFO(to_string(status) << ", qp " << to_string(result.qp_status));
      REQUIRE(status == PlanStatus::Planned);
      shifted = last;
      if (k > 0) {
        shifted.leftCols(shifted.cols() - 1) = last.rightCols(last.cols() - 1);
      }
      last = result.plan;
      result.input.wind = wind(t);
      plant.apply(result.input);
      REQUIRE(plant.advance(kDt).advanced);
    }
  }

  MatrixX<double> basis() const {
    detail::GripBasis<double, Contact> b(setup.grips, setup.triangles, settings.input);
    b.update(state.positions);
    return b.matrix();
  }

  std::vector<std::vector<int>> patches() const {
    std::vector<std::vector<int>> out;
    for (const Grip<double, Contact>& grip : setup.grips) out.push_back(grip.vertices());
    return out;
  }

  // Positions over the window for the unknowns u.
  MatrixX<double> simulate(const clothctl_test::DenseStep& dense, const VectorX<double>& u,
                           MatrixX<double>& raw) const {
    const MatrixX<double> b = basis();
    std::vector<int> held;
    for (const auto& patch : patches()) held.insert(held.end(), patch.begin(), patch.end());
    raw.resize(b.rows(), settings.horizon);
    MatrixX<double> air(3, settings.horizon);
    for (Index k = 0; k < settings.horizon; ++k) {
      raw.col(k) = b * u.segment(k * b.cols(), b.cols());
      air.col(k) = wind(t + static_cast<double>(k) * kDt);
    }
    return dense.rollout(state.positions, state.velocities, held, raw, air);
  }

  clothctl_test::DenseStep dense() const {
    std::vector<int> driven;
    if (settings.input == GripInput::Pose) {
      for (const auto& patch : patches()) driven.insert(driven.end(), patch.begin(), patch.end());
    }
    return clothctl_test::DenseStep(model, state.positions, state.velocities, wind(t), kDt, driven);
  }

  // Distances of a patch's vertices from the best affine image of their present positions (a row
  // for each coordinate).
  MatrixX<double> non_affine(const std::vector<int>& patch,
                             const Eigen::Ref<const VectorX<double>>& positions) const {
    MatrixX<double> regressors(static_cast<Index>(patch.size()), 4),
        moved(static_cast<Index>(patch.size()), 3);
    for (std::size_t j = 0; j < patch.size(); ++j) {
      regressors.row(static_cast<Index>(j)) << 1.0, state.positions.col(patch[j]).transpose();
      moved.row(static_cast<Index>(j)) = positions.segment<3>(3 * patch[j]).transpose();
    }
    // Directions thinner than a thousandth of the widest count as flat, as in AffinePatchBasis.
    regressors.rightCols<3>().rowwise() -= regressors.rightCols<3>().colwise().mean().eval();
    Eigen::JacobiSVD<MatrixX<double>> svd(regressors.rightCols<3>(), Eigen::ComputeThinU);
    MatrixX<double> rest = moved.rowwise() - moved.colwise().mean();
    for (Index a = 0; a < 3; ++a) {
      if (svd.singularValues()[a] < 1e-3 * svd.singularValues()[0]) continue;
      rest -= svd.matrixU().col(a) * (svd.matrixU().col(a).transpose() * rest);
    }
    return rest;
  }

  // L: the least-squares linear map of the patch from its present shape, on the span of that shape.
  Matrix3<double> linear_map(const std::vector<int>& patch,
                             const Eigen::Ref<const VectorX<double>>& positions) const {
    const Index m = static_cast<Index>(patch.size());
    MatrixX<double> r(3, m), x(3, m);
    for (Index j = 0; j < m; ++j) {
      r.col(j) = state.positions.col(patch[static_cast<std::size_t>(j)]);
      x.col(j) = positions.segment<3>(3 * patch[static_cast<std::size_t>(j)]);
    }
    r.colwise() -= r.rowwise().mean().eval();
    x.colwise() -= x.rowwise().mean().eval();
    Eigen::JacobiSVD<MatrixX<double>> svd(r, Eigen::ComputeThinU | Eigen::ComputeThinV);
    Matrix3<double> out = Matrix3<double>::Zero();
    for (Index a = 0; a < std::min<Index>(3, m); ++a) {
      if (svd.singularValues()[a] < 1e-3 * svd.singularValues()[0] ||
          svd.singularValues()[a] <= 0.0)
        continue;
      out +=
          (x * svd.matrixV().col(a)) * svd.matrixU().col(a).transpose() / svd.singularValues()[a];
    }
    return out;
  }

  // How far the hand leads in frame k: along gravity and air, in the plane across the features.
  V lead(const clothctl_test::DenseStep& dense_step, const HandAnchor<double>& anchor,
         Index k) const {
    const double end = t + static_cast<double>(k + 1) * kDt;
    const V velocity =
        0.5 * (wanted(0, end) + wanted(1, end) - wanted(0, end - kDt) - wanted(1, end - kDt)) / kDt;
    V force = V::Zero();
    for (Index i = 0; i < state.positions.cols(); ++i)
      force += dense_step.wind_force.block<3, 3>(3 * i, 0) * (wind(end - kDt) - velocity);
    const V air = force / model.network().mass.sum() - model.settings().drag * velocity;
    const V along = wanted(1, end) - wanted(0, end);
    const V across = V(-along[1], along[0], 0).normalized(), up(0, 0, 1);
    const V pull = (settings.gravity - air[2]) * up - across * across.dot(air);
    return anchor.hanging_length * (pull.normalized() - up);
  }

  // J of planner_settings.hpp.
  double cost(const clothctl_test::DenseStep& dense_step, const VectorX<double>& u) const {
    MatrixX<double> raw;
    const MatrixX<double> x = simulate(dense_step, u, raw);
    const PlannerWeights<double>& w = settings.weights;
    const bool force = settings.input == GripInput::Force;
    const VectorX<double> now =
        Eigen::Map<const VectorX<double>>(state.positions.data(), state.positions.size());
    const auto at = [&](Index k) -> VectorX<double> {
      return k < 0 ? now : VectorX<double>(x.col(k));
    };
    double J = 0.0;
    Points<double> y(3, 2), start(3, 2);
    evaluate_features<double>(setup.features, sheet.state.positions, start);
    for (Index k = 0; k < settings.horizon; ++k) {
      const double s = t + static_cast<double>(k + 1) * kDt;
      const VectorX<double> xk = x.col(k);
      evaluate_features<double>(setup.features,
                                Eigen::Map<const Points<double>>(xk.data(), 3, xk.size() / 3), y);
      for (Index i = 0; i < 2; ++i) J += w.feature * (y.col(i) - wanted(i, s)).squaredNorm();
      const double per_vertex = 1.0 / (static_cast<double>(raw.rows()) / 3.0);
      for (Index j = 0; 3 * j < raw.rows(); ++j) {
        const V reference = force ? V(settings.gravity_load * per_vertex) : V(V::Zero());
        J += (force ? w.force : w.velocity) * (raw.block<3, 1>(3 * j, k) - reference).squaredNorm();
        if (w.step > 0.0)
          J += w.step * (raw.block<3, 1>(3 * j, k) - shifted.block<3, 1>(3 * j, k)).squaredNorm();
      }
      const auto grips = patches();
      for (std::size_t g = 0; g < grips.size(); ++g) {
        const auto centroid = [&](Index frame) {
          V c = V::Zero();
          const VectorX<double> p = at(frame);
          for (int v : grips[g]) c += p.segment<3>(3 * v);
          return V(c / static_cast<double>(grips[g].size()));
        };
        const auto velocity = [&](Index frame) {  // ċ at the end of that frame; -1: measured now,
                                                  // -2: in the previous frame
          if (frame >= 0) return V((centroid(frame) - centroid(frame - 1)) / kDt);
          V c = V::Zero();
          for (int v : grips[g]) c += (frame == -1 ? state.velocities : before).col(v);
          return V(c / static_cast<double>(grips[g].size()));
        };
        Points<double> homes = Points<double>::Zero(3, 2);
        for (std::size_t i = 0; i < 2; ++i) {
          for (int v : grips[i])
            homes.col(static_cast<Index>(i)) +=
                sheet.state.positions.col(v) / static_cast<double>(grips[i].size());
        }
        const HandAnchor<double> anchor = make_anchors(Points<double>(start), homes)[g];
        const V wanted_hand = anchor_position(
            anchor, settings.heavy_chain_axes, settings.gravity,
            [&](Index i, double time) { return wanted(i, time); }, s);
        J += w.anchor * (centroid(k) - wanted_hand - lead(dense_step, anchor, k)).squaredNorm();
        J += w.smooth * (velocity(k) - velocity(k - 1)).squaredNorm();
        J += w.jerk * (velocity(k) - 2.0 * velocity(k - 1) + velocity(k - 2)).squaredNorm();
        if (grips[g].size() < 2) continue;
        J += w.shape * (linear_map(grips[g], xk) - linear_map(grips[g], at(k - 1))).squaredNorm();
        if (force && settings.patch == PatchMode::Soft)
          J += w.patch * non_affine(grips[g], xk).squaredNorm();
      }
    }
    if (force) J += w.cone * u.squaredNorm();
    return J;
  }
};

// The solver's quadratic function must be the cost, and its answer the cost's constrained minimum.
template <class Contact>
void check_frame(Frame<Contact>& frame, int frames) {
  frame.run(frames);
  const clothctl_test::DenseStep dense = frame.dense();
  const Index n = told.g.size();
  const VectorX<double> zero = VectorX<double>::Zero(n);
  const double at_zero = frame.cost(dense, zero);
  std::mt19937 random(static_cast<unsigned>(frames));
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const double size = frame.settings.input == GripInput::Force ? 0.3 : 0.5;
  for (int trial = 0; trial < 4; ++trial) {
    VectorX<double> u(n);
    for (Index i = 0; i < n; ++i)
      u[i] = size * (uniform(random) - (frame.settings.input == GripInput::Force ? 0.0 : 0.5));
    const double cost = frame.cost(dense, u);
    CHECK(0.5 * (cost - at_zero) ==
          Approx(0.5 * u.dot(told.H * u) + told.g.dot(u)).epsilon(1e-7).margin(1e-9 * at_zero));
  }

  const VectorX<double> x = told.answer.x;
  const KktResiduals<double> kkt =
      kkt_residuals(told.H, told.g, told.A, told.rl, told.ru, told.lb, told.ub, x,
                    told.answer.row_multipliers, told.answer.bound_multipliers);
  CHECK(kkt.worst() < 1e-7);

  // The plan is the solver's answer,
  MatrixX<double> raw;
  const MatrixX<double> positions = frame.simulate(dense, x, raw);
  CHECK((frame.result.plan - raw).norm() < 1e-9 * (1.0 + raw.norm()));
  // its prediction is what the linear window does under it,
  Points<double> y(3, 2);
  for (Index k = 0; k < frame.settings.horizon; ++k) {
    const VectorX<double> xk = positions.col(k);
    evaluate_features<double>(frame.setup.features,
                              Eigen::Map<const Points<double>>(xk.data(), 3, xk.size() / 3), y);
    CHECK(
        (y - Eigen::Map<const Points<double>>(frame.result.predicted.col(k).data(), 3, 2)).norm() <
        1e-9);
  }
  // and no feasible plan near it costs less.
  const double best = frame.cost(dense, x);
  for (int trial = 0; trial < 30; ++trial) {
    VectorX<double> u = x;
    const double radius = trial % 2 == 0 ? 1e-3 : 0.05;
    for (Index i = 0; i < n; ++i) {
      if (trial % 3 == 0 || i % 7 == trial % 7) u[i] += radius * (uniform(random) - 0.5);
      u[i] = std::clamp(u[i], told.lb[i], told.ub[i]);
    }
    if (told.A.rows() > 0) {
      const VectorX<double> rows = told.A * u;
      if (((rows - told.ru).array() > 0.0).any() || ((told.rl - rows).array() > 0.0).any())
        continue;
    }
    CHECK(frame.cost(dense, u) > best - 1e-9 * at_zero);
  }
}

const HangingSheet& single() {
  static const HangingSheet made = clothctl_test::hanging_sheet(5, 1, 60);
  return made;
}
const HangingSheet& patched() {
  static const HangingSheet made = clothctl_test::hanging_sheet(6, 2, 60);
  return made;
}

}  // namespace

TEST_CASE("planned forces of single vertices minimise the cost", "[mpc]") {
  for (const int frames : {1, 2, 5}) {
    Frame frame(single(), PlannerSettings<double>(), 1, 20.0, 0.5);
    check_frame(frame, frames);
    CHECK_FALSE(frame.result.used_rows);
  }
}

TEST_CASE("planned forces under grip limits minimise the cost", "[mpc]") {
  // Friction carries the weight, which needs a normal force near or above this limit.
  Frame frame(single(), PlannerSettings<double>(), 1, 0.35, 0.8);
  check_frame(frame, 4);
  CHECK(frame.result.used_rows);
  CHECK(told.A.rows() == 4 * frame.settings.horizon);
}

TEST_CASE("a frame counts the iterations of all its QPs", "[mpc]") {
  PlannerSettings<double> settings;
  settings.max_change = 1e-6;  // almost zero, so that the forces are planned repeatedly
  Frame frame(single(), settings, 1, 20.0, 0.5);
  frame.run(2);
  CHECK(told.solves == 5);  // with the weights 0, 1e-4, 4e-4, 16e-4 and 64e-4 of `step`
  CHECK(frame.result.qp_iterations == told.iterations);
  CHECK(told.iterations > static_cast<int>(told.answer.iterations));
}

TEST_CASE("planned forces of soft patches minimise the cost", "[mpc]") {
  PlannerSettings<double> settings;
  settings.patch = PatchMode::Soft;
  for (const int frames : {1, 3}) {
    Frame frame(patched(), settings, 2, 20.0, 0.5);
    check_frame(frame, frames);
  }
}

TEST_CASE("planned forces with fewer coefficients than forces minimise the cost", "[mpc]") {
  // Two coefficients and three forces a vertex.
  for (const int frames : {1, 2}) {
    Frame frame(patched(), PlannerSettings<double>(), 2, 20.0, Frictionless<double>());
    check_frame(frame, frames);
    CHECK(frame.basis().cols() < frame.basis().rows());
  }
}

TEST_CASE("hard rows require that the patch moves affinely", "[mpc]") {
  PlannerSettings<double> settings;
  settings.patch = PatchMode::Hard;
  Frame frame(patched(), settings, 2, 20.0, 0.5);
  check_frame(frame, 2);
  REQUIRE(frame.result.used_rows);
  // The rows are the non-affine motions of any plan.
  const clothctl_test::DenseStep dense = frame.dense();
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(0.0, 0.3);
  VectorX<double> u(told.g.size());
  for (Index i = 0; i < u.size(); ++i) u[i] = uniform(random);
  MatrixX<double> raw;
  const MatrixX<double> x = frame.simulate(dense, u, raw);
  double expected = 0.0;
  for (Index k = 0; k < x.cols(); ++k) {
    for (const auto& patch : frame.patches())
      expected += frame.non_affine(patch, x.col(k)).squaredNorm();
  }
  const VectorX<double> motion = told.A * u;
  double rows = 0.0;
  int equalities = 0, limits = 0, unused = 0;
  for (Index i = 0; i < motion.size(); ++i) {
    if (std::isfinite(told.rl[i])) {
      ++equalities;
      CHECK(told.rl[i] == told.ru[i]);
      rows += (motion[i] - told.rl[i]) * (motion[i] - told.rl[i]);
    } else if (std::isfinite(told.ru[i])) {
      ++limits;
    } else {
      ++unused;  // modes that these patches do not have
      CHECK(told.A.row(i).isZero());
    }
  }
  CHECK(rows == Approx(expected).epsilon(1e-8));
  CHECK(limits == 4 * frame.settings.horizon);
  CHECK(equalities + unused == 2 * 9 * frame.settings.horizon);
  CHECK(equalities > 0);
}

TEST_CASE("poses of patches pay for the velocities of their vertices", "[mpc]") {
  PlannerSettings<double> settings;
  settings.input = GripInput::Pose;
  MatrixX<double> H;
  VectorX<double> g;
  for (const double weight : {0.0, 0.3}) {
    settings.weights.velocity = weight;
    Frame frame(patched(), settings, 2, 20.0, 0.5);
    frame.run(1);
    if (weight == 0.0) {
      H = told.H;
      g = told.g;
      continue;
    }
    const MatrixX<double> b = frame.basis();
    const Index p = b.cols();
    REQUIRE(p < b.rows());
    MatrixX<double> effort = MatrixX<double>::Zero(H.rows(), H.cols());
    for (Index k = 0; k < frame.settings.horizon; ++k) {
      effort.block(k * p, k * p, p, p) = weight / 4 * b.transpose() * b;  // four vertices a hand
      effort.block(k * p, k * p, p, p).diagonal().array() += 1e-3 * weight;
    }
    CHECK((told.H - H - effort).norm() < 1e-9 * effort.norm());
    CHECK((told.g - g).norm() < 1e-9 * g.norm());  // of poses none is preferred
  }
}

TEST_CASE("planned poses minimise the cost", "[mpc]") {
  PlannerSettings<double> settings;
  settings.input = GripInput::Pose;
  settings.weights.velocity = 0.0;
  settings.weights.jerk = 0.01;
  for (const int frames : {2, 4}) {
    settings.weights.step = 0.02;
    Frame frame(single(), settings, 1, 20.0, 0.5);
    check_frame(frame, frames);
  }
  settings.weights.step = 0.0;
  for (const int frames : {1, 3}) {
    Frame frame(patched(), settings, 2, 20.0, 0.5);
    check_frame(frame, frames);
  }
}
