#pragma once

// The least type that satisfies FeatureMap. It counts with int, and the arguments of its callbacks
// only convert to the expected types.

#include "clothctl/concepts/prediction.hpp"

namespace clothctl_test {

/// A type with only what FeatureMap names. Feature i is the mean of vertices i and i + 1.
template <class Scalar>
class FeatureMapArchetype {
 public:
  explicit FeatureMapArchetype(int features) : features_(features) {}
  FeatureMapArchetype(const FeatureMapArchetype&) = delete;
  FeatureMapArchetype& operator=(const FeatureMapArchetype&) = delete;

  int count() const { return features_; }
  /// The callable is taken by forwarding reference and called as an lvalue, which the concept
  /// allows.
  template <class Function>
  void for_each_term(clothctl::Index feature, Function&& function) const {
    const short first = static_cast<short>(feature);
    function(first, Scalar(0.5));
    function(static_cast<short>(first + 1), Scalar(0.5));
  }

 private:
  int features_;
};

}  // namespace clothctl_test
