#pragma once

// A pinch for the tests of contact solvers: a light sheet between two heavy pads, all with dense
// mobilities, in random motion; and sides that are nothing but a mobility.

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <vector>

#include "clothctl/contact/detail/contact_sample.hpp"
#include "support/sweeps.hpp"

namespace clothctl_test {

using clothctl::ContactSample;
using clothctl::Index;
using clothctl::MatrixX;
using clothctl::Points;
using clothctl::Vector3;
using clothctl::VectorX;

/// A side with a dense mobility W and the velocities u of its points.
template <class S>
struct DenseSide {
  MatrixX<S> W;
  VectorX<S> u;

  Index point_count() const { return u.size() / 3; }
  void velocities(Eigen::Ref<VectorX<S>> out) const { out = u; }
  void add_mobility(Eigen::Ref<MatrixX<S>> out) const { out += W; }
  void apply(const Eigen::Ref<const VectorX<S>>& p) { u.noalias() += W * p; }
};

/// A sheet, two pads, and the contacts between them. Side 0 is the sheet, 1 and 2 are the pads.
template <class S>
struct Pinch {
  DenseSide<S> sheet, lower, upper;
  std::vector<ContactSample<S>> contacts;
  S dt = S(0.02);
};

/// How a pinch is made.
struct PinchSettings {
  /// Contacts, half of them on each pad.
  int contacts = 8;
  /// Stiffness of a whole pad, N/m; 0 for rigid contacts.
  double stiffness = 2000;
  /// Largest velocity at random, m/s, and velocity of the pads towards each other, m/s.
  double motion = 0.1, squeeze = 0.24;
  double friction = 0.6;
};

namespace pinch_detail {

/// The inverse step matrix of a sheet of side × side vertices, 1.56 cm apart, for h = 0.02 s.
inline Eigen::MatrixXd sheet_mobility(int side, double h) {
  const double spacing = 0.0156, mass = 0.2 * spacing * spacing, k = 200;
  Eigen::MatrixXd A = mass * Eigen::MatrixXd::Identity(3 * side * side, 3 * side * side);
  const auto spring = [&](int r, int c, int R, int C) {
    if (R >= side || C >= side || C < 0) return;
    const Eigen::Vector3d d = Eigen::Vector3d(C - c, R - r, 0).normalized();
    const Eigen::Matrix3d K = h * h * k * (d * d.transpose() + 0.02 * Eigen::Matrix3d::Identity());
    const int a = 3 * (r * side + c), b = 3 * (R * side + C);
    A.block<3, 3>(a, a) += K;
    A.block<3, 3>(b, b) += K;
    A.block<3, 3>(a, b) -= K;
    A.block<3, 3>(b, a) -= K;
  };
  for (int r = 0; r < side; ++r) {
    for (int c = 0; c < side; ++c) {
      spring(r, c, r, c + 1);
      spring(r, c, r + 1, c);
      spring(r, c, r + 1, c + 1);
      spring(r, c, r + 1, c - 1);
    }
  }
  const Eigen::MatrixXd inverse = A.llt().solve(Eigen::MatrixXd::Identity(A.rows(), A.cols()));
  return 0.5 * (inverse + inverse.transpose());
}

/// The mobility of points of a body of 20 g under PD control.
inline Eigen::MatrixXd pad_mobility(const std::vector<Eigen::Vector3d>& arms) {
  const Index n = static_cast<Index>(arms.size());
  Eigen::MatrixXd J(3 * n, 6);
  for (Index i = 0; i < n; ++i) {
    const Eigen::Vector3d& r = arms[static_cast<std::size_t>(i)];
    J.block<3, 3>(3 * i, 0).setIdentity();
    J.block<3, 3>(3 * i, 3) << 0, r[2], -r[1], -r[2], 0, r[0], r[1], -r[0], 0;
  }
  Eigen::VectorXd inverse(6);
  inverse << 2.4, 2.4, 2.4, 8e3, 8e3, 8e3;
  return J * inverse.asDiagonal() * J.transpose();
}

}  // namespace pinch_detail

/// Makes a pinch at random.
template <class S>
Pinch<S> make_pinch_problem(const PinchSettings& settings, unsigned seed) {
  Numbers random(seed);
  const int side = 9;
  const double spacing = 0.0156, h = 0.02;
  static const Eigen::MatrixXd A = pinch_detail::sheet_mobility(side, h);
  Pinch<S> pinch;
  // The pads touch the sheet within 6 mm of its middle: all points are in four cells.
  std::vector<int> touched;
  for (int r = 3; r <= 5; ++r) {
    for (int c = 3; c <= 5; ++c) touched.push_back(r * side + c);
  }
  const Index n = static_cast<Index>(touched.size());
  Eigen::MatrixXd Y(3 * n, 3 * n);
  Eigen::VectorXd u(3 * n);
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j)
      Y.block<3, 3>(3 * i, 3 * j) = A.block<3, 3>(3 * touched[static_cast<std::size_t>(i)],
                                                  3 * touched[static_cast<std::size_t>(j)]);
    for (Index k = 0; k < 3; ++k) u[3 * i + k] = random(-settings.motion, settings.motion);
  }
  pinch.sheet = {Y.cast<S>(), u.cast<S>()};
  const int half = settings.contacts / 2;
  std::array<std::vector<Eigen::Vector3d>, 2> arms;
  for (int k = 0; k < settings.contacts; ++k) {
    const std::size_t pad = k < half ? 0 : 1;
    const double up = pad == 0 ? 1.0 : -1.0;
    const double turn = random(0, 6.2831853), radius = 0.006 * std::sqrt(random(0, 1));
    const double x = radius * std::cos(turn), y = radius * std::sin(turn);
    ContactSample<S> contact;
    const int col = x < 0 ? 0 : 1, row = y < 0 ? 0 : 1;
    const double s = (x / spacing) + 1 - col, t = (y / spacing) + 1 - row;  // in the cell, 0 to 1
    const int v00 = row * 3 + col;
    contact.a.side = 0;
    if (s + t < 1) {
      contact.a.point = {v00, v00 + 1, v00 + 3};
      contact.a.weight = Vector3<S>(S(1 - s - t), S(s), S(t));
    } else {
      contact.a.point = {v00 + 4, v00 + 3, v00 + 1};
      contact.a.weight = Vector3<S>(S(s + t - 1), S(1 - s), S(1 - t));
    }
    contact.b.side = static_cast<int>(pad) + 1;
    contact.b.point[0] = static_cast<int>(arms[pad].size());
    arms[pad].push_back({x, y, -0.01 * up});
    const Eigen::Vector3d tilt(0.1 * x / 0.006, 0.1 * y / 0.006, up);
    contact.normal = tilt.normalized().cast<S>();
    contact.friction = S(settings.friction);
    contact.gap = S(random(-1e-4, 1e-4));
    if (settings.stiffness > 0) {
      contact.compliance = contact.tangential_compliance = S(half / settings.stiffness);
      contact.damping = S(0.1);
      contact.offset = Vector3<S>(S(random(-1e-4, 1e-4)), S(random(-1e-4, 1e-4)), S(0));
    }
    pinch.contacts.push_back(contact);
  }
  for (std::size_t pad = 0; pad < 2; ++pad) {
    const Index points = static_cast<Index>(arms[pad].size());
    const double up = pad == 0 ? 1.0 : -1.0;
    const Eigen::Vector3d v(random(-settings.motion, settings.motion),
                            random(-settings.motion, settings.motion), up * settings.squeeze);
    Eigen::VectorXd speed(3 * points);
    for (Index i = 0; i < points; ++i) speed.segment<3>(3 * i) = v;
    DenseSide<S>& to = pad == 0 ? pinch.lower : pinch.upper;
    to.W = pinch_detail::pad_mobility(arms[pad]).cast<S>();
    to.u = speed.cast<S>();
  }
  return pinch;
}

}  // namespace clothctl_test
