// Foreign types satisfy ClothPlant and ClothModel by a trait alone. For other types the concepts
// are false instead of a compile error.

#include "clothctl/concepts/cloth.hpp"

#include <array>
#include <string>
#include <vector>

#include "clothctl/cloth/model_plant.hpp"
#include "support/catch.hpp"

namespace other_engine {

// Another engine's sheet, which moves itself. It has interleaved floats, its own clock and its own
// error flag.
class Cloth {
 public:
  explicit Cloth(int particles) : data_(static_cast<std::size_t>(particles) * 6, 0.0f) {}
  int particles() const { return static_cast<int>(data_.size() / 6); }
  const float* data() const { return data_.data(); }
  void set_force(int i, float x, float y, float z) {
    force_[static_cast<std::size_t>(i)] = {x, y, z};
  }
  void clear_forces() { force_.assign(static_cast<std::size_t>(particles()), {0.0f, 0.0f, 0.0f}); }
  bool tick(float seconds) {
    if (!(seconds > 0.0f)) return false;
    for (std::size_t i = 0; i < force_.size(); ++i) {
      for (std::size_t c = 0; c < 3; ++c) {
        data_[6 * i + 3 + c] += seconds * force_[i][c];
        data_[6 * i + c] += seconds * data_[6 * i + 3 + c];
      }
    }
    return true;
  }

 private:
  std::vector<float> data_;  // x y z vx vy vz of each particle
  std::vector<std::array<float, 3>> force_;
};

// Another engine's solver, with its own names: takes a state and returns a state.
struct Solver {
  int n = 2;
  double gravity = -10.0;
};

}  // namespace other_engine

namespace clothctl {

template <>
struct plant_traits<other_engine::Cloth> {
  using Strided = Eigen::Map<const Eigen::Matrix3Xf, 0, Eigen::OuterStride<6>>;
  static Index vertex_count(const other_engine::Cloth& cloth) { return cloth.particles(); }
  static Strided positions(const other_engine::Cloth& cloth) {
    return Strided(cloth.data(), 3, cloth.particles());
  }
  static Strided velocities(const other_engine::Cloth& cloth) {
    return Strided(cloth.data() + 3, 3, cloth.particles());
  }
  static void apply(other_engine::Cloth& cloth, const ClothInput<float>& input) {
    cloth.clear_forces();
    for (std::size_t i = 0; i < input.force_vertices.size(); ++i) {
      const auto f = input.forces.col(static_cast<Index>(i));
      cloth.set_force(input.force_vertices[i], f[0], f[1], f[2]);
    }
  }
  static StepReport<float> advance(other_engine::Cloth& cloth, float dt) {
    const bool moved = cloth.tick(dt);
    return {moved ? StepStatus::Converged : StepStatus::InvalidInput, moved, 0.0f, 0};
  }
};

template <>
struct cloth_traits<other_engine::Solver> {
  static Index vertex_count(const other_engine::Solver& solver) { return solver.n; }
  static ClothState<double> rest_state(const other_engine::Solver& solver) {
    return {Points<double>::Zero(3, solver.n), Points<double>::Zero(3, solver.n)};
  }
  static int make_workspace(const other_engine::Solver&) { return 0; }
  static StepReport<double> step(const other_engine::Solver& solver, ClothState<double>& state,
                                 const ClothInput<double>&, double dt, int& steps) {
    ++steps;
    state.velocities.row(2).array() += solver.gravity * dt;
    state.positions += dt * state.velocities;
    return {StepStatus::Converged, true, 0.0, 1};
  }
};

}  // namespace clothctl

using namespace clothctl;

namespace {

struct Empty {};
struct Half {
  Index vertex_count() const { return 1; }
  Points<double> positions() const { return Points<double>::Zero(3, 1); }
};
// A plant that has everything, except that `advance` returns a bool instead of a report.
struct Curt {
  Index vertex_count() const { return 1; }
  Points<double> positions() const { return Points<double>::Zero(3, 1); }
  Points<double> velocities() const { return Points<double>::Zero(3, 1); }
  void apply(const ClothInput<double>&) {}
  bool advance(double) { return true; }
};
// A model whose `step` is not const, so that it may have hidden history.
struct Moody {
  Index vertex_count() const { return 1; }
  ClothState<double> rest_state() const { return {}; }
  int make_workspace() const { return 0; }
  StepReport<double> step(ClothState<double>&, const ClothInput<double>&, double, int&) {
    return {};
  }
};

// What a planner does with any plant: sets an input, advances, and reads the state.
template <class Scalar, ClothPlant<Scalar> Plant>
Scalar height_after_push(Plant& plant, Scalar dt) {
  ClothInput<Scalar> input;
  input.force_vertices = {1};
  input.forces = Points<Scalar>::Zero(3, 1);
  input.forces(2, 0) = Scalar(4);
  plant_traits<Plant>::apply(plant, input);
  const StepReport<Scalar> report = plant_traits<Plant>::advance(plant, dt);
  CHECK(report.advanced);
  const Points<Scalar> positions = plant_traits<Plant>::positions(plant);
  return positions(2, 1);
}

}  // namespace

static_assert(ClothPlant<other_engine::Cloth, float> && !ClothPlant<other_engine::Cloth, double>);
static_assert(ClothModel<other_engine::Solver> && !ClothModel<other_engine::Solver, float>);
static_assert(!ClothModel<other_engine::Cloth> && !ClothPlant<other_engine::Solver>);
static_assert(!ClothModel<int> && !ClothPlant<int> && !ClothModel<void*> &&
              !ClothPlant<std::string>);
static_assert(!ClothModel<Empty> && !ClothPlant<Empty> && !ClothPlant<Half> && !ClothModel<Half>);
static_assert(!ClothPlant<Curt> && !ClothModel<Moody>);
static_assert(!ClothModel<other_engine::Solver, int> &&
              !ClothPlant<other_engine::Cloth, std::string>);

TEST_CASE("a foreign cloth is driven through the plant concept", "[concepts]") {
  other_engine::Cloth cloth(2);
  CHECK(height_after_push<float>(cloth, 0.5f) == Approx(1.0f));
  const StepReport<float> refused = plant_traits<other_engine::Cloth>::advance(cloth, -1.0f);
  CHECK_FALSE(refused.advanced);
}

TEST_CASE("ModelPlant accepts a foreign model", "[concepts]") {
  using Plant = ModelPlant<other_engine::Solver, double>;
  static_assert(ClothPlant<Plant>);
  Plant plant(other_engine::Solver{});
  CHECK(plant.advance(0.1).advanced);
  CHECK(plant.velocities()(2, 0) == Approx(-1.0));
  CHECK(plant.positions()(2, 1) == Approx(-0.1));
}
