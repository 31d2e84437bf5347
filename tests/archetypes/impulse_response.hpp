#pragma once

// The least type that satisfies ImpulseResponse.

#include "clothctl/concepts/impulse_response.hpp"

namespace clothctl_test {

/// A type with only what ImpulseResponse names: a bead of 0.5 kg with one point.
template <class Scalar>
class ImpulseResponseArchetype {
 public:
  explicit ImpulseResponseArchetype(int) { v_ << Scalar(1), Scalar(-2), Scalar(0.5); }
  ImpulseResponseArchetype(const ImpulseResponseArchetype&) = delete;
  ImpulseResponseArchetype& operator=(const ImpulseResponseArchetype&) = delete;

  /// A type that only converts to an index.
  struct One {
    operator clothctl::Index() const { return 1; }
  };
  One point_count() const { return {}; }
  void velocities(Eigen::Ref<clothctl::VectorX<Scalar>> u) const { u = v_; }
  void add_mobility(Eigen::Ref<clothctl::MatrixX<Scalar>> W) const {
    for (int k = 0; k < 3; ++k) W(k, k) += Scalar(2);
  }
  void apply(const Eigen::Ref<const clothctl::VectorX<Scalar>>& p) { v_ += Scalar(2) * p; }

 private:
  clothctl::Vector3<Scalar> v_;
};

}  // namespace clothctl_test
