// A hand held in place by stable PD control.

#include "clothctl/robot.hpp"

int main() {
  using Tree = clothctl::KinematicTree<double>;
  using Vector = clothctl::VectorX<double>;
  const Tree hand = clothctl::hand34<double>();
  const clothctl::Index n = hand.nv();
  clothctl::KinematicTreeWorkspace<double> work(hand);
  clothctl::StablePdSettings<double> settings = clothctl::StablePdSettings<double>::uniform(n);
  settings.dt = 0.01;
  clothctl::StablePd<Tree> pd = clothctl::StablePd<Tree>::create(hand, settings).value();
  const Vector q = hand.neutral(), qd = Vector::Zero(n);
  Vector torques(n), qdd(n);
  const clothctl::PdReport report =
      pd.solve(hand, q, qd, q, Vector(), Vector(), work, torques, qdd);
  return report.status == clothctl::PdStatus::Solved ? 0 : 1;
}
