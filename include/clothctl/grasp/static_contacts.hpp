#pragma once

// Which vertices of a sheet a finger segment holds, from step to step. A vertex that sticks to a
// segment is a static contact of it: what a planner of contact forces may move. Contacts come and
// go for single steps, at the rim of a fingertip above all, and each change of a set costs a
// planner its warm start. So a vertex joins after it has stuck for some steps on end, and leaves
// after it has not stuck for some.
//
// When a vertex joins, its place in the frame of the segment is kept: the point that rectification
// brings to where the plan wants the vertex (rectify.hpp).
//
// Reference: [Bai 2016], section 4.1.1 (static contacts).

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/result.hpp"
#include "clothctl/sim/contact_summary.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// When vertices join and leave (StaticContacts).
struct StaticContactSettings {
  /// Steps on end that a vertex sticks before it joins.
  int join_after = 2;
  /// Steps on end that it does not stick before it leaves.
  int leave_after = 4;

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    if (join_after < 1)
      return "join_after is " + std::to_string(join_after) + ", expected 1 or more";
    if (leave_after < 1)
      return "leave_after is " + std::to_string(leave_after) + ", expected 1 or more";
    return {};
  }
};

/// The vertices of one sheet that each of several segments of hands holds.
template <RealScalar Scalar>
class StaticContacts {
 public:
  /// A vertex that a segment holds.
  struct Held {
    /// The vertex.
    int vertex;
    /// Its place in the frame of the segment when it joined, m.
    Vector3<Scalar> local;
    /// Steps that it has not stuck for.
    int missed;
  };

  /// Watches the obstacles `segments` of a world (numbers of shapes on links) on sheet `sheet`.
  /// Allocates. Fails when: the world has no such sheet, a segment is no obstacle of it or occurs
  /// twice, or `settings.validate()` does.
  static Result<StaticContacts> create(const World<Scalar>& world, int sheet,
                                       std::vector<int> segments,
                                       const StaticContactSettings& settings = {});

  /// Takes what stuck in the world's last step. Call it once after each step. Never allocates.
  /// Complexity: contacts, times the vertices that segments hold.
  void update(const World<Scalar>& world);
  /// Forgets all: after a jump.
  void clear() {
    for (Segment& s : segments_) {
      s.held.clear();
      s.stuck.clear();
    }
    changed_ = true;
  }

  /// Number of segments.
  int segment_count() const { return static_cast<int>(segments_.size()); }
  /// The obstacle that segment i is.
  int obstacle(int i) const { return segment(i).obstacle; }
  /// The vertices that segment i holds, ascending.
  std::span<const Held> held(int i) const { return segment(i).held; }
  /// Whether the last update changed which vertices are held.
  bool changed() const { return changed_; }

 private:
  /// A vertex that sticks, but not for long enough.
  struct Stuck {
    int vertex, steps;
    bool now;
  };
  struct Segment {
    int obstacle;
    std::vector<Held> held;
    std::vector<Stuck> stuck;
  };

  StaticContacts(int sheet, std::size_t room, std::vector<Segment> segments,
                 const StaticContactSettings& settings)
      : settings_(settings), sheet_(sheet), segments_(std::move(segments)) {
    sticking_.reserve(room);
  }

  const Segment& segment(int i) const {
    assert(0 <= i && i < segment_count());
    return segments_[static_cast<std::size_t>(i)];
  }
  /// Notes that a vertex sticks.
  static void note(Segment& s, int vertex);
  /// Ends an update of a segment.
  void settle(const World<Scalar>& world, Segment& s);

  StaticContactSettings settings_;
  int sheet_;
  std::vector<Segment> segments_;
  std::vector<int> sticking_;
  bool changed_ = false;
};

template <RealScalar Scalar>
auto StaticContacts<Scalar>::create(const World<Scalar>& world, int sheet,
                                    std::vector<int> segments,
                                    const StaticContactSettings& settings)
    -> Result<StaticContacts> {
  if (const std::string bad = settings.validate(); !bad.empty()) return Error{bad};
  if (sheet < 0 || sheet >= world.sheet_count())
    return Error{"there is no sheet " + std::to_string(sheet)};
  const std::size_t room = static_cast<std::size_t>(world.state(sheet).positions.cols());
  std::vector<Segment> list;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const std::string name = "segment " + std::to_string(i);
    if (segments[i] < 0 || segments[i] >= world.obstacle_count())
      return Error{name + ": there is no obstacle " + std::to_string(segments[i])};
    for (std::size_t j = 0; j < i; ++j) {
      if (segments[j] == segments[i])
        return Error{name + " is obstacle " + std::to_string(segments[i]) + ", as segment " +
                     std::to_string(j) + " is"};
    }
    Segment s{segments[i], {}, {}};
    s.held.reserve(room);
    s.stuck.reserve(room);
    list.push_back(std::move(s));
  }
  return StaticContacts(sheet, room, std::move(list), settings);
}

template <RealScalar Scalar>
void StaticContacts<Scalar>::note(Segment& s, int vertex) {
  const auto is = [vertex](const auto& item) { return item.vertex == vertex; };
  if (const auto found = std::find_if(s.held.begin(), s.held.end(), is); found != s.held.end()) {
    found->missed = -1;  // it sticks now
    return;
  }
  const auto found = std::find_if(s.stuck.begin(), s.stuck.end(), is);
  if (found == s.stuck.end()) {
    s.stuck.push_back({vertex, 1, true});
  } else if (!found->now) {
    ++found->steps;
    found->now = true;
  }
}

template <RealScalar Scalar>
void StaticContacts<Scalar>::settle(const World<Scalar>& world, Segment& s) {
  for (Held& h : s.held) ++h.missed;
  const auto left = [this](const Held& h) { return settings_.leave_after <= h.missed; };
  changed_ = 0 < std::erase_if(s.held, left) || changed_;
  std::erase_if(s.stuck, [](const Stuck& k) { return !k.now; });
  for (Stuck& k : s.stuck) k.now = false;
  const RigidMotion<Scalar>& frame = world.motion(s.obstacle);
  for (const Stuck& k : s.stuck) {
    if (k.steps < settings_.join_after) continue;
    const Vector3<Scalar> arm = world.state(sheet_).positions.col(k.vertex) - frame.position;
    const auto place = std::find_if(s.held.begin(), s.held.end(),
                                    [&](const Held& h) { return k.vertex < h.vertex; });
    s.held.insert(place, {k.vertex, frame.R_world_body.transpose() * arm, 0});
    changed_ = true;
  }
  std::erase_if(s.stuck, [this](const Stuck& k) { return settings_.join_after <= k.steps; });
}

template <RealScalar Scalar>
void StaticContacts<Scalar>::update(const World<Scalar>& world) {
  changed_ = false;
  for (Segment& s : segments_) {
    sticking_.clear();
    add_static_contacts(world, sheet_, s.obstacle, sticking_);
    for (const int v : sticking_) note(s, v);
    settle(world, s);
  }
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class StaticContacts<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
