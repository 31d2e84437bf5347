#pragma once

// The linearised step of the sheet for the baseline: A and K with general sparse matrices, written
// once more from their definition, and Eigen's sparse Cholesky factor.
//
//   A v⁺ = M v + h (f - K q + u),   q⁺ = q + h v⁺,   A = (1 + h α) M + h D + h² K

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <vector>

#include "clothctl/cloth/mass_spring_response.hpp"
#include "scene.hpp"

namespace planner_bench {

/// Whose factor solves the systems of the baseline.
enum class Factor { Eigen, Ours };

/// The step about a frame. Memory is made once, apart from that of the factor.
class SparseStep {
 public:
  SparseStep(const MassSpring<double>& model, Factor factor);

  /// Linearises about a frame. Returns false where A is not positive definite.
  bool linearise(const Frame& frame);

  /// Net force at the frame, 3n, N.
  const VectorX<double>& force() const { return force_; }
  /// Mass of each coordinate, 3n, kg.
  const VectorX<double>& mass() const { return mass_; }

  /// Advances velocity `v` (m/s) and displacement `q` (m) by a frame, in which f + `push` acts, or
  /// `push` alone (N).
  void advance(const VectorX<double>& push, VectorX<double>& v, VectorX<double>& q);

 private:
  using Sparse = Eigen::SparseMatrix<double>;
  using Entries = std::vector<Eigen::Triplet<double>>;

  void add_springs(const Frame& frame);
  void add_bending(const Frame& frame);

  const MassSpring<double>& model_;
  Factor kind_;
  Entries stiff_, step_;
  Eigen::SparseMatrix<double, Eigen::RowMajor> K_;
  Sparse A_;
  Eigen::SimplicialLLT<Sparse> factor_;
  MassSpringResponse<double> response_;
  Lanes<double, 1> lane_;
  VectorX<double> mass_, force_, product_;
  bool analysed_ = false;
};

}  // namespace planner_bench
