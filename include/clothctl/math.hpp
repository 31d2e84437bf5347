#pragma once

// Curves, rotations, absolute orientation and small eigenvalue problems.

#include "clothctl/math/b_spline.hpp"
#include "clothctl/math/closest_point.hpp"
#include "clothctl/math/horn.hpp"
#include "clothctl/math/rotation.hpp"
#include "clothctl/math/symmetric_eigen.hpp"
