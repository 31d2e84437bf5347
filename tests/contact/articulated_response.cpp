// The answer of robots to impulses: the laws, the dense formula, a finger that presses, refusals.

#include "clothctl/contact/articulated_response.hpp"

#include <Eigen/Dense>
#include <limits>
#include <vector>

#include "archetypes/articulated.hpp"
#include "clothctl/contact/contact_solver.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "laws/impulse_response_laws.hpp"
#include "robot/random_tree.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::GantryArchetype;
using clothctl_test::RobotDraws;

static_assert(ImpulseResponse<ArticulatedResponse<KinematicTree<double>>> &&
              ImpulseResponse<ArticulatedResponse<GantryArchetype<float>>, float>);

TEMPLATE_TEST_CASE("the response of a robot obeys the laws and the dense formula", "[contact]",
                   float, double) {
  using S = TestType;
  const bool exact = std::numeric_limits<S>::digits > 30;
  for (unsigned seed = 1; seed < 6; ++seed) {
    RobotDraws draws(seed);
    const KinematicTree<S> tree = draws.tree<S>(8, seed % 2 == 0, seed % 3 == 0);
    using Traits = articulated_traits<KinematicTree<S>>;
    KinematicTreeWorkspace<S> work = Traits::make_workspace(tree);
    Traits::forward_kinematics(tree, draws.positions<S>(tree), work);
    const VectorX<S> qd = draws.entries<S>(tree.nv());
    const VectorX<S> d = draws.entries<S>(tree.nv()).cwiseAbs() + VectorX<S>::Ones(tree.nv());
    const std::vector<int> frames{3, 8, 5};
    Points<S> x(3, 3);
    for (Index i = 0; i < 3; ++i) x.col(i) = draws.vector().template cast<S>();
    ArticulatedResponse<KinematicTree<S>> response(tree, 3);
    const long before = clothctl_test::allocations();
    const ArticulatedStatus status = response.update(tree, work, qd, d, frames, x);
    const long made = clothctl_test::allocations() - before;
    REQUIRE(status == ArticulatedStatus::Updated);
    if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
    MatrixX<S> M(tree.nv(), tree.nv()), J(9, tree.nv()), J6(6, tree.nv());
    MassMatrixWorkspace<S> memory(tree);
    REQUIRE(mass_matrix<S>(tree, work.body_poses, memory, M) == TreeStatus::Done);
    for (Index i = 0; i < 3; ++i) {
      Traits::point_jacobian(tree, work, frames[static_cast<std::size_t>(i)], x.col(i), J6);
      J.template middleRows<3>(3 * i) = J6.template topRows<3>();
    }
    M.diagonal() += d;
    const MatrixX<S> dense = J * M.ldlt().solve(J.transpose());
    MatrixX<S> W = MatrixX<S>::Zero(9, 9);
    response.add_mobility(W);
    const S tolerance = exact ? S(1e-11) : S(1e-3);
    CHECK((W - dense).norm() <= tolerance * dense.norm());
    VectorX<S> u(9);
    response.velocities(u);
    CHECK((u - J * qd).norm() <= tolerance * (J * qd).norm());
    clothctl_test::check_impulse_response_laws<S>(response, tolerance);
  }
}

TEST_CASE("a finger presses with the force of its springs in series", "[contact]") {
  // A gantry under PD control whose target lies 5 mm below a table; the fingertip is soft.
  const GantryArchetype<double> gantry;
  using Traits = articulated_traits<GantryArchetype<double>>;
  auto work = Traits::make_workspace(gantry);
  const double h = 0.02, kp = 1000, kd = 100, compliance = 1 / 2000.0;
  VectorX<double> q = VectorX<double>::Zero(3), qd = q, qdd = q, tau = q;
  const VectorX<double> d = VectorX<double>::Constant(3, h * kd + h * h * kp);
  VectorX<double> target(3), load(3);
  target << 0.001, 0, -0.005;
  ArticulatedResponse<GantryArchetype<double>> hand(gantry, 1);
  std::vector<ContactSample<double>> contacts(1);
  contacts[0].a.side = 0;
  contacts[0].a.point[0] = 0;
  contacts[0].friction = 0.5;
  contacts[0].compliance = contacts[0].tangential_compliance = compliance;
  ContactSolver<double> solver;
  solver.reserve(1, 1);
  const std::vector<int> frame{0};
  for (int k = 0; k < 400; ++k) {
    Traits::forward_kinematics(gantry, q, work);
    Traits::inverse_dynamics(gantry, VectorX<double>(VectorX<double>::Zero(3)),
                             VectorX<double>(VectorX<double>::Zero(3)), work, load);
    tau = load - kp * (q + h * qd - target) - kd * qd;
    REQUIRE(Traits::forward_dynamics(gantry, qd, tau, d, work, qdd) == -1);
    qd += h * qdd;
    Points<double> x(3, 1);
    x.col(0) = q;
    REQUIRE(hand.update(gantry, work, qd, d, frame, x) == ArticulatedStatus::Updated);
    contacts[0].gap = q[2];
    REQUIRE(solver.solve(contacts, h, hand).status == ContactStatus::Solved);
    REQUIRE(solver.apply(contacts, hand) == ContactStatus::Solved);
    qd = hand.joint_velocities();
    q += h * qd;
  }
  CHECK(qd.norm() < 1e-9);
  const Vector3<double> force = contacts[0].impulse / h;
  CHECK(force[2] == Approx(0.005 / (1 / kp + compliance)).epsilon(1e-6));
  CHECK(contacts[0].state == ContactState::Stick);
  CHECK(force[0] == Approx(-contacts[0].offset[0] / compliance).epsilon(1e-6));
}

TEST_CASE("bad input to the response of a robot is refused", "[contact]") {
  RobotDraws draws(4);
  const KinematicTree<double> tree = draws.tree<double>(6, false, false);
  const KinematicTree<double> other = draws.tree<double>(7, false, false);
  using Traits = articulated_traits<KinematicTree<double>>;
  auto work = Traits::make_workspace(tree), other_work = Traits::make_workspace(other);
  Traits::forward_kinematics(tree, draws.positions<double>(tree), work);
  VectorX<double> qd = draws.entries<double>(tree.nv());
  VectorX<double> d = VectorX<double>::Ones(tree.nv());
  std::vector<int> frames{2};
  Points<double> x = Points<double>::Ones(3, 1);
  ArticulatedResponse<KinematicTree<double>> response(tree, 1);
  using Status = ArticulatedStatus;
  REQUIRE(response.update(tree, work, qd, d, frames, x) == Status::Updated);
  CHECK(response.update(tree, work, qd.head(2), d, frames, x) == Status::WrongSize);
  CHECK(response.update(tree, work, qd, d, {}, x) == Status::WrongSize);
  frames[0] = 99;
  CHECK(response.update(tree, work, qd, d, frames, x) == Status::WrongSize);
  frames[0] = 2;
  const Points<double> two = Points<double>::Ones(3, 2);
  const std::vector<int> both{2, 2};
  CHECK(response.update(tree, work, qd, d, both, two) == Status::WrongSize);
  CHECK(response.update(tree, other_work, qd, d, frames, x) == Status::OtherWorkspace);
  CHECK(response.point_count() == 1);
  CHECK(response.joint_velocities() == qd);
  d[1] = -1;
  CHECK(response.update(tree, work, qd, d, frames, x) == Status::InvalidInput);
  CHECK(response.point_count() == 0);
  d[1] = 1;
  x(1, 0) = std::numeric_limits<double>::quiet_NaN();
  CHECK(response.update(tree, work, qd, d, frames, x) == Status::InvalidInput);
  x(1, 0) = 0;
  qd[0] = std::numeric_limits<double>::quiet_NaN();
  CHECK(response.update(tree, work, qd, d, frames, x) == Status::InvalidInput);
  CHECK(response.joint_velocities().allFinite());
}

TEST_CASE("the statuses of a robot's response have names", "[contact]") {
  CHECK(to_string(ArticulatedStatus::Updated) == "updated");
  CHECK(to_string(ArticulatedStatus::InvalidInput) == "invalid_input");
  CHECK(to_string(ArticulatedStatus::WrongSize) == "wrong_size");
  CHECK(to_string(ArticulatedStatus::OtherWorkspace) == "other_workspace");
  CHECK(to_string(ArticulatedStatus::NoInertia) == "no_inertia");
}
