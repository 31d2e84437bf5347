// The baseline: compile time of Eigen alone.

#include <Eigen/Dense>

int main() {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  turn(0, 1) = 0.5;
  return (turn * Eigen::Vector3d(1, 2, 3)).norm() > 0 ? 0 : 1;
}
