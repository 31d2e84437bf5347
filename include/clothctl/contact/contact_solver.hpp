#pragma once

// The contacts of a step between sides that answer to impulses (concept ImpulseResponse): sheets,
// fingers, rigid bodies, for tens of contacts, as those of a grip. Side s answers impulses p at its
// points by Δu = W_s p. With contact frames and weights in B_s, the relative velocities of the
// contacts are
//
//   u = D λ + b,     D = Σ_s B_s W_s B_sᵀ + compliance,     b = Σ_s B_s u_s + gaps and offsets
//
// (detail/delassus.hpp, detail/contact_sample.hpp), and the impulses λ obey Coulomb's law in the
// form of de Saxcé (detail/friction_problem.hpp). Newton's method on the equations of Alart and
// Curnier solves them, warm from the impulses of the last step (detail/friction_newton.hpp).
// Restitution is 0.

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include "clothctl/contact/detail/delassus.hpp"
#include "clothctl/contact/detail/friction_newton.hpp"
#include "clothctl/core/number_text.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a solve of contacts ended.
enum class ContactStatus {
  /// The residual is within the tolerances, or as small as rounding allows. Apply the impulses.
  Solved,
  /// The residual is not within the tolerances. The impulses are the best that were found; apply
  /// them if the residual is small enough for you, else take a smaller step, compliance, or fewer
  /// contacts on rigid bodies.
  NotConverged,
  /// A number of a contact, a side or the step is not finite or out of its range; the report may
  /// name a contact. Nothing was changed. Correct the input.
  InvalidInput,
  /// There are more contacts, or a side has more points, than the solver has room for; or a contact
  /// names a side or a point that does not exist. Nothing was changed. Call `reserve`, or correct
  /// the contact.
  WrongSize,
  /// A rigid contact joins two sides that no impulse moves there; the report names it. Nothing was
  /// changed. Give it compliance, or leave it out.
  Immovable
};

/// Returns the name of a status.
constexpr std::string_view to_string(ContactStatus status) {
  switch (status) {
    case ContactStatus::Solved: return "solved";
    case ContactStatus::NotConverged: return "not_converged";
    case ContactStatus::InvalidInput: return "invalid_input";
    case ContactStatus::WrongSize: return "wrong_size";
    case ContactStatus::Immovable: return "immovable";
  }
  return "unknown";
}

/// When the solver stops.
template <RealScalar Scalar>
struct ContactSolverSettings {
  /// Largest natural map of a solution, as a force, N.
  Scalar force_tolerance = Scalar(1e-9);
  /// Largest natural map of a solution, as a velocity, m/s.
  Scalar velocity_tolerance = Scalar(1e-9);
  /// Gauss–Seidel sweeps before Newton's method.
  int first_sweeps = 5;
  /// Newton steps of a round.
  int newton_steps = 30;
  /// Further rounds where the first does not converge; before round k there are k · `sweeps`
  /// sweeps.
  int rounds = 3;
  /// See `rounds`.
  int sweeps = 100;

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    if (!is_finite(force_tolerance) || !(Scalar(0) < force_tolerance))
      return "the force tolerance " + number_text(force_tolerance) + " N, must be positive";
    if (!is_finite(velocity_tolerance) || !(Scalar(0) < velocity_tolerance))
      return "the velocity tolerance " + number_text(velocity_tolerance) + " m/s, must be positive";
    for (const int count : {first_sweeps, newton_steps, rounds, sweeps}) {
      if (count < 0) return "the number " + std::to_string(count) + " of sweeps, steps or rounds";
    }
    return {};
  }
};

/// Result of a solve.
template <RealScalar Scalar>
struct ContactReport {
  /// How it ended.
  ContactStatus status = ContactStatus::Solved;
  /// Largest natural map of a contact, λ - P_K(λ - ρ û), as a force (N) and as a velocity (m/s),
  /// with ρ the inverse of the largest own mobility of the contact.
  Scalar force_residual = Scalar(0), velocity_residual = Scalar(0);
  /// Newton steps and Gauss–Seidel sweeps.
  int newton_steps = 0, sweeps = 0;
  /// Number of contacts in each state.
  int open = 0, stick = 0, slip = 0;
  /// The contact that InvalidInput, WrongSize or Immovable is about, -1 if none.
  Index contact = -1;
};

/// Solves the contacts between any number of sides.
template <RealScalar Scalar>
class ContactSolver {
 public:
  /// The settings.
  using Settings = ContactSolverSettings<Scalar>;
  /// The contacts of a step.
  using Contacts = std::span<ContactSample<Scalar>>;
  /// The sides; contact places name them by their place in this list.
  using Sides = std::span<const ImpulseResponseRef<Scalar>>;

  /// Keeps the settings. When the text of `settings.validate()` is not empty, every solve returns
  /// InvalidInput.
  explicit ContactSolver(const Settings& settings = {})
      : settings_(settings), valid_(settings.validate().empty()) {}

  /// Makes room for up to `contacts` contacts and sides of up to `points` points each. Allocates.
  void reserve(Index contacts, Index points);

  /// Finds the impulses of `contacts` in a step of `dt` (s), and writes `impulse`, `offset` and
  /// `state` of each. The sides are not changed: see `apply`. Starts from the `impulse` of each
  /// contact. Never allocates. Fails when: see ContactStatus. Complexity: with c contacts that are
  /// closed, O(c³) for each Newton step, one or two where little changed.
  [[nodiscard]] ContactReport<Scalar> solve(Contacts contacts, const Scalar& dt, Sides sides);
  /// The same, for sides in the order of the arguments.
  template <ImpulseResponse<Scalar>... Side>
  [[nodiscard]] ContactReport<Scalar> solve(Contacts contacts, const Scalar& dt, Side&... sides) {
    const std::array<ImpulseResponseRef<Scalar>, sizeof...(sides)> list{
        ImpulseResponseRef<Scalar>(sides)...};
    return solve(contacts, dt, Sides(list));
  }

  /// Changes the velocities of the sides by the impulses of `contacts`. Returns Solved, or
  /// InvalidInput or WrongSize when nothing was changed. Never allocates.
  [[nodiscard]] ContactStatus apply(std::span<const ContactSample<Scalar>> contacts, Sides sides);
  /// The same, for sides in the order of the arguments.
  template <ImpulseResponse<Scalar>... Side>
  [[nodiscard]] ContactStatus apply(std::span<const ContactSample<Scalar>> contacts,
                                    Side&... sides) {
    const std::array<ImpulseResponseRef<Scalar>, sizeof...(sides)> list{
        ImpulseResponseRef<Scalar>(sides)...};
    return apply(contacts, Sides(list));
  }

 private:
  using Sample = ContactSample<Scalar>;

  /// Returns Solved, or why the contacts and sides are refused, and which contact.
  ContactStatus refusal(std::span<const Sample> contacts, Sides sides, Index& contact) const;
  /// Returns Solved if a place is on a side that exists and its weights are finite.
  static ContactStatus refusal(const ContactPlace<Scalar>& place, Sides sides);
  /// Builds the problem. Returns false when a side's answer is not finite.
  bool build(std::span<const Sample> contacts, Sides sides, const Scalar& dt);
  /// Sums up the impulses p of the contacts on the points of a side.
  static void gather(std::span<const Sample> contacts, int side, Eigen::Ref<VectorX<Scalar>> p);
  /// Writes what was found to the contacts.
  void write(Contacts contacts, const Scalar& dt, ContactReport<Scalar>& report);

  Settings settings_;
  bool valid_;
  Index points_ = 0;
  Points<Scalar> frames_;
  MatrixX<Scalar> W_;
  VectorX<Scalar> u_;
  detail::FrictionProblem<Scalar> problem_;
  detail::FrictionNewton<Scalar> newton_;
};

template <RealScalar Scalar>
void ContactSolver<Scalar>::reserve(Index contacts, Index points) {
  points_ = points;
  frames_.setConstant(3, 3 * contacts, Scalar(0));
  W_.setConstant(3 * points, 3 * points, Scalar(0));
  u_.setConstant(3 * points, Scalar(0));
  problem_.reserve(contacts);
  newton_.reserve(contacts);
}

template <RealScalar Scalar>
ContactReport<Scalar> ContactSolver<Scalar>::solve(Contacts contacts, const Scalar& dt,
                                                   Sides sides) {
  ContactReport<Scalar> report;
  report.status = refusal(contacts, sides, report.contact);
  if (!valid_ || !is_finite(dt) || !(Scalar(0) < dt)) report.status = ContactStatus::InvalidInput;
  if (report.status != ContactStatus::Solved) return report;
  if (!build(contacts, sides, dt)) {
    report.status = ContactStatus::InvalidInput;
    return report;
  }
  report.contact = problem_.prepare();
  if (report.contact >= 0) {
    report.status = ContactStatus::Immovable;
    return report;
  }
  VectorX<Scalar>& lambda = newton_.impulses();
  for (Index i = 0; i < problem_.contacts(); ++i) {
    const Sample& contact = contacts[static_cast<std::size_t>(i)];
    const Matrix3<Scalar> F = frames_.template middleCols<3>(3 * i);
    const Vector3<Scalar> guess = F * contact.impulse;
    lambda.template segment<3>(3 * i) = detail::project_to_cone<Scalar>(guess, contact.friction);
  }
  const detail::FrictionLimits<Scalar> limits{dt * settings_.force_tolerance,
                                              settings_.velocity_tolerance,
                                              settings_.first_sweeps,
                                              settings_.newton_steps,
                                              settings_.rounds,
                                              settings_.sweeps};
  const detail::FrictionReport<Scalar> found = newton_.solve(problem_, limits);
  report.status = found.solved ? ContactStatus::Solved : ContactStatus::NotConverged;
  report.force_residual = found.residual.impulse / dt;
  report.velocity_residual = found.residual.velocity;
  report.newton_steps = found.newton_steps;
  report.sweeps = found.sweeps;
  write(contacts, dt, report);
  return report;
}

template <RealScalar Scalar>
ContactStatus ContactSolver<Scalar>::refusal(const ContactPlace<Scalar>& place, Sides sides) {
  if (place.side == -1) return ContactStatus::Solved;
  if (place.side < 0 || static_cast<std::size_t>(place.side) >= sides.size())
    return ContactStatus::WrongSize;
  const Index n = sides[static_cast<std::size_t>(place.side)].point_count();
  if (place.point[0] < 0) return ContactStatus::WrongSize;
  for (std::size_t k = 0; k < 3; ++k) {
    const int point = place.point[k];
    if (point < -1 || point >= n || (point >= 0 && k > 0 && place.point[k - 1] < 0))
      return ContactStatus::WrongSize;
    if (point >= 0 && !is_finite(place.weight[static_cast<Index>(k)]))
      return ContactStatus::InvalidInput;
  }
  return ContactStatus::Solved;
}

template <RealScalar Scalar>
ContactStatus ContactSolver<Scalar>::refusal(std::span<const Sample> contacts, Sides sides,
                                             Index& contact) const {
  if (static_cast<Index>(contacts.size()) > problem_.capacity()) return ContactStatus::WrongSize;
  for (const ImpulseResponseRef<Scalar>& side : sides) {
    if (side.point_count() > points_) return ContactStatus::WrongSize;
  }
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    const Sample& c = contacts[i];
    contact = static_cast<Index>(i);
    for (const ContactPlace<Scalar>* place : {&c.a, &c.b}) {
      const ContactStatus status = refusal(*place, sides);
      if (status != ContactStatus::Solved) return status;
    }
    bool good = is_finite(c.gap) && all_finite(c.normal) && all_finite(c.drift) &&
                all_finite(c.offset) && all_finite(c.impulse);
    for (const Scalar* number : {&c.friction, &c.compliance, &c.tangential_compliance, &c.damping})
      good = good && is_finite(*number) && !(*number < Scalar(0)) && !is_unbounded(*number);
    const Scalar length = c.normal.squaredNorm();
    // A normal from single precision is of length one to 1e-5.
    good = good && Scalar(0.9999) < length && length < Scalar(1.0001);
    if (!good) return ContactStatus::InvalidInput;
  }
  contact = -1;
  return ContactStatus::Solved;
}

template <RealScalar Scalar>
bool ContactSolver<Scalar>::build(std::span<const Sample> contacts, Sides sides, const Scalar& dt) {
  const Index c = static_cast<Index>(contacts.size());
  problem_.resize(c);
  for (Index i = 0; i < c; ++i)
    frames_.template middleCols<3>(3 * i) =
        detail::contact_frame<Scalar>(contacts[static_cast<std::size_t>(i)].normal);
  for (std::size_t s = 0; s < sides.size(); ++s) {
    const Index n = 3 * sides[s].point_count();
    if (n == 0) continue;
    Eigen::Ref<MatrixX<Scalar>> W = W_.topLeftCorner(n, n);
    Eigen::Ref<VectorX<Scalar>> u = u_.head(n);
    W.setConstant(Scalar(0));
    u.setConstant(Scalar(0));
    sides[s].velocities(u);
    sides[s].add_mobility(W);
    if (!all_finite(W) || !all_finite(u)) return false;
    detail::add_side<Scalar>(contacts, frames_, static_cast<int>(s), W, u, problem_);
  }
  detail::complete_problem<Scalar>(contacts, frames_, dt, problem_);
  return all_finite(problem_.D()) && all_finite(problem_.b());
}

template <RealScalar Scalar>
void ContactSolver<Scalar>::write(Contacts contacts, const Scalar& dt,
                                  ContactReport<Scalar>& report) {
  for (Index i = 0; i < problem_.contacts(); ++i) {
    Sample& contact = contacts[static_cast<std::size_t>(i)];
    const Matrix3<Scalar> F = frames_.template middleCols<3>(3 * i);
    const Vector3<Scalar> lambda = newton_.impulses().template segment<3>(3 * i);
    const Vector3<Scalar> u = newton_.velocities().template segment<3>(3 * i);
    const ContactState state =
        detail::contact_equation<Scalar>(lambda, u, contact.friction, problem_.rho_n(i),
                                         problem_.rho_t(i))
            .branch;
    detail::end_contact<Scalar>(F, lambda, state, dt, contact);
    ++(state == ContactState::Open ? report.open
                                   : (state == ContactState::Stick ? report.stick : report.slip));
  }
}

template <RealScalar Scalar>
void ContactSolver<Scalar>::gather(std::span<const Sample> contacts, int side,
                                   Eigen::Ref<VectorX<Scalar>> p) {
  p.setConstant(Scalar(0));
  for (const Sample& c : contacts) {
    detail::for_each_place<Scalar>(
        c, side, [&](const ContactPlace<Scalar>& place, const Scalar& sign) {
          for (std::size_t k = 0; k < 3 && place.point[k] >= 0; ++k) {
            const Scalar share = sign * place.weight[static_cast<Index>(k)];
            p.template segment<3>(3 * place.point[k]) += share * c.impulse;
          }
        });
  }
}

template <RealScalar Scalar>
ContactStatus ContactSolver<Scalar>::apply(std::span<const Sample> contacts, Sides sides) {
  Index contact = -1;
  const ContactStatus status = refusal(contacts, sides, contact);
  if (status != ContactStatus::Solved) return status;
  for (const bool change : {false, true}) {  // all sums are tested before the first side changes
    for (std::size_t s = 0; s < sides.size(); ++s) {
      Eigen::Ref<VectorX<Scalar>> p = u_.head(3 * sides[s].point_count());
      gather(contacts, static_cast<int>(s), p);
      if (!all_finite(p)) return ContactStatus::InvalidInput;
      if (change) sides[s].apply(p);
    }
  }
  return ContactStatus::Solved;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class detail::FrictionNewton<double>);
CLOTHCTL_INSTANTIATE(class ContactSolver<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
