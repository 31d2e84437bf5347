#pragma once

// A sheet that is moved along whole paths of its hands: where its features go, and the products of
// their Jacobian J and of Jᵀ with vectors. One factor of the step matrix is kept for each frame; a
// sweep forward through the frames gives J v, one backward Jᵀ w.

#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/mass_spring_derivative.hpp"
#include "clothctl/mpc/detail/held_vertices.hpp"
#include "clothctl/prediction/features.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Paths are matrices of 3·grips × frames, features of 3·features × frames, m.
template <RealScalar Scalar>
class CurveSweeps {
 public:
  /// A sheet that starts at `start`, in frames of `dt` (s). A grip moves its vertices by the motion
  /// of its centroid. `derivative` is that of `model`, with the vertices of `held` driven.
  /// Allocates.
  CurveSweeps(const MassSpring<Scalar>& model, MassSpringDerivative<Scalar> derivative,
              HeldVertices<Scalar> held, PointFeatures<Scalar> features,
              const ClothState<Scalar>& start, Scalar dt, Index frames)
      : model_(model),
        derivative_(std::move(derivative)),
        memory_(derivative_.make_memory()),
        held_(std::move(held)),
        features_(std::move(features)),
        dt_(dt),
        ws_(model.make_workspace()),
        states_(static_cast<std::size_t>(frames) + 1, start),
        steps_(static_cast<std::size_t>(frames)) {
    input_.driven_vertices = held_.vertices();
    input_.driven_positions.setZero(3, static_cast<Index>(held_.vertices().size()));
    change_.setZero(1, 3 * input_.driven_positions.cols());
    points_.setZero(3, features_.count());
    x_.setZero(1, 3 * model.vertex_count());
    v_ = x_;
  }

  /// Returns the number of frames.
  Index frames() const { return static_cast<Index>(steps_.size()); }
  /// Returns the grips.
  const HeldVertices<Scalar>& held() const { return held_; }
  /// Returns the state after `frame` frames of the last rollout.
  const ClothState<Scalar>& state(Index frame) const {
    return states_[static_cast<std::size_t>(frame)];
  }
  /// Returns in how many frames the exact stiffness was not definite when last linearised.
  int weakened() const { return weakened_; }

  /// Moves the sheet along `path` and writes its features. Returns the frame that failed, or -1.
  Index roll_out(const MatrixX<Scalar>& path, MatrixX<Scalar>& features) {
    for (Index k = 0; k < frames(); ++k) {
      const std::size_t i = static_cast<std::size_t>(k);
      for (std::size_t g = 0; g < held_.grip_count(); ++g) {
        const Vector3<Scalar> moved =
            grip_column(path, g, k) - held_.centroid(states_[0].positions, g);
        for (std::size_t j = held_.grip_begin(g); j < held_.grip_begin(g + 1); ++j)
          input_.driven_positions.col(static_cast<Index>(j)) =
              states_[0].positions.col(held_.vertices()[j]) + moved;
      }
      states_[i + 1] = states_[i];
      if (!model_.step(states_[i + 1], input_, dt_, ws_).advanced) return k;
      write_features(states_[i + 1].positions, features, k);
    }
    return -1;
  }

  /// Linearises the steps of the last rollout with a share of the compression part of the stiffness
  /// (MassSpringDerivative). Returns false when one cannot be.
  bool linearise(const Scalar& compression) {
    weakened_ = 0;
    for (std::size_t i = 0; i < steps_.size(); ++i) {
      if (!derivative_.linearise(states_[i], states_[i + 1], dt_, steps_[i], memory_, compression))
        return false;
      weakened_ += steps_[i].compression < compression ? 1 : 0;
    }
    return true;
  }

  /// features = J path.
  void push(const MatrixX<Scalar>& path, MatrixX<Scalar>& features) {
    x_.setZero();
    v_.setZero();
    for (Index k = 0; k < frames(); ++k) {
      for (std::size_t g = 0; g < held_.grip_count(); ++g) {
        for (std::size_t j = held_.grip_begin(g); j < held_.grip_begin(g + 1); ++j)
          change_.template middleCols<3>(3 * static_cast<Index>(j)) =
              grip_column(path, g, k).transpose();
      }
      derivative_.push(steps_[static_cast<std::size_t>(k)], memory_, change_, x_, v_);
      write_features(Eigen::Map<const Points<Scalar>>(x_.data(), 3, x_.cols() / 3), features, k);
    }
  }

  /// path = Jᵀ features.
  void pull(const MatrixX<Scalar>& features, MatrixX<Scalar>& path) {
    x_.setZero();
    v_.setZero();
    path.setZero();
    for (Index k = frames() - 1; k >= 0; --k) {
      for (Index f = 0; f < features_.count(); ++f) {
        const Vector3<Scalar> pulled = features.template block<3, 1>(3 * f, k);
        features_.for_each_term(f, [&](int vertex, const Scalar& weight) {
          x_.template middleCols<3>(3 * vertex) += weight * pulled.transpose();
        });
      }
      derivative_.pull(steps_[static_cast<std::size_t>(k)], memory_, x_, v_, change_);
      for (std::size_t g = 0; g < held_.grip_count(); ++g) {
        for (std::size_t j = held_.grip_begin(g); j < held_.grip_begin(g + 1); ++j)
          path.template block<3, 1>(3 * static_cast<Index>(g), k) +=
              change_.template middleCols<3>(3 * static_cast<Index>(j)).transpose();
      }
    }
  }

 private:
  void write_features(const PointsView<Scalar>& x, MatrixX<Scalar>& features, Index k) {
    evaluate_features<Scalar>(features_, x, points_);
    for (Index f = 0; f < points_.cols(); ++f)
      features.template block<3, 1>(3 * f, k) = points_.col(f);
  }
  static Vector3<Scalar> grip_column(const MatrixX<Scalar>& path, std::size_t g, Index k) {
    return path.template block<3, 1>(3 * static_cast<Index>(g), k);
  }

  MassSpring<Scalar> model_;
  MassSpringDerivative<Scalar> derivative_;
  typename MassSpringDerivative<Scalar>::template Memory<1> memory_;
  HeldVertices<Scalar> held_;
  PointFeatures<Scalar> features_;
  Scalar dt_;
  typename MassSpring<Scalar>::Workspace ws_;
  std::vector<ClothState<Scalar>> states_;
  std::vector<typename MassSpringDerivative<Scalar>::Step> steps_;
  ClothInput<Scalar> input_;
  Points<Scalar> points_;
  Lanes<Scalar, 1> change_, x_, v_;
  int weakened_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
