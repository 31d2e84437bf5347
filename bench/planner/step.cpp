#include "step.hpp"

#include <algorithm>

namespace planner_bench {

namespace {

using Entries = std::vector<Eigen::Triplet<double>>;

void add(Entries& to, int a, int b, const Matrix3<double>& block) {
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) to.emplace_back(3 * a + r, 3 * b + c, block(r, c));
  }
}

void couple(Entries& to, int a, int b, const Matrix3<double>& block) {
  add(to, a, a, block);
  add(to, b, b, block);
  add(to, a, b, -block);
  add(to, b, a, -block);
}

}  // namespace

SparseStep::SparseStep(const MassSpring<double>& model, Factor factor)
    : model_(model), kind_(factor), response_(model) {
  const Index size = 3 * model.network().vertex_count();
  mass_.setZero(size);
  for (Index i = 0; i < size; ++i) mass_[i] = model.network().mass[i / 3];
  force_.setZero(size);
  product_.setZero(size);
  lane_.setZero(1, size);
  K_.resize(size, size);
  A_.resize(size, size);
}

bool SparseStep::linearise(const Frame& frame) {
  stiff_.clear();
  step_.clear();
  for (Index i = 0; i < mass_.size(); ++i) {
    force_[i] = mass_[i] * model_.settings().gravity[i % 3];
    step_.emplace_back(static_cast<int>(i), static_cast<int>(i),
                       (1.0 + kDt * model_.settings().drag) * mass_[i]);
  }
  add_springs(frame);
  add_bending(frame);
  K_.setFromTriplets(stiff_.begin(), stiff_.end());
  if (kind_ == Factor::Ours) return response_.linearise(frame.x, frame.v, V::Zero(), kDt, {});
  for (const Eigen::Triplet<double>& e : stiff_)
    step_.emplace_back(e.row(), e.col(), kDt * kDt * e.value());
  A_.setFromTriplets(step_.begin(), step_.end());
  if (!analysed_) factor_.analyzePattern(A_);
  analysed_ = true;
  factor_.factorize(A_);
  return factor_.info() == Eigen::Success;
}

void SparseStep::add_springs(const Frame& frame) {
  for (const auto& s : model_.network().springs) {
    const V d = frame.x.col(s.a) - frame.x.col(s.b), n = d.normalized();
    const Matrix3<double> along = n * n.transpose(), across = Matrix3<double>::Identity() - along;
    const double tension = std::max(0.0, 1.0 - s.rest_length / d.norm());
    couple(stiff_, s.a, s.b, s.stiffness * (along + tension * across));
    couple(step_, s.a, s.b, kDt * s.damping * along);
    const V pull = s.stiffness * (d.norm() - s.rest_length) * n;
    force_.segment<3>(3 * s.a) -= pull;
    force_.segment<3>(3 * s.b) += pull;
  }
}

void SparseStep::add_bending(const Frame& frame) {
  for (const auto& b : model_.network().bends) {
    const auto count = static_cast<std::size_t>(b.count);
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t j = 0; j < count; ++j) {
        const double k = b.stiffness * b.weight[i] * b.weight[j];
        for (int c = 0; c < 3; ++c)
          stiff_.emplace_back(3 * b.vertex[i] + c, 3 * b.vertex[j] + c, k);
        force_.segment<3>(3 * b.vertex[i]) -= k * frame.x.col(b.vertex[j]);
      }
    }
  }
}

void SparseStep::advance(const VectorX<double>& push, VectorX<double>& v, VectorX<double>& q) {
  product_.noalias() = K_ * q;
  v = mass_.cwiseProduct(v) + kDt * (push - product_);
  if (kind_ == Factor::Ours) {
    lane_ = v.transpose();
    response_.solve<1>(lane_);
    v = lane_.transpose();
  } else {
    v = factor_.solve(v);
  }
  q += kDt * v;
}

}  // namespace planner_bench
