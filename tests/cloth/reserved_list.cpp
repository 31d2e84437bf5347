#include "clothctl/cloth/detail/reserved_list.hpp"

#include <utility>

#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl::detail::ReservedList;

TEST_CASE("reserved list: copies keep contents and capacity", "[reserved_list]") {
  ReservedList<int> list;
  list.reserve(100);
  list = {1, 2, 3};
  list.reserve(100);
  const ReservedList<int> copy(list);
  CHECK(copy == list);
  CHECK(copy.capacity() >= 100);
  ReservedList<int> assigned;
  assigned = copy;
  CHECK(assigned == list);
  CHECK(assigned.capacity() >= 100);
  const ReservedList<int> moved(std::move(assigned));
  CHECK(moved == list);
  CHECK(moved.capacity() >= 100);
}

TEST_CASE("reserved list: copies of a plant step, and allocate nothing", "[reserved_list]") {
  for (const int n : {5, 12}) {  // in batches and in lanes
    const auto grid = make_grid<double>(n, n, 0.5, 0.5).value();
    const auto network = sheet_network<double>(grid, Material<double>()).value();
    ModelPlant plant(PositionBased<double>::create(network).value());
    ClothInput<double> input;
    input.driven_vertices = {0};
    input.driven_positions = grid.positions.col(0);
    input.attached_vertices = {3};
    input.attached_positions = grid.positions.col(3);
    input.attachment_stiffness = VectorX<double>::Constant(1, 100.0);
    plant.apply(input);
    ModelPlant copy = plant;
    const bool counts = clothctl_test::allocation_counting_works();
    const long before = clothctl_test::allocations();
    const bool advanced = copy.advance(0.02).advanced;
    if (counts) CHECK(clothctl_test::allocations() == before);
    CHECK(advanced);
    CHECK(plant.advance(0.02).advanced);
    CHECK(copy.state() == plant.state());
  }
}
