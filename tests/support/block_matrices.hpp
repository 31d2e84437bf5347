#pragma once

// Random symmetric positive definite matrices of 3×3 blocks, on graphs like those of cloth, and
// their dense counterparts.

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <random>
#include <utility>
#include <vector>

#include "clothctl/linalg/block_symmetric.hpp"
#include "clothctl/linalg/elimination_tree.hpp"

namespace clothctl_test {

/// A graph with positions: the input of an ordering.
struct Graph {
  /// Pairs of coupled vertices.
  std::vector<std::pair<int, int>> pairs;
  /// Positions, 3×n.
  clothctl::Points<double> positions;

  int size() const { return static_cast<int>(positions.cols()); }
};

/// A rows×columns sheet with structural and shear couplings, and with couplings to the next but one
/// vertex if `bending`.
inline Graph sheet_graph(int rows, int columns, bool bending) {
  Graph graph;
  graph.positions.resize(3, rows * columns);
  const auto add = [&](int i, int j, int a, int b) {
    if (a >= 0 && a < rows && b >= 0 && b < columns)
      graph.pairs.push_back({i * columns + j, a * columns + b});
  };
  for (int i = 0; i < rows; ++i) {
    for (int j = 0; j < columns; ++j) {
      graph.positions.col(i * columns + j) << 0.1 * j, 0.0, -0.1 * i;
      add(i, j, i + 1, j);
      add(i, j, i, j + 1);
      add(i, j, i + 1, j + 1);
      add(i, j, i + 1, j - 1);
      if (bending) {
        add(i, j, i + 2, j);
        add(i, j, i, j + 2);
      }
    }
  }
  return graph;
}

/// A chain of n vertices, each coupled to the next and to the next but one.
inline Graph rope_graph(int n) { return sheet_graph(1, n, true); }

/// n vertices at random in a unit cube; `count` random pairs (fewer where a pair repeats).
inline Graph random_graph(int n, int count, std::mt19937& random) {
  Graph graph;
  graph.positions.resize(3, n);
  std::uniform_real_distribution<double> coordinate(0.0, 1.0);
  std::uniform_int_distribution<int> vertex(0, n - 1);
  for (int i = 0; i < n; ++i) {
    for (int c = 0; c < 3; ++c) graph.positions(c, i) = coordinate(random);
  }
  for (int k = 0; k < count; ++k) graph.pairs.push_back({vertex(random), vertex(random)});
  return graph;
}

/// Vertices at random in a unit cube. Each is coupled to all within `radius`, as by the springs of
/// a solid.
inline Graph cloud_graph(int n, double radius, std::mt19937& random) {
  Graph graph = random_graph(n, 0, random);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < i; ++j) {
      if ((graph.positions.col(i) - graph.positions.col(j)).norm() < radius)
        graph.pairs.push_back({i, j});
    }
  }
  return graph;
}

/// A random matrix on a graph: a random 3×3 block for each pair, and diagonal blocks that exceed
/// what definiteness needs by `margin`.
template <class Scalar>
clothctl::BlockSymmetric<Scalar> random_spd(const Graph& graph, std::mt19937& random,
                                            double margin = 0.1) {
  clothctl::BlockSymmetric<Scalar> matrix(graph.size(), graph.pairs);
  std::normal_distribution<double> normal;
  const auto draw = [&] {
    Eigen::Matrix3d m;
    for (int i = 0; i < 9; ++i) m(i) = normal(random);
    return m;
  };
  std::vector<Eigen::Matrix3d> diagonal(static_cast<std::size_t>(graph.size()),
                                        margin * Eigen::Matrix3d::Identity());
  for (int i = 0; i < graph.size(); ++i) {
    for (int s = matrix.row_begin(i); s < matrix.row_begin(i + 1); ++s) {
      // [AAᵀ ABᵀ; BAᵀ BBᵀ] is positive semidefinite.
      const Eigen::Matrix3d a = draw(), b = draw();
      diagonal[static_cast<std::size_t>(i)] += a * a.transpose();
      diagonal[static_cast<std::size_t>(matrix.column(s))] += b * b.transpose();
      matrix.lower(s) = (a * b.transpose()).template cast<Scalar>();
    }
    const Eigen::Matrix3d own = draw();
    diagonal[static_cast<std::size_t>(i)] += own * own.transpose();
  }
  for (int i = 0; i < graph.size(); ++i) {
    matrix.diagonal(i) = diagonal[static_cast<std::size_t>(i)].template cast<Scalar>();
  }
  return matrix;
}

/// Returns the same matrix, dense and in double.
template <class Scalar>
Eigen::MatrixXd dense(const clothctl::BlockSymmetric<Scalar>& matrix) {
  Eigen::MatrixXd full = Eigen::MatrixXd::Zero(3 * matrix.rows(), 3 * matrix.rows());
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    full.block<3, 3>(3 * i, 3 * i) = matrix.diagonal(i).template cast<double>();
    for (int s = matrix.row_begin(i); s < matrix.row_begin(i + 1); ++s) {
      const Eigen::Index j = matrix.column(s);
      full.block<3, 3>(3 * i, 3 * j) = matrix.lower(s).template cast<double>();
      full.block<3, 3>(3 * j, 3 * i) = matrix.lower(s).transpose().template cast<double>();
    }
  }
  return full;
}

/// No vertex of a matrix is held.
template <class Scalar>
std::vector<unsigned char> none_held(const clothctl::BlockSymmetric<Scalar>& matrix) {
  return std::vector<unsigned char>(static_cast<std::size_t>(matrix.rows()), 0);
}

/// Returns a linear map of 1×3n vectors as a dense matrix; `apply(x)` replaces x by its image.
template <class Apply>
Eigen::MatrixXd dense_map(clothctl::Index rows, Apply&& apply) {
  Eigen::MatrixXd out(3 * rows, 3 * rows);
  for (clothctl::Index k = 0; k < 3 * rows; ++k) {
    clothctl::Lanes<double, 1> x = clothctl::Lanes<double, 1>::Zero(1, 3 * rows);
    x[k] = 1.0;
    apply(x);
    out.col(k) = x.transpose();
  }
  return out;
}

/// Bisects the index range, and puts the vertices that couple both halves on top. Valid for any
/// graph, and written here so that its tests do not need the mesh folder.
struct IndexDissection {
  const clothctl::BlockSymmetric<double>& pattern;
  int leaf;
  clothctl::EliminationTree tree{{}, {0}, {}};

  int add(const std::vector<int>& vertices, const std::vector<int>& children) {
    tree.permutation.insert(tree.permutation.end(), vertices.begin(), vertices.end());
    tree.node_begin.push_back(static_cast<int>(tree.permutation.size()));
    tree.parent.push_back(-1);
    const int node = static_cast<int>(tree.parent.size()) - 1;
    for (int c : children) tree.parent[static_cast<std::size_t>(c)] = node;
    return node;
  }
  std::vector<int> cut(const std::vector<int>& set) {
    if (set.empty()) return {};
    if (static_cast<int>(set.size()) <= leaf) return {add(set, {})};
    const std::size_t half = set.size() / 2;
    std::vector<int> low, high(set.begin() + static_cast<std::ptrdiff_t>(half), set.end()),
        separator;
    for (std::size_t a = 0; a < half; ++a) {
      const bool couples = std::any_of(high.begin(), high.end(), [&](int b) {
        return set[a] != b && pattern.find(set[a], b) >= 0;
      });
      (couples ? separator : low).push_back(set[a]);
    }
    std::vector<int> open = cut(low);
    for (int node : cut(high)) open.push_back(node);
    if (separator.empty()) return open;
    return {add(separator, open)};
  }
};

inline clothctl::EliminationTree tree_of(const Graph& graph, int leaf) {
  const clothctl::BlockSymmetric<double> pattern(graph.size(), graph.pairs);
  IndexDissection dissection{pattern, leaf};
  std::vector<int> all(static_cast<std::size_t>(graph.size()));
  std::iota(all.begin(), all.end(), 0);
  dissection.cut(all);
  return dissection.tree;
}

/// Graphs of many shapes.
inline std::vector<Graph> graphs(std::mt19937& random) {
  return {sheet_graph(1, 1, false),
          sheet_graph(2, 2, false),
          rope_graph(2),
          rope_graph(40),
          sheet_graph(7, 7, true),
          sheet_graph(12, 9, true),
          sheet_graph(17, 17, false),
          random_graph(30, 45, random),
          random_graph(25, 400, random),
          cloud_graph(120, 0.3, random),
          random_graph(20, 0, random)};
}

}  // namespace clothctl_test
