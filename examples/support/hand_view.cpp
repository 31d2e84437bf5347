#include "support/hand_view.hpp"

#include <array>
#include <cstddef>
#include <utility>

namespace program {

using clothctl::Index;

HandView::HandView(const World& world, const Hand& tree, int hand, std::vector<int> pads,
                   Index samples)
    : world_(&world), tree_(&tree), hand_(hand), pads_(std::move(pads)), samples_(samples) {
  clothctl::BodyPoses<double> bodies(tree);
  (void)clothctl::forward_kinematics(tree, world.hand(hand).positions, bodies);
  shape_ = make_hand_shape(tree, bodies);
  // What reaches from the origin of the world to an arm beside the place is no part of it.
  std::erase_if(shape_.triangles, [this](const std::array<int, 3>& t) {
    return shape_.bodies[static_cast<std::size_t>(t[0])] < 0;
  });
}

void HandView::place(Points& vertices) const {
  clothctl::BodyPoses<double> bodies(*tree_);
  (void)clothctl::forward_kinematics(*tree_, world_->hand(hand_).positions, bodies);
  place_hand(shape_, bodies, vertices);
}

void HandView::add_arrows(double dt, Index first, Points& places, Points& forces) const {
  for (std::size_t k = 0; k < pads_.size(); ++k) {
    for (const auto& c : world_->pad_contacts(pads_[k])) {
      const Index i = first + 2 * samples_ * static_cast<Index>(k) + c.sample;
      places.col(i) = places.col(i + samples_) = c.place;
      forces.col(i) = c.impulse / dt;
      forces.col(i + samples_) = -c.impulse / dt;
    }
  }
}

}  // namespace program
