#pragma once

// Whether an assert stops a call. Where asserts are compiled out, or processes cannot be forked,
// the answer is not known.

#if !defined(NDEBUG) && (defined(__unix__) || defined(__APPLE__)) && !defined(__EMSCRIPTEN__)
#define CLOTHCTL_TEST_SEES_ASSERTS 1
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#endif

namespace clothctl_test {

/// What became of a call.
enum class Fate { Returned, Stopped, Unknown };

/// Makes the call in a process of its own and tells whether it was stopped by an assert.
template <class Call>
Fate fate_of([[maybe_unused]] Call&& call) {
#ifdef CLOTHCTL_TEST_SEES_ASSERTS
  const pid_t child = fork();
  if (child < 0) return Fate::Unknown;
  if (child == 0) {
    std::signal(SIGABRT, SIG_DFL);
    close(STDOUT_FILENO);
    close(STDERR_FILENO);
    call();
    _exit(0);
  }
  int status = 0;
  if (waitpid(child, &status, 0) != child) return Fate::Unknown;
  return WIFSIGNALED(status) && WTERMSIG(status) == SIGABRT ? Fate::Stopped : Fate::Returned;
#else
  return Fate::Unknown;
#endif
}

/// True where the call is stopped by an assert, or where that cannot be known.
template <class Call>
bool is_stopped(Call&& call) {
  return fate_of(call) != Fate::Returned;
}

/// True where the call returns, or where that cannot be known.
template <class Call>
bool is_let_through(Call&& call) {
  return fate_of(call) != Fate::Stopped;
}

}  // namespace clothctl_test
