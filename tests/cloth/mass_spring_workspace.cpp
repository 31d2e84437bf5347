// The memory of a step: its sizes, and the hash that tells structures apart.

#include "clothctl/cloth/detail/mass_spring_workspace.hpp"

#include "clothctl/cloth/detail/spring_forces.hpp"
#include "clothctl/linalg/nested_dissection.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

struct Structure {
  SpringNetwork<double> network;
  SpringPattern<double> pattern;
  EliminationTree tree;

  Structure(int rows, int cols, bool air)
      : network(sheet_network<double>(make_grid<double>(rows, cols, 0.3, 0.4).value(),
                                      Material<double>())
                    .value()),
        pattern(network, BendingBlocks::All, air),
        tree(nested_dissection<double>(pattern.matrix(), network.rest_positions)) {}

  MassSpringWorkspace<double> workspace(std::size_t air_count) const {
    MassSpringWorkspace<double> ws;
    ws.reserve(network, pattern.matrix(), tree, air_count);
    return ws;
  }
  bool holds(const MassSpringWorkspace<double>& ws, std::size_t air_count) const {
    return ws.fits(network, pattern.matrix(), air_count);
  }
};

}  // namespace

TEST_CASE("a workspace fits the network that it was made for and no other", "[cloth]") {
  const Structure sheet(5, 4, false), larger(5, 5, false);
  MassSpringWorkspace<double> ws = sheet.workspace(0);
  CHECK(sheet.holds(ws, 0));
  CHECK_FALSE(larger.holds(ws, 0));
  CHECK_FALSE(sheet.holds(ws, 3));
  CHECK_FALSE(sheet.holds(MassSpringWorkspace<double>(), 0));
  CHECK(sheet.holds(sheet.workspace(3), 3));
  for (Index i = 0; i < 20; ++i) CHECK_FALSE(ws.is_held(i));
  ws.held[7] = 1;
  CHECK(ws.is_held(7));
}

TEST_CASE("a workspace with one part of a wrong size does not fit", "[cloth]") {
  const Structure sheet(4, 4, false);
  const auto with = [&](auto change) {
    MassSpringWorkspace<double> ws = sheet.workspace(2);
    change(ws);
    return sheet.holds(ws, 2);
  };
  using W = MassSpringWorkspace<double>;
  CHECK(with([](W&) {}));
  for (Points<double> W::*part :
       {&W::outer, &W::velocity, &W::trial, &W::position, &W::gradient, &W::direction})
    CHECK_FALSE(with([&](W& ws) { (ws.*part).setZero(3, 5); }));
  for (Lanes<double, 1> W::*part : {&W::rhs, &W::product})
    CHECK_FALSE(with([&](W& ws) { (ws.*part).setZero(1, 5); }));
  const BlockSymmetric<double> fewer_rows = Structure(3, 3, false).pattern.matrix(),
                               fewer_blocks(16, {{0, 1}, {1, 2}});
  for (BlockSymmetric<double> W::*part : {&W::matrix, &W::frozen}) {
    CHECK_FALSE(with([&](W& ws) { ws.*part = fewer_rows; }));
    CHECK_FALSE(with([&](W& ws) { ws.*part = fewer_blocks; }));
  }
  CHECK_FALSE(with([](W& ws) { ws.air.clear(); }));
}

TEST_CASE("the hash of a structure sees pattern and order, not stiffness", "[cloth]") {
  const Structure sheet(5, 4, false), wide(4, 5, false);
  SpringNetwork<double> rest;
  rest.rest_positions.setZero(3, 20);
  const auto hash_of = [&](const BlockSymmetric<double>& pattern, const EliminationTree& tree) {
    return hash_structure(pattern, tree, rest);
  };
  const std::uint64_t hash = hash_of(sheet.pattern.matrix(), sheet.tree);
  CHECK(hash == hash_of(Structure(5, 4, false).pattern.matrix(), sheet.tree));
  CHECK(hash != hash_of(wide.pattern.matrix(), wide.tree));
  BlockSymmetric<double> filled = sheet.pattern.matrix();
  filled.diagonal(3)(0, 0) = 5.0;
  CHECK(hash == hash_of(filled, sheet.tree));
  for (std::vector<int> EliminationTree::*list :
       {&EliminationTree::permutation, &EliminationTree::node_begin, &EliminationTree::parent}) {
    EliminationTree other = sheet.tree;
    ++(other.*list)[0];
    CHECK(hash != hash_of(sheet.pattern.matrix(), other));
  }
  // One spring among three vertices: the same columns in other rows, and other columns.
  const BlockSymmetric<double> first(3, {{0, 1}}), second(3, {{0, 2}}), third(3, {{1, 2}});
  CHECK(hash_of(first, sheet.tree) != hash_of(second, sheet.tree));
  CHECK(hash_of(second, sheet.tree) != hash_of(third, sheet.tree));
  // Rest positions, and rest lengths along sides of triangles, place the coarse vertices of
  // conjugate gradients, which have no tree.
  SpringNetwork<double> moved = rest, long_side = rest, triangle = rest;
  moved.rest_positions(1, 7) = 0.5;
  triangle.springs = {{0, 1, 0.5, 10.0, 0.0}};
  triangle.triangles = {{0, 1, 2}};
  long_side = triangle;
  long_side.springs[0].rest_length = 0.75;
  const BlockSymmetric<double>& pattern = sheet.pattern.matrix();
  CHECK(hash == hash_structure(pattern, sheet.tree, moved));
  CHECK(hash_structure(pattern, {}, rest) != hash_structure(pattern, {}, moved));
  CHECK(hash_structure(pattern, {}, rest) != hash_structure(pattern, {}, triangle));
  CHECK(hash_structure(pattern, {}, triangle) != hash_structure(pattern, {}, long_side));
}
