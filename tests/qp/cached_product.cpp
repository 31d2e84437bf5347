#include "clothctl/qp/detail/cached_product.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

// A dense H that counts products with it.
struct Counting {
  MatrixX<double> H;
  int products = 0;
  Index unknowns() const { return H.rows(); }
  void add_product(const VectorX<double>& x, VectorX<double>& q) {
    ++products;
    q.head(H.rows()) += H * x.head(H.rows());
  }
};

}  // namespace

TEST_CASE("a cached product is computed once for an x and updated after small moves", "[qp]") {
  const Index n = 20;
  Counting curvature{MatrixX<double>::Random(n, n)};
  detail::CachedProduct<double> product;
  product.reserve(n + 3);
  VectorX<double> x = VectorX<double>::Random(n + 3);
  const auto right = [&](const VectorX<double>& q) {
    return (q.head(n) - curvature.H * x.head(n)).norm() < 1e-13;
  };
  CHECK(right(product.update(curvature, x)));
  CHECK(right(product.refresh(curvature, x)));
  CHECK(curvature.products == 1);
  CHECK(product.is_of(x, n));
  x.segment(3, 4) *= 2.0;
  CHECK_FALSE(product.is_of(x, n));
  CHECK(right(product.update(curvature, x)));
  CHECK(curvature.products == 2);
  CHECK(right(product.refresh(curvature, x)));  // an update does not count as a refresh
  CHECK(curvature.products == 3);
  x *= -1.0;
  CHECK(right(product.update(curvature, x)));
  CHECK(right(product.update(curvature, x)));
  CHECK(curvature.products == 4);
  curvature.H *= 3.0;
  product.forget();
  CHECK(right(product.update(curvature, x)));
}

TEST_CASE("a product that is not finite is not cached", "[qp]") {
  Counting curvature{MatrixX<double>::Identity(3, 3)};
  detail::CachedProduct<double> product;
  product.reserve(3);
  VectorX<double> x = VectorX<double>::Ones(3);
  x[1] = std::numeric_limits<double>::quiet_NaN();
  (void)product.refresh(curvature, x);
  x[1] = 2.0;
  CHECK(product.update(curvature, x) == x);
}
