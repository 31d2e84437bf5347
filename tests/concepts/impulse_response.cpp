// A body of another engine takes part as a side of contacts through its trait; what is not a side
// is answered with "no".

#include "clothctl/concepts/impulse_response.hpp"

#include <string>
#include <vector>

#include "clothctl/contact/contact_solver.hpp"
#include "laws/impulse_response_laws.hpp"
#include "support/catch.hpp"

namespace other_engine {

// A cart on a rail along x that carries hooks; its velocity is a plain number.
struct Cart {
  double kg;
  double speed;
  std::vector<double> hooks;  // places along the rail
};

}  // namespace other_engine

template <>
struct clothctl::impulse_response_traits<other_engine::Cart> {
  using Cart = other_engine::Cart;
  static std::size_t point_count(const Cart& cart) { return cart.hooks.size(); }
  static void velocities(const Cart& cart, Eigen::Ref<VectorX<double>> u) {
    u.setZero();
    for (Index i = 0; i < u.size(); i += 3) u[i] = cart.speed;
  }
  static void add_mobility(const Cart& cart, Eigen::Ref<MatrixX<double>> W) {
    for (Index j = 0; j < W.cols(); j += 3) {
      for (Index i = 0; i < W.rows(); i += 3) W(i, j) += 1 / cart.kg;
    }
  }
  static void apply(Cart& cart, const Eigen::Ref<const VectorX<double>>& p) {
    for (Index i = 0; i < p.size(); i += 3) cart.speed += p[i] / cart.kg;
  }
};

using namespace clothctl;

namespace {

struct Empty {};
// A side whose apply needs more than impulses.
struct Timed {
  int point_count() const { return 0; }
  void velocities(Eigen::Ref<VectorX<double>>) const {}
  void add_mobility(Eigen::Ref<MatrixX<double>>) const {}
  void apply(const Eigen::Ref<const VectorX<double>>&, double) {}
};
// One that cannot tell its mobility when it is const.
struct Lazy {
  int point_count() const { return 0; }
  void velocities(Eigen::Ref<VectorX<double>>) const {}
  void add_mobility(Eigen::Ref<MatrixX<double>>) {}
  void apply(const Eigen::Ref<const VectorX<double>>&) {}
};
struct Whole : Lazy {
  void add_mobility(Eigen::Ref<MatrixX<double>>) const {}
};

}  // namespace

static_assert(ImpulseResponse<other_engine::Cart> && !ImpulseResponse<other_engine::Cart, float>);
static_assert(ImpulseResponse<Whole> && !ImpulseResponse<Timed> && !ImpulseResponse<Lazy>);
static_assert(ImpulseResponse<ImpulseResponseRef<double>> &&
              !ImpulseResponse<ImpulseResponseRef<double>, float>);
static_assert(!ImpulseResponse<Empty> && !ImpulseResponse<int> &&
              !ImpulseResponse<Whole, std::string>);

TEST_CASE("a foreign body obeys the laws of impulse responses", "[concepts]") {
  other_engine::Cart cart{2.0, 0.3, {0.0, 0.5}};
  clothctl_test::check_impulse_response_laws<double>(cart, 1e-14);
}

TEST_CASE("foreign bodies collide through the contact solver", "[concepts]") {
  // A cart of 2 kg runs into one of 6 kg: without restitution both go on at a quarter of the speed.
  other_engine::Cart first{2.0, 1.0, {0.0}}, second{6.0, 0.0, {0.0}};
  std::vector<ContactSample<double>> contacts(1);
  contacts[0].a = {1, {0, -1, -1}, {1, 0, 0}};
  contacts[0].b = {0, {0, -1, -1}, {1, 0, 0}};
  contacts[0].normal = {1, 0, 0};
  ContactSolver<double> solver;
  solver.reserve(1, 1);
  REQUIRE(solver.solve(contacts, 0.01, first, second).status == ContactStatus::Solved);
  REQUIRE(solver.apply(contacts, first, second) == ContactStatus::Solved);
  CHECK(first.speed == Approx(0.25).epsilon(1e-14));
  CHECK(second.speed == Approx(0.25).epsilon(1e-14));
  CHECK(contacts[0].impulse[0] == Approx(1.5).epsilon(1e-14));
}
