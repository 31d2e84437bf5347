#pragma once

// The contacts of a sheet with a soft pad, as that of a fingertip. A pad has samples: points p_i on
// its undeformed surface with outward normals n_i, which move with the pad's body. Each sample is a
// contact of its own (ContactSample) with its share of the pad's stiffness. It remembers the
// material point x_i = Σ w_k x_k of the sheet that it touches, a triangle and weights w.
//
// - Open: the line from p_i along n_i meets the sheet at the height g with |g| <= reach; of several
//   layers, at the least height. w is from there, and s_i = 0.
// - Sticking: triangle and weights stay. From the places at the start of the step,
//   g = n_i·(x_i - p_i) and s_i is the part of x_i - p_i across the normal.
// - Sliding: the sheet has moved on. w is where the line from p_i + s_i along n_i meets it, s_i
//   being what the solver left at the limit of friction, in the frame of the pad.
// - Lost: the gap is above `release`, or the line does not meet the sheet. It is open again.
//
// The impulse acts at x_i on both sides, so that a pad and a sheet that turn together do not load
// the spring, and moments balance. A contact without memory creeps under load, with several
// millimetres a second, and the more the smaller the step.

#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/collision/sheet_contacts.hpp"
#include "clothctl/contact/contact_solver.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A point of a pad's surface, in the frame of the pad's body.
template <RealScalar Scalar>
struct PadSample {
  /// The point, m.
  Vector3<Scalar> position = Vector3<Scalar>::Constant(Scalar(0));
  /// Outward unit normal.
  Vector3<Scalar> normal = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1));
};

/// A contact of a pad with a sheet, to be read.
template <RealScalar Scalar>
struct PadContact {
  /// The sheet, and the sample of the pad.
  int sheet = 0, sample = 0;
  /// The triangle of the sheet that is touched.
  std::array<int, 3> vertex{-1, -1, -1};
  /// The weights of its corners.
  Vector3<Scalar> weight = Vector3<Scalar>(Scalar(1), Scalar(0), Scalar(0));
  /// Where it is touched at the start of the step, m (world).
  Vector3<Scalar> place = Vector3<Scalar>::Constant(Scalar(0));
  /// The pad's unit normal.
  Vector3<Scalar> normal = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1));
  /// The impulse on the sheet in the whole step, N s.
  Vector3<Scalar> impulse = Vector3<Scalar>::Constant(Scalar(0));
  /// What it did in the step.
  ContactState state = ContactState::Open;
  /// The way of the sheet on the pad from where it stuck at the end of the step, m: the shear of
  /// the pad.
  Vector3<Scalar> offset = Vector3<Scalar>::Constant(Scalar(0));
  /// How far it has slid since it closed, m.
  Scalar slid = Scalar(0);
};

/// What a pad is made of, and when it touches.
template <RealScalar Scalar>
struct PadSettings {
  /// Stiffness of the whole pad along the normal and across it, N/m. That of a fingertip's pulp is
  /// about 2000.
  Scalar stiffness = Scalar(2000), tangential_stiffness = Scalar(2000);
  /// Damping of the whole pad, N s/m.
  Scalar damping = Scalar(1);
  /// Friction coefficient.
  Scalar friction = Scalar(0.6);
  /// Largest gap, and largest overlap, at which a sample becomes a contact, m. A pad that moves
  /// further than this in a step may pass through the sheet.
  Scalar reach = Scalar(0.005);
  /// Largest gap of a contact that keeps its memory, m.
  Scalar release = Scalar(0.002);

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    const std::pair<const char*, Scalar> positive[] = {
        {"stiffness", stiffness}, {"tangential stiffness", tangential_stiffness}, {"reach", reach}};
    for (const auto& [name, value] : positive) {
      if (!is_finite(value) || !(Scalar(0) < value) || is_unbounded(value))
        return std::string("the ") + name + " " + number_text(value) +
               ", must be finite and positive" + detail::unbounded_text(value);
    }
    const std::pair<const char*, Scalar> others[] = {
        {"damping", damping}, {"friction coefficient", friction}, {"release", release}};
    for (const auto& [name, value] : others) {
      if (!is_finite(value) || value < Scalar(0) || is_unbounded(value))
        return std::string("the ") + name + " " + number_text(value) +
               ", must be finite and not negative" + detail::unbounded_text(value);
    }
    return {};
  }
};

/// Returns an empty string, or what is wrong with the samples of a pad: the end of a message that
/// begins with "the pad has".
template <RealScalar Scalar>
std::string validate_pad_samples(std::span<const PadSample<Scalar>> samples) {
  using std::abs;
  using std::sqrt;
  if (samples.empty()) return "no samples";
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const std::string name = "in sample " + std::to_string(i) + " ";
    std::string bad = detail::validate_point("position", samples[i].position);
    if (bad.empty()) bad = detail::validate_point("normal", samples[i].normal);
    if (!bad.empty()) return name + bad;
    const Scalar square = samples[i].normal.squaredNorm();
    if (Scalar(1e-4) < abs(square - Scalar(1)))
      return name + "a normal of length " + number_text(Scalar(sqrt(square))) + ", must be 1";
  }
  return {};
}

/// Finds and remembers the contacts of one sheet with one pad. `create` allocates all memory.
template <RealScalar Scalar>
class PadContacts {
 public:
  /// Makes the contacts of a pad with the sheet of `finder`, which has these `triangles`. `sheet`
  /// and `pad` are the numbers of the sides in the calls of the solver; -1 as `pad` is the resting
  /// world. Allocates. Fails when: there are no samples, a number of a sample is not finite, a
  /// normal is not of length one, the triangles are not those of the finder, a setting is wrong, or
  /// a side has another negative number.
  static Result<PadContacts> create(std::vector<PadSample<Scalar>> samples,
                                    std::vector<std::array<int, 3>> triangles,
                                    const SheetContactFinder<Scalar>& finder, int sheet, int pad,
                                    const PadSettings<Scalar>& settings = {});

  /// Moves the pad to its place at the start of a step, and finds the contacts with the sheet where
  /// the finder has it. Never allocates. InvalidArgument: the motion is not valid, or the finder is
  /// of another sheet; nothing changes then.
  [[nodiscard]] QueryStatus update(const RigidMotion<Scalar>& motion,
                                   SheetContactFinder<Scalar>& finder);

  /// The points of the pad's side (3×samples, m, world), in the order of the samples: where the
  /// sheet is touched, or the sample where it is not.
  const Points<Scalar>& places() const { return places_; }
  /// The contacts of this step, for the solver, with vertices of the sheet as points: `number`
  /// makes them points of its side.
  std::span<ContactSample<Scalar>> contacts() { return {active_.data(), active_.size()}; }
  /// Adds the vertices that the contacts touch to a list, those that it has not yet. Never
  /// allocates where the list has room for 3 vertices a sample.
  void add_touched(std::vector<int>& vertices) const;
  /// Names the points of the sheet's side: `point(vertex)` returns the number of a vertex.
  template <class F>
  void number(F point) {
    for (std::size_t i = 0; i < active_.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k)
        active_[i].a.point[k] = point(memory_[sample_[i]].triangle[k]);
    }
  }
  /// Keeps what the solver wrote to the contacts. Call it after each solve.
  void keep();
  /// Keeps what it remembers now, for `restore`. Never allocates.
  void save() { saved_ = memory_; }
  /// Goes back to what `save` kept; the contacts are those of the next `update`. Never allocates.
  void restore() {
    memory_ = saved_;
    active_.clear();
    sample_.clear();
  }
  /// The vertices that contact k touches.
  const std::array<int, 3>& vertices(std::size_t k) const { return memory_[sample_[k]].triangle; }
  /// The sample that contact k is of.
  std::size_t sample(std::size_t k) const { return sample_[k]; }
  /// Number of contacts of this step.
  std::size_t contact_count() const { return active_.size(); }

  /// Returns the way that the sheet has slid under sample i since it closed, m.
  Scalar slid(std::size_t i) const { return memory_[i].slid; }
  /// Returns whether sample i touches or nearly touches the sheet.
  bool touches(std::size_t i) const { return memory_[i].triangle[0] >= 0; }

 private:
  struct Memory {
    std::array<int, 3> triangle{-1, -1, -1};
    Vector3<Scalar> weight = Vector3<Scalar>::Constant(Scalar(0));
    Vector3<Scalar> offset = Vector3<Scalar>::Constant(Scalar(0));  // after the solve, pad's frame
    Scalar gap = Scalar(0);
    Vector3<Scalar> impulse = Vector3<Scalar>::Constant(Scalar(0));
    ContactState state = ContactState::Open;
    Scalar slid = Scalar(0);
  };

  PadContacts(std::vector<PadSample<Scalar>> samples, std::vector<std::array<int, 3>> triangles,
              const SheetContactFinder<Scalar>& finder, int sheet, int pad,
              const PadSettings<Scalar>& settings);

  static Vector3<Scalar> point_of(const Memory& memory, const PointsView<Scalar>& x) {
    Vector3<Scalar> out = Vector3<Scalar>::Constant(Scalar(0));
    for (std::size_t k = 0; k < 3; ++k)
      out += memory.weight[static_cast<Index>(k)] * x.col(memory.triangle[k]);
    return out;
  }
  /// Sets triangle and weights to where the line through `from` along `normal` meets the sheet at
  /// most `reach` away; of several heights the one nearest to `wanted`. Returns false where it does
  /// not.
  bool cast(const Vector3<Scalar>& from, const Vector3<Scalar>& normal, const Scalar& wanted,
            SheetContactFinder<Scalar>& finder, Memory& memory);
  /// The weights and the height at which the line meets a triangle; false where it does not.
  static bool meets(const Vector3<Scalar>& from, const Vector3<Scalar>& normal,
                    const Matrix3<Scalar>& corners, Vector3<Scalar>& weight, Scalar& height);
  /// Brings the memory of a sample at `place` up to date.
  void refresh(std::size_t i, const Vector3<Scalar>& place, const Vector3<Scalar>& normal,
               SheetContactFinder<Scalar>& finder);
  /// Makes the contact of a sample that touches.
  void add_contact(std::size_t i, const Vector3<Scalar>& place, const Vector3<Scalar>& normal,
                   const Points<Scalar>& x);

  std::vector<PadSample<Scalar>> samples_;
  std::vector<std::array<int, 3>> triangles_;
  PadSettings<Scalar> settings_;
  Index vertices_;
  int sheet_, pad_;
  Matrix3<Scalar> R_world_pad_ = Matrix3<Scalar>::Identity();
  std::vector<Memory> memory_, saved_;
  Points<Scalar> places_;
  std::vector<ContactSample<Scalar>> active_;
  std::vector<std::size_t> sample_;  // of each contact
  SheetOverlap overlap_;
};

template <RealScalar Scalar>
auto PadContacts<Scalar>::create(std::vector<PadSample<Scalar>> samples,
                                 std::vector<std::array<int, 3>> triangles,
                                 const SheetContactFinder<Scalar>& finder, int sheet, int pad,
                                 const PadSettings<Scalar>& settings) -> Result<PadContacts> {
  if (const std::string bad = validate_pad_samples<Scalar>(samples); !bad.empty())
    return Error{"the pad has " + bad};
  if (static_cast<Index>(triangles.size()) != finder.triangle_count())
    return Error{"the pad gets " + std::to_string(triangles.size()) +
                 " triangles, its finder has " + std::to_string(finder.triangle_count())};
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    for (const int v : triangles[t]) {
      if (v < 0 || v >= finder.positions().cols())
        return Error{"triangle " + std::to_string(t) + " holds vertex " + std::to_string(v) +
                     " off the sheet of the finder"};
    }
  }
  if (const std::string bad = settings.validate(); !bad.empty()) return Error{"the pad has " + bad};
  if (sheet < 0 || pad < -1) return Error{"the pad has a side with a negative number"};
  return PadContacts(std::move(samples), std::move(triangles), finder, sheet, pad, settings);
}

template <RealScalar Scalar>
PadContacts<Scalar>::PadContacts(std::vector<PadSample<Scalar>> samples,
                                 std::vector<std::array<int, 3>> triangles,
                                 const SheetContactFinder<Scalar>& finder, int sheet, int pad,
                                 const PadSettings<Scalar>& settings)
    : samples_(std::move(samples)),
      triangles_(std::move(triangles)),
      settings_(settings),
      vertices_(finder.positions().cols()),
      sheet_(sheet),
      pad_(pad),
      memory_(samples_.size()),
      saved_(samples_.size()),
      places_(Points<Scalar>::Constant(3, static_cast<Index>(samples_.size()), Scalar(0))),
      overlap_(finder.make_overlap()) {
  active_.reserve(samples_.size());
  sample_.reserve(samples_.size());
}

template <RealScalar Scalar>
bool PadContacts<Scalar>::meets(const Vector3<Scalar>& from, const Vector3<Scalar>& normal,
                                const Matrix3<Scalar>& corners, Vector3<Scalar>& weight,
                                Scalar& height) {
  // Cramer's rule for from + height normal = a + u (b - a) + v (c - a).
  const Vector3<Scalar> ab = corners.col(1) - corners.col(0), ac = corners.col(2) - corners.col(0);
  const Vector3<Scalar> way = from - corners.col(0), across = normal.cross(ac);
  const Scalar det = ab.dot(across);
  if (!(Scalar(0) < det) && !(det < Scalar(0))) return false;
  const Vector3<Scalar> lifted = way.cross(ab);
  const Scalar u = way.dot(across) / det, v = normal.dot(lifted) / det;
  const Scalar slack = Scalar(-64) * scalar_traits<Scalar>::epsilon();  // no gaps between triangles
  if (!(slack <= u && slack <= v && u + v <= Scalar(1) - slack)) return false;
  height = ac.dot(lifted) / det;
  weight = Vector3<Scalar>(Scalar(1) - u - v, u, v);
  return is_finite(height);
}

template <RealScalar Scalar>
bool PadContacts<Scalar>::cast(const Vector3<Scalar>& from, const Vector3<Scalar>& normal,
                               const Scalar& wanted, SheetContactFinder<Scalar>& finder,
                               Memory& memory) {
  using std::abs;
  BoundingBox<Scalar> box{from, from};
  box.include(Vector3<Scalar>(from + settings_.reach * normal));
  box.include(Vector3<Scalar>(from - settings_.reach * normal));
  finder.overlaps(box, overlap_);
  Scalar least = scalar_traits<Scalar>::infinity();
  bool found = false;
  for (const int t : overlap_.triangles) {
    const std::array<int, 3>& corner = triangles_[static_cast<std::size_t>(t)];
    Matrix3<Scalar> corners;
    for (std::size_t k = 0; k < 3; ++k)
      corners.col(static_cast<Index>(k)) = finder.positions().col(corner[k]);
    Vector3<Scalar> weight;
    Scalar height;
    if (!meets(from, normal, corners, weight, height) || settings_.reach < abs(height)) continue;
    if (found && !(abs(height - wanted) < least)) continue;
    least = abs(height - wanted);
    memory.triangle = corner;
    memory.weight = weight;
    found = true;
  }
  return found;
}

template <RealScalar Scalar>
void PadContacts<Scalar>::refresh(std::size_t i, const Vector3<Scalar>& place,
                                  const Vector3<Scalar>& normal,
                                  SheetContactFinder<Scalar>& finder) {
  using std::sqrt;
  Memory& memory = memory_[i];
  if (touches(i) && memory.state == ContactState::Slip) {
    const Vector3<Scalar> before = point_of(memory, finder.positions());
    const Vector3<Scalar> offset = R_world_pad_ * memory.offset;
    const Vector3<Scalar> from = place + offset - normal.dot(offset) * normal;
    if (cast(from, normal, memory.gap, finder, memory)) {
      const Vector3<Scalar> way = point_of(memory, finder.positions()) - before;
      memory.slid += sqrt(way.squaredNorm());
    } else {
      memory.state = ContactState::Open;
    }
  }
  if (touches(i) && memory.state != ContactState::Open) {
    memory.gap = normal.dot(point_of(memory, finder.positions()) - place);
    if (!(settings_.release < memory.gap)) return;
  }
  memory = Memory();
  // The least height: of several layers, the one that the pad meets first.
  if (cast(place, normal, -settings_.reach, finder, memory))
    memory.gap = normal.dot(point_of(memory, finder.positions()) - place);
}

template <RealScalar Scalar>
void PadContacts<Scalar>::add_contact(std::size_t i, const Vector3<Scalar>& place,
                                      const Vector3<Scalar>& normal, const Points<Scalar>& x) {
  const Memory& memory = memory_[i];
  const Scalar count = Scalar(static_cast<double>(samples_.size()));
  const Vector3<Scalar> at = point_of(memory, x), way = at - place;
  places_.col(static_cast<Index>(i)) = at;
  ContactSample<Scalar> contact;
  contact.a.side = sheet_;
  contact.a.point = memory.triangle;
  contact.a.weight = memory.weight;
  contact.b.side = pad_;
  contact.b.point = {static_cast<int>(i), -1, -1};
  contact.normal = normal;
  contact.friction = settings_.friction;
  contact.gap = memory.gap;
  contact.compliance = count / settings_.stiffness;
  contact.tangential_compliance = count / settings_.tangential_stiffness;
  contact.damping = settings_.damping / count;
  if (memory.state != ContactState::Open) contact.offset = way - normal.dot(way) * normal;
  contact.impulse = memory.impulse;
  contact.state = memory.state;
  active_.push_back(contact);
  sample_.push_back(i);
}

template <RealScalar Scalar>
QueryStatus PadContacts<Scalar>::update(const RigidMotion<Scalar>& motion,
                                        SheetContactFinder<Scalar>& finder) {
  const bool same = finder.positions().cols() == vertices_ &&
                    finder.triangle_count() == static_cast<Index>(triangles_.size());
  if (!same || !motion.validate().empty()) return QueryStatus::InvalidArgument;
  R_world_pad_ = motion.R_world_body;
  active_.clear();
  sample_.clear();
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    const Vector3<Scalar> place = motion.position + R_world_pad_ * samples_[i].position;
    const Vector3<Scalar> normal = R_world_pad_ * samples_[i].normal;
    places_.col(static_cast<Index>(i)) = place;
    refresh(i, place, normal, finder);
    if (touches(i)) add_contact(i, place, normal, finder.positions());
  }
  return QueryStatus::Answered;
}

template <RealScalar Scalar>
void PadContacts<Scalar>::add_touched(std::vector<int>& vertices) const {
  for (const std::size_t i : sample_) {
    for (const int v : memory_[i].triangle) {
      bool listed = false;
      for (const int other : vertices) listed = listed || other == v;
      if (!listed) vertices.push_back(v);
    }
  }
}

template <RealScalar Scalar>
void PadContacts<Scalar>::keep() {
  for (std::size_t k = 0; k < active_.size(); ++k) {
    Memory& memory = memory_[sample_[k]];
    memory.offset = R_world_pad_.transpose() * active_[k].offset;
    memory.impulse = active_[k].impulse;
    memory.state = active_[k].state;
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI
