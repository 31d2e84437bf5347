#include <qpmad/solver.h>

#include <string>

#include "solver.hpp"

namespace versus {

namespace {

/// Needs H > 0. It has no warm start: "kept" frames reuse the inverted Cholesky factor of H.
class Qpmad final : public Solver {
 public:
  bool prepare(const Problem& problem) override {
    problem_ = &problem;
    A_ = problem.A;
    return is_positive_definite(problem.H);
  }

  void setup() override {
    H_ = problem_->H;
    parameters_.hessian_type_ = qpmad::SolverParameters::HESSIAN_LOWER_TRIANGULAR;
    parameters_.max_iter_ = 1000000;
  }

  Verdict solve(const Vectors& v, Start start) override {
    v_ = &v;
    const bool boxed = (v.lb.array() > -1e20).any() || (v.ub.array() < 1e20).any();
    lb_.resize(0);
    ub_.resize(0);
    if (boxed) {
      lb_ = clip(v.lb, 1e20);
      ub_ = clip(v.ub, 1e20);
    }
    bounds_ = lb_.size();
    parameters_.return_inverted_cholesky_factor_ = start != Start::Single;
    x_.resize(problem_->n());
    try {
      qpmad::Solver::ReturnStatus status = qpmad::Solver::UNDEFINED;
      if (problem_->m() == 0) {
        status = solver_.solve(x_, H_, v.g, lb_, ub_, parameters_);
      } else {
        rl_ = clip(v.rl, 1e20);
        ru_ = clip(v.ru, 1e20);
        status = solver_.solve(x_, H_, v.g, lb_, ub_, A_, rl_, ru_, parameters_);
      }
      parameters_.hessian_type_ = solver_.getHessianType();
      return status == qpmad::Solver::OK ? Verdict::Solved : Verdict::Stopped;
    } catch (const std::exception& error) {
      parameters_.hessian_type_ = solver_.getHessianType();
      const std::string text = error.what();
      const bool said = text.find("Infeasible") != std::string::npos ||
                        text.find("Inconsistent") != std::string::npos;
      return said ? Verdict::Infeasible : Verdict::Stopped;
    }
  }

  /// The solver does not return multipliers of equalities; they are least-squares solutions of the
  /// stationarity condition.
  void read(Answer& answer) override {
    const Index n = problem_->n(), m = problem_->m();
    Vector dual;
    Eigen::Matrix<qpmad::MatrixIndex, Eigen::Dynamic, 1> index;
    Eigen::Matrix<bool, Eigen::Dynamic, 1> lower;
    solver_.getInequalityDual(dual, index, lower);
    answer.x = x_;
    answer.y.setZero(m);
    answer.z.setZero(n);
    for (Index k = 0; k < dual.size(); ++k) {
      const double value = lower[k] ? dual[k] : -dual[k];
      const Index i = static_cast<Index>(index[k]);
      (i < bounds_ ? answer.z[i] : answer.y[i - bounds_]) = value;
    }
    Vector rest = problem_->H * x_ + v_->g - problem_->A.transpose() * answer.y - answer.z;
    std::vector<Index> rows, open;
    for (Index i = 0; i < m; ++i) {
      if (!(v_->rl[i] < v_->ru[i])) rows.push_back(i);
    }
    for (Index j = 0; j < n; ++j) {
      if (v_->lb[j] < v_->ub[j]) open.push_back(j);
    }
    const auto at = [](const std::vector<Index>& list, Index k) {
      return list[static_cast<std::size_t>(k)];
    };
    Matrix normals(static_cast<Index>(open.size()), static_cast<Index>(rows.size()));
    Vector right(normals.rows());
    for (Index k = 0; k < normals.rows(); ++k) {
      right[k] = rest[at(open, k)];
      for (Index i = 0; i < normals.cols(); ++i) normals(k, i) = A_(at(rows, i), at(open, k));
    }
    if (normals.size() > 0) {
      const Vector y = normals.colPivHouseholderQr().solve(right);
      for (Index i = 0; i < y.size(); ++i) {
        answer.y[at(rows, i)] = y[i];
        rest -= y[i] * A_.row(at(rows, i)).transpose();
      }
    }
    for (Index j = 0; j < n; ++j) {
      if (!(v_->lb[j] < v_->ub[j])) answer.z[j] += rest[j];
    }
  }

 private:
  const Problem* problem_ = nullptr;
  const Vectors* v_ = nullptr;
  Matrix H_;
  RowMatrix A_;
  Vector x_, lb_, ub_, rl_, ru_;
  Index bounds_ = 0;
  qpmad::Solver solver_;
  qpmad::SolverParameters parameters_;
};

}  // namespace

Entry qpmad_entry() {
  return {"qpmad", VERSUS_QPMAD_VERSION, {Start::Kept}, [](double) -> std::unique_ptr<Solver> {
            return std::make_unique<Qpmad>();
          }};
}

}  // namespace versus
