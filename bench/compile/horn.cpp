// The rigid motion between two sets of points.

#include "clothctl/math.hpp"

int main() {
  clothctl::Points<double> from = clothctl::Points<double>::Identity(3, 3), to = -from;
  const clothctl::HornResult<double> fit = clothctl::horn<double>(from, to);
  return fit.status == clothctl::HornStatus::InvalidInput ? 1 : 0;
}
