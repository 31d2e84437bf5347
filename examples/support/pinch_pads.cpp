#include "support/pinch_pads.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "clothctl/math/rotation.hpp"

namespace program {

using clothctl::Index;
using clothctl::QueryStatus;

namespace {

constexpr double kPi = 3.14159265358979323846;

/// Four samples on a radius of 5 mm with the outward normal y.
std::vector<clothctl::PadSample<double>> four_samples() {
  std::vector<clothctl::PadSample<double>> out;
  for (const double a : {0.25, 0.75, 1.25, 1.75}) {
    const PinchPads::Vector place(0.005 * std::cos(a * kPi), 0, 0.005 * std::sin(a * kPi));
    out.push_back({place, PinchPads::Vector(0, 1, 0)});
  }
  return out;
}

}  // namespace

clothctl::Result<PinchPads> PinchPads::create(const clothctl::GridMesh<double>& grid,
                                              const clothctl::SpringNetwork<double>& network,
                                              const PinchMotion& motion,
                                              const clothctl::PadSettings<double>& pad) {
  PinchPads out;
  out.motion_ = motion;
  out.settings_ = pad;
  out.triangles_ = network.triangles;
  out.rest_ = network.rest_positions;
  out.inside_ = out.rest_.col(grid.vertex(grid.rows - 1, 0)) + Vector(0.015, 0, -0.015);
  auto finder =
      clothctl::SheetContactFinder<double>::create(network.rest_positions, network.triangles);
  if (!finder) return clothctl::Error{finder.error()};
  out.finder_.push_back(std::move(finder).value());
  for (int k = 0; k < 2; ++k) {
    auto made = clothctl::PadContacts<double>::create(four_samples(), network.triangles,
                                                      out.finder_.front(), 0, 1 + k, pad);
    if (!made) return clothctl::Error{made.error()};
    out.pads_.push_back(std::move(made).value());
    out.bodies_.emplace_back(4);
  }
  out.solver_.reserve(kSamples, 3 * kSamples);
  out.contacts_.resize(kSamples);
  out.vertices_.resize(kSamples);
  out.touched_.reserve(3 * kSamples);
  return out;
}

clothctl::RigidMotion<double> PinchPads::pose(std::size_t pad, double t, double dt) const {
  const double side = pad == 0 ? 1 : -1, overlap = motion_.force / settings_.stiffness;
  const auto way = [&](double s) { return motion_.amplitude * (1 - std::cos(4 * kPi * s)); };
  clothctl::RigidMotion<double> out;
  out.R_world_body = clothctl::rotation_exp<double>(Vector(0, motion_.twist * t, 0));
  if (side < 0) out.R_world_body *= clothctl::rotation_exp<double>(Vector(0, 0, kPi));
  out.position = inside_ + Vector(way(t), side * overlap, 0);
  out.velocity = Vector((way(t + dt) - way(t)) / dt, 0, 0);
  out.angular_velocity = Vector(0, motion_.twist, 0);
  return out;
}

bool PinchPads::find(const Points& x, double t, double dt) {
  if (finder_.front().update(x) != QueryStatus::Answered) return false;
  touched_.clear();
  for (std::size_t k = 0; k < 2; ++k) {
    const auto motion = pose(k, t, dt);
    if (pads_[k].update(motion, finder_.front()) != QueryStatus::Answered) return false;
    if (!bodies_[k].set_motion(motion).empty()) return false;
    if (bodies_[k].set_points(pads_[k].places()) != QueryStatus::Answered) return false;
    pads_[k].add_touched(touched_);
  }
  return true;
}

bool PinchPads::solve(double dt, clothctl::ClothState<double>& state, Model::Workspace& ws,
                      clothctl::MassSpringImpulses<double>& response) {
  if (response.attach(touched_, state, ws) != clothctl::StepStatus::Converged) return false;
  count_ = 0;
  for (auto& pad : pads_) {
    for (const auto& contact : pad.contacts()) vertices_[count_++] = contact.a.point;
    count_ -= pad.contacts().size();
    pad.number([&](int vertex) { return response.point(vertex); });
    for (const auto& contact : pad.contacts()) contacts_[count_++] = contact;
  }
  const std::span<clothctl::ContactSample<double>> all(contacts_.data(), count_);
  report_ = solver_.solve(all, dt, response, bodies_[0], bodies_[1]);
  const bool found = report_.status == clothctl::ContactStatus::Solved ||
                     report_.status == clothctl::ContactStatus::NotConverged;
  if (!found ||
      solver_.apply(all, response, bodies_[0], bodies_[1]) != clothctl::ContactStatus::Solved)
    return false;
  std::size_t next = 0;
  for (auto& pad : pads_) {
    for (auto& contact : pad.contacts()) contact = contacts_[next++];
    pad.keep();
  }
  return true;
}

PinchPads::Points PinchPads::touched_at_rest() const {
  Points out = Points::Constant(3, kSamples, std::nan(""));
  for (std::size_t i = 0; i < count_; ++i) {
    const auto& contact = contacts_[i];
    Vector at = Vector::Zero();
    for (std::size_t k = 0; k < 3; ++k)
      at += contact.a.weight[static_cast<Index>(k)] * rest_.col(vertices_[i][k]);
    out.col(4 * (contact.b.side - 1) + contact.b.point[0]) = at;
  }
  return out;
}

PinchPads::Vector PinchPads::mean_offset() const {
  Vector sum = Vector::Zero();
  for (std::size_t i = 0; i < count_; ++i) sum += contacts_[i].offset;
  return sum / std::max<double>(1, static_cast<double>(count_));
}

void PinchPads::mark() {
  marked_ = touched_at_rest();
  marked_offset_ = mean_offset();
}

double PinchPads::slip() const {
  if (marked_.cols() == 0) return 0;
  const Points ways = touched_at_rest() - marked_;
  Vector sum = Vector::Zero();
  double count = 0;
  for (Index k = 0; k < kSamples; ++k) {
    if (!ways.col(k).allFinite()) continue;
    sum += ways.col(k);
    ++count;
  }
  return sum.norm() / std::max(1.0, count) + (mean_offset() - marked_offset_).norm();
}

double PinchPads::sample_slip() const {
  if (marked_.cols() == 0) return 0;
  const Points ways = touched_at_rest() - marked_;
  double most = 0;
  for (Index k = 0; k < kSamples; ++k) {
    if (ways.col(k).allFinite()) most = std::max(most, ways.col(k).norm());
  }
  return most;
}

double PinchPads::normal_force(double dt) const {
  double sum = 0;
  for (std::size_t i = 0; i < count_; ++i) sum += contacts_[i].impulse.dot(contacts_[i].normal);
  return 0.5 * sum / dt;
}

double PinchPads::friction_use() const {
  double normal = 0, tangential = 0;
  for (std::size_t i = 0; i < count_; ++i) {
    const double lift = contacts_[i].impulse.dot(contacts_[i].normal);
    normal += lift;
    tangential += (contacts_[i].impulse - lift * contacts_[i].normal).norm();
  }
  return normal > 0 ? tangential / (settings_.friction * normal) : 0;
}

PinchPads::Points PinchPads::places() const {
  Points out(3, kSamples);
  out << pads_[0].places(), pads_[1].places();
  return out;
}

PinchPads::Points PinchPads::forces(double dt) const {
  Points out = Points::Zero(3, kSamples);
  for (std::size_t i = 0; i < count_; ++i) {
    const auto& place = contacts_[i].b;
    out.col(4 * (place.side - 1) + place.point[0]) = contacts_[i].impulse / dt;
  }
  return out;
}

}  // namespace program
