// Included one by one: the header for all of dynamics needs a file that is missing from Debian's
// package.
#include <dart/dynamics/BodyNode.hpp>
#include <dart/dynamics/DegreeOfFreedom.hpp>
#include <dart/dynamics/Joint.hpp>
#include <dart/dynamics/Skeleton.hpp>
#include <dart/utils/urdf/DartLoader.hpp>

#include <filesystem>

#include "peer.hpp"

namespace {

using namespace versus;
namespace dynamics = dart::dynamics;

/// Answers are computed on request and cached until positions change. The diagonal is DART's joint
/// damping, which enters forward dynamics implicitly (damping × time step on the diagonal, with a
/// step of 1 s here); its explicit part is compensated in the torques. DART's whole-body
/// inverse kinematics is left out: it adds or ranks the steps of single tips and did not bring five
/// tips to 1 mm.
class Dart final : public Peer {
 public:
  std::string load(const Model& model) override {
    model_ = model;
    // For links without inertia. DART would assume 1 kg, and warns of each.
    const dynamics::Inertia nothing(1e-20, Eigen::Vector3d::Zero(),
                                    1e-20 * Eigen::Matrix3d::Identity());
    using Loader = dart::utils::DartLoader;
    Loader loader(Loader::Options(nullptr, Loader::RootJointType::FIXED, nothing));
    // DART takes a path without a leading slash for a URI without a scheme, and refuses it.
    robot_ = loader.parseSkeleton(std::filesystem::absolute(model.file).string());
    if (!robot_) return "DartLoader cannot read the file";
    if (static_cast<int>(robot_->getNumDofs()) != model.n()) return "another number of coordinates";
    place_.clear();
    for (const std::string& name : model.joints) {
      const dynamics::Joint* joint = robot_->getJoint(name);
      if (joint == nullptr) return "no joint " + name;
      place_.push_back(static_cast<Eigen::Index>(joint->getIndexInSkeleton(0)));
    }
    links_.clear();
    for (const std::string& name : model.links) links_.push_back(robot_->getBodyNode(name));
    robot_->setGravity({0, 0, -9.81});
    robot_->setTimeStep(1.0);
    for (std::size_t i = 0; i < robot_->getNumDofs(); ++i) {
      dynamics::DegreeOfFreedom* dof = robot_->getDof(i);
      dof->setDampingCoefficient(0);
      dof->setSpringStiffness(0);
      dof->setCoulombFriction(0);
    }
    return {};
  }

  bool offers(Task) const override { return true; }

  void prepare(Task task, const std::vector<Sample>& samples) override {
    inputs_.clear();
    for (const Sample& s : samples) {
      Input in{to_own(s.q), to_own(s.qd), to_own(s.qdd), to_own(s.torques)};
      if (task == Task::DampedDynamics) in.torques += to_own(s.diagonal).cwiseProduct(in.qd);
      inputs_.push_back(in);
    }
    const Eigen::VectorXd damping = to_own(samples.front().diagonal);
    for (std::size_t i = 0; i < robot_->getNumDofs(); ++i) {
      const bool damped = task == Task::DampedDynamics;
      robot_->getDof(i)->setDampingCoefficient(damped ? damping[static_cast<Eigen::Index>(i)]
                                                      : 0.0);
    }
  }

  void run(Task task, int sample) override {
    const Input& in = inputs_[static_cast<std::size_t>(sample)];
    robot_->setPositions(in.q);
    switch (task) {
      case Task::Poses:
        for (const dynamics::BodyNode* link : links_) {
          if (link != nullptr) link->getWorldTransform();
        }
        return;
      case Task::Jacobian: J_ = robot_->getWorldJacobian(tip()); return;
      case Task::InverseDynamics:
        robot_->setVelocities(in.qd);
        robot_->setAccelerations(in.qdd);
        robot_->computeInverseDynamics();
        return;
      case Task::MassMatrix: robot_->getMassMatrix(); return;
      case Task::ForwardDynamics:
      case Task::DampedDynamics:
        robot_->setVelocities(in.qd);
        robot_->setForces(in.torques);
        robot_->computeForwardDynamics();
        return;
    }
  }

  void read(Task task, double* out) override {
    const std::size_t n = place_.size();
    if (task == Task::Poses) {
      for (std::size_t k = 0; k < links_.size(); ++k) {
        Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
        if (links_[k] != nullptr) pose = links_[k]->getWorldTransform();
        const Eigen::Matrix3d R = pose.linear();
        const Eigen::Vector3d p = pose.translation();
        out = std::copy_n(R.data(), 9, out);
        out = std::copy_n(p.data(), 3, out);
      }
    } else if (task == Task::Jacobian) {
      for (std::size_t i = 0; i < n; ++i) {
        for (Eigen::Index r = 0; r < 6; ++r)
          out[6 * i + static_cast<std::size_t>((r + 3) % 6)] = J_(r, place_[i]);
      }
    } else if (task == Task::MassMatrix) {
      const Eigen::MatrixXd& M = robot_->getMassMatrix();
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t k = 0; k < n; ++k) out[n * i + k] = M(place_[k], place_[i]);
      }
    } else {
      const Eigen::VectorXd answer =
          task == Task::InverseDynamics ? robot_->getForces() : robot_->getAccelerations();
      for (std::size_t i = 0; i < n; ++i) out[i] = answer[place_[i]];
    }
  }

 private:
  struct Input {
    Eigen::VectorXd q, qd, qdd, torques;
  };

  const dynamics::BodyNode* tip() const { return links_[static_cast<std::size_t>(model_.tips[0])]; }

  Eigen::VectorXd to_own(const std::vector<double>& values) const {
    Eigen::VectorXd own(static_cast<Eigen::Index>(place_.size()));
    for (std::size_t i = 0; i < place_.size(); ++i) own[place_[i]] = values[i];
    return own;
  }

  Model model_;
  dynamics::SkeletonPtr robot_;
  std::vector<Eigen::Index> place_;  // index of each of our coordinates
  std::vector<dynamics::BodyNode*> links_;
  std::vector<Input> inputs_;
  dart::math::Jacobian J_;
};

}  // namespace

VERSUS_MODULE("dart", VERSUS_DART_VERSION, Dart)
