#pragma once

// What lies under a pad: the contacts of the vertices that pads touch with obstacles that rest or
// move on their own, as a table that a fingertip presses the sheet to. Models of sheets hold such
// contacts by soft springs, made for what a vertex weighs; a finger presses with a thousand times
// as much. So they join the problem of the pads as nearly rigid contacts, on top of these springs.

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <span>
#include <vector>

#include "clothctl/contact/contact_solver.hpp"
#include "clothctl/contact/obstacle_contacts.hpp"
#include "clothctl/sim/detail/world_parts.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Whether an obstacle of a sheet's list rests, or moves on its own.
template <RealScalar Scalar>
bool bears_load(const WorldParts<Scalar>& parts, const WorldSheet<Scalar>& sheet, int obstacle) {
  const int number = sheet.obstacle_number[static_cast<std::size_t>(obstacle)];
  return 0 <= number && parts.obstacles[static_cast<std::size_t>(number)]->hand < 0;
}

/// The contacts of sheets with obstacles under pads, and what they did in the last solve.
template <RealScalar Scalar>
class PadSupports {
 public:
  /// Compliance, m/N: 1 N presses 1 µm deep.
  static constexpr double kCompliance = 1e-6;
  /// Depth below the thickness from which a contact counts as one that fingers press, m.
  static constexpr double kDeep = 1e-4;

  /// Whether a sheet of a world may touch an obstacle that bears a load.
  static bool occur(const WorldParts<Scalar>& parts) {
    for (const auto& sheet : parts.sheets) {
      for (std::size_t k = 0; k < sheet->obstacles.size(); ++k) {
        if (bears_load(parts, *sheet, static_cast<int>(k))) return true;
      }
    }
    return false;
  }
  /// Makes room for `count` contacts. Allocates.
  void reserve(std::size_t count) {
    for (auto* list : {&now_, &last_, &saved_}) list->reserve(count);
  }
  /// Forgets all.
  void clear() {
    now_.clear();
    last_.clear();
  }
  void save() { saved_ = last_; }
  void restore() { last_ = saved_; }

  /// Calls add(vertex, impulse) for what the last solve exerted on vertices of a sheet, N s.
  template <class Add>
  void for_each_last(int sheet, Add add) const {
    for (const Support& s : last_) {
      if (s.sheet != sheet || s.state == ContactState::Open) continue;
      for (std::size_t k = 0; k < 3 && 0 <= s.vertex[k]; ++k)
        add(s.vertex[k], Vector3<Scalar>(s.weight[static_cast<Index>(k)] * s.impulse));
    }
  }

  /// Adds what the last solve exerted to the contacts of a sheet, which are those that it was made
  /// with.
  void add_to(int sheet, std::vector<ObstacleContact<Scalar>>& contacts) const {
    for (const Support& s : last_) {
      if (s.sheet != sheet || s.state == ContactState::Open) continue;
      assert(s.place < contacts.size());
      contacts[s.place].impulse += s.impulse;
      contacts[s.place].state = s.state;
    }
  }

  /// Adds the vertices of a sheet that pads do not touch, but that count: those of the last solve,
  /// and those that an obstacle which bears a load has let in by more than `kDeep` at the end of
  /// the step of `dt` s, as far as it is known: what fingers push together would dent a table that
  /// is made for what vertices weigh. The list does not grow beyond its capacity.
  void add_vertices(const WorldParts<Scalar>& parts, int sheet, const Scalar& dt,
                    std::vector<int>& touched) const {
    const auto add = [&](const std::array<int, 3>& vertex) {
      for (const int v : vertex) {
        if (v < 0 || touched.size() == touched.capacity()) return;
        if (std::find(touched.begin(), touched.end(), v) == touched.end()) touched.push_back(v);
      }
    };
    for (const Support& s : last_) {
      if (s.sheet == sheet && s.state != ContactState::Open) add(s.vertex);
    }
    const WorldSheet<Scalar>& there = *parts.sheets[static_cast<std::size_t>(sheet)];
    for (const ObstacleContact<Scalar>& c : there.contacts.contacts()) {
      if (there.gap_after(c, dt) < Scalar(-kDeep) && bears_load(parts, there, c.obstacle))
        add(c.point.vertex);
    }
  }

  /// Begins the list of a solve.
  void begin() { now_.clear(); }
  /// Adds the contacts of a sheet, of a step of `dt` s, whose vertices are all points of side
  /// `place`: `point(vertex)` returns which, or a negative number. `counts(obstacle)` says which
  /// obstacles count. Contacts get the impulses of the last solve, times `ratio`, as a guess.
  template <class Point, class Counts>
  void add(int sheet, int place, const ObstacleContacts<Scalar>& from, const Scalar& dt,
           const Scalar& ratio, Point point, Counts counts,
           std::vector<ContactSample<Scalar>>& contacts) {
    const std::span<const ObstacleContact<Scalar>> list = from.contacts();
    for (std::size_t i = 0; i < list.size(); ++i) {
      const ObstacleContact<Scalar>& c = list[i];
      if (now_.size() == now_.capacity()) return;
      const SurfacePoint<Scalar>& there = c.point.surface;
      ContactSample<Scalar> sample;
      bool touched = counts(c.obstacle);
      for (std::size_t k = 0; touched && k < 3 && 0 <= c.point.vertex[k]; ++k) {
        sample.a.point[k] = point(c.point.vertex[k]);
        touched = 0 <= sample.a.point[k];
      }
      if (!touched) continue;
      sample.a.side = place;
      sample.a.weight = c.point.weight;
      sample.normal = there.normal;
      sample.friction = there.friction;
      sample.drift = there.velocity;
      sample.gap = there.distance + c.point.slack - from.settings().thickness;
      const Scalar deepest = Scalar(0) - from.settings().push_out_speed * dt;
      if (sample.gap < deepest) sample.gap = deepest;
      sample.compliance = sample.tangential_compliance = Scalar(kCompliance);
      Support support{sheet,          c.obstacle,        i, c.point.vertex, c.point.weight,
                      sample.impulse, ContactState::Open};
      const auto same = [&](const Support& s) {
        return s.sheet == sheet && s.obstacle == support.obstacle && s.vertex == support.vertex;
      };
      const auto known = std::find_if(last_.begin(), last_.end(), same);
      if (known != last_.end()) sample.impulse = ratio * known->impulse;
      now_.push_back(support);
      contacts.push_back(sample);
    }
  }
  /// Adds those of a sheet of a world, which has been attached as side `place`.
  void add(const WorldParts<Scalar>& parts, int sheet, int place, const Scalar& dt,
           const Scalar& ratio, std::vector<ContactSample<Scalar>>& contacts) {
    const WorldSheet<Scalar>& there = *parts.sheets[static_cast<std::size_t>(sheet)];
    const auto counts = [&](int obstacle) { return bears_load(parts, there, obstacle); };
    add(
        sheet, place, there.contacts, dt, ratio, [&](int v) { return there.point(v); }, counts,
        contacts);
  }
  /// Takes what a solve found for the contacts that were added, in their order.
  void take(std::span<const ContactSample<Scalar>> contacts) {
    for (std::size_t i = 0; i < now_.size(); ++i) {
      now_[i].impulse = contacts[i].impulse;
      now_[i].state = contacts[i].state;
    }
    std::swap(now_, last_);
  }

 private:
  struct Support {
    int sheet, obstacle;
    std::size_t place;  // in the sheet's list of contacts
    std::array<int, 3> vertex;
    Vector3<Scalar> weight, impulse;
    ContactState state;
  };

  std::vector<Support> now_, last_, saved_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
