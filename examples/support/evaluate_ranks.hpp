#pragma once

// The processes of `mpirun`, if the program was built with MPI and started by it; else one.

#include <functional>
#include <vector>

namespace program {

/// The processes that share an evaluation. They need no memory of each other: they divide a list of
/// runs once, and each writes its results itself.
class Ranks {
 public:
  /// Joins the other processes.
  Ranks(int* argc, char*** argv);
  ~Ranks();
  Ranks(const Ranks&) = delete;
  Ranks& operator=(const Ranks&) = delete;

  int rank() const { return rank_; }
  int count() const { return count_; }
  bool first() const { return rank_ == 0; }
  /// Runs `work` on the first process, then on the others, so that bad input is reported once.
  void first_alone(const std::function<void()>& work) const;
  /// Gives the list of the first process to all.
  void share(std::vector<int>& list) const;
  /// Waits for all.
  void wait() const;

 private:
  int rank_ = 0, count_ = 1;
};

}  // namespace program
