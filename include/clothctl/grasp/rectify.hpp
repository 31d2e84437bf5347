#pragma once

// A planner moves each vertex that a finger holds on its own, but a finger segment is rigid. Of all
// poses of the segment, rectification takes the one whose contact points come closest to where the
// plan wants them:
//
//   min over R, t   Σ w_j |b_j - R a_j - t|²,     t = c_b - R c_a
//
// a_j: the contact point on the segment, in its frame, where it was when the contact began. b_j:
// the planned place in the world. c: weighted centroids. R is that of Horn's method (math/horn.hpp)
// on the pairs of points. (Taking it from the planned linear map alone fails: a patch is nearly
// flat, and its map says nothing about the normal.) The centroid goes exactly where the plan wants
// it. What points do not determine, as the turn of two points about their line, stays as it is in
// the reference, the segment's present rotation.
//
// The pose becomes tasks for inverse kinematics: the contact points themselves, or the centroid and
// what is determined of the rotation.
//
// Reference: [Bai 2016], section 4.2, eq. 11.

#include <cmath>
#include <string_view>
#include <vector>

#include "clothctl/math/horn.hpp"
#include "clothctl/math/rotation.hpp"
#include "clothctl/robot/ik_task.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How much of a segment's pose the planned points determine.
enum class RectifyStatus {
  /// All of it. Use it.
  Pose,
  /// The place, and the rotation up to a turn about `SegmentTarget::free_axis`: the points are on a
  /// line, or there are two. That turn is the reference's. Use it.
  FreeTurn,
  /// The place alone: there is one point, or all coincide. The rotation is the reference. Use it.
  Place,
  /// Nothing: there are no points, or none has weight. Leave the segment where it is.
  NoPoints,
  /// A number is not finite, a weight is negative, sizes differ, or a setting is bad; `message`
  /// says what. Correct the input.
  InvalidInput
};

/// Returns the name of a status.
constexpr std::string_view to_string(RectifyStatus status) {
  switch (status) {
    case RectifyStatus::Pose: return "pose";
    case RectifyStatus::FreeTurn: return "free_turn";
    case RectifyStatus::Place: return "place";
    case RectifyStatus::NoPoints: return "no_points";
    case RectifyStatus::InvalidInput: return "invalid_input";
  }
  return "unknown";
}

/// Settings of `rectify`.
template <RealScalar Scalar>
struct RectifySettings {
  /// When a turn counts as free (HornSettings::tie_tolerance). The default suits planned points of
  /// a simulated sheet: a strip is a line below 0.7 % of its length.
  Scalar tie_tolerance = Scalar(1e-4);
  /// The plan counts as `unrigid` when the root mean square of its residuals is more than this
  /// share of the points' mean distance from their centroid.
  Scalar unrigid_share = Scalar(0.1);

  /// Returns an empty text, or a static one that names the first bad value.
  std::string_view validate() const {
    if (!is_finite(unrigid_share) || !(Scalar(0) < unrigid_share))
      return "unrigid_share is not a positive number";
    return HornSettings<Scalar>{tie_tolerance}.validate();
  }
};

/// Where a segment shall be.
template <RealScalar Scalar>
struct SegmentTarget {
  /// How much of the pose is determined.
  RectifyStatus status = RectifyStatus::NoPoints;
  /// Rotation from the segment's frame to the world.
  Matrix3<Scalar> R_world_frame = Matrix3<Scalar>::Identity();
  /// Origin of the frame in the world, m.
  Vector3<Scalar> position = Vector3<Scalar>::Constant(Scalar(0));
  /// Weighted centroid of the contact points, in the frame, m.
  Vector3<Scalar> local_centroid = Vector3<Scalar>::Constant(Scalar(0));
  /// Where it shall be in the world, m.
  Vector3<Scalar> centroid = Vector3<Scalar>::Constant(Scalar(0));
  /// With FreeTurn: the unit axis, in the world, about which the turn is free; else zero.
  Vector3<Scalar> free_axis = Vector3<Scalar>::Constant(Scalar(0));
  /// Root mean square distance of the contact points from their centroid, m.
  Scalar radius = Scalar(0);
  /// How unrigid the plan is: distances of planned points from those of the pose, m.
  Scalar rms_residual = Scalar(0), largest_residual = Scalar(0);
  /// Whether the residuals are large for the size of the patch (`RectifySettings::unrigid_share`):
  /// the plan pulls the points of this segment apart.
  bool unrigid = false;
  /// With InvalidInput: what was refused (static text).
  std::string_view message;

  /// Where a point of the frame (m) shall be in the world.
  Vector3<Scalar> at(const Vector3<Scalar>& local) const {
    return Vector3<Scalar>(R_world_frame * local + position);
  }
  /// Whether there is a pose to go to.
  bool found() const {
    return status == RectifyStatus::Pose || status == RectifyStatus::FreeTurn ||
           status == RectifyStatus::Place;
  }
};

/// Finds where a segment shall be so that its contact points `local` (3×n, m, in its frame) come
/// closest to `planned` (3×n, m, world). `weights` (n, at least 0) may be empty, which stands for
/// ones. `R_now`: the segment's present rotation, from its frame to the world. Never allocates.
/// Complexity: O(n). Fails when: see RectifyStatus; the pose is then R_now at the origin.
template <RealScalar Scalar>
[[nodiscard]] SegmentTarget<Scalar> rectify(const PointsView<Scalar>& local,
                                            const PointsView<Scalar>& planned,
                                            const Eigen::Ref<const VectorX<Scalar>>& weights,
                                            const Matrix3<Scalar>& R_now,
                                            const RectifySettings<Scalar>& settings = {}) {
  using std::sqrt;
  SegmentTarget<Scalar> out;
  out.status = RectifyStatus::InvalidInput;
  if (!all_finite(R_now)) {
    out.message = "the present rotation holds NaN or an infinity";
    return out;
  }
  if (!is_rotation<Scalar>(R_now, Scalar(1e-2))) {
    out.message = "the present rotation is not a rotation";
    return out;
  }
  out.R_world_frame = R_now;
  out.message = settings.validate();
  if (!out.message.empty()) return out;
  const HornResult<Scalar> fit = horn<Scalar>(
      local, planned, weights, Eigen::Quaternion<Scalar>(R_now), {settings.tie_tolerance});
  out.message = fit.message;
  if (fit.status == HornStatus::InvalidInput) return out;
  Scalar total(0);
  Vector3<Scalar> first = Vector3<Scalar>::Constant(Scalar(0)), second = first;
  for (Index j = 0; j < local.cols(); ++j) {
    const Scalar w = weights.size() == 0 ? Scalar(1) : weights[j];
    total += w;
    first += w * local.col(j);
    second += w * planned.col(j);
  }
  out.status = RectifyStatus::NoPoints;
  if (!(Scalar(0) < total)) return out;
  out.local_centroid = first / total;
  out.centroid = second / total;
  Scalar square(0);
  for (Index j = 0; j < local.cols(); ++j) {
    const Scalar w = weights.size() == 0 ? Scalar(1) : weights[j];
    square += w * (local.col(j) - out.local_centroid).squaredNorm();
  }
  out.radius = sqrt(square / total);
  out.R_world_frame = fit.R;
  out.position = fit.t;
  out.rms_residual = fit.rms_residual;
  out.largest_residual = fit.largest_residual;
  out.unrigid = settings.unrigid_share * out.radius < out.rms_residual;
  out.free_axis = fit.free_axis;
  out.status = RectifyStatus::Pose;
  if (fit.status == HornStatus::FreeTurn) out.status = RectifyStatus::FreeTurn;
  if (fit.status == HornStatus::Free) out.status = RectifyStatus::Place;
  return out;
}

/// What a segment's target becomes for inverse kinematics.
enum class SegmentTasks {
  /// One task for each contact point. What the points leave free stays free.
  Points,
  /// The centroid, and the rotation or what is determined of it, which counts as a turn of the
  /// patch's radius (at least `least_radius`). Three to six rows, whatever the number of points.
  Pose
};

/// Adds the tasks that bring the contact points `local` (3×n, m) of a segment to its target.
/// `frame`: the segment's. Adds none where nothing was found. Allocates as push_back does.
template <RealScalar Scalar>
void add_segment_tasks(const SegmentTarget<Scalar>& target, int frame,
                       const PointsView<Scalar>& local, SegmentTasks kind,
                       std::vector<IkTask<Scalar>>& tasks,
                       const Scalar& least_radius = Scalar(2e-3)) {
  if (!target.found()) return;
  if (kind == SegmentTasks::Points) {
    for (Index j = 0; j < local.cols(); ++j) {
      const Vector3<Scalar> point = local.col(j);
      tasks.push_back(IkTask<Scalar>::position(frame, point, target.at(point)));
    }
    return;
  }
  tasks.push_back(IkTask<Scalar>::position(frame, target.local_centroid, target.centroid));
  const Scalar length = target.radius < least_radius ? least_radius : target.radius;
  if (target.status == RectifyStatus::Pose) {
    tasks.push_back(IkTask<Scalar>::orientation(frame, target.R_world_frame, length));
  } else if (target.status == RectifyStatus::FreeTurn) {
    const Vector3<Scalar> axis = target.R_world_frame.transpose() * target.free_axis;
    tasks.push_back(IkTask<Scalar>::pointing(frame, axis, target.free_axis, length));
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI
