#include "support/options.hpp"

#include <cstdio>
#include <cstdlib>

namespace program {

void refuse(const std::string& reason) {
  std::fprintf(stderr, "error: %s\n", reason.c_str());
  std::exit(2);
}

}  // namespace program
