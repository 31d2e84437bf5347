// A user's first program: all headers, one object, one line of output.

#include <clothctl/clothctl.hpp>
#include <cstdio>

int main() {
  clothctl::SpringNetwork<double> pair;
  pair.rest_positions = clothctl::Points<double>::Zero(3, 2);
  pair.rest_positions(0, 1) = 0.1;
  pair.mass = clothctl::VectorX<double>::Constant(2, 0.01);
  pair.springs.push_back({0, 1, 0.1, 100.0, 0.01});
  const std::string problem = pair.validate();
  if (!problem.empty()) {
    std::fprintf(stderr, "%s\n", problem.c_str());
    return 1;
  }
  std::printf("clothctl %s, %d vertices\n", CLOTHCTL_VERSION_STRING,
              static_cast<int>(pair.vertex_count()));
  return 0;
}
