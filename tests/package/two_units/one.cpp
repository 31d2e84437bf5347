// In single precision this unit only makes memory, which the other one uses; in double precision it does everything.

#include "checks.hpp"
#include "units.hpp"

namespace one {

bool makes_memory() {
  const clothctl::SpringNetwork<float> network = sheet<float>();
  const clothctl::BlockSymmetric<float> matrix = matrix_of(network);
  const clothctl::BlockCholesky<float> factor(matrix, clothctl::nested_dissection<float>(matrix, network.rest_positions));
  const auto made = clothctl::MassSpring<float>::create(network);
  return factor.factor_entries() > 0 && made && made->make_workspace().factor.factor_entries() > 0;
}

double factor_error() { return error_of_factor<double>(); }
double step_error() { return error_of_step<double>(); }

}  // namespace one
