// plan_joint_path: paths of arms among discs against sampling and against a search on a grid,
// endings without a path, determinism, shortcuts, refused input.

#include "clothctl/grasp/joint_path_planner.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "support/catch.hpp"

using clothctl::Index;
using clothctl::is_path_free;
using clothctl::JointPath;
using clothctl::JointPathSettings;
using clothctl::JointPathStatus;
using clothctl::plan_joint_path;
using clothctl::VectorX;

namespace {

VectorX<double> vector(double a, double b) {
  VectorX<double> v(2);
  v << a, b;
  return v;
}

struct Disc {
  double x, y, radius;
};

/// An arm in the plane with its base at the origin, among discs. Links are segments of 0.4 m.
struct ArmWorld {
  static constexpr double kLink = 0.4;
  Index joints = 2;
  std::vector<Disc> discs;

  /// The exact distance between arm and discs, m.
  double operator()(const VectorX<double>& q) const {
    double least = 10, x = 0, y = 0, angle = 0;
    for (Index i = 0; i < joints; ++i) {
      angle += q[i];
      const double dx = std::cos(angle), dy = std::sin(angle);
      for (const Disc& disc : discs) {
        const double along =
            std::clamp((disc.x - x) * dx + (disc.y - y) * dy, 0.0, static_cast<double>(kLink));
        const double away = std::hypot(disc.x - x - along * dx, disc.y - y - along * dy);
        least = std::min(least, away - disc.radius);
      }
      x += kLink * dx;
      y += kLink * dy;
    }
    return least;
  }
  /// The length of the arm beyond each joint.
  VectorX<double> reach() const {
    VectorX<double> r(joints);
    for (Index i = 0; i < joints; ++i) r[i] = kLink * static_cast<double>(joints - i);
    return r;
  }
};

struct Task {
  ArmWorld world;
  VectorX<double> from, to, lower, upper;
};

/// A random world, with start and goal that do not collide.
Task random_task(Index joints, unsigned seed) {
  std::mt19937 engine(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  Task task;
  task.world.joints = joints;
  while (task.world.discs.size() < 5) {
    const Disc disc{uniform(engine), uniform(engine), 0.1 + 0.05 * uniform(engine)};
    if (std::hypot(disc.x, disc.y) > disc.radius + 0.1) task.world.discs.push_back(disc);
  }
  task.lower = VectorX<double>::Constant(joints, -2.8);
  task.upper = VectorX<double>::Constant(joints, 2.8);
  task.from = task.to = VectorX<double>::Zero(joints);
  for (VectorX<double>* q : {&task.from, &task.to}) {
    do {
      for (Index i = 0; i < joints; ++i) (*q)[i] = 2.8 * uniform(engine);
    } while (task.world(*q) < 5e-3);
  }
  return task;
}

JointPath<double> plan(const Task& task, const JointPathSettings<double>& settings = {}) {
  return plan_joint_path(task.from, task.to, task.lower, task.upper, task.world.reach(), task.world,
                         settings);
}

double way(const VectorX<double>& a, const VectorX<double>& b, const VectorX<double>& reach) {
  return reach.dot((a - b).cwiseAbs());
}

/// Returns the least clearance of a path at samples 1 mm of way apart.
double least_clearance(const ArmWorld& world, const std::vector<VectorX<double>>& positions) {
  double least = 1e9;
  for (std::size_t i = 0; i + 1 < positions.size(); ++i) {
    const VectorX<double>&a = positions[i], &b = positions[i + 1];
    const int n = static_cast<int>(std::ceil(way(a, b, world.reach()) / 1e-3));
    for (int k = 0; k <= n; ++k)
      least = std::min(least, world(a + static_cast<double>(k) / std::max(n, 1) * (b - a)));
  }
  return least;
}

/// Checks everything that a found path promises.
void check_path(const Task& task, const JointPath<double>& path,
                const JointPathSettings<double>& settings = {}) {
  REQUIRE(path.positions.size() >= 2);
  CHECK(path.message.empty());
  CHECK(path.positions.front() == task.from);
  CHECK(path.positions.back() == task.to);
  double length = 0;
  for (std::size_t i = 0; i < path.positions.size(); ++i) {
    const VectorX<double>& q = path.positions[i];
    CHECK((q.array() >= task.lower.array()).all());
    CHECK((q.array() <= task.upper.array()).all());
    if (i > 0) length += way(path.positions[i - 1], q, task.world.reach());
  }
  CHECK(path.length == Approx(length));
  CHECK(path.queries >= 2);
  CHECK(least_clearance(task.world, path.positions) >=
        settings.margin - settings.resolution / 2 - 1e-12);
  CHECK(is_path_free(path.positions, task.world.reach(), task.world, settings.margin,
                     settings.resolution));
}

bool same(const JointPath<double>& a, const JointPath<double>& b) {
  return a.status == b.status && a.message == b.message && a.positions == b.positions &&
         a.length == b.length && a.iterations == b.iterations && a.queries == b.queries;
}

/// Returns whether free motions between neighbours on a grid join start and goal of a 2-joint arm.
bool joined_on_grid(const Task& task) {
  constexpr int kSide = 57;
  const VectorX<double> reach = task.world.reach();
  const auto place = [](int i, int j) { return vector(-2.8 + 0.1 * i, -2.8 + 0.1 * j); };
  const auto free = [&](const VectorX<double>& a, const VectorX<double>& b) {
    return is_path_free<double>({a, b}, reach, task.world, 1e-3, 1e-3);
  };
  std::vector<char> seen(kSide * kSide, 0);
  std::vector<int> open;
  std::vector<char> goal(kSide * kSide, 0);
  for (int n = 0; n < kSide * kSide; ++n) {
    const VectorX<double> q = place(n / kSide, n % kSide);
    if ((q - task.from).cwiseAbs().maxCoeff() < 0.1 && free(task.from, q)) {
      seen[static_cast<std::size_t>(n)] = 1;
      open.push_back(n);
    }
    if ((q - task.to).cwiseAbs().maxCoeff() < 0.1 && free(q, task.to))
      goal[static_cast<std::size_t>(n)] = 1;
  }
  while (!open.empty()) {
    const int n = open.back(), i = n / kSide, j = n % kSide;
    open.pop_back();
    if (goal[static_cast<std::size_t>(n)] != 0) return true;
    const int next[4][2] = {{i + 1, j}, {i - 1, j}, {i, j + 1}, {i, j - 1}};
    for (const auto& [k, l] : next) {
      if (k < 0 || l < 0 || k >= kSide || l >= kSide) continue;
      char& mark = seen[static_cast<std::size_t>(k * kSide + l)];
      if (mark != 0 || !free(place(i, j), place(k, l))) continue;
      mark = 1;
      open.push_back(k * kSide + l);
    }
  }
  return false;
}

/// A point in the plane, moved by two prismatic joints, and a task for it.
struct PointTask {
  VectorX<double> from = VectorX<double>::Zero(2), to = VectorX<double>::Zero(2);
  VectorX<double> lower = VectorX<double>::Constant(2, -1), upper = VectorX<double>::Constant(2, 1),
                  reach = VectorX<double>::Ones(2);

  PointTask() {
    from[0] = -0.8;
    to[0] = 0.8;
  }
  template <class Clearance>
  JointPath<double> plan(Clearance clearance,
                         const JointPathSettings<double>& settings = {}) const {
    return plan_joint_path(from, to, lower, upper, reach, clearance, settings);
  }
};

double disc_in_the_middle(const VectorX<double>& q) { return q.norm() - 0.4; }

}  // namespace

TEST_CASE("paths of a 2-joint arm among discs are free, and found where a grid finds one",
          "[joint_path_planner]") {
  int found = 0, straight = 0, closed = 0;
  for (unsigned seed = 0; seed < 50; ++seed) {
    const Task task = random_task(2, seed);
    const JointPath<double> path = plan(task);
    if (path.status != JointPathStatus::Found) {
      CHECK(path.status == JointPathStatus::NotFound);
      CHECK(path.iterations == 5000);
      CHECK(path.positions.empty());
      CHECK(!joined_on_grid(task));
      ++closed;
      continue;
    }
    check_path(task, path);
    ++found;
    straight += path.iterations == 0 ? 1 : 0;
  }
  CAPTURE(found, straight, closed);
  CHECK(found > 25);
  CHECK(found - straight > 10);
}

TEST_CASE("paths of a 3-joint arm among discs are free", "[joint_path_planner]") {
  int found = 0, straight = 0;
  for (unsigned seed = 100; seed < 150; ++seed) {
    const Task task = random_task(3, seed);
    JointPathSettings<double> settings;
    settings.max_iterations = 2000;
    settings.margin = 2e-3;
    settings.seed = seed;
    const JointPath<double> path = plan(task, settings);
    if (path.status != JointPathStatus::Found) continue;
    check_path(task, path, settings);
    ++found;
    straight += path.iterations == 0 ? 1 : 0;
  }
  CAPTURE(found, straight);
  CHECK(found > 30);
  CHECK(found - straight > 12);
}

TEST_CASE("a lower bound of the clearance serves as well", "[joint_path_planner]") {
  int found = 0;
  for (unsigned seed = 0; seed < 10; ++seed) {
    const Task task = random_task(2, seed);
    const auto bound = [&task](const VectorX<double>& q) { return 0.5 * task.world(q); };
    const JointPath<double> path =
        plan_joint_path(task.from, task.to, task.lower, task.upper, task.world.reach(), bound, {});
    if (path.status != JointPathStatus::Found) continue;
    check_path(task, path);
    ++found;
  }
  CHECK(found > 3);
}

TEST_CASE("a straight way that is free has two positions", "[joint_path_planner]") {
  const PointTask task;
  const JointPath<double> path = task.plan([](const VectorX<double>&) { return 2.0; });
  CHECK(path.status == JointPathStatus::Found);
  REQUIRE(path.positions.size() == 2);
  CHECK(path.positions[0] == task.from);
  CHECK(path.positions[1] == task.to);
  CHECK(path.length == Approx(1.6));
  CHECK(path.iterations == 0);
  CHECK(path.queries == 2);
  // Also from a posture to itself.
  const JointPath<double> stay =
      plan_joint_path(task.from, task.from, task.lower, task.upper, task.reach,
                      [](const VectorX<double>&) { return 2.0; });
  CHECK(stay.status == JointPathStatus::Found);
  CHECK(stay.positions.size() == 2);
  CHECK(stay.length == 0);
}

TEST_CASE("a wall of any thickness closes the way", "[joint_path_planner]") {
  PointTask task;
  JointPathSettings<double> settings;
  settings.max_iterations = 300;
  for (const double half : {0.3, 1e-3, 1e-7, 0.0}) {
    const auto wall = [half](const VectorX<double>& q) { return std::abs(q[0] - 0.1234) - half; };
    const JointPath<double> path = task.plan(wall, settings);
    CHECK(path.status == JointPathStatus::NotFound);
    CHECK(path.iterations == 300);
    CHECK(path.message == "no path was found in 300 iterations");
    CHECK(path.positions.empty());
    CHECK(path.length == 0);
    CHECK(path.queries > 300);
  }
}

TEST_CASE("a goal inside of a ring is not found, through a gap in the ring it is",
          "[joint_path_planner]") {
  PointTask task;
  task.to << 0.05, 0;
  const auto ring = [](const VectorX<double>& q) { return std::abs(q.norm() - 0.4) - 0.02; };
  const JointPath<double> closed = task.plan(ring);
  CHECK(closed.status == JointPathStatus::NotFound);
  CHECK(closed.iterations == 5000);
  // The gap is on the far side, 0.1 m wide. The bound is the distance to the ring's arc.
  const auto gap = [](const VectorX<double>& q) {
    const double angle = std::atan2(std::abs(q[1]), q[0]);
    const double end = 0.17;
    if (angle > end) return std::abs(q.norm() - 0.4) - 0.02;
    return std::hypot(q[0] - 0.4 * std::cos(end), std::abs(q[1]) - 0.4 * std::sin(end)) - 0.02;
  };
  const JointPath<double> open = task.plan(gap);
  REQUIRE(open.status == JointPathStatus::Found);
  CHECK(is_path_free(open.positions, task.reach, gap, 1e-3, 1e-3));
  CHECK(open.length > 1.5);
}

TEST_CASE("joints without limits go around obstacles", "[joint_path_planner]") {
  PointTask task;
  const double infinite = std::numeric_limits<double>::infinity();
  for (const double bound : {infinite, 1e30}) {
    task.lower.setConstant(-bound);
    task.upper.setConstant(bound);
    const JointPath<double> path = task.plan(disc_in_the_middle);
    REQUIRE(path.status == JointPathStatus::Found);
    CHECK(path.iterations > 0);
    CHECK(is_path_free(path.positions, task.reach, disc_in_the_middle, 1e-3, 1e-3));
    CHECK(path.length < 3);  // 2.4 + a little: over the disc and back
  }
  // One limit: the path takes the other side.
  task.upper << infinite, 0.2;
  const JointPath<double> path = task.plan(disc_in_the_middle);
  REQUIRE(path.status == JointPathStatus::Found);
  for (const VectorX<double>& q : path.positions) CHECK(q[1] <= 0.2);
}

TEST_CASE("the same seed gives the same bits, another seed another path", "[joint_path_planner]") {
  const PointTask task;
  JointPathSettings<double> settings;
  const JointPath<double> first = task.plan(disc_in_the_middle, settings);
  REQUIRE(first.status == JointPathStatus::Found);
  CHECK(same(first, task.plan(disc_in_the_middle, settings)));
  settings.seed = 2;
  const JointPath<double> second = task.plan(disc_in_the_middle, settings);
  REQUIRE(second.status == JointPathStatus::Found);
  CHECK(second.positions != first.positions);
}

TEST_CASE("shortcuts never lengthen a path", "[joint_path_planner]") {
  int shorter = 0, compared = 0;
  for (unsigned seed = 0; seed < 60; ++seed) {
    const Task task = random_task(3, seed);
    JointPathSettings<double> settings;
    settings.max_iterations = 1000;
    double last = std::numeric_limits<double>::infinity();
    for (const int shortcuts : {0, 20, 200}) {
      settings.shortcuts = shortcuts;
      const JointPath<double> path = plan(task, settings);
      if (path.status != JointPathStatus::Found || path.iterations == 0) break;
      check_path(task, path, settings);
      if (shortcuts > 0) {
        ++compared;
        CHECK(path.length <= last * (1 + 1e-12));
        shorter += path.length < 0.99 * last ? 1 : 0;
      }
      last = shortcuts == 0 ? path.length : last;  // both from the path of the trees
    }
  }
  CHECK(compared > 20);
  CHECK(shorter > compared / 2);
}

TEST_CASE("start and goal that collide are told, with their clearance", "[joint_path_planner]") {
  PointTask task;
  task.from << 0.25, 0;
  JointPath<double> path = task.plan(disc_in_the_middle);
  CHECK(path.status == JointPathStatus::StartCollides);
  CHECK(path.message == "the start has a clearance of -0.15 m, less than the margin 0.001 m");
  CHECK(path.positions.empty());
  task = PointTask();
  task.to << 0, 0.25;
  path = task.plan(disc_in_the_middle);
  CHECK(path.status == JointPathStatus::GoalCollides);
  CHECK(path.message.starts_with("the goal has a clearance of -0.15"));
  // Less than the margin collides, too.
  path = task.plan([](const VectorX<double>&) { return 0.25e-3; });
  CHECK(path.status == JointPathStatus::StartCollides);
  CHECK(path.message == "the start has a clearance of 0.00025 m, less than the margin 0.001 m");
  path = task.plan([](const VectorX<double>&) { return -std::numeric_limits<double>::infinity(); });
  CHECK(path.status == JointPathStatus::StartCollides);
}

TEST_CASE("start and goal beyond limits are told, with joint and value", "[joint_path_planner]") {
  PointTask task;
  task.from[1] = 1.25;
  JointPath<double> path = task.plan(disc_in_the_middle);
  CHECK(path.status == JointPathStatus::OutOfLimits);
  CHECK(path.message == "joint 1: the start 1.25 is above the upper limit 1");
  CHECK(path.queries == 0);
  task = PointTask();
  task.to[0] = -1.5;
  path = task.plan(disc_in_the_middle);
  CHECK(path.status == JointPathStatus::OutOfLimits);
  CHECK(path.message == "joint 0: the goal -1.5 is below the lower limit -1");
}

TEST_CASE("NaN is never taken for a clearance", "[joint_path_planner]") {
  const PointTask task;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  JointPath<double> path = task.plan([nan](const VectorX<double>&) { return nan; });
  CHECK(path.status == JointPathStatus::InvalidInput);
  CHECK(path.message == "the clearance is nan at (-0.8, 0)");
  // On the straight way.
  path = task.plan([nan](const VectorX<double>& q) { return q[0] == 0 ? nan : 0.5; });
  CHECK(path.status == JointPathStatus::InvalidInput);
  CHECK(path.message == "the clearance is nan at (0, 0)");
  // Far from it, where only the trees come.
  path = task.plan(
      [nan](const VectorX<double>& q) { return q[1] > 0.42 ? nan : disc_in_the_middle(q); });
  CHECK(path.status == JointPathStatus::InvalidInput);
  CHECK(path.message.starts_with("the clearance is nan at ("));
  CHECK(path.positions.empty());
  const auto broken = [nan](const VectorX<double>& q) { return q[0] == 0 ? nan : 0.5; };
  CHECK(!is_path_free<double>({task.from, task.to}, task.reach, broken, 1e-3, 1e-3));
}

TEST_CASE("robots of no and of one joint have paths", "[joint_path_planner]") {
  const VectorX<double> none;
  JointPath<double> path =
      plan_joint_path(none, none, none, none, none, [](const VectorX<double>&) { return 1.0; });
  CHECK(path.status == JointPathStatus::Found);
  CHECK(path.positions.size() == 2);
  path = plan_joint_path(none, none, none, none, none, [](const VectorX<double>&) { return -1.0; });
  CHECK(path.status == JointPathStatus::StartCollides);

  const auto one = [](double x) { return VectorX<double>(VectorX<double>::Constant(1, x)); };
  const auto post = [](const VectorX<double>& q) { return std::abs(q[0] - 0.5) - 0.1; };
  path = plan_joint_path(one(0), one(0.3), one(-1), one(1), one(1), post);
  CHECK(path.status == JointPathStatus::Found);
  CHECK(path.positions.size() == 2);
  JointPathSettings<double> settings;
  settings.max_iterations = 100;
  path = plan_joint_path(one(0), one(1), one(-1), one(1), one(1), post, settings);
  CHECK(path.status == JointPathStatus::NotFound);
  CHECK(path.iterations == 100);
}

TEST_CASE("bad sizes, numbers and settings are refused with a message", "[joint_path_planner]") {
  const PointTask task;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [&task](auto change) {
    PointTask changed = task;
    JointPathSettings<double> settings;
    change(changed, settings);
    const JointPath<double> path = changed.plan(disc_in_the_middle, settings);
    CHECK(path.status == JointPathStatus::InvalidInput);
    CHECK(path.queries == 0);
    CHECK(path.positions.empty());
    return path.message;
  };
  using Settings = JointPathSettings<double>;
  CHECK(refused([](PointTask& t, Settings&) { t.reach.resize(3); }) ==
        "reach: expected 2 values as in from, found 3");
  CHECK(refused([&](PointTask& t, Settings&) { t.to[1] = nan; }) == "joint 1: the goal is nan");
  CHECK(refused([](PointTask&, Settings& s) { s.step = 0; }) ==
        "step is 0 m, expected a positive number");
  CHECK(refused([&](PointTask&, Settings& s) { s.margin = nan; }) ==
        "margin is nan m, expected a positive number");
  CHECK(refused([](PointTask&, Settings& s) { s.resolution = -1; }) ==
        "resolution is -1 m, expected at least 1e-6");
  CHECK(refused([](PointTask&, Settings& s) { s.resolution = 0.25; }) ==
        "resolution is 0.25 m, expected at most twice the margin 0.001 m");
  CHECK(refused([](PointTask&, Settings& s) { s.max_iterations = -1; }) ==
        "max_iterations is -1, expected at least 0");
  CHECK(refused([](PointTask&, Settings& s) { s.shortcuts = -2; }) ==
        "shortcuts is -2, expected at least 0");
}

TEST_CASE("is_path_free looks at every motion and at both ends", "[joint_path_planner]") {
  const PointTask task;
  const VectorX<double> above = vector(0, 0.9);
  const auto free = [&task](const std::vector<VectorX<double>>& positions) {
    return is_path_free(positions, task.reach, disc_in_the_middle, 1e-3, 1e-3);
  };
  CHECK(free({}));
  CHECK(free({task.from}));
  CHECK(!free({VectorX<double>::Zero(2)}));
  CHECK(free({task.from, above, task.to}));
  CHECK(!free({task.from, task.to}));
  CHECK(!free({task.from, above, task.to, task.from}));
  CHECK(!free({task.from, VectorX<double>::Zero(2)}));
}

TEST_CASE("paths are planned in float, too", "[joint_path_planner]") {
  VectorX<float> from(2), to(2);
  from << -0.8f, 0.0f;
  to << 0.8f, 0.0f;
  const VectorX<float> lower = VectorX<float>::Constant(2, -1.0f), upper = -lower, reach = upper;
  const auto disc = [](const VectorX<float>& q) { return q.norm() - 0.4f; };
  const JointPath<float> path = plan_joint_path(from, to, lower, upper, reach, disc);
  REQUIRE(path.status == JointPathStatus::Found);
  CHECK(path.positions.front() == from);
  CHECK(path.positions.back() == to);
  CHECK(is_path_free(path.positions, reach, disc, 1e-3f, 1e-3f));
}

TEST_CASE("statuses have names", "[joint_path_planner]") {
  CHECK(to_string(JointPathStatus::Found) == "found");
  CHECK(to_string(JointPathStatus::InvalidInput) == "invalid_input");
  CHECK(to_string(JointPathStatus::OutOfLimits) == "out_of_limits");
  CHECK(to_string(JointPathStatus::StartCollides) == "start_collides");
  CHECK(to_string(JointPathStatus::GoalCollides) == "goal_collides");
  CHECK(to_string(JointPathStatus::NotFound) == "not_found");
}
