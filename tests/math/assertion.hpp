#pragma once

// Finds out whether an assert stops a call. The answer is unknown if asserts are compiled out or
// processes cannot be forked.

#if !defined(NDEBUG) && (defined(__unix__) || defined(__APPLE__)) && !defined(__EMSCRIPTEN__)
#define CLOTHCTL_TEST_SEES_ASSERTS 1
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#endif

namespace clothctl_test {

/// The outcome of a call.
enum class Fate { Returned, Stopped, Unknown };

/// Makes the call in its own process and returns whether an assert stopped it.
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

/// True if an assert stops the call, or if that is unknown.
template <class Call>
bool is_stopped(Call&& call) {
  return fate_of(call) != Fate::Returned;
}

/// True if the call returns, or if that is unknown.
template <class Call>
bool is_let_through(Call&& call) {
  return fate_of(call) != Fate::Stopped;
}

}  // namespace clothctl_test
