// One unit of the program, compiled as `plain` for any processor and as `wide` for a wider
// instruction set. Both instantiate the same templates with the same types, so the linker sees each
// of them twice.

#include <clothctl/clothctl.hpp>
#include <clothctl/io.hpp>
#include <cmath>
#include <utility>

#include "units.hpp"

namespace UNIT {
namespace {

using clothctl::Index;
using clothctl::Vector3;
using clothctl::VectorX;

template <class Scalar>
clothctl::SpringNetwork<Scalar> sheet() {
  const auto grid = clothctl::make_grid<Scalar>(9, 9, Scalar(0.4), Scalar(0.4)).value();
  return clothctl::sheet_network(grid, clothctl::Material<Scalar>{}).value();
}

/// |A x - b| / |b| of a block-sparse system with four right-hand sides.
template <class Scalar>
double factor_error() {
  const clothctl::SpringNetwork<Scalar> network = sheet<Scalar>();
  std::vector<std::pair<int, int>> pairs;
  for (const auto& spring : network.springs) pairs.emplace_back(spring.a, spring.b);
  clothctl::BlockSymmetric<Scalar> matrix(network.rest_positions.cols(), pairs);
  for (Index i = 0; i < matrix.rows(); ++i) matrix.diagonal(i).diagonal().setConstant(Scalar(9));
  for (Index s = 0; s < matrix.lower_count(); ++s) matrix.lower(s).setConstant(Scalar(-0.2));
  clothctl::BlockCholesky<Scalar> factor(
      matrix, clothctl::nested_dissection<Scalar>(matrix, network.rest_positions));
  if (!factor.factorize(matrix)) return 1;
  using Lanes = clothctl::Lanes<Scalar, 4>;
  Lanes b(4, 3 * matrix.rows());
  for (Index i = 0; i < b.size(); ++i) b(i) = Scalar(static_cast<double>(i * 37 % 11) - 5);
  Lanes x = b, back = b;
  factor.template solve<4>(x);
  matrix.template multiply<4>(x, back);
  return static_cast<double>((back - b).norm() / b.norm());
}

/// The position of a sheet's corner after some steps with its other side held.
template <class Scalar>
double fall() {
  const auto model = clothctl::MassSpring<Scalar>::create(sheet<Scalar>()).value();
  auto memory = model.make_workspace();
  auto state = model.rest_state();
  for (Index v = 0; v < state.positions.cols(); ++v)
    state.positions(1, v) += Scalar(0.001 * static_cast<double>(v % 5));
  for (int k = 0; k < 10; ++k) {
    if (model.step(state, {}, Scalar(0.02), memory).status != clothctl::StepStatus::Converged)
      return std::nan("");
  }
  return static_cast<double>(state.positions.col(0).norm());
}

/// The objective of a quadratic program with bounds, and with or without rows.
template <class Scalar>
double program(bool rows) {
  const Index n = 40, m = 15;
  using Matrix = Eigen::Matrix<Scalar, Eigen::Dynamic,
                               Eigen::Dynamic>;  // in the caller's default storage order
  Matrix M(n, n), A(m, n);
  for (Index i = 0; i < M.size(); ++i)
    M(i % n, i / n) = Scalar(static_cast<double>(i * 7919 % 101) / 101 - 0.5);
  for (Index i = 0; i < A.size(); ++i)
    A(i % m, i / m) = Scalar(static_cast<double>(i * 104729 % 97) / 97 - 0.5);
  Matrix H = M * M.transpose();
  H.diagonal().array() += Scalar(0.5);
  const VectorX<Scalar> g = VectorX<Scalar>::LinSpaced(n, Scalar(-3), Scalar(3));
  const VectorX<Scalar> top = VectorX<Scalar>::Constant(n, Scalar(0.5)), bottom = -top;
  const VectorX<Scalar> above = VectorX<Scalar>::Constant(m, Scalar(0.1)), below = -above;
  clothctl::QpResult<Scalar> result;
  if (rows) {
    clothctl::ActiveSet<Scalar> solver;
    solver.reserve(n, m);
    if (solver.set_hessian(H) != clothctl::QpStatus::Solved ||
        solver.set_rows(A) != clothctl::QpStatus::Solved)
      return std::nan("");
    if (solver.solve(g, bottom, top, below, above, result) != clothctl::QpStatus::Solved)
      return std::nan("");
  } else {
    clothctl::BoxActiveSet<Scalar> solver;
    solver.reserve(n);
    if (solver.set_hessian(H) != clothctl::QpStatus::Solved) return std::nan("");
    if (solver.solve(g, bottom, top, result) != clothctl::QpStatus::Solved) return std::nan("");
  }
  return static_cast<double>(result.objective);
}

/// The error of a 34-joint hand after some frames of stable PD, and its distance from an answer of
/// inverse kinematics.
std::pair<double, double> hand() {
  using Tree = clothctl::KinematicTree<double>;
  const Tree tree = clothctl::hand34<double>();
  clothctl::KinematicTreeWorkspace<double> work(tree);
  VectorX<double> q = clothctl::hand34_home<double>(tree);
  clothctl::forward_kinematics<double>(tree, q, work.body_poses);
  const int tip = tree.find_link("index_distal");
  const Vector3<double> place = clothctl::link_pose(tree, work.body_poses, tip).p;
  const std::vector<clothctl::IkTask<double>> tasks = {clothctl::IkTask<double>::position(
      tip, Vector3<double>::Zero(), place + Vector3<double>(0.01, 0, -0.01))};
  clothctl::InverseKinematics<Tree> ik(tree, 5);
  VectorX<double> goal = q;
  const double miss = ik.solve(tree, tasks, VectorX<double>(), goal).error;
  auto settings = clothctl::StablePdSettings<double>::uniform(tree.nv());
  settings.dt = 0.01;
  auto pd = clothctl::StablePd<Tree>::create(tree, settings).value();
  VectorX<double> qd = VectorX<double>::Zero(tree.nv()), torques = qd, qdd = qd;
  for (int k = 0; k < 50; ++k) {
    const auto step =
        pd.solve(tree, q, qd, goal, VectorX<double>(), VectorX<double>(), work, torques, qdd);
    if (step.status != clothctl::PdStatus::Solved) return {std::nan(""), miss};
    qd += settings.dt * qdd;
    tree.advance(q, settings.dt * qd, q);
  }
  return {q.norm(), miss};
}

/// The distance of a planned sheet's corner from its target after some frames.
double planned() {
  const auto grid = clothctl::make_grid<double>(7, 7, 0.3, 0.3).value();
  const auto network = clothctl::sheet_network(grid, clothctl::Material<double>{}).value();
  const auto model = clothctl::MassSpring<double>::create(network).value();
  clothctl::ModelPlant<clothctl::MassSpring<double>> plant(model);
  clothctl::PlannerSetup<double> setup;
  setup.triangles = network.triangles;
  for (int col : {0, 6}) {
    setup.features.add_point(grid.vertex(0, col));
    setup.grips.push_back(clothctl::make_pinch<double>({grid.vertex(6, col)}, 0.5, 20.0));
  }
  clothctl::PlannerSettings<double> settings;
  settings.gravity_load = {0, 0, 9.81 * network.mass.sum()};
  const auto target = [&](Index corner, double t) -> Vector3<double> {
    return grid.positions.col(corner == 0 ? 0 : 6) +
           Vector3<double>(0.05 * t, 0.05 * std::sin(2 * t), 0);
  };
  clothctl::LinearisedPredictor<clothctl::MassSpringResponse<float>> predictor{
      clothctl::MassSpringResponse<float>(model)};
  auto planner =
      clothctl::Planner<decltype(predictor)>::create(setup, settings, predictor, plant.positions())
          .value();
  clothctl::PlanResult<double> plan = planner.make_result();
  for (int frame = 0; frame < 10; ++frame) {
    if (!clothctl::can_apply(
            planner.plan(plant.positions(), plant.velocities(), 0.02 * frame, target, plan)))
      return std::nan("");
    plant.apply(plan.input);
    if (!plant.advance(0.02).advanced) return std::nan("");
  }
  return plant.positions().norm();
}

/// Eigen's own product, factor, sums and fixed sizes.
template <class Scalar>
double eigen() {
  const Index n = 150;
  clothctl::MatrixX<Scalar> M(n, n);
  for (Index i = 0; i < M.size(); ++i)
    M(i) = Scalar(static_cast<double>(i * 7919 % 101) / 101 - 0.5);
  clothctl::MatrixX<Scalar> S = M * M.transpose();
  S.diagonal().array() += Scalar(1);
  const VectorX<Scalar> x =
      S.llt().solve(M.col(3)) + S.template triangularView<Eigen::Lower>() * M.col(5).eval();
  Eigen::Matrix<Scalar, 4, 4> block =
      M.template topLeftCorner<4, 4>() * S.template topLeftCorner<4, 4>();
  block += block.inverse();
  return static_cast<double>(x.segment(1, n - 3).norm() + block.norm());
}

}  // namespace

std::vector<Figure> figures() {
  const auto [pose, miss] = hand();
  return {{"factor, double", factor_error<double>(), 1e-12},
          {"factor, float", factor_error<float>(), 1e-5},
          {"mass-spring, double", fall<double>(), 1e-9},
          {"mass-spring, float", fall<float>(), 1e-3},
          {"box program, double", program<double>(false), 1e-9},
          {"box program, float", program<float>(false), 1e-3},
          {"program with rows, double", program<double>(true), 1e-8},
          {"program with rows, float", program<float>(true), 1e-2},
          {"hand, pose", pose, 1e-6},
          {"hand, inverse kinematics", miss, 1e-6},
          {"planned sheet", planned(), 1e-4},
          {"Eigen, double", eigen<double>(), 1e-8},
          {"Eigen, float", eigen<float>(), 1e-2}};
}

void fill(Passed& passed) {
  passed.matrix = Eigen::MatrixXd::Identity(7, 7);
  passed.block.setIdentity();
  for (int i = 0; i < 5; ++i) {
    passed.vectors.push_back(Eigen::VectorXd::Ones(3 + i));
    passed.points.push_back(Eigen::Vector4d::Ones());
  }
}

double grow(Passed& passed) {
  passed.matrix.conservativeResize(19, 19);
  passed.matrix = Eigen::MatrixXd::Identity(19, 19) * 2.0;
  passed.block += passed.block * passed.block;
  for (int i = 0; i < 50; ++i) {
    passed.vectors.push_back(passed.vectors.front() * 2.0);
    passed.points.push_back(passed.points.back());
  }
  for (auto& v : passed.vectors) v.resize(11), v.setOnes();
  double sum = passed.matrix.sum() + static_cast<double>(passed.block.sum());
  for (const auto& v : passed.vectors) sum += v.sum();
  for (const auto& p : passed.points) sum += p.sum();
  return sum;
}

}  // namespace UNIT
