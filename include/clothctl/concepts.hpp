#pragma once

// What the parts of the library ask of each other, and the traits through which foreign types
// answer.

#include "clothctl/concepts/articulated.hpp"
#include "clothctl/concepts/cloth.hpp"
#include "clothctl/concepts/collider.hpp"
#include "clothctl/concepts/colliding_cloth.hpp"
#include "clothctl/concepts/contact_model.hpp"
#include "clothctl/concepts/executor.hpp"
#include "clothctl/concepts/impulse_response.hpp"
#include "clothctl/concepts/prediction.hpp"
#include "clothctl/concepts/qp_solver.hpp"
