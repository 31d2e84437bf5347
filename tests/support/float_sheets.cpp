// Position-based sheets in float, which many tests step. Here they are compiled with optimisation,
// where the tests are not.

#include "clothctl/cloth/position_based.hpp"

template class clothctl::PositionBased<float>;
