#pragma once

// The laws that every ContactModel must obey. Call check_contact_laws<Scalar>(model, tolerance)
// inside a TEST_CASE.
//
//   layout     a generator acts on vertices of the finger; its rows of all other vertices are zero
//   shares     on a flat patch, generator i adds s_i > 0 to the normal force Σ_j n_j·f_j
//   cone       coefficients d >= 0 below the limit never violate the contact law
//   bound      a coefficient at its upper bound alone reaches the limit on the normal force
//   leaving    pulling more than the adhesion, or pressing more than the limit, is a violation that
//              grows with the excess
//   refusal    a force, normal or limit that is not finite gives infinity
//   memory     nothing allocates

#include <cmath>
#include <limits>
#include <random>
#include <utility>

#include "clothctl/concepts/contact_model.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// A patch of vertices with unit contact normals, 3×m each.
template <class Scalar>
struct ContactPatch {
  clothctl::Points<Scalar> points, normals;
};

/// Returns m vertices 10 mm apart near the plane z = 0. Their normals are (0, 0, 1), or tilt by up
/// to about 0.1 rad if `curved`.
template <class Scalar>
ContactPatch<Scalar> contact_patch(clothctl::Index m, bool curved) {
  ContactPatch<Scalar> patch{clothctl::Points<Scalar>::Zero(3, m),
                             clothctl::Points<Scalar>::Zero(3, m)};
  for (clothctl::Index j = 0; j < m; ++j) {
    patch.points.col(j) << Scalar(0.01) * Scalar(j % 2), Scalar(0.01) * Scalar(j / 2), Scalar(0);
    const Scalar lean = curved ? Scalar(0.1) * Scalar(j % 3) - Scalar(0.1) : Scalar(0);
    patch.normals.col(j) << std::sin(lean), Scalar(0), std::cos(lean);
  }
  return patch;
}

/// Returns the adhesion of a model, N; 0 if the optional hook is missing.
template <class Scalar, class Model>
Scalar adhesion_of(const Model& model) {
  if constexpr (requires { clothctl::contact_traits<Model>::adhesion(model); })
    return clothctl::contact_traits<Model>::adhesion(model);
  return Scalar(0);
}

/// Returns the forces f_j = G_j d - (a/m) n_j, 3×m, N.
template <class Scalar, class Model>
clothctl::Points<Scalar> contact_forces(const Model& model, const ContactPatch<Scalar>& patch,
                                        const clothctl::VectorX<Scalar>& d) {
  const clothctl::Index m = patch.points.cols();
  clothctl::MatrixX<Scalar> G(3 * m, d.size());
  clothctl::contact_traits<Model>::fill(model, patch.points, patch.normals, G);
  const clothctl::VectorX<Scalar> f = G * d;
  clothctl::Points<Scalar> out = Eigen::Map<const clothctl::Points<Scalar>>(f.data(), 3, m);
  out -= adhesion_of<Scalar>(model) / Scalar(m) * patch.normals;
  return out;
}

namespace law_detail {

template <class Scalar, class Model>
void check_generators(const Model& model, clothctl::Index m, Scalar tolerance) {
  using clothctl::Index;
  using Traits = clothctl::contact_traits<Model>;
  const ContactPatch<Scalar> patch = contact_patch<Scalar>(m, false);
  const Index count = Traits::generators(model, m);
  REQUIRE(count >= 1);
  // As in the planner, the output is a block of a larger matrix that holds old values.
  clothctl::MatrixX<Scalar> store =
      clothctl::MatrixX<Scalar>::Constant(3 * m + 2, count + 1, Scalar(7));
  Traits::fill(model, patch.points, patch.normals, store.topLeftCorner(3 * m, count));
  CHECK((store.bottomRows(2).array() == Scalar(7)).all());
  CHECK((store.rightCols(1).array() == Scalar(7)).all());
  for (Index i = 0; i < count; ++i) {
    CAPTURE(i);
    const std::pair<Index, Index> range = Traits::support(model, m, i);
    REQUIRE((range.first >= 0 && range.second >= 1 && range.first + range.second <= m));
    Scalar normal_force(0), size(0);
    for (Index j = 0; j < m; ++j) {
      const clothctl::Vector3<Scalar> g = store.col(i).segment(3 * j, 3);
      normal_force += g.dot(patch.normals.col(j));
      size += g.norm();
      if (j < range.first || range.first + range.second <= j) CHECK(g.isZero(Scalar(0)));
    }
    const Scalar share = Traits::normal_share(model, m, i);
    CHECK(Scalar(0) < share);
    CHECK(std::abs(normal_force - share) <= tolerance * size);
  }
}

template <class Scalar, class Model>
void check_forces(const Model& model, const ContactPatch<Scalar>& patch, Scalar limit,
                  Scalar tolerance) {
  using clothctl::Index;
  using Traits = clothctl::contact_traits<Model>;
  const Index m = patch.points.cols(), count = Traits::generators(model, m);
  const Scalar slack = tolerance * (limit + adhesion_of<Scalar>(model));
  const auto violation = [&](const clothctl::Points<Scalar>& f) {
    return Scalar(Traits::violation(model, patch.points, patch.normals, f, limit));
  };
  std::mt19937 random(11);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  for (int trial = 0; trial < 50; ++trial) {
    clothctl::VectorX<Scalar> d(count);
    Scalar pressed(0);
    for (Index i = 0; i < count; ++i) {
      const bool used =
          trial % 3 != 0 ||
          i % 3 == trial % 2;  // with few coefficients, forces lie on the border of the cone
      d[i] = used ? Scalar(uniform(random)) : Scalar(0);
      pressed += d[i] * Traits::normal_share(model, m, i);
    }
    d *= Scalar(0.95) * (limit + adhesion_of<Scalar>(model)) / (pressed + Scalar(1e-6));
    CHECK(violation(contact_forces(model, patch, d)) <= slack);
  }
  for (Index i = 0; i < count; ++i) {
    clothctl::VectorX<Scalar> d = clothctl::VectorX<Scalar>::Zero(count);
    d[i] = Traits::upper_bound(model, m, i, limit);
    const Scalar reached = d[i] * Traits::normal_share(model, m, i) - adhesion_of<Scalar>(model);
    CHECK(std::abs(reached - limit) <= slack);
  }
  Scalar last_pull(0), last_press(0);
  for (const Scalar excess : {Scalar(0.1), Scalar(0.5), Scalar(2)}) {
    const Scalar a = adhesion_of<Scalar>(model);
    const Scalar pull = violation(-(a + excess) / Scalar(m) * patch.normals);
    const Scalar press = violation((limit + excess) / Scalar(m) * patch.normals);
    CHECK(last_pull < pull);
    CHECK(last_press < press);
    last_pull = pull;
    last_press = press;
  }
}

template <class Scalar, class Model>
void check_refusals(const Model& model, const ContactPatch<Scalar>& patch) {
  using Traits = clothctl::contact_traits<Model>;
  const clothctl::Points<Scalar> good = patch.normals;
  const Scalar nan = std::numeric_limits<Scalar>::quiet_NaN(), limit(5);
  const auto refused = [&](const clothctl::Points<Scalar>& n, const clothctl::Points<Scalar>& f,
                           Scalar most) {
    const Scalar told = Traits::violation(model, patch.points, n, f, most);
    return clothctl::is_unbounded(told) && Scalar(0) < told;
  };
  for (const Scalar bad : {nan, std::numeric_limits<Scalar>::infinity()}) {
    clothctl::Points<Scalar> spoilt = good;
    spoilt(1, spoilt.cols() - 1) = bad;
    CHECK(refused(good, spoilt, limit));
    CHECK(refused(spoilt, good, limit));
    CHECK(refused(good, good, bad));
  }
  CHECK_FALSE(refused(good, good, limit));
}

}  // namespace law_detail

/// Checks all laws of this file on patches of one, two and six vertices. Errors are relative to the
/// forces and at most `tolerance`.
template <class Scalar, class Model>
void check_contact_laws(const Model& model, Scalar tolerance) {
  static_assert(clothctl::ContactModel<Model, Scalar>);
  using Traits = clothctl::contact_traits<Model>;
  CHECK(Traits::validate(model) == "");
  for (const clothctl::Index m : {1, 2, 6}) {
    CAPTURE(m);
    law_detail::check_generators<Scalar>(model, m, tolerance);
    for (const bool curved : {false, true}) {
      CAPTURE(curved);
      const ContactPatch<Scalar> patch = contact_patch<Scalar>(m, curved);
      law_detail::check_forces<Scalar>(model, patch, Scalar(5), tolerance);
      law_detail::check_refusals<Scalar>(model, patch);
    }
  }
  const ContactPatch<Scalar> patch = contact_patch<Scalar>(6, true);
  const clothctl::Index count = Traits::generators(model, 6);
  clothctl::MatrixX<Scalar> G(18, count);
  const Scalar limit(5);
  const long before = allocations();
  Traits::fill(model, patch.points, patch.normals, G);
  Scalar sum = Traits::violation(model, patch.points, patch.normals, patch.normals, limit);
  for (clothctl::Index i = 0; i < count; ++i) {
    sum += Traits::normal_share(model, 6, i) + Traits::upper_bound(model, 6, i, limit) +
           Scalar(Traits::support(model, 6, i).first);
  }
  const long made = allocations() - before;
  CHECK(clothctl::is_finite(sum));
  if (allocation_counting_works()) CHECK(made == 0);
}

}  // namespace clothctl_test
