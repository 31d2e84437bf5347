// The order of sweeps without a limit of stretch.

#include "clothctl/cloth/detail/plain_sweeps.hpp"

#include <string>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

/// A sheet that records what is done to it: capitals read the multipliers of the sweep before, and
/// ">" follows what leaves them.
struct RecordingSheet {
  static constexpr int kLanes = 1;
  struct Scratch {
    std::string calls;
  };
  bool with_dampers = false;
  bool damped() const { return with_dampers; }

  template <bool kDamped, bool kRead, bool kWrite>
  void sweep(const CompliantRule<double, 1, kDamped, kRead, kWrite>&, SweepOrder,
             Scratch& memory) const {
    memory.calls += kDamped ? (kRead ? 'D' : 'd') : (kRead ? 'S' : 's');
    if (kWrite) memory.calls += '>';
  }
  void sweep(const RigidRule<double, 1>&, SweepOrder order, Scratch& memory) const {
    memory.calls += order == SweepOrder::Forward ? 'r' : '<';
  }
  template <bool kRead, bool kWrite>
  void bend(SweepOrder, Scratch& memory) const {
    memory.calls += kRead ? 'B' : 'b';
    if (kWrite) memory.calls += '>';
  }
};

std::string rigid(int sweeps) {
  RecordingSheet::Scratch memory;
  sweep_rigidly<double>(
      RecordingSheet{}, memory, sweeps, [&](SweepOrder) { memory.calls += 'e'; },
      [&] { memory.calls += 'a'; });
  return memory.calls;
}

std::string compliant(int sweeps, bool damped) {
  RecordingSheet::Scratch memory;
  sweep_compliantly<double>(
      RecordingSheet{damped}, memory, sweeps, [&](SweepOrder) { memory.calls += 'e'; },
      [&] { memory.calls += 'a'; });
  return memory.calls;
}

}  // namespace

TEST_CASE("rigid sweeps are all alike", "[cloth]") {
  CHECK(rigid(1) == "reba");
  CHECK(rigid(3) == "rebarebareba");
}

TEST_CASE("compliant sweeps alternate, and pass multipliers on from first to last", "[cloth]") {
  // The last of several runs forwards.
  CHECK(compliant(1, false) == "seba");
  CHECK(compliant(2, false) == "b>es>aSeBa");
  CHECK(compliant(3, false) == "s>eb>aB>eS>aSeBa");
  CHECK(compliant(2, true) == "b>ed>aDeBa");
}
