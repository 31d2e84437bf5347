#pragma once

// ContactModel: the forces that one finger can transmit to the patch of cloth that it presses.
//
// A finger holds m vertices x_j with unit contact normals n_j that point from the finger into the
// sheet. Grasp mechanics describes such a contact by generators: the transmissible forces are
//
//   f_j = -(a/m) n_j + Σ_i G_ji d_i,     d_i >= 0,     j = 1..m
//
// with coefficients d, generators G (3m × count) and an adhesion a >= 0 (N). The total normal force
// of the finger is Σ_j n_j·f_j = Σ_i s_i d_i - a; s_i is the normal share of generator i.
// References: Murray, Li, Sastry, A Mathematical Introduction to Robotic Manipulation (1994),
// chapter 5; [Bai 2016], eq. 1-2.

#include <concepts>
#include <string>
#include <utility>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a type acts as a contact model. The primary template forwards to members of the same names.
template <class Model>
struct contact_traits {
  /// Returns the number of generators of one finger on `vertices` vertices.
  static Index generators(const Model& model, Index vertices) requires requires {
    model.generators(vertices);
  }
  { return model.generators(vertices); }

  /// Returns the first of the finger's vertices that generator `i` acts on, and the number of
  /// successive vertices that it acts on. The rows of all other vertices are zero.
  static std::pair<Index, Index> support(const Model& model, Index vertices,
                                         Index i) requires requires {
    model.support(vertices, i);
  }
  { return model.support(vertices, i); }

  /// Writes the generators (3·m × count) for vertices at `points` (3×m, m) with unit contact
  /// normals `normals` (3×m). Must not allocate.
  template <class Positions, class Normals, class Out>
  requires requires(const Model& m, const Positions& x, const Normals& n, Out& out) {
    m.fill(x, n, out);
  }
  static void fill(const Model& model, const Positions& points, const Normals& normals, Out&& out) {
    model.fill(points, normals, out);
  }

  /// Returns s_i, the normal force that a unit of coefficient `i` adds. Positive.
  static auto normal_share(const Model& model, Index vertices, Index i) requires requires {
    model.normal_share(vertices, i);
  }
  { return model.normal_share(vertices, i); }

  /// Returns the largest value of coefficient `i` of a finger whose normal force is limited to
  /// `max_normal_force` (N).
  template <class Scalar>
  requires requires(const Model& m, Index n, Scalar force) { m.upper_bound(n, n, force); }
  static Scalar upper_bound(const Model& model, Index vertices, Index i,
                            const Scalar& max_normal_force) {
    return model.upper_bound(vertices, i, max_normal_force);
  }

  /// Returns by how much (N) the forces (3×m, N) on the sheet violate the contact law or the limit
  /// on the normal force: 0 when they satisfy both, infinity when an argument is not finite.
  template <class Positions, class Normals, class Forces, class Scalar>
  requires requires(const Model& m, const Positions& x, const Normals& n, const Forces& f,
                    Scalar force) {
    m.violation(x, n, f, force);
  }
  static Scalar violation(const Model& model, const Positions& points, const Normals& normals,
                          const Forces& forces, const Scalar& max_normal_force) {
    return model.violation(points, normals, forces, max_normal_force);
  }

  /// Returns an empty string, or what is wrong with the model's parameters.
  static std::string validate(const Model& model) requires requires { model.validate(); }
  { return std::string(model.validate()); }

  /// Returns the adhesion a of the finger, N. Optional.
  static auto adhesion(const Model& model) requires requires { model.adhesion(); }
  { return model.adhesion(); }
};

/// What a finger can transmit to the sheet.
///
/// Axioms: forces of coefficients d >= 0 satisfy the contact law to rounding, but may exceed the
/// limit on the normal force; one coefficient at its `upper_bound`, with all others zero, reaches
/// that limit; `fill` writes zeros outside of each generator's `support`; nothing allocates.
///
/// Optional hooks: `adhesion(model)`, 0 where it is missing.
template <class Model, class Scalar = double>
concept ContactModel = RealScalar<Scalar> && std::copy_constructible<Model> &&
    requires(const Model& model, const Points<Scalar>& x, Eigen::Ref<MatrixX<Scalar>> out, Index n,
             const Scalar& limit) {
  { contact_traits<Model>::generators(model, n) } -> std::convertible_to<Index>;
  { contact_traits<Model>::support(model, n, n) } -> std::convertible_to<std::pair<Index, Index>>;
  contact_traits<Model>::fill(model, x, x, out);
  { contact_traits<Model>::normal_share(model, n, n) } -> std::convertible_to<Scalar>;
  { contact_traits<Model>::upper_bound(model, n, n, limit) } -> std::convertible_to<Scalar>;
  { contact_traits<Model>::violation(model, x, x, x, limit) } -> std::convertible_to<Scalar>;
  { contact_traits<Model>::validate(model) } -> std::convertible_to<std::string>;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
