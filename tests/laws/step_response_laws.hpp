#pragma once

// The laws that every StepResponse must obey, whatever its equations. Call
// check_step_response_laws(response, x, v, wind, dt, driven, tolerance) inside a TEST_CASE. The
// laws compute A w = (1 + h α) M w + R w from the functions of the response.
//
//   shapes      mass, force and held have one entry for each vertex; driven vertices are held
//   linear      K and R are linear
//   symmetric   uᵀK w = wᵀK u and the same for R
//   definite    wᵀA w > 0
//   inverse     A solve(b) = b on the free vertices, and held entries of b = 0 stay 0
//   lanes       each lane of a block gives the result that it gives alone
//   repeats     linearising again at the same state gives the same bits
//   wind        add_wind_force is linear and adds to its output

#include <random>
#include <utility>
#include <vector>

#include "clothctl/concepts/prediction.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// Returns {K w, R w}.
template <int kLanes, class Response, class Scalar = typename Response::Scalar>
std::pair<clothctl::Lanes<Scalar, kLanes>, clothctl::Lanes<Scalar, kLanes>> multiply(
    const Response& response, const clothctl::Lanes<Scalar, kLanes>& w) {
  std::pair<clothctl::Lanes<Scalar, kLanes>, clothctl::Lanes<Scalar, kLanes>> out{w, w};
  out.first.setZero();
  out.second.setZero();
  response.multiply(w, out.first, out.second);
  return out;
}

/// Checks all laws of this file at one state. Errors are relative to the largest entry and at most
/// `tolerance`.
template <clothctl::StepResponse Response, class Scalar = typename Response::Scalar>
void check_step_response_laws(Response& response, const clothctl::Points<Scalar>& x,
                              const clothctl::Points<Scalar>& v,
                              const clothctl::Vector3<Scalar>& wind, Scalar dt,
                              const std::vector<int>& driven, Scalar tolerance) {
  using Block = clothctl::Lanes<Scalar, 8>;
  using clothctl::Index;
  const Index n = response.vertex_count();
  REQUIRE(x.cols() == n);
  REQUIRE(response.linearise(x, v, wind, dt, driven));
  const std::vector<unsigned char> held = response.held();
  const clothctl::Points<Scalar> force = response.force();
  REQUIRE(response.mass().size() == n);
  REQUIRE(force.cols() == n);
  REQUIRE(held.size() == static_cast<std::size_t>(n));
  for (int i : driven) CHECK(held[static_cast<std::size_t>(i)] != 0);
  CHECK(clothctl::all_finite(force));
  CHECK(response.mass().minCoeff() > Scalar(0));
  CHECK(!(response.drag() < Scalar(0)));

  std::mt19937 random(17);
  std::normal_distribution<double> normal;
  const auto draw = [&](bool free_only) {
    Block block(8, 3 * n);
    for (Index j = 0; j < block.cols(); ++j) {
      const bool zero = free_only && held[static_cast<std::size_t>(j / 3)] != 0;
      for (Index i = 0; i < 8; ++i)
        block(i, j) = zero ? Scalar(0) : static_cast<Scalar>(normal(random));
    }
    return block;
  };
  const auto near = [&](const Block& a, const Block& b) {
    const Scalar size = a.cwiseAbs().maxCoeff() + b.cwiseAbs().maxCoeff();
    CHECK((a - b).cwiseAbs().maxCoeff() <= tolerance * size);
  };
  const auto step_matrix = [&](const Block& w) {
    Block out = multiply<8>(response, w).second;
    for (Index j = 0; j < out.cols(); ++j) {
      out.col(j) += (Scalar(1) + dt * response.drag()) * response.mass()[j / 3] * w.col(j);
    }
    return out;
  };

  const Block u = draw(false), w = draw(false);
  const auto [k_u, r_u] = multiply<8>(response, u);
  const auto [k_w, r_w] = multiply<8>(response, w);
  {
    INFO("law: linear");
    const auto [k_sum, r_sum] = multiply<8>(response, Block(Scalar(2) * u - w));
    near(k_sum, Scalar(2) * k_u - k_w);
    near(r_sum, Scalar(2) * r_u - r_w);
  }
  {
    INFO("law: symmetric");
    const auto check = [&](const Block& a_u, const Block& a_w) {
      for (Index lane = 0; lane < 8; ++lane) {
        const Scalar there = w.row(lane).dot(a_u.row(lane)), back = u.row(lane).dot(a_w.row(lane));
        const Scalar size =
            w.row(lane).norm() * a_u.row(lane).norm() + u.row(lane).norm() * a_w.row(lane).norm();
        CHECK((there - back < Scalar(0) ? back - there : there - back) <= tolerance * size);
      }
    };
    check(k_u, k_w);
    check(r_u, r_w);
  }
  {
    INFO("law: definite");
    const Block a_w = step_matrix(w);
    for (Index lane = 0; lane < 8; ++lane) CHECK(w.row(lane).dot(a_w.row(lane)) > Scalar(0));
  }
  {
    INFO("law: inverse");
    const Block b = draw(true);
    Block solved = b;
    response.solve(solved);
    Block back = step_matrix(solved);
    for (Index i = 0; i < n; ++i) {
      if (held[static_cast<std::size_t>(i)] == 0) continue;
      CHECK(solved.template middleCols<3>(3 * i).isZero(Scalar(0)));
      back.template middleCols<3>(3 * i).setZero();
    }
    near(back, b);
    INFO("law: lanes");
    Block same = b;
    for (Index lane = 0; lane < 8; ++lane) same.row(lane) = b.row(3);
    response.solve(same);
    for (Index lane = 0; lane < 8; ++lane) {
      CHECK((same.row(lane) - solved.row(3)).cwiseAbs().maxCoeff() <=
            tolerance * solved.cwiseAbs().maxCoeff());
    }
    INFO("law: repeats");
    REQUIRE(response.linearise(x, v, wind, dt, driven));
    Block again = b;
    response.solve(again);
    CHECK(again == solved);
    CHECK(response.force() == force);
    CHECK(response.held() == held);
  }
  {
    INFO("law: wind");
    clothctl::Points<Scalar> one = clothctl::Points<Scalar>::Zero(3, n), two = one;
    const clothctl::Vector3<Scalar> gust(Scalar(0.3), Scalar(-0.2), Scalar(0.5));
    response.add_wind_force(gust, one);
    response.add_wind_force(Scalar(3) * gust, two);
    response.add_wind_force(gust, two);
    CHECK((two - Scalar(4) * one).cwiseAbs().maxCoeff() <=
          tolerance * (Scalar(1) + two.cwiseAbs().maxCoeff()));
  }
}

}  // namespace clothctl_test
