#include "support/foreign_cloth.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>

#include "clothctl/cloth/settle.hpp"
#include "support/options.hpp"
#include "support/random_number.hpp"

namespace program {

ForeignVariant draw_variant(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  ForeignVariant variant;
  variant.stiffness = std::exp(random_number(random, std::log(2.0)));
  variant.damping = std::exp(random_number(random, std::log(2.0)));
  variant.drag = 0.1 * std::sqrt(8.0) * std::exp(random_number(random, 0.5 * std::log(8.0)));
  variant.substeps = std::exp(random_number(random, 0.5 * std::log(2.0)));
  return variant;
}

game::Cloth hanging_foreign_cloth(const clothctl::GridMesh<double>& grid,
                                  const clothctl::SpringNetwork<double>& network,
                                  const ForeignVariant& variant) {
  clothctl::Points<double> x = grid.positions;
  for (clothctl::Index i = 0; i < x.cols(); ++i) x(1, i) = -0.03 * std::cos(6.28 * x(0, i));
  x.row(0) *= 0.95;
  game::Cloth cloth = game::make_cloth(network, x);
  for (game::Cloth::Spring& spring : cloth.springs) {
    spring.stiffness *= static_cast<float>(variant.stiffness);
    spring.damping *= static_cast<float>(variant.damping);
  }
  const int side = grid.cols, last = side - 1;
  const double needed = std::sqrt(std::max({1.0, variant.stiffness, variant.damping}));
  cloth.substeps = static_cast<int>((side <= 9    ? 400
                                     : side <= 13 ? 600
                                                  : 1000) *
                                    needed * variant.substeps);
  cloth.drag = 4;
  const std::vector<int> hands{grid.vertex(last, 0), grid.vertex(last, last)};
  if (!clothctl::settle(cloth, hands, 0.02, 6.0, 1e-3).advanced)
    refuse("the engine's cloth does not come to rest");
  cloth.drag = static_cast<float>(variant.drag);
  return cloth;
}

void LongRun::add(double time, double mean, double largest, bool losing) {
  sum_ += mean;
  ++frames_;
  largest_ = std::max(largest_, largest);
  if (losing && losing_ < 0) losing_ = time;
  if (kLost < largest && lost_ < 0) lost_ = time;
  part_ += mean;
  ++part_frames_;
  if (time + 1e-9 < kPart * (parts_ + 1)) return;
  part_ /= part_frames_;
  if (parts_ == 0) first_ = part_;
  worst_ = std::max(worst_, part_);
  part_ = 0;
  part_frames_ = 0;
  ++parts_;
}

void LongRun::print() const {
  std::printf("the corners follow for %d frames with a mean error of %.1f mm, worst %.1f mm\n",
              frames_, 1000 * sum_ / frames_, 1000 * largest_);
  std::printf("mean error of the first 5 s %.1f mm, of the worst 5 s %.1f mm\n", 1000 * first_,
              1000 * worst_);
  if (0 <= losing_) std::printf("said to be losing at %.2f s\n", losing_);
  if (0 <= lost_) std::printf("the error passes 30 mm at %.2f s\n", lost_);
}

}  // namespace program
