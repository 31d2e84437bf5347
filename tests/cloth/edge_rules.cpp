#include "clothctl/cloth/detail/edge_rules.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>

#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::Numbers;

namespace {

template <class Scalar>
constexpr int kCount = std::is_same_v<Scalar, long double> ? 1 : 16 / int(sizeof(Scalar) / 4);

/// Random edges, a lane each: lengths from half to twice the rest length.
template <class Scalar>
struct Edges {
  static constexpr std::size_t kLanes = std::size_t(kCount<Scalar>);
  using Pack = Simd<Scalar, kCount<Scalar>>;
  using List = std::array<Scalar, kLanes>;
  /// d, d_start, inverse masses, h² k, h c, and what the rules read.
  std::array<Vector3<double>, kLanes> d, start;
  List w_a, w_b, rest, weight, stiffness, damping, inverse, multiplier, share;

  explicit Edges(unsigned seed, double shortest = 0.5, double longest = 2.0) {
    Numbers random(seed);
    for (std::size_t i = 0; i < kLanes; ++i) {
      rest[i] = Scalar(random(0.1, 1.0));
      const double length = static_cast<double>(rest[i]) * random(shortest, longest);
      const Vector3<double> n(random(-1, 1), random(-1, 1), random(0.1, 1));
      // The numbers that the rules see.
      d[i] = (length * n.normalized()).template cast<Scalar>().template cast<double>();
      const Vector3<double> before(random(-1, 1), random(-1, 1), random(-1, 1));
      start[i] = d[i] + 0.1 * before;
      w_a[i] = Scalar(random(0.0, 2.0));
      w_b[i] = Scalar(random(0.1, 2.0));
      stiffness[i] = Scalar(random(0.0, 3.0));
      damping[i] = Scalar(random(0.0, 1.0));
      const Scalar w = w_a[i] + w_b[i];
      weight[i] = Scalar(1) / w;
      inverse[i] = Scalar(1) / ((stiffness[i] + damping[i]) * w + Scalar(1));
      multiplier[i] = Scalar(random(-0.3, 0.3));
      share[i] = stiffness[i] * w / (stiffness[i] * w + Scalar(1));
    }
  }
  EdgeData<Scalar> data(bool limited) {
    return {rest.data(),    weight.data(),  limited ? share.data() : stiffness.data(),
            damping.data(), inverse.data(), multiplier.data()};
  }
  double w(std::size_t i) const {
    return static_cast<double>(w_a[i]) + static_cast<double>(w_b[i]);
  }
  double stretch(std::size_t i) const { return 1.0 - static_cast<double>(rest[i]) / d[i].norm(); }

  /// s of the lanes.
  template <class Rule>
  List scales(Rule& rule, bool limited) {
    List q, dot, out;
    for (std::size_t i = 0; i < kLanes; ++i) {
      q[i] = Scalar(d[i].squaredNorm());
      dot[i] = Scalar(d[i].dot(start[i]));
    }
    const auto along = [&]() { return Pack::load(dot.data()); };
    rule.scale(data(limited), 0, Pack::load(q.data()), along).store(out.data());
    return out;
  }
};

/// Rounding errors allowed.
template <class Scalar>
constexpr double kSmall = std::is_same_v<Scalar, float> ? 2e-5 : 1e-13;

template <class Scalar>
double plain(const Scalar& value) {
  return static_cast<double>(value);
}

}  // namespace

TEMPLATE_TEST_CASE("edge rules: the rigid rule restores the rest length, or a part of the error",
                   "[edge_rules]", float, double, long double) {
  using Scalar = TestType;
  for (unsigned seed = 0; seed < 30; ++seed) {
    Edges<Scalar> edges(seed);
    RigidRule<Scalar, kCount<Scalar>> rule;
    for (const double relaxation : {1.0, 0.3}) {
      for (std::size_t i = 0; i < edges.kLanes; ++i)
        edges.weight[i] = Scalar(relaxation / edges.w(i));
      const auto s = edges.scales(rule, false);
      for (std::size_t i = 0; i < edges.kLanes; ++i) {
        const double length = edges.d[i].norm() * (1.0 - plain(s[i]) * edges.w(i));
        const double expected =
            edges.d[i].norm() + relaxation * (plain(edges.rest[i]) - edges.d[i].norm());
        CHECK(std::abs(length - expected) < kSmall<Scalar>);
      }
    }
  }
}

TEMPLATE_TEST_CASE("edge rules: a compliant visit balances spring, damper and multiplier",
                   "[edge_rules]", float, double, long double) {
  using Scalar = TestType;
  constexpr int kLanes = kCount<Scalar>;
  for (unsigned seed = 0; seed < 30; ++seed) {
    Edges<Scalar> edges(seed);
    const auto before = edges.multiplier;
    // λ + h² k (|d| - l0) + h c n·(d - d_start) = 0 after the visit, n as it was before.
    const auto balanced = [&](const auto& s, bool damped, bool read, bool written) {
      for (std::size_t i = 0; i < edges.kLanes; ++i) {
        const double length = edges.d[i].norm(), change = -plain(s[i]) * length;
        const double after = length + change * edges.w(i);
        const double lambda = (read ? plain(before[i]) : 0.0) + change;
        double sum = lambda + plain(edges.stiffness[i]) * (after - plain(edges.rest[i]));
        if (damped) {
          const Vector3<double> n = edges.d[i] / length;
          sum += plain(edges.damping[i]) * (after - n.dot(edges.start[i]));
        }
        CHECK(std::abs(sum) < kSmall<Scalar>);
        const double expected = written ? lambda : plain(before[i]);
        CHECK(std::abs(plain(edges.multiplier[i]) - expected) < kSmall<Scalar>);
      }
      edges.multiplier = before;
    };
    CompliantRule<Scalar, kLanes, true, true, true> both;
    balanced(edges.scales(both, false), true, true, true);
    CompliantRule<Scalar, kLanes, true, false, true> first;
    balanced(edges.scales(first, false), true, false, true);
    CompliantRule<Scalar, kLanes, true, true, false> last;
    balanced(edges.scales(last, false), true, true, false);
    CompliantRule<Scalar, kLanes, true, false, false> only;
    balanced(edges.scales(only, false), true, false, false);
    for (std::size_t i = 0; i < edges.kLanes; ++i) {
      edges.damping[i] = Scalar(0);
      edges.inverse[i] = Scalar(1) / (edges.stiffness[i] * Scalar(edges.w(i)) + Scalar(1));
    }
    CompliantRule<Scalar, kLanes, false, true, true> undamped;
    balanced(edges.scales(undamped, false), false, true, true);
    CompliantRule<Scalar, kLanes, false, false, false> plain_rule;
    balanced(edges.scales(plain_rule, false), false, false, false);
  }
}

TEMPLATE_TEST_CASE("edge rules: the limit rule acts by branches", "[edge_rules]", float, double,
                   long double) {
  using Scalar = TestType;
  using Pack = Simd<Scalar, kCount<Scalar>>;
  int soft = 0, rigid = 0, free_edges = 0, short_edges = 0;
  for (unsigned seed = 0; seed < 40; ++seed) {
    Edges<Scalar> edges(seed, 0.7, 1.3);
    const double slack = 0.03, compression = 0.4, free = seed % 2 == 0 ? 0.0 : 0.125;
    LimitRule<Scalar, kCount<Scalar>> rule{Pack::all(Scalar(slack)), Pack::all(Scalar(compression)),
                                           Pack::all(Scalar(free))};
    const auto s = edges.scales(rule, true);
    double worst = 0;
    for (std::size_t i = 0; i < edges.kLanes; ++i) {
      const double e = edges.stretch(i), sigma = plain(edges.share[i]);
      worst = std::max(worst, e);
      double expected = 0;
      if (e < -free) {
        expected = compression * sigma * (e + free);
        ++short_edges;
      } else if (e < 0) {
        ++free_edges;
      } else if (e - slack > sigma * e) {
        expected = e - slack;
        // What is left is the slack, as part of the length before.
        const double length = edges.d[i].norm(), left = length * (1.0 - plain(s[i]) * edges.w(i));
        CHECK(std::abs(left - plain(edges.rest[i]) - slack * length) < kSmall<Scalar>);
        ++rigid;
      } else {
        expected = sigma * e;
        ++soft;
      }
      CHECK(std::abs(plain(s[i]) * edges.w(i) - expected) < kSmall<Scalar>);
    }
    CHECK(std::abs(plain(rule.worst.largest()) - worst) < kSmall<Scalar>);
  }
  CHECK(std::min({soft, rigid, free_edges, short_edges}) > 3);
}

TEMPLATE_TEST_CASE("edge rules: the tension rule removes what exceeds the slack and no more",
                   "[edge_rules]", float, double, long double) {
  using Scalar = TestType;
  using Pack = Simd<Scalar, kCount<Scalar>>;
  int slacking = 0, tight = 0;
  for (unsigned seed = 0; seed < 40; ++seed) {
    Edges<Scalar> edges(seed, 0.8, 1.3);
    for (const double omega : {1.0, 1.7}) {
      TensionRule<Scalar, kCount<Scalar>> rule{Pack::all(Scalar(0.05)), Pack::all(Scalar(omega))};
      const auto s = edges.scales(rule, true);
      double worst = 0;
      for (std::size_t i = 0; i < edges.kLanes; ++i) {
        const double e = edges.stretch(i);
        worst = std::max(worst, e);
        if (e < 0.05) {
          ++slacking;
          CHECK(s[i] == Scalar(0));
        } else {
          ++tight;
          CHECK(std::abs(plain(s[i]) * edges.w(i) - omega * (e - 0.05)) < kSmall<Scalar>);
        }
      }
      CHECK(std::abs(plain(rule.worst.largest()) - worst) < kSmall<Scalar>);
    }
  }
  CHECK(std::min(slacking, tight) > 10);
}

TEMPLATE_TEST_CASE("edge rules: the largest stretch is kept from visit to visit", "[edge_rules]",
                   float, double, long double) {
  using Scalar = TestType;
  using Pack = Simd<Scalar, kCount<Scalar>>;
  Edges<Scalar> stretched(1, 1.2, 1.5), slack(2, 0.5, 0.9);
  TensionRule<Scalar, kCount<Scalar>> rule{Pack::all(Scalar(0))};
  CHECK(rule.worst.largest() == Scalar(0));
  slack.scales(rule, true);
  CHECK(rule.worst.largest() == Scalar(0));
  stretched.scales(rule, true);
  const Scalar most = rule.worst.largest();
  CHECK(most > Scalar(0.16));
  slack.scales(rule, true);
  CHECK(rule.worst.largest() == most);
}

TEMPLATE_TEST_CASE("edge rules: no rule moves an entry without an edge, whatever its length",
                   "[edge_rules]", float, double, long double) {
  using Scalar = TestType;
  constexpr int kLanes = kCount<Scalar>;
  using Pack = Simd<Scalar, kLanes>;
  Edges<Scalar> edges(3);
  edges.rest.fill(Scalar(1e15));
  for (auto* list :
       {&edges.weight, &edges.stiffness, &edges.damping, &edges.share, &edges.multiplier})
    list->fill(Scalar(0));
  edges.inverse.fill(Scalar(1));
  edges.d.front().setZero();
  edges.d.back() *= 1e6;
  const Pack slack = Pack::all(Scalar(0.01));
  RigidRule<Scalar, kLanes> rigid;
  CompliantRule<Scalar, kLanes, true, true, true> compliant;
  LimitRule<Scalar, kLanes> limit{slack, Pack::all(Scalar(1))};
  TensionRule<Scalar, kLanes> tension{slack};
  for (const auto& s : {edges.scales(rigid, false), edges.scales(compliant, false),
                        edges.scales(limit, true), edges.scales(tension, true)}) {
    for (const Scalar& value : s) CHECK(value == Scalar(0));
  }
  CHECK(limit.worst.largest() == Scalar(0));
  CHECK(tension.worst.largest() == Scalar(0));
}
