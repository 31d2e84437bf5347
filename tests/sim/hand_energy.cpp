// The energy of a hand in a world whose target rests. Gravity is fed forward and cancels what pulls
// at the joints, so that its potential is no part of the energy. With e = q - target and the
// velocities v before and v' after a step of length h, the step of
//
//   Implicit   M (v' - v) = -h Kp (e + h v') - h Kd v'
//
// is one of implicit Euler and never raises
//
//   E = 1/2 vᵀ M v + 1/2 eᵀ Kp e.
//
// PdForm::Stable has h Kp (e + h v) in place of h Kp (e + h v'): the same step with M - h² Kp for M
// on the left. It may raise E: the spring of a joint with little inertia goes where its velocity
// before the step leads, however much the damper slows it. What never rises is
//
//   V = 1/2 vᵀ (M + h Kd - 1/2 h² Kp) v + 1/2 eᵀ Kp e.
//
// With A = (M + h Kd - 1/2 h² Kp) / 2 and B = (M - h² Kp) / 2,
//
//   V - V' = v'ᵀ A v' - 2 v'ᵀ B v + vᵀ A v,
//
// which is not negative where A + B and A - B are positive semidefinite. A + B is h/2 times what
// StablePd::unstable_at looks at, and A - B = h/2 Kd + h²/4 Kp.

#include <cmath>

#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/inverse_dynamics.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "clothctl/robot/stable_pd.hpp"
#include "clothctl/sim/world.hpp"
#include "robot/random_tree.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Tree = KinematicTree<double>;

/// A hand34 alone in a world, with random velocities.
struct PushedHand {
  Tree tree = hand34<double>();
  World<double> world;
  StablePdSettings<double> control = StablePdSettings<double>::uniform(tree.nv());
  KinematicTreeWorkspace<double> work{tree};
  MassMatrixWorkspace<double> memory{tree};
  MatrixX<double> M{tree.nv(), tree.nv()};

  /// `apart`: the hand starts elsewhere than at its target.
  PushedHand(RobotDraws& draws, PdForm form, bool feed_gravity, bool apart) {
    control.form = form;
    control.feed_gravity = feed_gravity;
    control.limit_torques = false;  // at its limit a torque is no spring
    HandSetup<double> setup;
    setup.positions = somewhere(draws);
    setup.velocities = draws.entries<double>(tree.nv());
    setup.control = control;
    (void)world.add_hand(tree, setup).value();
    if (apart) world.drive(0).target = somewhere(draws);
  }
  VectorX<double> somewhere(RobotDraws& draws) const {
    VectorX<double> q(tree.nq());
    for (Index i = 0; i < q.size(); ++i) {
      const double share = 0.5 + 0.4 * std::tanh(draws.normal());
      q[i] = tree.lower()[i] + share * (tree.upper()[i] - tree.lower()[i]);
    }
    return q;
  }
  /// E, and the potential of gravity where it is not fed forward.
  double energy() {
    const HandState<double>& now = world.hand(0);
    forward_kinematics<double>(tree, now.positions, work.body_poses);
    mass_matrix<double>(tree, work.body_poses, memory, M);
    const VectorX<double> e = now.positions - world.drive(0).target;
    double out =
        0.5 * now.velocities.dot(M * now.velocities) + 0.5 * e.dot(control.kp.cwiseProduct(e));
    if (control.feed_gravity) return out;
    for (std::size_t b = 0; b < tree.bodies().size(); ++b) {
      const Inertia<double>& part = tree.bodies()[b].inertia;
      const BodyPose<double>& place = work.body_poses.poses[b];
      out -= part.mass * work.gravity.dot(place.R * part.com + place.p);
    }
    return out;
  }
  /// What a step of `h` s never raises.
  double falling(double h) {
    if (control.form == PdForm::Implicit) return energy();
    const VectorX<double>& v = world.hand(0).velocities;
    const VectorX<double> more = h * control.kd - 0.5 * h * h * control.kp;
    return energy() + 0.5 * v.dot(more.cwiseProduct(v));
  }
};

}  // namespace

TEST_CASE("the energy of a hand whose target rests never rises from step to step", "[sim]") {
  RobotDraws draws(2025);
  const int count = trials(12, 200);
  int raised = 0, implicit_raised = 0;
  for (const PdForm form : {PdForm::Stable, PdForm::Implicit}) {
    for (const double h : {0.02, 0.005}) {
      for (int trial = 0; trial < count; ++trial) {
        const bool feed_gravity = trial % 4 != 3, apart = trial % 2 == 1;
        CAPTURE(h, trial, form == PdForm::Implicit);
        PushedHand hand(draws, form, feed_gravity, apart);
        const double first = hand.falling(h);
        double last = first, plain = hand.energy();
        const double rounding = 1e-12 * (std::abs(first) + 1);
        for (int k = 0; k * h < 2; ++k) {
          CAPTURE(k);
          REQUIRE(hand.world.step(h).status == StepStatus::Converged);
          const double now = hand.falling(h), energy = hand.energy();
          REQUIRE(now <= last + rounding);
          if (plain + rounding < energy) ++(form == PdForm::Stable ? raised : implicit_raised);
          last = now;
          plain = energy;
        }
        if (feed_gravity) CHECK(last < 1e-6 * first);  // it comes to rest at the target
      }
    }
  }
  CHECK(implicit_raised == 0);
  CHECK(raised > 0);  // so V is needed
}
