#include "clothctl/qp/detail/zero_curvature_direction.hpp"

#include <random>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

// A dense H, the factor of the unknowns `free`, and memory for a direction.
template <class S>
struct Scene {
  MatrixX<S> H;
  detail::DenseCurvature<S> curvature;
  detail::ZeroCurvatureDirection<S> flat;
  std::vector<Index> moving;
  VectorX<S> p, g, lo, hi;

  Scene(const MatrixX<S>& given, Index free) : H(given) {
    const Index n = H.rows();
    curvature.reserve(n);
    curvature.attach(Eigen::Map<const MatrixX<S>>(H.data(), n, n));
    for (Index i = 0; i < free; ++i) curvature.append(i);
    flat.reserve(n);
    moving.assign(static_cast<std::size_t>(n), 0);
    p.setZero(n);
    g.setZero(n);
    const S none = detail::no_bound<S>();
    lo.setConstant(n, -none);
    hi.setConstant(n, none);
  }
  bool is_ray(Index count) { return flat.is_ray(curvature, moving, count, p, g, lo, hi); }
};

// JᵀJ of n unknowns. Unknown `last` is a sum of earlier ones with small integer factors, so that
// the dependence is exact.
template <class S>
MatrixX<S> dependent(Index n, Index last, unsigned seed) {
  std::mt19937 random(seed);
  const auto draw = [&] { return S(static_cast<int>(random() % 7) - 3); };
  MatrixX<S> J(n, n);
  for (Index k = 0; k < J.size(); ++k) J.data()[k] = draw();
  for (Index i = 0; i < last; ++i) J(i, i) += S(8);
  J.col(last) = J.leftCols(last).rowwise().sum();
  return J.transpose() * J;
}

}  // namespace

TEMPLATE_TEST_CASE("a dependent unknown gives a direction without curvature", "[qp]", float,
                   double) {
  using S = TestType;
  for (unsigned seed = 0; seed < 20; ++seed) {
    const Index last = 3 + static_cast<Index>(seed % 7), n = last + 1;
    Scene<S> scene(dependent<S>(n, last, seed), last);
    REQUIRE(scene.curvature.size() == last);
    const long before = clothctl_test::allocations();
    const Index count = scene.flat.open(scene.curvature, last, S(-1), scene.moving, scene.p);
    scene.g[last] = S(1);
    const bool proven = scene.is_ray(count);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    REQUIRE(count == n);
    CHECK(scene.p[last] == S(-1));
    // The others compensate: each moves by +1.
    const S loose = S(1000) * scalar_traits<S>::epsilon();
    CHECK((scene.p.head(last) - VectorX<S>::Ones(last)).cwiseAbs().maxCoeff() < loose);
    CHECK((scene.H * scene.p).cwiseAbs().maxCoeff() < loose * scene.H.cwiseAbs().maxCoeff());
    CHECK(proven);
    CHECK((scene.flat.ray() - scene.p / scene.p.cwiseAbs().maxCoeff()).cwiseAbs().maxCoeff() <
          loose);
  }
}

TEMPLATE_TEST_CASE(
    "a direction is no ray if it rises, meets a bound, or has curvature outside the factor", "[qp]",
    float, double) {
  using S = TestType;
  const Index last = 4;
  const auto open = [&](Scene<S>& scene, const S& sign) {
    scene.g[last] = S(1);
    return scene.flat.open(scene.curvature, last, sign, scene.moving, scene.p);
  };
  {
    Scene<S> scene(dependent<S>(last + 1, last, 3), last);
    CHECK(scene.is_ray(open(scene, S(-1))));
    CHECK_FALSE(scene.is_ray(open(scene, S(1))));  // rises
    scene.hi[2] = S(1e6);
    CHECK_FALSE(scene.is_ray(open(scene, S(-1))));  // unknown 2 grows
    scene.hi[2] = detail::no_bound<S>();
    scene.lo[2] = S(0);
    CHECK(scene.is_ray(open(scene, S(-1))));
  }
  {  // one more unknown outside the factor, which the direction moves too
    MatrixX<S> H = MatrixX<S>::Zero(last + 2, last + 2);
    H.topLeftCorner(last + 1, last + 1) = dependent<S>(last + 1, last, 3);
    H(last + 1, last + 1) = S(4);
    H(last + 1, last) = H(last, last + 1) = S(1);
    Scene<S> scene(H, last);
    CHECK_FALSE(scene.is_ray(open(scene, S(-1))));
  }
}

TEMPLATE_TEST_CASE("a rounding error in an uninvolved unknown does not hide a ray", "[qp]", float,
                   double) {
  using S = TestType;
  MatrixX<S> H = MatrixX<S>::Zero(3, 3);
  H(0, 0) = S(2);  // unknown 1 alone is flat; rounding in the factor moved unknown 0 a little
  Scene<S> scene(H, 1);
  scene.g << S(0), S(1), S(0);
  scene.moving = {0, 1, 0};
  scene.p << std::sqrt(scalar_traits<S>::epsilon()), S(-1), S(0);
  CHECK(scene.is_ray(2));
  CHECK(scene.flat.ray()[0] == S(0));
  scene.p[1] = std::numeric_limits<S>::quiet_NaN();
  CHECK_FALSE(scene.is_ray(2));
}
