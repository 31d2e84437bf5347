// A foreign contact satisfies ContactModel by a trait alone. For other types the concept is false
// instead of a compile error.

#include "clothctl/concepts/contact_model.hpp"

#include <cmath>
#include <string>
#include <vector>

#include "clothctl/contact/grip.hpp"
#include "laws/contact_laws.hpp"
#include "support/catch.hpp"

namespace other_engine {

// A fingertip that rolls freely along x. It has friction only along y, and adheres a little.
struct Roller {
  float grip = 0.8f;   // tangential force over normal force
  float stick = 0.2f;  // N
};

}  // namespace other_engine

template <>
struct clothctl::contact_traits<other_engine::Roller> {
  using Roller = other_engine::Roller;
  using View = PointsView<double>;
  static int generators(const Roller&, Index vertices) { return static_cast<int>(2 * vertices); }
  static std::pair<Index, Index> support(const Roller&, Index, Index i) { return {i / 2, 1}; }
  /// The unit vector along the part of the y axis that is orthogonal to the normal.
  static Vector3<double> axle(const Vector3<double>& normal) {
    Vector3<double> t(0, 1, 0);
    t -= t.dot(normal) * normal;
    return t / t.norm();
  }
  static void fill(const Roller& r, const View&, const View& normals,
                   Eigen::Ref<MatrixX<double>> out) {
    out.setZero();
    for (Index j = 0; j < normals.cols(); ++j) {
      const Vector3<double> n = normals.col(j), t = axle(n);
      out.block<3, 1>(3 * j, 2 * j) = n + double(r.grip) * t;
      out.block<3, 1>(3 * j, 2 * j + 1) = n - double(r.grip) * t;
    }
  }
  static double normal_share(const Roller&, Index, Index) { return 1; }
  static double upper_bound(const Roller& r, Index, Index, double limit) {
    return limit + double(r.stick);
  }
  static double violation(const Roller& r, const View&, const View& normals, const View& forces,
                          double limit) {
    double worst = 0, total = 0;
    for (Index j = 0; j < forces.cols(); ++j) {
      const Vector3<double> n = normals.col(j), t = axle(n), f = forces.col(j);
      const double pressed = f.dot(n) + double(r.stick) / static_cast<double>(forces.cols());
      const double along = f.dot(t), across = (f - f.dot(n) * n - along * t).norm();
      total += f.dot(n);
      if (!is_finite(pressed + along + across)) return scalar_traits<double>::infinity();
      worst = std::max({worst, across, std::abs(along) - double(r.grip) * pressed, -pressed});
    }
    if (!is_finite(limit)) return scalar_traits<double>::infinity();
    return std::max(worst, total - limit);
  }
  static std::string validate(const Roller& r) { return r.grip < 0 ? "negative grip" : ""; }
  static double adhesion(const Roller& r) { return double(r.stick); }
};

using namespace clothctl;

namespace {

struct Empty {};
// A contact model without normal shares.
struct Shareless {
  Index generators(Index n) const { return n; }
  std::pair<Index, Index> support(Index, Index i) const { return {i, 1}; }
  void fill(const PointsView<double>&, const PointsView<double>&,
            Eigen::Ref<MatrixX<double>>) const {}
  double upper_bound(Index, Index, double limit) const { return limit; }
  double violation(const PointsView<double>&, const PointsView<double>&, const PointsView<double>&,
                   double) const {
    return 0;
  }
  std::string validate() const { return {}; }
};
struct Whole : Shareless {
  double normal_share(Index, Index) const { return 1; }
};
// A contact model that writes only to whole matrices, while a planner passes a block of one.
struct Greedy : Whole {
  void fill(const PointsView<double>&, const PointsView<double>&, MatrixX<double>&) const {}
};

}  // namespace

static_assert(ContactModel<other_engine::Roller> && !ContactModel<other_engine::Roller, float>);
static_assert(ContactModel<Whole> && !ContactModel<Shareless> && !ContactModel<Greedy>);
static_assert(!ContactModel<Empty> && !ContactModel<int> && !ContactModel<std::string> &&
              !ContactModel<Whole, std::string>);

TEST_CASE("a foreign contact obeys the laws and makes a grip", "[concepts]") {
  const other_engine::Roller roller;
  clothctl_test::check_contact_laws<double>(roller, 1e-12);
  using Rolling = Grip<double, other_engine::Roller>;
  const Rolling pinch = make_pinch<double>({4, 2}, roller, 3.0);
  CHECK(pinch.vertices() == std::vector<int>{2, 4});
  CHECK(validate_grips(std::vector<Rolling>{pinch}, 5) == "");
  CHECK(validate_grips(
            std::vector<Rolling>{make_pinch<double>({1}, other_engine::Roller{-1, 0}, 3.0)}, 5) ==
        "grip 0 finger 0 has negative grip");
}
