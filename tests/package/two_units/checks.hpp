#pragma once

// Small computations with known answers. Each unit has its own copy of them, but shares the library's templates.

#include <clothctl/clothctl.hpp>
#include <utility>
#include <vector>

namespace {

constexpr int kSide = 7;

template <class Scalar>
clothctl::SpringNetwork<Scalar> sheet() {
  clothctl::SpringNetwork<Scalar> network;
  network.rest_positions.resize(3, kSide * kSide);
  network.mass = clothctl::VectorX<Scalar>::Constant(kSide * kSide, Scalar(0.01));
  for (int i = 0; i < kSide; ++i) {
    for (int j = 0; j < kSide; ++j) {
      const int v = i * kSide + j;
      network.rest_positions.col(v) = clothctl::Vector3<Scalar>(Scalar(0.1 * j), Scalar(0.0), Scalar(0.1 * i));
      if (j > 0) network.springs.push_back({v - 1, v, Scalar(0.1), Scalar(50.0), Scalar(0.01)});
      if (i > 0) network.springs.push_back({v - kSide, v, Scalar(0.1), Scalar(50.0), Scalar(0.01)});
    }
  }
  return network;
}

template <class Scalar>
clothctl::BlockSymmetric<Scalar> matrix_of(const clothctl::SpringNetwork<Scalar>& network) {
  std::vector<std::pair<int, int>> pairs;
  for (const auto& spring : network.springs) pairs.emplace_back(spring.a, spring.b);
  clothctl::BlockSymmetric<Scalar> matrix(kSide * kSide, pairs);
  for (clothctl::Index i = 0; i < matrix.rows(); ++i) matrix.diagonal(i).diagonal().setConstant(Scalar(5.0));
  for (clothctl::Index s = 0; s < matrix.lower_count(); ++s) matrix.lower(s).setConstant(Scalar(-0.25));
  return matrix;
}

/// Solves A x = b and multiplies back.
template <class Scalar>
double error_of_factor() {
  const clothctl::SpringNetwork<Scalar> network = sheet<Scalar>();
  const clothctl::BlockSymmetric<Scalar> matrix = matrix_of(network);
  clothctl::BlockCholesky<Scalar> factor(matrix, clothctl::nested_dissection<Scalar>(matrix, network.rest_positions));
  if (!factor.factorize(matrix)) return 1.0;
  using Lanes = clothctl::Lanes<Scalar, 4>;
  Lanes b(4, 3 * matrix.rows());
  for (clothctl::Index i = 0; i < b.size(); ++i) b(i) = Scalar(static_cast<double>(i * 37 % 11) - 5.0);
  Lanes x = b, back = b;
  factor.template solve<4>(x);
  matrix.template multiply<4>(x, back);
  return static_cast<double>((back - b).norm() / b.norm());
}

/// Lets a sheet fall: springs pull at its vertices, but its middle gains -g h whatever they do.
template <class Scalar>
double error_of_step() {
  const auto made = clothctl::MassSpring<Scalar>::create(sheet<Scalar>());
  if (!made) return 1.0;
  auto memory = made->make_workspace();
  auto state = made->rest_state();
  state.positions.col(0).array() -= Scalar(0.05);
  if (made->step(state, {}, Scalar(0.02), memory).status != clothctl::StepStatus::Converged) return 1.0;
  const clothctl::Vector3<Scalar> error = state.velocities.rowwise().mean() - made->settings().gravity * Scalar(0.02);
  return static_cast<double>(error.norm());
}

}  // namespace
