// A foreign job system satisfies Executor by a trait alone.

#include "clothctl/concepts/executor.hpp"

#include <functional>
#include <thread>
#include <vector>

#include "laws/executor_laws.hpp"
#include "support/catch.hpp"
#include "support/thread_executor.hpp"

namespace other_engine {

// Jobs are queued, then run by two threads; `wait` returns when all are done.
class JobSystem {
 public:
  void push(std::function<void()> job) { jobs_.push_back(std::move(job)); }
  void wait() {
    const auto run = [this](std::size_t first) {
      for (std::size_t i = first; i < jobs_.size(); i += 2) jobs_[i]();
    };
    std::thread helper(run, std::size_t{1});
    run(0);
    helper.join();
    jobs_.clear();
  }

 private:
  std::vector<std::function<void()>> jobs_;
};

}  // namespace other_engine

namespace clothctl {

template <>
struct executor_traits<other_engine::JobSystem> {
  static void for_each_block(other_engine::JobSystem& system, int count, const BlockTask& task) {
    for (int i = 0; i < count; ++i) system.push([task, i] { task(i); });
    system.wait();
  }
};

}  // namespace clothctl

using namespace clothctl;

static_assert(Executor<other_engine::JobSystem>);

TEST_CASE("a foreign job system is an executor", "[concepts]") {
  other_engine::JobSystem system;
  clothctl_test::check_executor_laws(system);
}

TEST_CASE("executors of the tests obey the laws", "[concepts]") {
  for (const int threads : {1, 2, 4}) {
    clothctl_test::ThreadExecutor team{threads};
    clothctl_test::check_executor_laws(team);
  }
  clothctl_test::BackwardExecutor backward;
  clothctl_test::check_executor_laws(backward);
}

TEST_CASE("without an executor the blocks run in order on the caller", "[concepts]") {
  std::vector<int> order;
  ExecutorRef().for_each_block(4, [&](int block) { order.push_back(block); });
  CHECK(order == std::vector<int>{0, 1, 2, 3});
}
