#pragma once

// The linearised step of a spring network, written once more with dense matrices, straight from its
// definition. Tests compare sparse predictors with it.
//
//   A v⁺ = M v + h ( f - K q + E u + G (w - w_1) ),   x⁺ = x + h v⁺,
//   A = (1 + h α) M + h (D + C) + h² K

#include <Eigen/Dense>
#include <cmath>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"

namespace clothctl_test {

struct DenseStep {
  double dt = 0;
  Eigen::MatrixXd A, K, wind_force;  // wind_force: 3n×3
  Eigen::VectorXd mass, f;           // 3n each
  std::vector<bool> held;

  /// Linearises about (x, v) in air that moves at `wind`. `driven` and pinned vertices are
  /// prescribed.
  DenseStep(const clothctl::MassSpring<double>& model, const clothctl::Points<double>& x,
            const clothctl::Points<double>& v, const Eigen::Vector3d& wind, double h,
            const std::vector<int>& driven)
      : dt(h), held(static_cast<std::size_t>(x.cols()), false) {
    const clothctl::SpringNetwork<double>& net = model.network();
    const clothctl::MassSpringSettings<double>& set = model.settings();
    const Eigen::Index n = x.cols();
    for (int i : set.pinned) held[static_cast<std::size_t>(i)] = true;
    for (int i : driven) held[static_cast<std::size_t>(i)] = true;
    K.setZero(3 * n, 3 * n);
    Eigen::MatrixXd D = K;
    mass.resize(3 * n);
    f.resize(3 * n);
    wind_force.setZero(3 * n, 3);
    for (Eigen::Index i = 0; i < n; ++i) {
      mass.segment<3>(3 * i).setConstant(net.mass[i]);
      f.segment<3>(3 * i) = net.mass[i] * set.gravity;
    }
    const auto couple = [](Eigen::MatrixXd& out, int a, int b, const Eigen::Matrix3d& s) {
      out.block<3, 3>(3 * a, 3 * a) += s;
      out.block<3, 3>(3 * b, 3 * b) += s;
      out.block<3, 3>(3 * a, 3 * b) -= s;
      out.block<3, 3>(3 * b, 3 * a) -= s;
    };
    const Eigen::Matrix3d I = Eigen::Matrix3d::Identity();
    for (const auto& s : net.springs) {
      const Eigen::Vector3d d = x.col(s.a) - x.col(s.b), e = d.normalized();
      const Eigen::Matrix3d along = e * e.transpose();
      couple(K, s.a, s.b,
             s.stiffness * (along + std::max(0.0, 1.0 - s.rest_length / d.norm()) * (I - along)));
      couple(D, s.a, s.b, s.damping * along);
      const Eigen::Vector3d pull = s.stiffness * (d.norm() - s.rest_length) * e;
      f.segment<3>(3 * s.a) -= pull;
      f.segment<3>(3 * s.b) += pull;
    }
    for (const auto& b : net.bends) {
      for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i) {
        for (std::size_t j = 0; j < static_cast<std::size_t>(b.count); ++j) {
          const double k = b.stiffness * b.weight[i] * b.weight[j];
          K.block<3, 3>(3 * b.vertex[i], 3 * b.vertex[j]) += k * I;
          f.segment<3>(3 * b.vertex[i]) -= k * x.col(b.vertex[j]);
        }
      }
    }
    if (set.air.enabled()) {
      for (const auto& t : net.triangles) {
        const Eigen::Vector3d cross = (x.col(t[1]) - x.col(t[0])).cross(x.col(t[2]) - x.col(t[0]));
        const Eigen::Vector3d normal = cross.normalized();
        const Eigen::Vector3d r = wind - (v.col(t[0]) + v.col(t[1]) + v.col(t[2])) / 3.0;
        const double r_n = r.dot(normal), r_t = (r - r_n * normal).norm();
        const Eigen::Matrix3d C =
            0.5 * set.air.density * 0.5 * cross.norm() *
            (set.air.normal_coefficient * std::abs(r_n) * normal * normal.transpose() +
             set.air.tangent_coefficient * r_t * (I - normal * normal.transpose()));
        for (int i : t) {
          wind_force.block<3, 3>(3 * i, 0) += C / 3.0;
          f.segment<3>(3 * i) += C * wind / 3.0;
          for (int j : t) D.block<3, 3>(3 * i, 3 * j) += C / 9.0;
        }
      }
    }
    A = h * D + h * h * K;
    A.diagonal() += (1.0 + h * set.drag) * mass;
    free_ = Eigen::LLT<Eigen::MatrixXd>(reduced(A));
  }

  /// Returns the vertex positions at the end of frames 1 … K from (x, v): 3n × K. `u`
  /// (3·inputs.size() × K) holds the forces on the vertices `inputs` or, if those are held, their
  /// velocities. `wind` (3×K) replaces the wind of the linearisation.
  Eigen::MatrixXd rollout(const clothctl::Points<double>& x, const clothctl::Points<double>& v,
                          const std::vector<int>& inputs, const Eigen::MatrixXd& u,
                          const Eigen::MatrixXd& wind) const {
    const Eigen::Index n3 = x.size(), frames = u.cols();
    Eigen::VectorXd q = Eigen::VectorXd::Zero(n3),
                    w = Eigen::Map<const Eigen::VectorXd>(v.data(), n3);
    Eigen::MatrixXd out(n3, frames);
    for (Eigen::Index k = 0; k < frames; ++k) {
      Eigen::VectorXd rhs =
          mass.cwiseProduct(w) + dt * (f - K * q + wind_force * (wind.col(k) - wind.col(0)));
      Eigen::VectorXd next = Eigen::VectorXd::Zero(n3);
      for (std::size_t j = 0; j < inputs.size(); ++j) {
        const Eigen::Vector3d given = u.block<3, 1>(3 * static_cast<Eigen::Index>(j), k);
        if (held[static_cast<std::size_t>(inputs[j])]) {
          next.segment<3>(3 * inputs[j]) = given;
        } else {
          rhs.segment<3>(3 * inputs[j]) += dt * given;
        }
      }
      rhs -= A * next;  // moves the prescribed columns to the right-hand side
      const Eigen::VectorXd solved = free_.solve(gather(rhs));
      Eigen::Index row = 0;
      for (std::size_t i = 0; i < held.size(); ++i) {
        if (!held[i])
          next.segment<3>(3 * static_cast<Eigen::Index>(i)) = solved.segment<3>(3 * row++);
      }
      w = next;
      q += dt * w;
      out.col(k) = Eigen::Map<const Eigen::VectorXd>(x.data(), n3) + q;
    }
    return out;
  }

 private:
  Eigen::VectorXd gather(const Eigen::VectorXd& full) const {
    Eigen::VectorXd out(full.size());
    Eigen::Index row = 0;
    for (std::size_t i = 0; i < held.size(); ++i) {
      if (!held[i]) out.segment<3>(3 * row++) = full.segment<3>(3 * static_cast<Eigen::Index>(i));
    }
    return out.head(3 * row);
  }
  Eigen::MatrixXd reduced(const Eigen::MatrixXd& full) const {
    Eigen::MatrixXd rows(full.rows(), full.cols());
    Eigen::Index count = 0;
    for (Eigen::Index j = 0; j < full.cols(); ++j) {
      if (!held[static_cast<std::size_t>(j / 3)]) rows.row(count++) = full.row(j);
    }
    Eigen::MatrixXd out(count, count);
    count = 0;
    for (Eigen::Index j = 0; j < full.cols(); ++j) {
      if (!held[static_cast<std::size_t>(j / 3)]) out.col(count++) = rows.col(j).head(out.rows());
    }
    return out;
  }

  Eigen::LLT<Eigen::MatrixXd> free_;
};

}  // namespace clothctl_test
