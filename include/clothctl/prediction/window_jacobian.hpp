#pragma once

// How the features respond to the velocities of the held vertices along a rollout: the block
// ∂y_k/∂u_j of the feature outputs in frame k and the inputs in frame j, for every j <= k. An
// impulse response does not depend on the time; this does, since a sheet stiffens as it is pulled
// and softens as it folds.
//
// The frames are split in two. Changes of the inputs are pushed from their frame to the end of the
// first half, derivatives of the outputs are pulled from their frame to the start of the second
// half. Blocks within a half come on the way. The others are products: with the change X_j of the
// state at the split by input j, the derivative L_k of output k by that state, and the displacement
// h that an input keeps its vertex at in all later frames,
//
//   ∂y_k/∂u_j = L_k X_j + h Σ_l ∂y_k/∂p_l      j before the split, k and l after it, l <= k
//
// With m inputs and p outputs a frame, that costs m s(s+1)/2 pushes and p (K-s)(K-s+1)/2 pulls
// instead of p K (K+1)/2 pulls; s is the split that costs least. Sixteen are done side by side.
//
// A step of the derivation can be several frames long. It then goes from the state before its first
// frame to the one after its last, as if the model had made one step of that length. Displacements
// at the middle of a step and outputs at its end are all that it knows; blocks between them are
// interpolated. The factors are fewer by the number of frames, pushes and pulls by its square.

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "clothctl/concepts/executor.hpp"
#include "clothctl/prediction/window.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Derives rollouts. `Derivative` linearises steps, and pushes and pulls changes through them as
/// MassSpringDerivative does; `S` is the scalar of the planner.
template <class Derivative, RealScalar S>
class WindowJacobian {
 public:
  /// The planner's scalar.
  using Scalar = S;

  /// Makes room for windows of a request whose held vertices `derivative` drives. Each step of the
  /// derivation takes `stride` frames; the last takes what is left. 1: exact. Allocates. Fails when
  /// stride < 1 (assert).
  WindowJacobian(Derivative derivative, const WindowRequest<Scalar>& request, Index stride = 1);

  /// Writes the Jacobian of the rollout through `states` (K + 1 of them) to `out`, (3·features·K) ×
  /// (inputs·K): row 3 F k + 3 f + c is coordinate c of feature f in frame k, column m j + i is
  /// input i of frame j (velocity, m/s; m of them). `out` has that size, and zeros where j > k.
  /// Returns false when a step cannot be linearised or the result is not finite; `out` is then of
  /// no use. Both halves can run on `executor` at the same time, with the same bits. Never
  /// allocates.
  bool evaluate(std::span<const ClothState<Scalar>> states, const WindowRequest<Scalar>& request,
                ExecutorRef executor, MatrixX<Scalar>& out);

 private:
  using Inner = typename Derivative::Scalar;
  static constexpr int kLanes = 16;
  using Changes = Lanes<Inner, kLanes>;

  /// Sixteen changes of the state at the split, or derivatives by it.
  struct Block {
    Changes x, v;
    /// First half: by what the held vertices are moved now. Second: derivatives by where they are,
    /// summed over the frames.
    Changes held;

    void set_zero() {
      for (Changes* each : {&x, &v, &held}) each->setZero();
    }
  };
  /// What a half needs, which may run on a thread of its own.
  struct Half {
    typename Derivative::template Memory<kLanes> memory;
    ClothState<Inner> before, after;
    /// The columns of the Jacobian before the split, or its rows after it, sixteen in each block.
    std::vector<Block> blocks;
    Index count = 0;
    bool linearised = false;

    Index begin(std::size_t block) const { return static_cast<Index>(block) * kLanes; }
    Index end(std::size_t block) const {
      return begin(block) + kLanes < count ? begin(block) + kLanes : count;
    }
  };

  /// The step of row `g` of the second half, where outputs of later steps come first, and its row.
  Index step_of(Index g) const { return count_ - 1 - g / outputs_; }
  Index row_of(Index g) const { return outputs_ * step_of(g) + g % outputs_; }
  /// First frame of step k; the horizon for the last step's end.
  Index frame_at(Index k) const { return (std::min)(stride_ * k, horizon_); }
  /// Returns the split that costs least.
  static Index cheapest_split(Index steps, Index inputs, Index outputs);
  /// Linearises step k.
  bool linearise(Index k, std::span<const ClothState<Scalar>> states,
                 const WindowRequest<Scalar>& request, Half& half);
  void push_inputs(const WindowRequest<Scalar>& request, MatrixX<Scalar>& out);
  void pull_outputs(const WindowRequest<Scalar>& request, MatrixX<Scalar>& out);
  /// Writes the blocks between the halves.
  void join(const WindowRequest<Scalar>& request, MatrixX<Scalar>& out);

  /// Two steps and their weights; a step below 0 stands for zeros.
  struct Between {
    std::array<Index, 2> step;
    std::array<Scalar, 2> weight;
  };
  /// What the end of frame k lies between, and what the middle of frame j does.
  Between around_end(Index k) const;
  Between around_middle(Index j) const;
  /// Interpolates the blocks of frames between those of steps.
  void interpolate(MatrixX<Scalar>& out) const;

  Derivative derivative_;
  Index inputs_, outputs_, horizon_, stride_, count_, split_;
  MatrixX<Scalar> coarse_;  // where steps take several frames: displacements of steps, times dt
  std::vector<typename Derivative::Step> steps_;
  Half first_, second_;
  Changes pulled_;
};

template <class Derivative, RealScalar S>
WindowJacobian<Derivative, S>::WindowJacobian(Derivative derivative,
                                              const WindowRequest<Scalar>& request, Index stride)
    : derivative_(std::move(derivative)),
      inputs_(request.inputs()),
      outputs_(3 * request.held_outputs),
      horizon_(request.horizon),
      stride_(stride),
      count_((horizon_ + stride - 1) / stride),
      split_(cheapest_split(count_, inputs_, outputs_)) {
  assert(1 <= stride);
  if (1 < stride_) coarse_.setZero(outputs_ * count_, inputs_ * count_);
  const Index n = derivative_.vertex_count();
  const auto prepare = [&](Half& half, Index count) {
    half.memory = derivative_.template make_memory<kLanes>();
    half.before.positions.setZero(3, n);
    half.before.velocities.setZero(3, n);
    half.after = half.before;
    half.count = count;
    const Block block{Changes::Zero(kLanes, 3 * n), Changes::Zero(kLanes, 3 * n),
                      Changes::Zero(kLanes, inputs_)};
    half.blocks.assign(static_cast<std::size_t>((count + kLanes - 1) / kLanes), block);
  };
  prepare(first_, inputs_ * split_);
  prepare(second_, outputs_ * (count_ - split_));
  pulled_.setZero(kLanes, inputs_);
  for (Index k = 0; k < count_; ++k) steps_.push_back(derivative_.make_step(first_.memory));
}

template <class Derivative, RealScalar S>
Index WindowJacobian<Derivative, S>::cheapest_split(Index steps, Index inputs, Index outputs) {
  const auto cost = [&](Index s) {
    return inputs * s * (s + 1) + outputs * (steps - s) * (steps - s + 1);
  };
  Index best = 0;
  for (Index s = 1; s <= steps; ++s) {
    if (cost(s) < cost(best)) best = s;
  }
  return best;
}

template <class Derivative, RealScalar S>
bool WindowJacobian<Derivative, S>::linearise(Index k, std::span<const ClothState<Scalar>> states,
                                              const WindowRequest<Scalar>& request, Half& half) {
  const std::size_t i = static_cast<std::size_t>(k);
  const ClothState<Scalar>& first = states[static_cast<std::size_t>(frame_at(k))];
  const Vector3<Scalar> origin = first.positions.col(0);  // a derivative knows no place
  const auto cast = [&](const ClothState<Scalar>& from, ClothState<Inner>& to) {
    for (Index v = 0; v < from.positions.cols(); ++v) {
      const Vector3<Scalar> local = from.positions.col(v) - origin;
      to.positions.col(v) = local.template cast<Inner>();
      to.velocities.col(v) = from.velocities.col(v).template cast<Inner>();
    }
  };
  cast(first, half.before);
  cast(states[static_cast<std::size_t>(frame_at(k + 1))], half.after);
  const Vector3<Scalar> wind = request.wind.col(frame_at(k));
  const Scalar dt = Scalar(static_cast<double>(frame_at(k + 1) - frame_at(k))) * request.dt;
  return derivative_.linearise(half.before, half.after, static_cast<Inner>(dt), steps_[i],
                               half.memory, Inner(1), wind.template cast<Inner>());
}

template <class Derivative, RealScalar S>
bool WindowJacobian<Derivative, S>::evaluate(std::span<const ClothState<Scalar>> states,
                                             const WindowRequest<Scalar>& request,
                                             ExecutorRef executor, MatrixX<Scalar>& out) {
  assert(static_cast<Index>(states.size()) == horizon_ + 1 && out.rows() == outputs_ * horizon_ &&
         out.cols() == inputs_ * horizon_);
  MatrixX<Scalar>& blocks = stride_ == 1 ? out : coarse_;
  executor.for_each_block(2, [&](int block) {
    Half& half = block == 0 ? first_ : second_;
    const Index end = block == 0 ? split_ : count_;
    half.linearised = true;
    for (Index k = block == 0 ? 0 : split_; k < end && half.linearised; ++k)
      half.linearised = linearise(k, states, request, half);
    if (!half.linearised) return;
    if (block == 0) {
      push_inputs(request, blocks);
    } else {
      pull_outputs(request, blocks);
    }
  });
  if (!first_.linearised || !second_.linearised) return false;
  join(request, blocks);
  if (1 < stride_) interpolate(out);
  return all_finite(out);
}

template <class Derivative, RealScalar S>
void WindowJacobian<Derivative, S>::push_inputs(const WindowRequest<Scalar>& request,
                                                MatrixX<Scalar>& out) {
  const Inner h = static_cast<Inner>(request.dt);
  for (std::size_t b = 0; b < first_.blocks.size(); ++b) {
    Block& block = first_.blocks[b];
    const Index begin = first_.begin(b), end = first_.end(b);
    block.set_zero();
    for (Index k = begin / inputs_; k < split_; ++k) {
      for (Index g = begin; g < end; ++g) {
        if (g / inputs_ == k) block.held(g - begin, g % inputs_) = h;
      }
      derivative_.template push<kLanes>(steps_[static_cast<std::size_t>(k)], first_.memory,
                                        block.held, block.x, block.v);
      for (Index f = 0; f < request.held_outputs; ++f) {
        Eigen::Matrix<Inner, kLanes, 3> moved = Eigen::Matrix<Inner, kLanes, 3>::Zero();
        request.outputs.for_each_term(f, [&](int vertex, const Scalar& weight) {
          moved += static_cast<Inner>(weight) * block.x.template middleCols<3>(3 * vertex);
        });
        for (Index g = begin; g < end && g / inputs_ <= k; ++g) {
          for (Index i = 0; i < 3; ++i)
            out(outputs_ * k + 3 * f + i, g) = static_cast<Scalar>(moved(g - begin, i));
        }
      }
    }
  }
}

template <class Derivative, RealScalar S>
void WindowJacobian<Derivative, S>::pull_outputs(const WindowRequest<Scalar>& request,
                                                 MatrixX<Scalar>& out) {
  for (std::size_t b = 0; b < second_.blocks.size(); ++b) {
    Block& block = second_.blocks[b];
    const Index begin = second_.begin(b), end = second_.end(b);
    block.set_zero();
    for (Index k = step_of(begin); k >= split_; --k) {
      for (Index g = begin; g < end; ++g) {
        if (step_of(g) != k) continue;
        const Index f = g % outputs_;
        request.outputs.for_each_term(f / 3, [&](int vertex, const Scalar& weight) {
          block.x(g - begin, 3 * vertex + f % 3) += static_cast<Inner>(weight);
        });
      }
      derivative_.template pull<kLanes>(steps_[static_cast<std::size_t>(k)], second_.memory,
                                        block.x, block.v, pulled_);
      block.held += pulled_;
      for (Index g = begin; g < end && k <= step_of(g); ++g) {
        for (Index i = 0; i < inputs_; ++i)
          out(row_of(g), inputs_ * k + i) =
              request.dt * static_cast<Scalar>(block.held(g - begin, i));
      }
    }
  }
}

template <class Derivative, RealScalar S>
auto WindowJacobian<Derivative, S>::around_end(Index k) const -> Between {
  const Index step = k / stride_, first = frame_at(step), last = frame_at(step + 1);
  const Scalar share =
      Scalar(static_cast<double>(k + 1 - first) / static_cast<double>(last - first));
  return {{step - 1, step}, {Scalar(1) - share, share}};
}

template <class Derivative, RealScalar S>
auto WindowJacobian<Derivative, S>::around_middle(Index j) const -> Between {
  const auto middle = [&](Index step) {
    return 0.5 * static_cast<double>(frame_at(step) + frame_at(step + 1));
  };
  const double time = static_cast<double>(j) + 0.5;
  Index step = j / stride_;
  if (time < middle(step) && 0 < step) --step;
  const Index next = (std::min)(step + 1, count_ - 1);
  if (time < middle(step) || next == step) return {{step, step}, {Scalar(1), Scalar(0)}};
  const Scalar share = Scalar((time - middle(step)) / (middle(next) - middle(step)));
  return {{step, next}, {Scalar(1) - share, share}};
}

template <class Derivative, RealScalar S>
void WindowJacobian<Derivative, S>::interpolate(MatrixX<Scalar>& out) const {
  for (Index k = 0; k < horizon_; ++k) {
    const Between to = around_end(k);
    for (Index j = 0; j <= k; ++j) {
      const Between from = around_middle(j);
      auto block = out.block(outputs_ * k, inputs_ * j, outputs_, inputs_);
      block.setZero();
      for (std::size_t a = 0; a < 2; ++a) {
        for (std::size_t b = 0; b < 2; ++b) {
          if (from.step[b] <= to.step[a])  // what comes later has no effect
            block +=
                (to.weight[a] * from.weight[b]) *
                coarse_.block(outputs_ * to.step[a], inputs_ * from.step[b], outputs_, inputs_);
        }
      }
    }
  }
}

template <class Derivative, RealScalar S>
void WindowJacobian<Derivative, S>::join(const WindowRequest<Scalar>& request,
                                         MatrixX<Scalar>& out) {
  using Products = Eigen::Matrix<Inner, kLanes, kLanes>;
  for (std::size_t b = 0; b < second_.blocks.size(); ++b) {
    const Block& from = second_.blocks[b];
    for (std::size_t a = 0; a < first_.blocks.size(); ++a) {
      const Block& to = first_.blocks[a];
      Products products = Products::Zero();
      for (Index i = 0; i < from.x.cols(); ++i) {
        products.noalias() += from.x.col(i) * to.x.col(i).transpose();
        products.noalias() += from.v.col(i) * to.v.col(i).transpose();
      }
      for (Index g = second_.begin(b); g < second_.end(b); ++g) {
        const Index l = g - second_.begin(b);
        for (Index column = first_.begin(a); column < first_.end(a); ++column) {
          out(row_of(g), column) = static_cast<Scalar>(products(l, column - first_.begin(a))) +
                                   request.dt * static_cast<Scalar>(from.held(l, column % inputs_));
        }
      }
    }
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI
