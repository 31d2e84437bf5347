// Compiled with -DEIGEN_DEFAULT_TO_ROW_MAJOR, which makes Eigen's own matrix types row-major. All
// matrix types of the library name their order, so sheets and a quadratic program must give the
// same results as without the macro. Exits with 0 if they do; otherwise prints the difference.

#include <cmath>
#include <cstdio>

#include "clothctl/qp/box_active_set.hpp"
#include "support/state_hash.hpp"

using namespace clothctl;

static_assert(Eigen::MatrixXd::IsRowMajor, "compile with -DEIGEN_DEFAULT_TO_ROW_MAJOR");
static_assert(!MatrixX<double>::IsRowMajor && !Points<double>::IsRowMajor &&
              !Matrix3<double>::IsRowMajor && !Lanes<double, 4>::IsRowMajor);

namespace {

int failures = 0;

void expect(bool good, const char* what) {
  if (good) return;
  std::printf("%s differs\n", what);
  ++failures;
}

/// min ½ xᵀHx + gᵀx, x ≥ 0, with g such that a known x is the minimiser. Every third entry of x is
/// 0 with the multiplier 1.
void run_qp() {
  const int n = 30;
  MatrixX<double> H = MatrixX<double>::Zero(n, n);
  VectorX<double> known = VectorX<double>::Zero(n), g = VectorX<double>::Zero(n);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) H(i, j) = (i == j ? 4.0 + 0.1 * i : 0.0) + 1.0 / (1.0 + i + j);
    known[i] = i % 3 == 0 ? 0.0 : 1.0 + 0.05 * i;
  }
  for (int i = 0; i < n; ++i) {
    g[i] = i % 3 == 0 ? 1.0 : 0.0;
    for (int j = 0; j < n; ++j) g[i] -= H(i, j) * known[j];
  }
  const VectorX<double> lower = VectorX<double>::Zero(n),
                        upper = VectorX<double>::Constant(n, 1e30);
  BoxActiveSet<double> solver;
  expect(solver.set_hessian(H) == QpStatus::Solved, "status of set_hessian");
  QpResult<double> result;
  expect(solver.solve(g, lower, upper, result) == QpStatus::Solved, "status of the QP");
  double worst = 0.0;
  for (int i = 0; i < n; ++i) worst = std::fmax(worst, std::fabs(result.x[i] - known[i]));
  expect(worst < 1e-10, "minimiser of the QP");
}

}  // namespace

int main() {
  if (clothctl_test::kBaselineFlags) {
    expect(clothctl_test::sheet_hashes<double>() == clothctl_test::kDoubleHashes, "sheet (double)");
    expect(clothctl_test::sheet_hashes<float>() == clothctl_test::kFloatHashes, "sheet (float)");
  }
  run_qp();
  std::printf("row major: %d failure(s)\n", failures);
  return failures == 0 ? 0 : 1;
}
