#include "clothctl/core/result.hpp"

#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "support/catch.hpp"

#if __has_include(<sys/wait.h>)
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#endif

using namespace clothctl;

namespace {

Result<int> halve(int value) {
  if (value % 2 != 0) return Error{"value " + std::to_string(value) + " is odd"};
  return value / 2;
}

}  // namespace

TEST_CASE("a result holds a value or an error message", "[result]") {
  const Result<int> good = halve(8);
  REQUIRE(good.has_value());
  CHECK(good);
  CHECK(good.value() == 4);
  CHECK(*good == 4);

  const Result<int> bad = halve(7);
  CHECK_FALSE(bad.has_value());
  CHECK_FALSE(bad);
  CHECK(bad.error() == "value 7 is odd");
}

TEST_CASE("values can be changed and moved out", "[result]") {
  Result<std::vector<int>> list(std::vector<int>{1, 2, 3});
  list->push_back(4);
  (*list)[0] = 9;
  CHECK(list.value() == std::vector<int>{9, 2, 3, 4});
  const std::vector<int> taken = std::move(list).value();
  CHECK(taken.size() == 4);

  Result<std::unique_ptr<int>> unique(std::make_unique<int>(5));
  const std::unique_ptr<int> owner = std::move(unique).value();
  CHECK(*owner == 5);
}

TEST_CASE("a result of strings distinguishes values and errors", "[result]") {
  const Result<std::string> value(std::string("fine"));
  const Result<std::string> error(Error{"not fine"});
  CHECK(value.has_value());
  CHECK(*value == "fine");
  CHECK_FALSE(error.has_value());
  CHECK(error.error() == "not fine");
}

#if __has_include(<sys/wait.h>)
TEST_CASE("taking the value of an error ends the program, in every build", "[result]") {
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    (void)std::signal(SIGABRT, SIG_DFL);
    (void)close(2);  // where assertions are on, they print
    _exit(halve(7).value());
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  REQUIRE(WIFSIGNALED(status));
  CHECK(WTERMSIG(status) == SIGABRT);
}
#endif

// A result only converts to bool explicitly: `int n = result;` and adding results must not compile.
static_assert(!std::is_convertible_v<Result<int>, bool> &&
              std::is_constructible_v<bool, Result<int>>);
static_assert(!std::is_convertible_v<Result<int>, int>);
static_assert(!std::is_default_constructible_v<Result<int>>);
