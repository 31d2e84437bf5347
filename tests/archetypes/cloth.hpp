#pragma once

// The least types that satisfy ClothPlant and ClothModel: they offer what the concepts name and
// refuse everything else (no copies, no default construction, no comparison, results of unusual but
// allowed types). An algorithm that compiles with them asks for nothing beyond its concept. They
// stand still; cloth_laws.hpp says what a real model must do.

#include "clothctl/concepts/cloth.hpp"

namespace clothctl_test {

/// A plant that offers what ClothPlant names, and nothing more.
template <class Scalar>
class PlantArchetype {
 public:
  explicit PlantArchetype(clothctl::Index vertices)
      : positions_(clothctl::Points<Scalar>::Zero(3, vertices)),
        velocities_(clothctl::Points<Scalar>::Zero(3, vertices)) {}
  PlantArchetype(const PlantArchetype&) = delete;
  PlantArchetype& operator=(const PlantArchetype&) = delete;

  /// Fewer promises than Index: merely convertible to it.
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

/// A model that offers what ClothModel names, and nothing more. Movable, since algorithms may own
/// their model.
template <class Scalar>
class ModelArchetype {
 public:
  /// Scratch memory that can be moved and nothing else.
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
