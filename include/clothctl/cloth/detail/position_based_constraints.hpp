#pragma once

// Constraints of the position-based schemes, stored in flat arrays, and Gauss-Seidel sweeps over
// them. Symbols: p positions being corrected, w inverse masses, h substep, l0 rest length, n unit
// vector along p_a - p_b, λ multiplier, δ = p - (position at the start of the substep).
//
//   rigid distance (Verlet), relaxation r:
//     c = r (|p_a - p_b| - l0)/(w_a + w_b),        p_a -= w_a c n,   p_b += w_b c n
//   spring k with damper d (XPBD):
//     Δλ = -( h² k (|p_a - p_b| - l0) + λ + h d n·(δ_a - δ_b) )
//          / ( (h² k + h d)(w_a + w_b) + 1 ),      p_a += w_a Δλ n,  p_b -= w_b Δλ n,  λ += Δλ
//   bending stencil Σ ω_i p_i = 0 with stiffness kb and weights ω (XPBD); λ is a vector:
//     Δλ = -( h² kb Σ ω_i p_i + λ ) / ( h² kb Σ ω_i² w_i + 1 ),   p_i += ω_i w_i Δλ,  λ += Δλ
//   bending stencil (Verlet), relaxation r:
//     Δλ = -r Σ ω_i p_i / Σ ω_i² w_i,              p_i += ω_i w_i Δλ
//
// The XPBD equations are the usual ones (compliance 1/k, multiplier λ) multiplied by h² k, so that
// neither k = 0 nor a huge k needs a special case. λ has the unit of an impulse times time. XPBD
// visits its springs colour by colour. Springs of one colour share no vertex, so their
// updates do not wait for each other.

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Greedy (first-fit) colouring: no two items of a colour share a vertex. `corners(e)` returns the
/// vertices of item e. Returns the items of `items` colour by colour; within a colour they keep
/// their order. Allocates. Complexity: O(items × colours).
template <class Corners>
std::vector<std::vector<std::size_t>> colour_items(std::vector<std::size_t> items,
                                                   std::size_t vertex_count, Corners corners) {
  std::vector<std::vector<std::size_t>> colours;
  std::vector<std::size_t> taken(vertex_count, 0);
  std::vector<std::size_t> rest;
  while (!items.empty()) {
    colours.emplace_back();
    rest.clear();
    for (std::size_t e : items) {
      bool fits = true;
      for (int v : corners(e)) fits = fits && taken[static_cast<std::size_t>(v)] != colours.size();
      (fits ? colours.back() : rest).push_back(e);
      if (!fits) continue;
      for (int v : corners(e)) taken[static_cast<std::size_t>(v)] = colours.size();
    }
    items.swap(rest);
  }
  return colours;
}

/// The ends of a distance constraint, and their current separation.
template <RealScalar Scalar>
struct Separation {
  int a, b;
  /// p_a - p_b.
  Triple<Scalar> d;
  Scalar squared_length;
};

template <RealScalar Scalar>
CLOTHCTL_FORCE_INLINE Separation<Scalar> separation(const Points<Scalar>& p,
                                                    const std::array<int, 2>& ends) {
  const Triple<Scalar> d = column(p, ends[0]) - column(p, ends[1]);
  return {ends[0], ends[1], d, squared_norm(d)};
}

/// Threshold of (distance / rest length)². Below it, the ends of a constraint count as one point
/// and define no direction.
template <RealScalar Scalar>
Scalar squared_resolution() {
  return scalar_traits<Scalar>::epsilon() * scalar_traits<Scalar>::epsilon();
}

/// The springs as rigid distance constraints, in the order of the network.
template <RealScalar Scalar>
class RigidDistances {
 public:
  /// Data of a step: the fraction of the length error that each end corrects.
  struct Scratch {
    VectorX<Scalar> share_a, share_b;
  };

  RigidDistances() = default;

  RigidDistances(const SpringNetwork<Scalar>& network, const std::vector<Scalar>& relaxation) {
    for (std::size_t e = 0; e < network.springs.size(); ++e) {
      const Spring<Scalar>& s = network.springs[e];
      if (!(Scalar(0) < s.stiffness)) continue;
      ends_.push_back({s.a, s.b});
      rest_.push_back(s.rest_length);
      relaxation_.push_back(relaxation.empty() ? Scalar(1) : relaxation[e]);
    }
  }

  Scratch make_scratch() const {
    const Index count = static_cast<Index>(ends_.size());
    return {VectorX<Scalar>::Zero(count), VectorX<Scalar>::Zero(count)};
  }

  bool fits(const Scratch& scratch) const {
    const Index count = static_cast<Index>(ends_.size());
    return scratch.share_a.size() == count && scratch.share_b.size() == count;
  }

  void prepare(const VectorX<Scalar>& w, Scratch& scratch) const {
    for (std::size_t e = 0; e < ends_.size(); ++e) {
      const Index i = static_cast<Index>(e);
      const Scalar w_a = w[ends_[e][0]];
      const Scalar w_b = w[ends_[e][1]];
      const Scalar sum = w_a + w_b;
      const Scalar scale = Scalar(0) < sum ? relaxation_[e] / sum : Scalar(0);
      scratch.share_a[i] = scale * w_a;
      scratch.share_b[i] = scale * w_b;
    }
  }

  void sweep(Points<Scalar>& p, const Scratch& scratch) const {
    using std::sqrt;
    const Scalar tiny = squared_resolution<Scalar>();
    for (std::size_t e = 0; e < ends_.size(); ++e) {
      const Index i = static_cast<Index>(e);
      const auto [a, b, d, squared] = separation(p, ends_[e]);
      if (squared <= tiny * rest_[e] * rest_[e]) continue;
      const Scalar length = sqrt(squared);
      const Scalar c = (length - rest_[e]) / length;
      subtract_from_column(p, a, d * (scratch.share_a[i] * c));
      add_to_column(p, b, d * (scratch.share_b[i] * c));
    }
  }

 private:
  std::vector<std::array<int, 2>> ends_;
  std::vector<Scalar> rest_, relaxation_;
};

/// The springs as compliant distance constraints, colour by colour.
template <RealScalar Scalar>
class CompliantDistances {
 public:
  /// Data of a step: inverse masses of the ends, h² k, h d, 1/(denominator of Δλ), and λ.
  struct Scratch {
    VectorX<Scalar> w_a, w_b, stiffness, damping, inverse, multiplier;
  };

  CompliantDistances() = default;

  explicit CompliantDistances(const SpringNetwork<Scalar>& network) {
    std::vector<std::size_t> items;
    for (std::size_t e = 0; e < network.springs.size(); ++e) {
      const Spring<Scalar>& s = network.springs[e];
      if (Scalar(0) < s.stiffness || Scalar(0) < s.damping) items.push_back(e);
      if (Scalar(0) < s.damping) damped_ = true;
    }
    const auto ends = [&](std::size_t e) {
      return std::array<int, 2>{network.springs[e].a, network.springs[e].b};
    };
    rest_.resize(static_cast<Index>(items.size()));
    stiffness_.resize(static_cast<Index>(items.size()));
    damping_.resize(static_cast<Index>(items.size()));
    for (const auto& colour :
         colour_items(items, static_cast<std::size_t>(network.vertex_count()), ends)) {
      for (std::size_t e : colour) {
        const Index i = static_cast<Index>(ends_.size());
        ends_.push_back(ends(e));
        rest_[i] = network.springs[e].rest_length;
        stiffness_[i] = network.springs[e].stiffness;
        damping_[i] = network.springs[e].damping;
      }
    }
  }

  Scratch make_scratch() const {
    const VectorX<Scalar> zero = VectorX<Scalar>::Zero(rest_.size());
    return {zero, zero, zero, zero, zero, zero};
  }

  bool fits(const Scratch& s) const {
    bool good = true;
    for (const VectorX<Scalar>* list :
         {&s.w_a, &s.w_b, &s.stiffness, &s.damping, &s.inverse, &s.multiplier})
      good = good && list->size() == rest_.size();
    return good;
  }

  void prepare(const VectorX<Scalar>& w, const Scalar& h, Scratch& s) const {
    for (std::size_t e = 0; e < ends_.size(); ++e) {
      const Index i = static_cast<Index>(e);
      s.w_a[i] = w[ends_[e][0]];
      s.w_b[i] = w[ends_[e][1]];
      s.stiffness[i] = h * h * stiffness_[i];
      s.damping[i] = h * damping_[i];
      s.inverse[i] =
          Scalar(1) / ((s.stiffness[i] + s.damping[i]) * (s.w_a[i] + s.w_b[i]) + Scalar(1));
    }
  }

  void begin_substep(Scratch& scratch) const { scratch.multiplier.setZero(); }

  void sweep(Points<Scalar>& p, const Points<Scalar>& start, Scratch& scratch) const {
    if (damped_) {
      sweep_springs<true>(p, start, scratch);
    } else {
      sweep_springs<false>(p, start, scratch);
    }
  }

 private:
  template <bool kDamped>
  void sweep_springs(Points<Scalar>& p, const Points<Scalar>& start, Scratch& s) const {
    using std::sqrt;
    const Scalar tiny = squared_resolution<Scalar>();
    for (std::size_t e = 0; e < ends_.size(); ++e) {
      const Index i = static_cast<Index>(e);
      const auto [a, b, d, squared] = separation(p, ends_[e]);
      const Scalar smallest = tiny * rest_[i] * rest_[i];
      const Scalar inverse_length = Scalar(1) / sqrt(squared < smallest ? smallest : squared);
      Scalar force = s.stiffness[i] * (squared * inverse_length - rest_[i]) + s.multiplier[i];
      if constexpr (kDamped) {
        const Triple<Scalar> d_start = column(start, a) - column(start, b);
        force += s.damping[i] * inverse_length * (squared - dot(d, d_start));
      }
      const Scalar change = -force * s.inverse[i];
      s.multiplier[i] += change;
      const Scalar along = change * inverse_length;
      add_to_column(p, a, d * (along * s.w_a[i]));
      subtract_from_column(p, b, d * (along * s.w_b[i]));
    }
  }

  std::vector<std::array<int, 2>> ends_;
  VectorX<Scalar> rest_, stiffness_, damping_;
  bool damped_ = false;
};

/// Bending stencils of at most kCount vertices, colour by colour. Shorter stencils are padded with
/// their first vertex at weight 0.
template <RealScalar Scalar, int kCount>
class BendConstraints {
 public:
  /// Data of a step, one column for each stencil: ω_i w_i; the factors of Σ ω_i p_i and of λ in
  /// -Δλ; and λ.
  struct Scratch {
    DenseMatrix<Scalar, kCount, Eigen::Dynamic> share;
    VectorX<Scalar> error_factor, multiplier_factor;
    Points<Scalar> multiplier;
  };

  BendConstraints() = default;

  /// Takes the stencils of positive stiffness that have `least` to kCount vertices.
  BendConstraints(const SpringNetwork<Scalar>& network, int least) {
    std::vector<std::size_t> items;
    for (std::size_t e = 0; e < network.bends.size(); ++e) {
      const BendStencil<Scalar>& s = network.bends[e];
      if (s.count >= least && s.count <= kCount && Scalar(0) < s.stiffness) items.push_back(e);
    }
    const auto padded = [&](std::size_t e) {
      std::array<int, kCount> vertex{};
      const BendStencil<Scalar>& s = network.bends[e];
      for (std::size_t i = 0; i < kCount; ++i)
        vertex[i] = static_cast<int>(i) < s.count ? s.vertex[i] : s.vertex[0];
      return vertex;
    };
    for (const std::vector<std::size_t>& colour :
         colour_items(items, static_cast<std::size_t>(network.vertex_count()), padded)) {
      for (std::size_t e : colour) {
        const BendStencil<Scalar>& s = network.bends[e];
        vertex_.push_back(padded(e));
        std::array<Scalar, kCount> weight;
        for (std::size_t i = 0; i < kCount; ++i)
          weight[i] = static_cast<int>(i) < s.count ? s.weight[i] : Scalar(0);
        weight_.push_back(weight);
        stiffness_.push_back(s.stiffness);
      }
    }
  }

  Scratch make_scratch() const {
    const Index count = static_cast<Index>(vertex_.size());
    Scratch scratch;
    scratch.share.setZero(kCount, count);
    scratch.error_factor.setZero(count);
    scratch.multiplier_factor.setZero(count);
    scratch.multiplier.setZero(3, count);
    return scratch;
  }

  bool fits(const Scratch& scratch) const {
    const Index count = static_cast<Index>(vertex_.size());
    return scratch.share.cols() == count && scratch.error_factor.size() == count &&
           scratch.multiplier_factor.size() == count && scratch.multiplier.cols() == count;
  }

  void prepare_compliant(const VectorX<Scalar>& w, const Scalar& h, Scratch& scratch) const {
    for (std::size_t e = 0; e < vertex_.size(); ++e) {
      const Index i = static_cast<Index>(e);
      const Scalar k = h * h * stiffness_[e];
      const Scalar inverse = Scalar(1) / (k * fill_share(w, e, scratch) + Scalar(1));
      scratch.error_factor[i] = k * inverse;
      scratch.multiplier_factor[i] = inverse;
    }
  }

  void prepare_rigid(const VectorX<Scalar>& w, const Scalar& relaxation, Scratch& scratch) const {
    for (std::size_t e = 0; e < vertex_.size(); ++e) {
      const Scalar sum = fill_share(w, e, scratch);
      scratch.error_factor[static_cast<Index>(e)] = Scalar(0) < sum ? relaxation / sum : Scalar(0);
    }
  }

  void begin_substep(Scratch& scratch) const { scratch.multiplier.setZero(); }

  template <bool kRigid>
  void sweep(Points<Scalar>& p, Scratch& scratch) const {
    for (std::size_t e = 0; e < vertex_.size(); ++e) {
      const Index i = static_cast<Index>(e);
      Triple<Scalar> error = column(p, vertex_[e][0]) * weight_[e][0];
      for (std::size_t c = 1; c < kCount; ++c)
        error = error + column(p, vertex_[e][c]) * weight_[e][c];
      Triple<Scalar> change = error * -scratch.error_factor[i];
      if constexpr (!kRigid) {
        change = change - column(scratch.multiplier, i) * scratch.multiplier_factor[i];
        add_to_column(scratch.multiplier, i, change);
      }
      for (std::size_t c = 0; c < kCount; ++c)
        add_to_column(p, vertex_[e][c], change * scratch.share(static_cast<Index>(c), i));
    }
  }

 private:
  /// Writes ω_i w_i of stencil e to the scratch and returns Σ ω_i² w_i.
  Scalar fill_share(const VectorX<Scalar>& w, std::size_t e, Scratch& scratch) const {
    Scalar sum = Scalar(0);
    for (std::size_t c = 0; c < kCount; ++c) {
      const Scalar share = weight_[e][c] * w[vertex_[e][c]];
      scratch.share(static_cast<Index>(c), static_cast<Index>(e)) = share;
      sum += weight_[e][c] * share;
    }
    return sum;
  }

  std::vector<std::array<int, kCount>> vertex_;
  std::vector<std::array<Scalar, kCount>> weight_;
  std::vector<Scalar> stiffness_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
