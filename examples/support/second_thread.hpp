#pragma once

// A thread that helps the main one with blocks of work: an Executor of two threads.

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "clothctl/concepts/executor.hpp"

namespace program {

/// Runs blocks on the calling thread and on one more, which waits in between.
class SecondThread {
 public:
  SecondThread();
  ~SecondThread();
  SecondThread(const SecondThread&) = delete;
  SecondThread& operator=(const SecondThread&) = delete;

  /// Calls task(0) … task(count - 1).
  void for_each_block(int count, const clothctl::BlockTask& task);

 private:
  void help();
  void work(const clothctl::BlockTask& task, int count);

  std::mutex mutex_;
  std::condition_variable wake_, done_;
  const clothctl::BlockTask* task_ = nullptr;  // while there is work to join
  int count_ = 0;
  bool busy_ = false, ends_ = false;
  std::atomic<int> next_{0};
  std::thread thread_;
};

/// The second thread of the program, made at the first call.
SecondThread& second_thread();

}  // namespace program
