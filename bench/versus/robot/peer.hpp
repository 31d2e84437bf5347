#pragma once

// The interface to every robot library of the comparison. It consists of names and arrays of
// numbers, so that libraries compiled with other processor flags (and other memory layouts of
// Eigen) can take part. All adapters but our own are modules that the program opens.

#include <string>
#include <vector>

namespace versus {

/// The timed tasks. World axes; Jacobians and twists have linear rows first; gravity is (0, 0,
/// -9.81) m/s².
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

/// A robot of n coordinates, one for each joint. Joints and links are in the order of our tree.
struct Model {
  std::string file;
  std::vector<std::string> joints, links;
  /// For libraries that merge links: the joint that moves each link, or -1, and the link's pose (12
  /// numbers) in a frame that moves with that joint, or in the world.
  std::vector<int> movers;
  std::vector<double> placements;
  /// The links that are tips.
  std::vector<int> tips;
  std::vector<double> lower, upper;

  int n() const { return static_cast<int>(joints.size()); }
};

/// The inputs of a task, n numbers each.
struct Sample {
  std::vector<double> q, qd, qdd, torques, diagonal;
};

/// Largest allowed error of each tip (m).
inline constexpr double kReachTolerance = 1e-3;

/// Targets of tips, with a start and with other starts for failed attempts.
struct Reach {
  /// Three numbers for each tip (m, world).
  std::vector<double> targets;
  std::vector<double> start;
  /// Numbers u in [0, 1), n for each other start: q = lower + u (upper - lower).
  std::vector<double> uniforms;
};

/// A library with a robot.
class Peer {
 public:
  virtual ~Peer() = default;
  /// Loads a robot. Returns "" or the reason for a failure.
  virtual std::string load(const Model& model) = 0;
  /// Returns whether the library has a function for the task.
  virtual bool offers(Task task) const = 0;
  /// Converts samples to the library's order and storage; not timed.
  virtual void prepare(Task task, const std::vector<Sample>& samples) = 0;
  /// Computes a task for a prepared sample, and leaves the answer in the library's storage; timed.
  virtual void run(Task task, int sample) = 0;
  /// Converts the answer; not timed.
  virtual void read(Task task, double* out) = 0;

  /// Returns whether the library has inverse kinematics for several tips.
  virtual bool reaches() const { return false; }
  /// Converts the input; not timed.
  virtual void prepare(const Reach&) {}
  /// Solves; timed. Returns false if the library reports a failure.
  virtual bool reach() { return false; }
  /// Returns the positions; not timed.
  virtual void read(double*) {}
};

/// A library of the comparison.
struct Entry {
  std::string name, version;
  Peer* (*make)();
};

}  // namespace versus

/// The function that a module exports.
#define VERSUS_MODULE(name, version, type)                                                      \
  extern "C" __attribute__((visibility("default"))) void versus_entry(versus::Entry* entry) {   \
    *entry = versus::Entry{name, version, [] { return static_cast<versus::Peer*>(new type); }}; \
  }
