#include "clothctl/robot/prioritised_ik.hpp"

#include "robot/small_hand.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl_test;

namespace {

struct Ranked : Reach {
  PrioritisedIk<KinematicTree<double>> ik{tree, 6, 3};
  int palm = tree.find_link("palm5");

  Matrix3<double> palm_at(const VectorX<double>& q) {
    forward_kinematics<double>(tree, q, body_poses);
    return link_pose(tree, body_poses, palm).R;
  }
  VectorX<double> near(const VectorX<double>& q) {
    VectorX<double> moved = q;
    for (Index i = 0; i < q.size(); ++i) moved[i] += 0.1 * (uniform() - 0.5);
    return moved.cwiseMax(tree.lower()).cwiseMin(tree.upper());
  }
};

}  // namespace

TEST_CASE("compatible levels are all satisfied within the limits", "[robot]") {
  Ranked hand;
  int reached = 0;
  for (int round = 0; round < 50; ++round) {
    const VectorX<double> goal = hand.anywhere();
    hand.aim_at(goal);
    hand.tasks.push_back(IkTask<double>::orientation(hand.palm, hand.palm_at(goal)));
    VectorX<double> q = hand.near(goal);
    const int levels[] = {5, 1};
    const long before = clothctl_test::allocations();
    const IkReport<double> report =
        hand.ik.solve(hand.tree, hand.tasks, levels, VectorX<double>(), q);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    reached += report.status == IkStatus::Reached ? 1 : 0;
    CHECK(hand.within_limits(q));
    CHECK(hand.ik.level_error(0) <= report.error);
  }
  CHECK(reached >= 48);
}

TEST_CASE("a conflicting later level does what it can without affecting the first", "[robot]") {
  Ranked hand;
  int first = 0, helped = 0;
  for (int round = 0; round < 30; ++round) {
    const VectorX<double> goal = hand.anywhere();
    hand.aim_at(goal);
    const Matrix3<double> wanted = hand.palm_at(hand.anywhere());
    hand.tasks.push_back(IkTask<double>::orientation(hand.palm, wanted));
    VectorX<double> q = hand.near(goal);
    const int levels[] = {5, 1};
    const double before = rotation_log<double>(wanted * hand.palm_at(q).transpose()).norm();
    const IkReport<double> report =
        hand.ik.solve(hand.tree, hand.tasks, levels, VectorX<double>(), q);
    const double after = rotation_log<double>(wanted * hand.palm_at(q).transpose()).norm();
    first += hand.ik.level_error(0) <= 1e-4 ? 1 : 0;
    helped += after < 0.9 * before ? 1 : 0;
    CHECK(hand.ik.level_error(1) == Approx(0.1 * after).margin(1e-12));
    CHECK(report.status != IkStatus::InvalidInput);
    CHECK(hand.within_limits(q));

    // In the reverse order the palm comes first, and the tips miss.
    std::vector<IkTask<double>> turned = {hand.tasks[5]};
    turned.insert(turned.end(), hand.tasks.begin(), hand.tasks.begin() + 5);
    const int other[] = {1, 5};
    hand.ik.solve(hand.tree, turned, other, VectorX<double>(), q);
    CHECK(hand.ik.level_error(0) <= 0.1 * after + 1e-12);
  }
  CHECK(first >= 28);
  CHECK(helped >= 20);
}

TEST_CASE("motion that the tasks leave free approaches the reference", "[robot]") {
  Ranked hand;
  const VectorX<double> goal = hand.anywhere();
  hand.aim_at(goal);
  hand.tasks.resize(2);
  VectorX<double> q = hand.near(goal);
  const VectorX<double> reference = hand.near(goal);
  const int levels[] = {2};
  const double before = (q - reference).norm();
  const IkReport<double> report = hand.ik.solve(hand.tree, hand.tasks, levels, reference, q);
  CHECK(report.status == IkStatus::Reached);
  CHECK((q - reference).norm() < 0.5 * before);
}

TEST_CASE("without refine_posture a call stops after one step, and the posture follows over calls",
          "[robot]") {
  Ranked hand;
  IkSettings<double> settings;
  settings.refine_posture = false;
  PrioritisedIk<KinematicTree<double>> tracking(hand.tree, 6, 3, settings);
  const int levels[] = {2};
  for (int round = 0; round < 10; ++round) {
    const VectorX<double> goal = hand.anywhere();
    hand.aim_at(goal);
    hand.tasks.resize(2);
    const VectorX<double> reference = hand.near(goal);
    VectorX<double> refined = goal, q = goal;  // which meets the tasks
    hand.ik.solve(hand.tree, hand.tasks, levels, reference, refined);
    for (int call = 0; call < 40; ++call) {
      const IkReport<double> report = tracking.solve(hand.tree, hand.tasks, levels, reference, q);
      CHECK(report.status == IkStatus::Reached);
      CHECK(report.iterations <= 3);  // a step that misses a task is followed by one that meets it
    }
    const double whole = (goal - reference).norm();
    CHECK((refined - reference).norm() < 0.99 * whole);
    CHECK((q - reference).norm() < (refined - reference).norm() + 1e-3 * whole);
  }
}

TEST_CASE("without tasks the posture alone is approached", "[robot]") {
  Ranked hand;
  VectorX<double> q = hand.anywhere();
  const VectorX<double> reference = hand.anywhere();
  CHECK(hand.ik.solve(hand.tree, {}, {}, reference, q).status == IkStatus::Reached);
  CHECK((q - reference).norm() < 1e-3);
}

TEST_CASE("wrong numbers of levels are refused", "[robot]") {
  Ranked hand;
  VectorX<double> q = hand.anywhere();
  const VectorX<double> before = q;
  hand.aim_at(q);
  const int short_by_one[] = {3, 1}, empty[] = {5, 0}, many[] = {1, 1, 1, 2};
  CHECK(hand.ik.solve(hand.tree, hand.tasks, short_by_one, VectorX<double>(), q).message ==
        "the levels' counts do not add up to the number of tasks");
  CHECK(hand.ik.solve(hand.tree, hand.tasks, empty, VectorX<double>(), q).message ==
        "a level has no task");
  CHECK(hand.ik.solve(hand.tree, hand.tasks, many, VectorX<double>(), q).message ==
        "there are more levels than memory was made for");
  CHECK(q == before);
}

TEST_CASE("reserving negative numbers of tasks and levels reserves none", "[robot]") {
  Reach reach;
  reach.aim_at(reach.tree.neutral());
  const VectorX<double> none;
  VectorX<double> q = reach.tree.neutral();
  const int levels[] = {5};
  PrioritisedIk<KinematicTree<double>> tasks(reach.tree, -1, 1), ranks(reach.tree, 5, -1);
  CHECK(tasks.solve(reach.tree, reach.tasks, levels, none, q).message ==
        "there are more tasks than memory was made for");
  CHECK(ranks.solve(reach.tree, reach.tasks, levels, none, q).message ==
        "there are more levels than memory was made for");
  CHECK(std::isinf(ranks.level_error(3)));
}
