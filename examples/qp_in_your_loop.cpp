// A cart follows a path by model-predictive control. Each frame solves one QP with bounds, warm
// from the previous frame.

#include <cmath>
#include <cstdio>

#include "clothctl/qp/box_active_set.hpp"

int main() {
  const int horizon = 40, frames = 300;
  const double dt = 0.05, limit = 1.0, effort = 1e-3;
  // The positions at the next `horizon` frames are (position + dt k velocity) + M u, where u are
  // the accelerations.
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(horizon, horizon);
  for (int i = 0; i < horizon; ++i) {
    for (int j = 0; j <= i; ++j) M(i, j) = dt * dt * (i - j + 0.5);
  }
  const Eigen::MatrixXd H =
      M.transpose() * M + effort * Eigen::MatrixXd::Identity(horizon, horizon);
  const Eigen::VectorXd top = Eigen::VectorXd::Constant(horizon, limit), bottom = -top;

  clothctl::BoxActiveSet<double> warm, cold;
  if (warm.set_hessian(H) != clothctl::QpStatus::Solved ||
      cold.set_hessian(H) != clothctl::QpStatus::Solved)
    return 1;
  clothctl::QpResult<double> plan, check;
  Eigen::VectorXd miss(horizon);  // positions without acceleration, minus the path
  double x = 0, v = 0, worst = 0;
  int warm_rounds = 0, cold_rounds = 0;
  for (int frame = 0; frame < frames; ++frame) {
    for (int k = 0; k < horizon; ++k)
      miss[k] = x + dt * (k + 1) * v - std::sin(dt * (frame + k + 1));
    const Eigen::VectorXd g = M.transpose() * miss;
    warm.shift(1);  // one acceleration per frame
    cold.reset();
    if (warm.solve(g, bottom, top, plan) != clothctl::QpStatus::Solved) return 1;
    if (cold.solve(g, bottom, top, check) != clothctl::QpStatus::Solved) return 1;
    warm_rounds += plan.iterations, cold_rounds += check.iterations;
    x += dt * (v + 0.5 * dt * plan.x[0]), v += dt * plan.x[0];
    if (frame > 100) worst = std::fmax(worst, std::fabs(x - std::sin(dt * (frame + 1))));
  }
  std::printf("largest error after 5 s: %.1f mm; active-set rounds: %d warm, %d cold\n",
              1e3 * worst, warm_rounds, cold_rounds);
}
