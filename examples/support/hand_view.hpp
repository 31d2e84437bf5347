#pragma once

// A hand of a world as a page shows it: its shape, and the forces of its pads on both sides.

#include <vector>

#include "clothctl/sim/world.hpp"
#include "support/hand_shape.hpp"

namespace program {

/// The shape and the forces.
class HandView {
 public:
  using World = clothctl::World<double>;
  using Hand = clothctl::KinematicTree<double>;
  using Points = clothctl::Points<double>;

  /// The hand as it is now; its pads have up to `samples` samples each. World and tree must outlive
  /// the view.
  HandView(const World& world, const Hand& tree, int hand, std::vector<int> pads,
           clothctl::Index samples);

  /// The shape, whose vertices `place` writes (3×n, m).
  const HandShape& shape() const { return shape_; }
  void place(Points& vertices) const;

  /// The arrows: forces on the sheet and on the fingers, N, and where they act (3×n, m).
  clothctl::Index arrow_count() const {
    return 2 * samples_ * static_cast<clothctl::Index>(pads_.size());
  }
  /// Writes them from column `first` on, for a step of `dt` s; what does not press is not written.
  void add_arrows(double dt, clothctl::Index first, Points& places, Points& forces) const;

 private:
  const World* world_;
  const Hand* tree_;
  int hand_;
  std::vector<int> pads_;
  clothctl::Index samples_;
  HandShape shape_;
};

}  // namespace program
