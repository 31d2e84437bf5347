#pragma once

// What every robot library of the comparison is seen through: names and arrays of numbers, so that
// a library compiled with other processor flags (and so other ideas of how Eigen lays out memory)
// can take part. All adapters but our own are modules that the program opens.

#include <string>
#include <vector>

namespace versus {

/// What is timed. World axes; Jacobians and twists are linear first; gravity is (0, 0, -9.81) m/s².
enum class Task {
  Poses,            ///< q → pose of every link: R by columns, p; 12 numbers a link
  Jacobian,         ///< q → Jacobian of the first tip's origin, 6 × n by columns
  InverseDynamics,  ///< q, q̇, q̈ → τ
  MassMatrix,       ///< q → M, n × n
  ForwardDynamics,  ///< q, q̇, τ → q̈
  DampedDynamics    ///< the same with d added to the mass matrix's diagonal
};

inline constexpr Task kTasks[] = {Task::Poses,      Task::Jacobian,        Task::InverseDynamics,
                                  Task::MassMatrix, Task::ForwardDynamics, Task::DampedDynamics};

/// A robot of n coordinates, one a joint. Orders of joints and links are those of our tree.
struct Model {
  std::string file;
  std::vector<std::string> joints, links;
  /// The joint that moves each link, or -1, and its pose in a frame that moves with that joint (or
  /// in the world; 12 numbers): for libraries that merge links.
  std::vector<int> movers;
  std::vector<double> placements;
  /// Links that are tips.
  std::vector<int> tips;
  std::vector<double> lower, upper;

  int n() const { return static_cast<int>(joints.size()); }
};

/// Inputs of a task, n numbers each.
struct Sample {
  std::vector<double> q, qd, qdd, torques, diagonal;
};

/// How near every tip is to come (m).
inline constexpr double kReachTolerance = 1e-3;

/// Tips to be brought to places from a start, and if that fails from other starts.
struct Reach {
  /// Three numbers a tip (m, world).
  std::vector<double> targets;
  std::vector<double> start;
  /// Numbers in [0, 1), n for each other start: q = lower + u (upper - lower).
  std::vector<double> uniforms;
};

/// A library with one robot.
class Peer {
 public:
  virtual ~Peer() = default;
  /// Loads a robot; "" or the reason why it cannot.
  virtual std::string load(const Model& model) = 0;
  /// Whether there is a function for the task.
  virtual bool offers(Task task) const = 0;
  /// Converts samples to its own order and storage; not timed.
  virtual void prepare(Task task, const std::vector<Sample>& samples) = 0;
  /// Does a task on a prepared sample and leaves the answer in its own storage; timed.
  virtual void run(Task task, int sample) = 0;
  /// Converts the answer; not timed.
  virtual void read(Task task, double* out) = 0;

  /// Whether it has inverse kinematics of many tips.
  virtual bool reaches() const { return false; }
  /// Converts; not timed.
  virtual void prepare(const Reach&) {}
  /// Solves; timed. False when it says that it failed.
  virtual bool reach() { return false; }
  /// Hands over the positions; not timed.
  virtual void read(double*) {}
};

/// A library of the comparison.
struct Entry {
  std::string name, version;
  Peer* (*make)();
};

}  // namespace versus

/// What a module of the comparison exports.
#define VERSUS_MODULE(name, version, type)                                                      \
  extern "C" __attribute__((visibility("default"))) void versus_entry(versus::Entry* entry) {   \
    *entry = versus::Entry{name, version, [] { return static_cast<versus::Peer*>(new type); }}; \
  }
