#include "baseline.hpp"

#include <cmath>

namespace planner_bench {

PaperBaseline::PaperBaseline(const Scene& scene, Index horizon, Factor factor)
    : scene_(scene),
      settings_(scene.settings(GripInput::Force, horizon, false)),
      step_(scene.model, factor),
      basis_(scene.setup.grips, scene.setup.triangles, GripInput::Force) {
  const Points<double>& start = scene.frames.front().x;
  Points<double> features(3, 2), hands(3, 2);
  for (Index i = 0; i < 2; ++i) {
    features.col(i) = start.col(scene.feature(i));
    hands.col(i) = start.col(basis_.held().vertices()[static_cast<std::size_t>(i)]);
  }
  anchors_ = make_anchors(features, hands);
  const Index unknowns = basis_.unknowns() * horizon;
  map_.assign(static_cast<std::size_t>(horizon), MatrixX<double>::Zero(start.size(), unknowns));
  free_.setZero(start.size(), horizon);
  rows_.setZero(24 * horizon, unknowns);
  rest_.setZero(24 * horizon);
  problem_.A.resize(0, unknowns);
  problem_.first.lb.setZero(unknowns);
  problem_.first.ub.setZero(unknowns);
}

bool PaperBaseline::form(const Frame& frame, Phases& times) {
  {
    const Stopwatch watch(times.linearise);
    if (!step_.linearise(frame)) return false;
    basis_.update(frame.x);
  }
  {
    const Stopwatch watch(times.response);
    integrate_all(frame);
  }
  const Stopwatch watch(times.stack);
  stack(frame);
  return true;
}

void PaperBaseline::integrate_all(const Frame& frame) {
  const Index horizon = settings_.horizon, p = basis_.unknowns(), size = frame.x.size();
  const Eigen::Map<const VectorX<double>> x(frame.x.data(), size);
  VectorX<double> v = Eigen::Map<const VectorX<double>>(frame.v.data(), size);
  VectorX<double> q = VectorX<double>::Zero(size), push = q, none = q;
  for (Index k = 0; k < horizon; ++k) {
    step_.advance(step_.force(), v, q);
    free_.col(k) = x + q;
  }
  for (Index j = 0; j < horizon; ++j) {
    for (Index c = 0; c < p; ++c) {
      push.setZero();
      for (std::size_t s = 0; s < basis_.held().vertices().size(); ++s)
        push.segment<3>(3 * basis_.held().vertices()[s]) =
            basis_.matrix().block<3, 1>(3 * static_cast<Index>(s), c);
      v.setZero();
      q.setZero();
      for (Index k = j; k < horizon; ++k) {
        step_.advance(k == j ? push : none, v, q);
        map_[static_cast<std::size_t>(k)].col(j * p + c) = q;
      }
    }
  }
}

void PaperBaseline::load_point(const Frame& frame, Index k, int vertex, MatrixX<double>& of_d,
                               V& now) const {
  if (k < 0) {  // before the window it moved at the measured velocity
    of_d.setZero(3, rows_.cols());
    now = frame.x.col(vertex) + static_cast<double>(k + 1) * kDt * frame.v.col(vertex);
    return;
  }
  of_d = map_[static_cast<std::size_t>(k)].middleRows(3 * vertex, 3);
  now = free_.block<3, 1>(3 * vertex, k);
}

void PaperBaseline::add(double scale, const MatrixX<double>& of_d, const V& now) {
  rows_.middleRows(row_, 3) = scale * of_d;
  rest_.segment<3>(row_) = scale * now;
  row_ += 3;
}

V PaperBaseline::lead(const HandAnchor<double>& anchor, double t) const {
  const V left = scene_.target(0, t), right = scene_.target(1, t);
  const V before = scene_.target(0, t - kDt) + scene_.target(1, t - kDt);
  const V velocity = (left + right - before) / (2.0 * kDt);
  return air_lead<double>(anchor, settings_.heavy_chain_axes, settings_.gravity, right - left,
                          -scene_.model.settings().drag * velocity);
}

void PaperBaseline::stack(const Frame& frame) {
  const Index horizon = settings_.horizon, p = basis_.unknowns();
  const PlannerWeights<double>& w = settings_.weights;
  const auto target = [&](Index i, double t) { return scene_.target(i, t); };
  MatrixX<double> z0, z1, z2, effort;
  V c0, c1, c2;
  row_ = 0;
  for (Index k = 0; k < horizon; ++k) {
    const double t = frame.t + static_cast<double>(k + 1) * kDt;
    for (Index i = 0; i < 2; ++i) {
      const int hand = basis_.held().vertices()[static_cast<std::size_t>(i)];
      load_point(frame, k, scene_.feature(i), z0, c0);
      add(std::sqrt(w.feature), z0, c0 - target(i, t));
      load_point(frame, k, hand, z0, c0);
      const HandAnchor<double>& anchor = anchors_[static_cast<std::size_t>(i)];
      add(std::sqrt(w.anchor), z0,
          c0 - lead(anchor, t) -
              anchor_position(anchor, settings_.heavy_chain_axes, settings_.gravity, target, t));
      load_point(frame, k - 1, hand, z1, c1);
      load_point(frame, k - 2, hand, z2, c2);
      add(std::sqrt(w.smooth) / kDt, z0 - 2.0 * z1 + z2, c0 - 2.0 * c1 + c2);
      effort.setZero(3, rows_.cols());
      effort.middleCols(k * p, p) = basis_.matrix().middleRows(3 * i, 3);
      add(std::sqrt(w.force), effort, -0.5 * settings_.gravity_load);
    }
  }
  problem_.H.noalias() = rows_.transpose() * rows_;
  problem_.H.diagonal().array() += w.cone;
  problem_.first.g.noalias() = rows_.transpose() * rest_;
  for (Index k = 0; k < horizon; ++k)
    basis_.bounds(frame.x, settings_.max_step, kDt, problem_.first.lb.segment(k * p, p),
                  problem_.first.ub.segment(k * p, p));
}

}  // namespace planner_bench
