#include "clothctl/cloth/detail/bend_batches.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>
#include <vector>

#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::Numbers;
using clothctl_test::PlainPoint;

namespace {

constexpr int kVertices = 50;

/// A stencil in plain code.
struct PlainBend {
  std::array<std::size_t, 4> vertex{};
  std::array<double, 4> weight{};
  double stiffness = 0;
  Vector3<double> multiplier = Vector3<double>::Zero();
};

Vector3<double> error_of(const PlainBend& bend, const std::vector<PlainPoint>& points) {
  Vector3<double> sum = Vector3<double>::Zero();
  for (std::size_t c = 0; c < 4; ++c) sum += bend.weight[c] * points[bend.vertex[c]].at;
  return sum;
}

double share_of(const PlainBend& bend, const std::vector<PlainPoint>& points) {
  double sum = 0;
  for (std::size_t c = 0; c < 4; ++c)
    sum += bend.weight[c] * bend.weight[c] * points[bend.vertex[c]].w;
  return sum;
}

void apply(const PlainBend& bend, const Vector3<double>& change, std::vector<PlainPoint>& points) {
  for (std::size_t c = 0; c < 4; ++c) {
    PlainPoint& p = points[bend.vertex[c]];
    p.at += bend.weight[c] * p.w * change;
  }
}

/// A random network of stencils of two, three and four vertices; some without stiffness.
template <class Scalar>
struct Mesh {
  std::vector<PlainPoint> points;
  std::vector<BendStencil<Scalar>> stencils;
  BendBatches<Scalar> packed;
  BendScratch<Scalar> scratch;
  VectorX<Scalar> buffer;

  Mesh(unsigned seed, const PackOrder& order, bool held) {
    Numbers random(seed);
    points.resize(kVertices);
    buffer.setZero(4 * (kVertices + 2));
    buffer[4 * kVertices + 4] = Scalar(1);
    for (std::size_t v = 0; v < points.size(); ++v) {
      const Index at = static_cast<Index>(4 * v);
      for (Index c = 0; c < 3; ++c) buffer[at + c] = Scalar(random(-1, 1));
      buffer[at + 3] = Scalar(held && random.below(5) == 0 ? 0.0 : random(0.2, 3.0));
      points[v].at = buffer.template segment<3>(at).template cast<double>();
      points[v].w = static_cast<double>(buffer[at + 3]);
    }
    for (int i = 0; i < 90; ++i) {
      BendStencil<Scalar> stencil;
      stencil.count = 2 + random.below(3);
      const int first = random.below(kVertices - 8);
      Scalar sum = Scalar(0);
      for (std::size_t c = 0; c < static_cast<std::size_t>(stencil.count); ++c) {
        stencil.vertex[c] = first + 2 * static_cast<int>(c) + random.below(2);
        stencil.weight[c] = c + 1 == static_cast<std::size_t>(stencil.count)
                                ? Scalar(0) - sum
                                : Scalar(random(-2, 2));
        sum = sum + stencil.weight[c];
      }
      stencil.stiffness = Scalar(i % 9 == 4 ? 0.0 : random(0.1, 300.0));
      stencils.push_back(stencil);
    }
    packed = pack_bends(stencils, order, kVertices);
    scratch.resize(packed.size());
  }
  /// The stencils that act, in the order of the list.
  std::vector<PlainBend> listed() const {
    std::vector<PlainBend> out;
    for (const BendStencil<Scalar>& s : stencils) {
      if (!(Scalar(0) < s.stiffness)) continue;
      PlainBend bend;
      for (std::size_t c = 0; c < static_cast<std::size_t>(s.count); ++c) {
        bend.vertex[c] = static_cast<std::size_t>(s.vertex[c]);
        bend.weight[c] = static_cast<double>(s.weight[c]);
      }
      bend.stiffness = static_cast<double>(s.stiffness);
      out.push_back(bend);
    }
    return out;
  }
  /// The same in the order of the batches.
  std::vector<PlainBend> batch_order() const {
    std::vector<PlainBend> out;
    for (Index i = 0; i < packed.size(); ++i) {
      if (!(Scalar(0) < packed.stiffness[i])) continue;
      PlainBend bend;
      for (std::size_t c = 0; c < 4; ++c) {
        const int v = packed.vertex[c][static_cast<std::size_t>(i)] / 4;
        bend.vertex[c] = v < kVertices ? static_cast<std::size_t>(v) : 0;
        bend.weight[c] = static_cast<double>(packed.weight[c][i]);
      }
      bend.stiffness = static_cast<double>(packed.stiffness[i]);
      out.push_back(bend);
    }
    return out;
  }
  double distance() const {
    double most = 0;
    for (std::size_t v = 0; v < points.size(); ++v) {
      const Vector3<double> p =
          buffer.template segment<3>(static_cast<Index>(4 * v)).template cast<double>();
      most = std::max(most, (p - points[v].at).norm());
    }
    return most;
  }
};

template <class Scalar>
constexpr double kSmall = std::is_same_v<Scalar, float> ? 2e-4 : 1e-11;

}  // namespace

TEMPLATE_TEST_CASE("bend batches: rigid stencils in listed order are a plain sequential sweep",
                   "[bend_batches]", float, double, long double) {
  using Scalar = TestType;
  for (unsigned seed = 0; seed < 5; ++seed) {
    Mesh<Scalar> mesh(seed, {1, 0}, true);
    prepare_rigid_bends(mesh.packed, Scalar(0.25), mesh.buffer.data(), mesh.scratch);
    for (int sweep = 0; sweep < 2; ++sweep) {
      sweep_bends<false, false>(mesh.packed, mesh.scratch, mesh.buffer.data());
      for (const PlainBend& bend : mesh.listed()) {
        const double share = share_of(bend, mesh.points);
        if (share > 0) apply(bend, -0.25 / share * error_of(bend, mesh.points), mesh.points);
      }
      CHECK(mesh.distance() < kSmall<Scalar>);
    }
  }
}

TEMPLATE_TEST_CASE("bend batches: compliant stencils are a plain sequential sweep in batch order",
                   "[bend_batches]", float, double, long double) {
  using Scalar = TestType;
  const double h = static_cast<double>(Scalar(0.05));
  for (unsigned seed = 0; seed < 5; ++seed) {
    Mesh<Scalar> mesh(seed, seed % 2 == 0 ? PackOrder{1, 0} : PackOrder{3, 256}, true);
    prepare_bends(mesh.packed, Scalar(h), mesh.buffer.data(), mesh.scratch);
    std::vector<PlainBend> order = mesh.batch_order();
    REQUIRE(order.size() == mesh.listed().size());
    const auto plain_sweep = [&](SweepOrder direction) {
      const SweepPlaces places(direction, 0, order.size());
      for (std::size_t i = 0; i < places.count(); ++i) {
        PlainBend& bend = order[places[i]];
        const double k = h * h * bend.stiffness;
        const Vector3<double> change = -(k * error_of(bend, mesh.points) + bend.multiplier) /
                                       (k * share_of(bend, mesh.points) + 1.0);
        bend.multiplier += change;
        apply(bend, change, mesh.points);
      }
    };
    sweep_bends<false, true>(mesh.packed, mesh.scratch, mesh.buffer.data());
    plain_sweep(SweepOrder::Forward);
    CHECK(mesh.distance() < kSmall<Scalar>);
    sweep_bends<true, true>(mesh.packed, mesh.scratch, mesh.buffer.data(), {},
                            SweepOrder::Backward);
    plain_sweep(SweepOrder::Backward);
    sweep_bends<true, false>(mesh.packed, mesh.scratch, mesh.buffer.data());
    plain_sweep(SweepOrder::Forward);
    CHECK(mesh.distance() < kSmall<Scalar>);
  }
}

TEMPLATE_TEST_CASE("bend batches: a compliant visit balances the stencil with its multiplier",
                   "[bend_batches]", float, double, long double) {
  using Scalar = TestType;
  BendStencil<Scalar> stencil;
  stencil.vertex = {3, 1, 2, 0};
  stencil.weight = {Scalar(1), Scalar(-2), Scalar(1), Scalar(0)};
  stencil.stiffness = Scalar(50);
  stencil.count = 3;
  const BendBatches<Scalar> packed = pack_bends<Scalar>({stencil}, {1, 0}, 4);
  BendScratch<Scalar> scratch;
  scratch.resize(packed.size());
  VectorX<Scalar> points = VectorX<Scalar>::Zero(24);
  points.segment(4, 4) << Scalar(0.1), Scalar(0.2), Scalar(0), Scalar(2);
  points.segment(8, 4) << Scalar(0.3), Scalar(-0.1), Scalar(0.5), Scalar(1);
  points.segment(12, 4) << Scalar(0), Scalar(0), Scalar(0.2), Scalar(0.5);
  prepare_bends(packed, Scalar(0.1), points.data(), scratch);
  const Scalar k = Scalar(0.1) * Scalar(0.1) * Scalar(50);
  for (int visit = 0; visit < 3; ++visit) {
    if (visit == 0) sweep_bends<false, true>(packed, scratch, points.data());
    if (visit > 0) sweep_bends<true, true>(packed, scratch, points.data());
    for (Index c = 0; c < 3; ++c) {
      const Scalar error = points[12 + c] - Scalar(2) * points[4 + c] + points[8 + c];
      const Scalar sum = scratch.multiplier[static_cast<std::size_t>(c)][0] + k * error;
      CHECK(std::abs(static_cast<double>(sum)) < (std::is_same_v<Scalar, float> ? 1e-6 : 1e-15));
    }
  }
}

TEMPLATE_TEST_CASE("bend batches: sweeps keep the momentum; held and spare vertices stay",
                   "[bend_batches]", float, double, long double) {
  using Scalar = TestType;
  Mesh<Scalar> free(11, {3, 256}, false);
  prepare_bends(free.packed, Scalar(0.1), free.buffer.data(), free.scratch);
  for (int sweep = 0; sweep < 3; ++sweep)
    sweep_bends<false, false>(free.packed, free.scratch, free.buffer.data());
  std::vector<Vector3<double>> moved;
  for (std::size_t v = 0; v < free.points.size(); ++v)
    moved.push_back(
        free.buffer.template segment<3>(static_cast<Index>(4 * v)).template cast<double>() -
        free.points[v].at);
  CHECK(free.distance() > 0.1);
  CHECK(momenta(free.points, moved)[0].norm() < (std::is_same_v<Scalar, float> ? 1e-4 : 1e-12));

  Mesh<Scalar> mesh(12, {3, 256}, true);
  const VectorX<Scalar> before = mesh.buffer;
  prepare_bends(mesh.packed, Scalar(0.1), mesh.buffer.data(), mesh.scratch);
  sweep_bends<false, false>(mesh.packed, mesh.scratch, mesh.buffer.data());
  int held = 0;
  for (Index v = 0; v < kVertices + 2; ++v) {
    CHECK(mesh.buffer[4 * v + 3] == before[4 * v + 3]);
    if (before[4 * v + 3] > Scalar(0)) continue;
    ++held;
    CHECK(mesh.buffer.template segment<3>(4 * v) == before.template segment<3>(4 * v));
  }
  CHECK(held > 5);
}

TEST_CASE("bend batches: stencils without stiffness are left out", "[bend_batches]") {
  std::vector<BendStencil<double>> stencils(3);
  for (BendStencil<double>& s : stencils) {
    s.vertex = {0, 1, 2, 0};
    s.weight = {1, -2, 1, 0};
    s.count = 3;
  }
  CHECK(pack_bends(stencils, {1, 0}, 3).size() == 0);
  stencils[1].stiffness = 2;
  const BendBatches<double> packed = pack_bends(stencils, {1, 0}, 3);
  CHECK(packed.size() == batch_lanes<double>());
  CHECK(packed.stiffness.sum() == 2);
  CHECK(packed.vertex[3][0] == 12);
}

namespace {

/// Random hinges with folds on the points of a Mesh, which may be held.
template <class Scalar>
struct FoldedMesh : Mesh<Scalar> {
  using Mesh<Scalar>::packed;
  using Mesh<Scalar>::stencils;

  FoldedMesh(unsigned seed, const PackOrder& order, bool held) : Mesh<Scalar>(seed, order, held) {
    Numbers random(seed + 100);
    for (std::size_t e = 0; e < stencils.size(); ++e) {
      BendStencil<Scalar>& s = stencils[e];
      if (s.count != 4 || e % 4 == 0) continue;  // some rest flat
      for (std::size_t c = 2; c < 4; ++c) s.weight[c] = Scalar(random(-2, -0.2));
      s.weight[0] = Scalar(random(0.2, 1.5));
      s.weight[1] = -(s.weight[0] + s.weight[2] + s.weight[3]);
      s.rest_fold = Scalar(std::tan(random(-1.4, 1.4)));
    }
    packed = pack_bends(stencils, order, kVertices);
  }

  /// One visit of every stencil after the other, in double and plain code.
  void plain_sweep(double h, double relaxation, std::vector<Vector3<double>>& multiplier) {
    Points<double> x(3, kVertices);
    std::size_t at = 0;
    for (const BendStencil<Scalar>& listed : stencils) {
      if (!(Scalar(0) < listed.stiffness)) continue;
      BendStencil<double> s;
      s.vertex = listed.vertex;
      s.count = listed.count;
      s.rest_fold = static_cast<double>(listed.rest_fold);
      for (std::size_t c = 0; c < 4; ++c) s.weight[c] = static_cast<double>(listed.weight[c]);
      for (std::size_t v = 0; v < this->points.size(); ++v)
        x.col(static_cast<Index>(v)) = this->points[v].at;
      const FoldedHinge<double> hinge(s, x);
      const auto w = [&](std::size_t c) {
        return this->points[static_cast<std::size_t>(s.vertex[c])].w;
      };
      double bound = 0;
      for (std::size_t c = 0; c < static_cast<std::size_t>(s.count); ++c)
        bound += s.weight[c] * s.weight[c] * w(c);
      if (s.is_folded()) {
        const double sine = half_rest_angle(s)[1], skew = s.weight[2] - s.weight[3];
        const Vector3<double> o = x.col(s.vertex[0]);
        const Vector3<double> span =
            s.weight[3] * (x.col(s.vertex[3]) - o) - s.weight[2] * (x.col(s.vertex[2]) - o);
        const double squared =
            std::max((x.col(s.vertex[1]) - o).squaredNorm(), 1e-6 * span.squaredNorm());
        bound += sine * sine * (span.squaredNorm() / squared * (w(0) + w(1)) + skew * skew * w(0));
      }
      const Triple<double> e = bending_error<double>(s, x);
      const Vector3<double> error(e.x, e.y, e.z);
      const double k = h * h * static_cast<double>(listed.stiffness);
      Vector3<double>& sum = multiplier[at++];
      Vector3<double> change = -(k * error + sum) / (k * bound + 1.0);
      if (relaxation > 0)
        change = bound > 0 ? Vector3<double>(-relaxation / bound * error) : error * 0.0;
      sum += change;
      for (std::size_t c = 0; c < static_cast<std::size_t>(s.count); ++c) {
        const Triple<double> push{change[0], change[1], change[2]};
        const Triple<double> part =
            s.is_folded() ? hinge.share(static_cast<int>(c), push) : push * s.weight[c];
        PlainPoint& p = this->points[static_cast<std::size_t>(s.vertex[c])];
        p.at += p.w * Vector3<double>(part.x, part.y, part.z);
      }
    }
  }
};

}  // namespace

TEMPLATE_TEST_CASE("bend batches: folded hinges are a plain sequential sweep", "[bend_batches]",
                   float, double, long double) {
  using Scalar = TestType;
  const double h = static_cast<double>(Scalar(0.05));
  for (unsigned seed = 0; seed < 8; ++seed) {
    const bool rigid = seed % 2 == 0;
    FoldedMesh<Scalar> mesh(seed, {1, 0}, true);
    CHECK(mesh.packed.sine.size() == mesh.packed.size());
    std::vector<Vector3<double>> multiplier(mesh.stencils.size(), Vector3<double>::Zero());
    const double relaxation = seed % 4 == 0 ? 1.0 : 0.25;
    if (rigid)
      prepare_rigid_bends(mesh.packed, Scalar(relaxation), mesh.buffer.data(), mesh.scratch);
    if (!rigid) prepare_bends(mesh.packed, Scalar(h), mesh.buffer.data(), mesh.scratch);
    for (int sweep = 0; sweep < 3; ++sweep) {
      if (rigid || sweep == 0)
        std::fill(multiplier.begin(), multiplier.end(), Vector3<double>::Zero());
      if (rigid) sweep_bends<false, false>(mesh.packed, mesh.scratch, mesh.buffer.data());
      if (!rigid && sweep == 0)
        sweep_bends<false, true>(mesh.packed, mesh.scratch, mesh.buffer.data());
      if (!rigid && sweep > 0)
        sweep_bends<true, true>(mesh.packed, mesh.scratch, mesh.buffer.data());
      mesh.plain_sweep(h, rigid ? relaxation : 0.0, multiplier);
    }
    INFO("seed " << seed);
    CHECK(mesh.distance() < 20 * kSmall<Scalar>);
  }
}

TEMPLATE_TEST_CASE("bend batches: a visit of a folded hinge keeps both momenta", "[bend_batches]",
                   float, double, long double) {
  using Scalar = TestType;
  const double tolerance = std::is_same_v<Scalar, float> ? 1e-6 : 1e-14;
  for (unsigned seed = 0; seed < 20; ++seed) {
    FoldedMesh<Scalar> mesh(seed, {3, 256}, false);
    const auto folded = std::find_if(mesh.stencils.begin(), mesh.stencils.end(), [](const auto& s) {
      return s.is_folded() && Scalar(0) < s.stiffness;
    });
    REQUIRE(folded != mesh.stencils.end());
    mesh.packed = pack_bends<Scalar>({*folded}, {3, 256}, kVertices);
    prepare_bends(mesh.packed, Scalar(0.05), mesh.buffer.data(), mesh.scratch);
    sweep_bends<false, false>(mesh.packed, mesh.scratch, mesh.buffer.data());
    std::vector<Vector3<double>> moved;
    for (std::size_t v = 0; v < mesh.points.size(); ++v)
      moved.push_back(
          mesh.buffer.template segment<3>(static_cast<Index>(4 * v)).template cast<double>() -
          mesh.points[v].at);
    CHECK(mesh.distance() > 1e-3);
    for (const Vector3<double>& sum : momenta(mesh.points, moved)) CHECK(sum.norm() < tolerance);
  }
}
