#pragma once

// The soft pads of a world: each with each sheet that it may touch. Their contacts are solved
// together after the sheets have made their step, with sheets, hands, bodies and moving obstacles
// as the sides of one problem (contact/contact_solver.hpp). Sides and their points are listed anew
// in every step: a side is there when it is touched, and a point of what carries pads is a contact.

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/contact/contact_solver.hpp"
#include "clothctl/contact/impulse_responses.hpp"
#include "clothctl/sim/detail/pad_carrier.hpp"
#include "clothctl/sim/detail/pad_supports.hpp"
#include "clothctl/sim/detail/world_parts.hpp"
#include "clothctl/sim/pad_contacts.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// All pads of a world.
template <RealScalar Scalar>
class WorldGrips {
 public:
  /// A pad: the number of the obstacle that carries it, or -1 - b for body b.
  struct Pad {
    int carrier;
    std::vector<PadSample<Scalar>> samples;
    PadSettings<Scalar> settings;
  };

  /// Adds a pad whose samples and settings are valid. Allocates.
  int add(Pad pad) {
    pads_.push_back(std::move(pad));
    told_.emplace_back();
    return pad_count() - 1;
  }
  int pad_count() const { return static_cast<int>(pads_.size()); }
  int carrier(int pad) const {
    assert(0 <= pad && pad < pad_count());
    return pads_[index(pad)].carrier;
  }
  /// Whether something carries a pad.
  bool carries(int carrier) const {
    return std::any_of(pads_.begin(), pads_.end(),
                       [&](const Pad& pad) { return pad.carrier == carrier; });
  }

  /// Makes what depends on all that was added. Allocates. Returns an empty string, or what is
  /// wrong.
  std::string prepare(WorldParts<Scalar>& parts);
  /// Begins a part of `dt` s, before anything moves. A pad on a hand or a body is expected to
  /// change its velocity as in the last part, unless someone has set it since: what it would do
  /// without contacts, as a finger that presses, is not what it will do.
  void begin_part(const WorldParts<Scalar>& parts, const Scalar& dt) {
    for (std::size_t i = 0; i < pads_.size(); ++i) {
      const int c = pads_[i].carrier;
      const RigidMotion<Scalar> now = motion(parts, c);
      expected_[i] = now;
      const bool pushed =
          c < 0 ? Scalar(0) < parts.bodies.mass(-1 - c) : 0 <= parts.obstacles[index(c)]->hand;
      if (pushed && Scalar(0) < last_dt_ && now.velocity == left_[i].velocity &&
          now.angular_velocity == left_[i].angular_velocity) {
        const Scalar ratio = dt / last_dt_;
        expected_[i].velocity += ratio * (now.velocity - before_[i].velocity);
        expected_[i].angular_velocity +=
            ratio * (now.angular_velocity - before_[i].angular_velocity);
      }
      before_[i] = now;
    }
    ratio_ = Scalar(0) < last_dt_ ? Scalar(dt / last_dt_) : Scalar(1);
    last_dt_ = dt;
  }
  /// Ends a part, after all has moved.
  void end_part(const WorldParts<Scalar>& parts) {
    for (std::size_t i = 0; i < pads_.size(); ++i) left_[i] = motion(parts, pads_[i].carrier);
  }
  /// Finds the contacts of a sheet (finder up to date) with all pads. False: a motion is not valid.
  bool find(WorldParts<Scalar>& parts, int sheet);
  /// Tells a sheet what pads are likely to do in the step that it is about to make: what they did
  /// in the last one. After `find`.
  void expect(WorldParts<Scalar>& parts, int sheet);
  /// Finds what pads hold of a sheet in a part of `dt` s, after `find`.
  void find_patches(WorldParts<Scalar>& parts, int sheet, const Scalar& dt);
  /// Begins a step, of one or more parts: impulses are summed over them.
  void begin() {
    for (Touch& t : touches_) {
      for (Vector3<Scalar>& sum : t.impulse) sum.setConstant(Scalar(0));
    }
  }
  /// Finds impulses within a part of `dt` s and gives them to all sides.
  ContactReport<Scalar> solve(WorldParts<Scalar>& parts, const Scalar& dt);

  /// The contacts of a pad in the last solve.
  std::span<const PadContact<Scalar>> contacts(int pad) const {
    assert(0 <= pad && pad < pad_count());
    return told_[index(pad)];
  }
  /// Whether pads touch a sheet.
  bool touches(int sheet) const { return !touched_[index(sheet)].empty(); }
  /// Adds what a sheet's obstacles exerted in the last solve to its contacts.
  void add_supports(int sheet, std::vector<ObstacleContact<Scalar>>& contacts) const {
    supports_.add_to(sheet, contacts);
  }
  void save() {
    saved_before_ = before_;
    saved_left_ = left_;
    saved_dt_ = last_dt_;
    for (Touch& t : touches_) t.contacts.save();
    supports_.save();
  }
  void restore() {
    before_ = saved_before_;
    left_ = saved_left_;
    last_dt_ = saved_dt_;
    for (Touch& t : touches_) t.contacts.restore();
    supports_.restore();
  }

 private:
  /// A pad with a sheet.
  struct Touch {
    int pad, sheet;
    PadContacts<Scalar> contacts;
    std::vector<Vector3<Scalar>> impulse;  // of each sample in the step so far
  };
  using Carrier = PadCarrier<Scalar>;

  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  /// Returns the place in sides_ of what carries a pad; adds it if it is not there.
  std::size_t find_side(const WorldParts<Scalar>& parts, int carrier);
  Carrier& side_of(const Touch& t) { return sides_[side_of_pad_[index(t.pad)]]; }
  static RigidMotion<Scalar> motion(const WorldParts<Scalar>& parts, int carrier) {
    return Carrier::motion(parts, carrier);
  }
  /// Lists the vertices of a sheet that pads touch, and those of supports.
  const std::vector<int>& list_touched(const WorldParts<Scalar>& parts, int sheet);
  /// Lists contacts, and the points of what carries pads.
  void list_contacts(WorldParts<Scalar>& parts);
  /// Lists the sides that are touched, and names them in the contacts. Returns false where one
  /// refuses.
  bool list_sides(WorldParts<Scalar>& parts);
  /// Takes what impulses changed in the sides.
  void take(WorldParts<Scalar>& parts, const Scalar& dt);
  void tell();

  std::vector<Pad> pads_;
  std::vector<Touch> touches_;
  std::vector<Carrier> sides_;
  std::vector<std::size_t> side_of_pad_;
  std::vector<std::vector<int>> touched_;  // vertices of each sheet
  std::vector<int> sheet_place_, side_place_;
  std::vector<ImpulseResponseRef<Scalar>> list_;
  std::vector<ContactSample<Scalar>> contacts_;
  std::vector<GripContact<Scalar>> closed_;
  /// Motion of each pad: at the start of the part before, at its end, and as expected in this one.
  std::vector<RigidMotion<Scalar>> before_, left_, expected_, saved_before_, saved_left_;
  Scalar last_dt_ = Scalar(0), saved_dt_ = Scalar(0), ratio_ = Scalar(1);
  /// Impulses that a sheet expects at vertices.
  std::vector<int> expected_vertices_;
  Points<Scalar> expected_impulses_;
  std::vector<std::vector<PadContact<Scalar>>> told_;
  PadSupports<Scalar> supports_;
  ContactSolver<Scalar> solver_;
};

template <RealScalar Scalar>
std::size_t WorldGrips<Scalar>::find_side(const WorldParts<Scalar>& parts, int carrier) {
  const int hand = carrier < 0 ? -1 : parts.obstacles[index(carrier)]->hand;
  const auto same = [&](const Carrier& side) {
    return side.hand == hand && (hand >= 0 || side.carrier == carrier);
  };
  const auto found = std::find_if(sides_.begin(), sides_.end(), same);
  if (found != sides_.end()) return static_cast<std::size_t>(found - sides_.begin());
  sides_.push_back(Carrier::make(parts, hand, carrier));
  return sides_.size() - 1;
}

template <RealScalar Scalar>
std::string WorldGrips<Scalar>::prepare(WorldParts<Scalar>& parts) {
  touches_.clear();
  sides_.clear();
  side_of_pad_.clear();
  touched_.assign(parts.sheets.size(), {});
  std::size_t most = 0;
  for (int pad = 0; pad < pad_count(); ++pad) {
    const Pad& p = pads_[index(pad)];
    told_[index(pad)].reserve(p.samples.size() * parts.sheets.size());
    side_of_pad_.push_back(find_side(parts, p.carrier));
    for (std::size_t s = 0; s < parts.sheets.size(); ++s) {
      const WorldSheet<Scalar>& sheet = *parts.sheets[s];
      if (!parts.meet(s, p.carrier)) continue;
      Result<PadContacts<Scalar>> made = PadContacts<Scalar>::create(
          p.samples, sheet.mesh.triangles, sheet.finder, 0, 0, p.settings);
      if (!made) return "pad " + std::to_string(pad) + ": " + made.error();
      touches_.push_back({pad, static_cast<int>(s), std::move(made).value(),
                          std::vector<Vector3<Scalar>>(p.samples.size())});
      touched_[s].reserve(touched_[s].capacity() + 3 * p.samples.size());
      most += p.samples.size();
    }
  }
  for (std::size_t s = 0; s < parts.sheets.size(); ++s) {
    const std::size_t room = touched_[s].capacity();
    if (room == 0) continue;
    parts.sheets[s]->grip.reserve(room, parts.sheets[s]->mesh.vertex_count());
    const std::string bad = parts.sheets[s]->reserve_touched(static_cast<Index>(room));
    if (!bad.empty()) return "sheet " + std::to_string(s) + ": " + bad;
  }
  // The vertices under the samples, each on a table and, at its edge, on one more side of it.
  const std::size_t supports = PadSupports<Scalar>::occur(parts) ? 6 * most : 0;
  supports_.clear();
  supports_.reserve(supports);
  const std::size_t expected = 3 * (most + supports);
  expected_vertices_.reserve(expected);
  expected_impulses_ = Points<Scalar>::Constant(3, static_cast<Index>(expected), Scalar(0));
  contacts_.reserve(most + supports);
  closed_.reserve(most);
  for (auto* list : {&before_, &left_, &expected_, &saved_before_, &saved_left_})
    list->assign(pads_.size(), {});
  last_dt_ = Scalar(0);
  list_.reserve(parts.sheets.size() + sides_.size());
  sheet_place_.assign(parts.sheets.size(), -1);
  side_place_.assign(sides_.size(), -1);
  for (Carrier& side : sides_) side.reserve(parts, most);
  if (most > 0) solver_.reserve(static_cast<Index>(most + supports), static_cast<Index>(3 * most));
  return {};
}

template <RealScalar Scalar>
bool WorldGrips<Scalar>::find(WorldParts<Scalar>& parts, int sheet) {
  for (Touch& t : touches_) {
    if (t.sheet != sheet) continue;
    const RigidMotion<Scalar> now = motion(parts, carrier(t.pad));
    if (t.contacts.update(now, parts.sheets[index(sheet)]->finder) != QueryStatus::Answered)
      return false;
  }
  return true;
}

template <RealScalar Scalar>
void WorldGrips<Scalar>::expect(WorldParts<Scalar>& parts, int sheet) {
  expected_vertices_.clear();
  const auto add = [&](int vertex, const Scalar& share, const Vector3<Scalar>& impulse) {
    expected_impulses_.col(static_cast<Index>(expected_vertices_.size())) = share * impulse;
    expected_vertices_.push_back(vertex);
  };
  for (Touch& t : touches_) {
    if (t.sheet != sheet) continue;
    for (const ContactSample<Scalar>& c : t.contacts.contacts()) {
      for (Index k = 0; k < 3; ++k)
        add(c.a.point[static_cast<std::size_t>(k)], ratio_ * c.a.weight[k], c.impulse);
    }
  }
  if (!expected_vertices_.empty()) {
    const std::vector<int>& touched = list_touched(parts, sheet);
    supports_.for_each_last(sheet, [&](int v, const Vector3<Scalar>& impulse) {
      if (std::find(touched.begin(), touched.end(), v) != touched.end()) add(v, ratio_, impulse);
    });
  }
  const Index count = static_cast<Index>(expected_vertices_.size());
  parts.sheets[index(sheet)]->expect(expected_vertices_, expected_impulses_.leftCols(count));
}

template <RealScalar Scalar>
void WorldGrips<Scalar>::find_patches(WorldParts<Scalar>& parts, int sheet, const Scalar& dt) {
  WorldSheet<Scalar>& there = *parts.sheets[index(sheet)];
  if (there.neighbours() == nullptr) return;
  closed_.clear();
  for (Touch& t : touches_) {
    if (t.sheet != sheet) continue;
    const RigidMotion<Scalar>& pad = expected_[index(t.pad)];
    for (const ContactSample<Scalar>& c : t.contacts.contacts()) {
      if (!closes(c, there.state, motion(parts, carrier(t.pad)), dt)) continue;
      closed_.push_back({c.a.point, c.state == ContactState::Stick, c.normal.dot(c.impulse),
                         pad.velocity - pad.angular_velocity.cross(pad.position),
                         pad.angular_velocity, c.normal});
    }
  }
  const auto has = [](const std::vector<int>& list, int v) {
    return std::find(list.begin(), list.end(), v) != list.end();
  };
  const auto prescribed = [&](int v) {
    return has(there.mesh.pinned, v) || has(there.input.driven_vertices, v);
  };
  // The other links of a hand move with its pads.
  const auto counts = [&](int k) { return k < 0 || parts.obstacles[index(k)]->hand < 0; };
  there.grip.find(closed_, *there.neighbours(), prescribed,
                  [&](int v) { return there.lies(v, counts); });
}

template <RealScalar Scalar>
const std::vector<int>& WorldGrips<Scalar>::list_touched(const WorldParts<Scalar>& parts,
                                                         int sheet) {
  std::vector<int>& list = touched_[index(sheet)];
  list.clear();
  for (const Touch& t : touches_) {
    if (t.sheet == sheet) t.contacts.add_touched(list);
  }
  if (!list.empty()) supports_.add_vertices(parts, sheet, last_dt_, list);
  return list;
}

template <RealScalar Scalar>
void WorldGrips<Scalar>::list_contacts(WorldParts<Scalar>& parts) {
  contacts_.clear();
  for (std::size_t s = 0; s < touched_.size(); ++s) (void)list_touched(parts, static_cast<int>(s));
  for (Carrier& side : sides_) {
    side.count = 0;
    side.frames.clear();
  }
  for (Touch& t : touches_) {
    Carrier& side = side_of(t);
    const std::span<ContactSample<Scalar>> now = t.contacts.contacts();
    for (std::size_t k = 0; k < now.size(); ++k) {
      const int point = static_cast<int>(side.count++);
      side.points.col(point) = t.contacts.places().col(static_cast<Index>(t.contacts.sample(k)));
      if (side.hand >= 0) side.frames.push_back(parts.obstacles[index(carrier(t.pad))]->frame);
      contacts_.push_back(now[k]);
      contacts_.back().b.point = {point, -1, -1};
    }
  }
}

template <RealScalar Scalar>
bool WorldGrips<Scalar>::list_sides(WorldParts<Scalar>& parts) {
  list_.clear();
  for (std::size_t s = 0; s < touched_.size(); ++s) {
    sheet_place_[s] = static_cast<int>(list_.size());
    if (touched_[s].empty()) continue;
    WorldSheet<Scalar>& sheet = *parts.sheets[s];
    if (sheet.attach(touched_[s]) != StepStatus::Converged) return false;
    list_.push_back(sheet.side());
  }
  for (std::size_t k = 0; k < sides_.size(); ++k) {
    side_place_[k] = static_cast<int>(list_.size());
    if (sides_[k].count == 0) continue;
    if (!sides_[k].attach(parts)) return false;
    list_.push_back(sides_[k].side(parts));
  }
  std::size_t next = 0;
  for (const Touch& t : touches_) {
    const WorldSheet<Scalar>& sheet = *parts.sheets[index(t.sheet)];
    for (std::size_t k = 0; k < t.contacts.contact_count(); ++k) {
      ContactSample<Scalar>& c = contacts_[next++];
      c.a.side = sheet_place_[index(t.sheet)];
      c.b.side = side_place_[side_of_pad_[index(t.pad)]];
      for (int& point : c.a.point) point = sheet.point(point);
    }
  }
  return true;
}

template <RealScalar Scalar>
void WorldGrips<Scalar>::take(WorldParts<Scalar>& parts, const Scalar& dt) {
  for (const Carrier& side : sides_) {
    if (side.hand >= 0 && side.count > 0) parts.hands[index(side.hand)]->take_side();
  }
  std::size_t next = 0;
  for (Touch& t : touches_) {
    const Carrier& side = side_of(t);
    const std::span<ContactSample<Scalar>> kept = t.contacts.contacts();
    for (std::size_t k = 0; k < kept.size(); ++k) {
      const ContactSample<Scalar>& c = contacts_[next++];
      t.impulse[t.contacts.sample(k)] += c.impulse;
      kept[k].impulse = c.impulse;
      kept[k].offset = c.offset;
      kept[k].state = c.state;
      if (!side.rigid) continue;
      const Vector3<Scalar> back = Scalar(-1) * c.impulse;
      (void)parts.bodies.apply_impulse(-1 - side.carrier, back, side.points.col(c.b.point[0]));
    }
    t.contacts.keep();
  }
  supports_.take(std::span<const ContactSample<Scalar>>(contacts_).subspan(next));
  for (std::size_t s = 0; s < touched_.size(); ++s) {
    if (touched_[s].empty()) continue;
    parts.sheets[s]->take_side(dt);
  }
}

template <RealScalar Scalar>
void WorldGrips<Scalar>::tell() {
  for (std::vector<PadContact<Scalar>>& list : told_) list.clear();
  for (Touch& t : touches_) {
    const std::span<ContactSample<Scalar>> now = t.contacts.contacts();
    for (std::size_t k = 0; k < now.size(); ++k) {
      const std::size_t sample = t.contacts.sample(k);
      PadContact<Scalar> c;
      c.sheet = t.sheet;
      c.sample = static_cast<int>(sample);
      c.vertex = t.contacts.vertices(k);
      c.weight = now[k].a.weight;
      c.place = t.contacts.places().col(static_cast<Index>(sample));
      c.normal = now[k].normal;
      c.impulse = t.impulse[sample];
      c.state = now[k].state;
      c.offset = now[k].offset;
      c.slid = t.contacts.slid(sample);
      told_[index(t.pad)].push_back(c);
    }
  }
}

template <RealScalar Scalar>
ContactReport<Scalar> WorldGrips<Scalar>::solve(WorldParts<Scalar>& parts, const Scalar& dt) {
  ContactReport<Scalar> report;
  list_contacts(parts);
  if (!contacts_.empty()) {
    report.status = ContactStatus::InvalidInput;
    if (!list_sides(parts)) return report;
    supports_.begin();
    for (std::size_t s = 0; s < touched_.size(); ++s) {
      if (!touched_[s].empty())
        supports_.add(parts, static_cast<int>(s), sheet_place_[s], dt, ratio_, contacts_);
    }
    const std::span<const ImpulseResponseRef<Scalar>> sides(list_);
    report = solver_.solve(contacts_, dt, sides);
    const bool found =
        report.status == ContactStatus::Solved || report.status == ContactStatus::NotConverged;
    if (!found) return report;
    const ContactStatus applied = solver_.apply(contacts_, sides);
    if (applied != ContactStatus::Solved) {
      report.status = applied;
      return report;
    }
    take(parts, dt);
  } else {
    supports_.clear();
  }
  tell();
  return report;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
