#include "support/hand_shape.hpp"

#include <algorithm>
#include <cmath>

namespace program {

namespace {

using clothctl::Body;
using clothctl::BodyPoses;
using clothctl::Index;
using clothctl::KinematicTree;
using clothctl::Link;
using Vec = Eigen::Vector3d;

struct Ball {
  Vec centre;
  double radius;
};

/// Data about a body's shape. Bone 0 is the world, and body i is bone i + 1.
struct Bone {
  Vec end = Vec::Zero();      // its furthest point from its origin
  std::vector<Vec> hinges;    // origins of its child joints
  std::vector<int> children;  // and the bones of those joints
  std::vector<Vec> tips;      // origins of its links
  double length = 0;          // distance from its origin to `end`
  double thickness = 0;       // radius at its middle
  int last = 0;               // the last bone above it that has a length, or itself
  bool stub = false;          // a guessed length, with child joints: not used for other bodies
};

std::vector<Bone> find_bones(const KinematicTree<double>& tree) {
  std::vector<Bone> bones(tree.bodies().size() + 1);
  for (std::size_t i = 0; i < tree.bodies().size(); ++i) {
    const Body<double>& body = tree.bodies()[i];
    Bone& parent = bones[static_cast<std::size_t>(body.parent + 1)];
    parent.hinges.push_back(body.placement.p);
    parent.children.push_back(static_cast<int>(i + 1));
  }
  for (const Link<double>& link : tree.links())
    bones[static_cast<std::size_t>(link.body + 1)].tips.push_back(link.placement.p);
  for (std::size_t i = 0; i < bones.size(); ++i) {
    Bone& bone = bones[i];
    if (!bone.hinges.empty()) bone.tips.clear();  // the links are sensors and the like
    for (const std::vector<Vec>* points : {&bone.hinges, &bone.tips}) {
      for (const Vec& p : *points) {
        if (p.norm() > bone.end.norm()) bone.end = p;
      }
    }
    // If neither joints nor links give a body's length, its centre of mass does, as the middle.
    if (i > 0 && bone.end.norm() < 1e-6 && tree.bodies()[i - 1].inertia.mass > 0) {
      bone.end = 2 * tree.bodies()[i - 1].inertia.com;
      bone.tips.assign(1, bone.end);
      bone.stub = !bone.hinges.empty();
    }
    bone.length = bone.end.norm();
    if (bone.length < 2e-3) bone.length = 0;
  }
  return bones;
}

/// Radii grow with lengths but less than in proportion: an arm is thicker than its fingers, but not
/// by the ratio of their lengths.
void find_thickness(const KinematicTree<double>& tree, std::vector<Bone>& bones) {
  std::vector<double> lengths;
  for (const Bone& bone : bones) {
    if (bone.length > 0) lengths.push_back(bone.length);
  }
  if (lengths.empty()) return;
  std::sort(lengths.begin(), lengths.end());
  const double usual = lengths[lengths.size() / 3];
  for (std::size_t i = 0; i < bones.size(); ++i) {
    Bone& bone = bones[i];
    const int above =
        i > 0 ? bones[static_cast<std::size_t>(tree.bodies()[i - 1].parent + 1)].last : 0;
    bone.last = bone.length > 0 && !bone.stub ? static_cast<int>(i) : above;
    bone.thickness =
        std::min(0.27 * usual * std::pow(bone.length / usual, bone.length > usual ? 0.75 : 0.5),
                 0.45 * bone.length);
    // Along a chain, radii only decrease, and in small steps.
    const Bone& before = bones[static_cast<std::size_t>(above)];
    if (bone.length > 0 && !bone.stub && above > 0 && before.thickness > 0 &&
        before.children.size() < 2)
      bone.thickness = std::clamp(bone.thickness, 0.80 * before.thickness, 0.97 * before.thickness);
  }
}

/// Returns the bone that moves with a bone's joint: itself, or the next one below that has a
/// length.
const Bone* next_bone(const std::vector<Bone>& bones, int i) {
  const Bone* bone = &bones[static_cast<std::size_t>(i)];
  while (!(bone->length > 0) && bone->children.size() == 1)
    bone = &bones[static_cast<std::size_t>(bone->children[0])];
  return bone->length > 0 ? bone : nullptr;
}

std::vector<Ball> balls_of(const std::vector<Bone>& bones, const Bone& bone, bool world) {
  std::vector<Ball> balls;
  const double own = bone.thickness;
  Vec middle = Vec::Zero();
  for (const Vec& p : bone.hinges) middle += p / static_cast<double>(bone.hinges.size());
  const bool palm = bone.hinges.size() > 2;
  double thinnest = own;
  for (std::size_t k = 0; k < bone.hinges.size(); ++k) {
    const Bone* next = next_bone(bones, bone.children[k]);
    const double radius = next != nullptr ? std::min(own, 1.03 * next->thickness) : 0.8 * own;
    thinnest = std::min(thinnest, radius);
    balls.push_back({bone.hinges[k], radius});
  }
  if (palm) {  // the heel of the hand is half as wide as the knuckles
    for (std::size_t k = 0; k < bone.hinges.size(); ++k)
      balls.push_back({0.5 * (bone.hinges[k] - middle), 1.1 * thinnest});
  }
  for (const Vec& p : bone.tips) {
    if (p.norm() > 0.5 * bone.length) balls.push_back({p * (1 - 0.5 * own / p.norm()), 0.78 * own});
  }
  if (!palm && !(world && bone.hinges.size() > 1)) balls.push_back({Vec::Zero(), own});
  return balls;
}

void add_hull(const std::vector<Ball>& balls, int body, std::vector<Vec>& vertices,
              HandShape& shape) {
  // The axis is along the largest distance between two centres.
  const Ball *low = &balls[0], *high = &balls[0];
  double largest = 0;
  for (const Ball& p : balls) {
    for (const Ball& q : balls) {
      if ((q.centre - p.centre).norm() <= largest) continue;
      largest = (q.centre - p.centre).norm();
      low = &p;
      high = &q;
    }
  }
  const Vec axis = largest > 0 ? Vec((high->centre - low->centre) / largest) : Vec(Vec::UnitZ());
  const Vec side = axis.unitOrthogonal(), other = axis.cross(side);
  const bool simple = balls.size() <= 2;
  const int around = simple ? 12 : 24, rings = simple ? 6 : 14;
  const int first = static_cast<int>(vertices.size());
  const auto add = [&](const Vec& direction) {
    const Ball* best = nullptr;
    double reach = 0;
    for (const Ball& ball : balls) {
      const double here = ball.centre.dot(direction) + ball.radius;
      if (best != nullptr && here <= reach) continue;
      best = &ball;
      reach = here;
    }
    vertices.push_back(best->centre + best->radius * direction);
    shape.bodies.push_back(body);
  };
  const double pi = std::acos(-1.0);
  add(-axis);
  // The latitude where the two ends of a bone meet has a ring on either side.
  const double parting =
      largest > 0 ? std::asin(std::clamp((low->radius - high->radius) / largest, -0.99, 0.99)) : 0;
  for (int i = 0; i < rings; ++i) {
    const int half = rings / 2;
    const double angle = i < half ? -pi / 2 + (parting - 1e-3 + pi / 2) * (i + 1) / half
                                  : parting + 1e-3 + (pi / 2 - parting - 1e-3) * (i - half) / half;
    for (int k = 0; k < around; ++k) {
      const double turn = 2 * pi * k / around;
      add(std::sin(angle) * axis +
          std::cos(angle) * (std::cos(turn) * side + std::sin(turn) * other));
    }
  }
  add(axis);
  const int last = static_cast<int>(vertices.size()) - 1;
  const auto at = [&](int ring, int k) { return first + 1 + ring * around + k % around; };
  for (int k = 0; k < around; ++k) {
    shape.triangles.push_back({first, at(0, k + 1), at(0, k)});
    for (int i = 0; i + 1 < rings; ++i) {
      shape.triangles.push_back({at(i, k), at(i, k + 1), at(i + 1, k + 1)});
      shape.triangles.push_back({at(i, k), at(i + 1, k + 1), at(i + 1, k)});
    }
    shape.triangles.push_back({last, at(rings - 1, k), at(rings - 1, k + 1)});
  }
}

}  // namespace

HandShape make_hand_shape(const KinematicTree<double>& tree, const BodyPoses<double>& start) {
  HandShape shape;
  std::vector<Bone> bones = find_bones(tree);
  find_thickness(tree, bones);
  std::vector<Vec> vertices;
  for (std::size_t i = 0; i < bones.size(); ++i) {
    if (!(bones[i].length > 0)) continue;
    const std::vector<Ball> balls = balls_of(bones, bones[i], i == 0);
    if (!balls.empty()) add_hull(balls, static_cast<int>(i) - 1, vertices, shape);
  }
  if (!vertices.empty()) {
    // The player looks at a sheet from the side that its triangles face. A closed mesh has no such
    // side, so a tiny triangle inside it, facing up in the first frame, decides.
    const int body = shape.bodies.back(), first = static_cast<int>(vertices.size());
    const Vec inside = 0.5 * bones[static_cast<std::size_t>(body + 1)].end;
    const Eigen::Matrix3d axes = body < 0
                                     ? Eigen::Matrix3d(Eigen::Matrix3d::Identity())
                                     : start.poses[static_cast<std::size_t>(body)].R.transpose();
    for (const Vec& corner : {Vec(0, 0, 0), Vec(5e-4, 0, 0), Vec(0, 5e-4, 0)}) {
      vertices.push_back(inside + axes * corner);
      shape.bodies.push_back(body);
    }
    shape.triangles.push_back({first, first + 1, first + 2});
  }
  shape.vertices.resize(3, static_cast<Index>(vertices.size()));
  for (std::size_t v = 0; v < vertices.size(); ++v)
    shape.vertices.col(static_cast<Index>(v)) = vertices[v];
  return shape;
}

void place_hand(const HandShape& shape, const BodyPoses<double>& body_poses,
                Eigen::Matrix3Xd& vertices) {
  vertices.resize(3, shape.vertices.cols());
  for (Index v = 0; v < shape.vertices.cols(); ++v) {
    const int body = shape.bodies[static_cast<std::size_t>(v)];
    if (body < 0) {
      vertices.col(v) = shape.vertices.col(v);
      continue;
    }
    const clothctl::BodyPose<double>& place = body_poses.poses[static_cast<std::size_t>(body)];
    vertices.col(v) = place.R * shape.vertices.col(v) + place.p;
  }
}

}  // namespace program
