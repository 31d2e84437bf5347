#pragma once

// The paper's own procedure for a frame of planned forces ([Bai 2016], eq. 5 to 10), written
// plainly: every pair of frames (j, k) and every generator is integrated with one right-hand side
// at a time, by one factorisation a frame. There is no Toeplitz structure, no block of right-hand
// sides, and no start from the last plan. The map from coefficients to positions is stored whole,
// and a product of the weighted rows gives the normal matrix.

#include <vector>

#include "../versus/qp/solver.hpp"
#include "clothctl/mpc/planner.hpp"
#include "step.hpp"
#include "watch.hpp"

namespace planner_bench {

/// Forms the QP in the contact coefficients d >= 0 of all frames.
class PaperBaseline {
 public:
  PaperBaseline(const Scene& scene, Index horizon, Factor factor);

  /// Forms the QP of a frame, and adds to linearise, response and stack of `times`. Returns false
  /// where A is not positive definite.
  bool form(const Frame& frame, Phases& times);

  /// The QP of the last frame.
  const versus::Problem& problem() const { return problem_; }

  /// Returns the forces on the held vertices in the first frame of a solution, N.
  VectorX<double> first_input(const VectorX<double>& d) const {
    return basis_.matrix() * d.head(basis_.unknowns());
  }

 private:
  void integrate_all(const Frame& frame);
  /// How far drag makes a hand lead at time `t` (s), m.
  V lead(const HandAnchor<double>& anchor, double t) const;
  void stack(const Frame& frame);
  void load_point(const Frame& frame, Index k, int vertex, MatrixX<double>& of_d, V& now) const;
  void add(double scale, const MatrixX<double>& of_d, const V& now);

  const Scene& scene_;
  PlannerSettings<double> settings_;
  SparseStep step_;
  detail::GripBasis<double> basis_;
  std::vector<HandAnchor<double>> anchors_;
  std::vector<MatrixX<double>> map_;  // of each frame, 3n × unknowns
  MatrixX<double> free_, rows_;
  VectorX<double> rest_;
  Index row_ = 0;
  versus::Problem problem_;
};

}  // namespace planner_bench
