#pragma once

// The least types that satisfy ClothPlant and ClothModel. They have what the concepts name and
// nothing else: no copies, no default construction, no comparison, and results of unusual but
// allowed types. An algorithm that compiles with them needs no more than its concept. They do not
// move; cloth_laws.hpp says what a real model must do.

#include "clothctl/concepts/cloth.hpp"

namespace clothctl_test {

/// A plant with only what ClothPlant names.
template <class Scalar>
class PlantArchetype {
 public:
  explicit PlantArchetype(clothctl::Index vertices)
      : positions_(clothctl::Points<Scalar>::Zero(3, vertices)),
        velocities_(clothctl::Points<Scalar>::Zero(3, vertices)) {}
  PlantArchetype(const PlantArchetype&) = delete;
  PlantArchetype& operator=(const PlantArchetype&) = delete;

  /// Can do less than Index: it only converts to it.
  int vertex_count() const { return static_cast<int>(positions_.cols()); }
  /// A view rather than a matrix.
  clothctl::PointsView<Scalar> positions() const { return positions_; }
  clothctl::PointsView<Scalar> velocities() const { return velocities_; }
  void apply(const clothctl::ClothInput<Scalar>&) {}
  clothctl::StepReport<Scalar> advance(Scalar) { return {}; }

 private:
  clothctl::Points<Scalar> positions_;
  clothctl::Points<Scalar> velocities_;
};

/// A model with only what ClothModel names. It can be moved, since algorithms may own their model.
template <class Scalar>
class ModelArchetype {
 public:
  /// Scratch memory that can only be moved.
  class Scratch {
   public:
    Scratch(Scratch&&) = default;
    Scratch& operator=(Scratch&&) = default;

   private:
    friend ModelArchetype;
    Scratch() = default;
  };

  explicit ModelArchetype(clothctl::Index vertices) : vertices_(vertices) {}
  ModelArchetype(ModelArchetype&&) = default;
  ModelArchetype& operator=(ModelArchetype&&) = default;

  int vertex_count() const { return static_cast<int>(vertices_); }
  clothctl::ClothState<Scalar> rest_state() const {
    return {clothctl::Points<Scalar>::Zero(3, vertices_),
            clothctl::Points<Scalar>::Zero(3, vertices_)};
  }
  Scratch make_workspace() const { return Scratch(); }
  clothctl::StepReport<Scalar> step(clothctl::ClothState<Scalar>&,
                                    const clothctl::ClothInput<Scalar>&, Scalar, Scratch&) const {
    return {};
  }

 private:
  clothctl::Index vertices_;
};

}  // namespace clothctl_test
