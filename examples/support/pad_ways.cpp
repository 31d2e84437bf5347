#include "support/pad_ways.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace program {

using clothctl::Index;
using Points = clothctl::Points<double>;
using Vec = clothctl::Vector3<double>;

Points touched_at_rest(const clothctl::World<double>& world, std::span<const int> pads,
                       Index samples, const Points& rest) {
  const Index count = static_cast<Index>(pads.size());
  Points out = Points::Constant(3, count * samples, std::nan(""));
  for (Index k = 0; k < count; ++k) {
    for (const auto& contact : world.pad_contacts(pads[static_cast<std::size_t>(k)])) {
      Vec at = Vec::Zero();
      for (std::size_t i = 0; i < 3; ++i)
        at += contact.weight[static_cast<Index>(i)] * rest.col(contact.vertex[i]);
      out.col(samples * k + contact.sample) = at;
    }
  }
  return out;
}

double mean_way(const Points& ways) {
  Vec sum = Vec::Zero();
  double count = 0;
  for (Index k = 0; k < ways.cols(); ++k) {
    if (!ways.col(k).allFinite()) continue;
    sum += ways.col(k);
    ++count;
  }
  return sum.norm() / std::max(1.0, count);
}

}  // namespace program
