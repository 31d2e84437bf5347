// A hand: poses of its links, and joint angles that bring a fingertip to its target.

#include "clothctl/robot.hpp"

int main() {
  using Tree = clothctl::KinematicTree<double>;
  const Tree hand = clothctl::hand34<double>();
  clothctl::KinematicTreeWorkspace<double> work(hand);
  clothctl::VectorX<double> q = hand.neutral();
  clothctl::forward_kinematics<double>(hand, q, work.body_poses);
  const int tip = hand.find_link("index_tip");
  clothctl::Vector3<double> place = clothctl::link_pose(hand, work.body_poses, tip).p;
  place[0] += 0.02;
  const std::vector<clothctl::IkTask<double>> tasks = {
      clothctl::IkTask<double>::position(tip, clothctl::Vector3<double>::Zero(), place)};
  clothctl::InverseKinematics<Tree> solver(hand, 1);
  const auto report = solver.solve(hand, tasks, clothctl::VectorX<double>(), q);
  return report.status == clothctl::IkStatus::Reached ? 0 : 1;
}
