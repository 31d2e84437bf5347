#pragma once

// The least type that satisfies ContactModel. It counts with int, has no adhesion, and has neither
// default construction nor assignment.

#include <string>
#include <utility>

#include "clothctl/concepts/contact_model.hpp"

namespace clothctl_test {

/// A type with only what ContactModel names. Its one generator pushes all vertices equally along
/// their normals.
template <class Scalar>
class ContactModelArchetype {
 public:
  explicit ContactModelArchetype(int) {}
  ContactModelArchetype(const ContactModelArchetype&) = default;
  ContactModelArchetype& operator=(const ContactModelArchetype&) = delete;

  int generators(clothctl::Index) const { return 1; }
  std::pair<int, int> support(clothctl::Index vertices, clothctl::Index) const {
    return {0, static_cast<int>(vertices)};
  }
  void fill(const clothctl::PointsView<Scalar>&, const clothctl::PointsView<Scalar>& normals,
            Eigen::Ref<clothctl::MatrixX<Scalar>> out) const {
    for (clothctl::Index j = 0; j < normals.cols(); ++j)
      out.block(3 * j, 0, 3, 1) = normals.col(j) / Scalar(normals.cols());
  }
  Scalar normal_share(clothctl::Index, clothctl::Index) const { return Scalar(1); }
  Scalar upper_bound(clothctl::Index, clothctl::Index, const Scalar& limit) const { return limit; }
  Scalar violation(const clothctl::PointsView<Scalar>&, const clothctl::PointsView<Scalar>& normals,
                   const clothctl::PointsView<Scalar>& forces, const Scalar& limit) const {
    Scalar total(0), uneven(0);
    for (clothctl::Index j = 0; j < normals.cols(); ++j) total += normals.col(j).dot(forces.col(j));
    const Scalar share = total / Scalar(normals.cols());
    for (clothctl::Index j = 0; j < normals.cols(); ++j)
      uneven += (forces.col(j) - share * normals.col(j)).norm();
    Scalar worst = uneven;
    if (worst < -total) worst = -total;
    if (worst < total - limit) worst = total - limit;
    const bool good = clothctl::is_finite(worst) && clothctl::is_finite(uneven) &&
                      clothctl::is_finite(total) && clothctl::is_finite(limit);
    return good ? worst : clothctl::scalar_traits<Scalar>::infinity();
  }
  /// A text type that only converts to a string.
  const char* validate() const { return ""; }
};

}  // namespace clothctl_test
