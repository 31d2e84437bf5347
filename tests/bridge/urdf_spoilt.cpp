// Damaged URDF: bytes, tags and numbers are removed, repeated, exchanged and replaced. Each text
// must either give a tree that can be moved or be refused with one line that names file and line.

#include <cstddef>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "bridge/urdf_text.hpp"
#include "clothctl/bridge/urdf.hpp"
#include "clothctl/robot/forward_dynamics.hpp"
#include "clothctl/robot/forward_kinematics.hpp"
#include "io/spoilt_text.hpp"
#include "support/catch.hpp"
#include "support/shared_data.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl;
using namespace clothctl_test;

namespace {

struct Counts {
  int read = 0, refused = 0, moved = 0;
};

/// Reads a text. Moves the tree, or checks the error message.
template <class S>
void judge(const std::string& text, Counts& counts) {
  const Result<UrdfModel<S>> model = parse_urdf<S>(text, "f.urdf");
  if (!model) {
    ++counts.refused;
    check_refusal(model.error(), "f.urdf", text);
    return;
  }
  ++counts.read;
  for (const std::string& warning : model->warnings) check_refusal(warning, "f.urdf", text);
  const KinematicTree<S>& tree = model->tree;
  const VectorX<S> q = tree.neutral(), zero = VectorX<S>::Constant(tree.nv(), S(0));
  if (!all_finite(q) || !all_finite(model->damping)) FAIL("a tree that is not finite: " + text);
  BodyPoses<S> body_poses(tree);
  forward_kinematics<S>(tree, q, body_poses);
  ForwardDynamicsWorkspace<S> work(tree);
  VectorX<S> qdd(tree.nv());
  const Vector3<S> gravity(S(0), S(0), S(-9.81));
  const DynamicsReport report =
      forward_dynamics<S>(tree, body_poses, zero, zero, model->damping, gravity, work, qdd);
  if (report.status != DynamicsStatus::Solved) return;
  ++counts.moved;
  if (!all_finite(qdd)) FAIL("accelerations that are not finite: " + text);
}

/// Begin and end of the tags in a text.
std::vector<std::pair<std::size_t, std::size_t>> tags_of(const std::string& text) {
  std::vector<std::pair<std::size_t, std::size_t>> tags;
  for (std::size_t place = text.find('<'); place != std::string::npos;
       place = text.find('<', place + 1)) {
    const std::size_t end = text.find('>', place);
    if (end == std::string::npos) break;
    tags.emplace_back(place, end + 1);
  }
  return tags;
}

/// Begin and end of the attribute values in a text.
std::vector<std::pair<std::size_t, std::size_t>> values_of(const std::string& text) {
  std::vector<std::pair<std::size_t, std::size_t>> values;
  for (std::size_t place = text.find("=\""); place != std::string::npos;
       place = text.find("=\"", place + 1)) {
    const std::size_t end = text.find('"', place + 2);
    if (end == std::string::npos) break;
    values.emplace_back(place + 2, end);
  }
  return values;
}

/// Damages a text in one place, like a mistake while editing.
std::string edited(const std::string& text, std::mt19937& engine) {
  static const std::vector<std::string> words = {"",         "x",      "${x}",  "world", "bend",
                                                 "lift",     "mount",  "fixed", "curl",  "floating",
                                                 "revolute", "planar", "wheel", "tip"};
  static const std::vector<std::string> numbers = {"nan",   "1e999",
                                                   "",      "-inf",
                                                   "0",     "-1",
                                                   "1e308", "1e-320",
                                                   "1e30",  "0.25",
                                                   "3",     "-0.5",
                                                   "1e-6",  "-1e-9",
                                                   "1e12",  "1e5",
                                                   "0 0 0", "1 2 3",
                                                   "0 0",   "2",
                                                   "0.01",  "1e200 1e200 1e200"};
  const auto pick = [&engine](std::size_t size) {
    return static_cast<std::size_t>(engine()) % size;
  };
  const auto tags = tags_of(text), values = values_of(text);
  const auto [begin, end] = tags[pick(tags.size())];
  const std::string tag = text.substr(begin, end - begin);
  switch (engine() % 10) {
    case 0: return text.substr(0, begin) + text.substr(end);
    case 1: return text.substr(0, end) + tag + text.substr(end);
    case 2: {
      const auto& other = tags[pick(tags.size())];
      if (other.first < end) return text;
      return text.substr(0, begin) + text.substr(other.first, other.second - other.first) +
             text.substr(end, other.first - end) + tag + text.substr(other.second);
    }
    default: {
      const auto& value = values[pick(values.size())];
      const bool numeric = text.find_first_of("0123456789-", value.first) == value.first;
      std::string now = numeric ? numbers[pick(numbers.size())] : words[pick(words.size())];
      if (engine() % 4 == 0) {
        const auto& other = values[pick(values.size())];
        now = text.substr(other.first, other.second - other.first);
      }
      return text.substr(0, value.first) + now + text.substr(value.second);
    }
  }
}

/// Damages a text in `trials` ways, in one or two places: half of them by bytes, half by elements.
void campaign(const std::string& text, unsigned seed, int trials, Counts& counts) {
  const std::string bytes = "<>/=\"' \n\t0123456789.-+e&;#!?[]xabc\xef\xbb\xbf";
  for_each_spoilt(text, bytes, seed, trials / 2,
                  [&counts](const std::string& spoilt) { judge<double>(spoilt, counts); });
  std::mt19937 engine(seed + 1);
  for (int trial = 0; trial < trials - trials / 2; ++trial) {
    std::string spoilt = edited(text, engine);
    for (auto more = engine() % 2; more > 0; --more) {
      if (!tags_of(spoilt).empty() && !values_of(spoilt).empty()) spoilt = edited(spoilt, engine);
    }
    if (trial % 8 == 0) {
      judge<float>(spoilt, counts);
    } else {
      judge<double>(spoilt, counts);
    }
  }
}

}  // namespace

TEST_CASE("URDF: damaged files are read or refused without crashing", "[urdf]") {
  Counts counts;
  campaign(full_robot(), 5, trials(1600, 80000), counts);
  INFO(counts.read << " read, of these " << counts.moved << " moved; " << counts.refused
                   << " refused");
  CHECK(counts.read > 200);
  CHECK(counts.moved > 200);
  CHECK(counts.refused > 500);
  for (const char* name : {"hand34", "leap_hand_right"}) {
    const std::string path = shared_path(std::string("data/models/") + name + ".urdf");
    if (path.empty()) {
      WARN("no shared model " << name << ": not spoilt");
      continue;
    }
    const Result<std::string> text = read_file(path);
    REQUIRE(text.has_value());
    campaign(*text, 6, trials(200, 10000), counts);
  }
}
