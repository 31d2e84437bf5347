#include <algorithm>
#include <kdl/treefksolverpos_recursive.hpp>
#include <kdl/treeidsolver_recursive_newton_euler.hpp>
#include <kdl/treeiksolverpos_nr_jl.hpp>
#include <kdl/treeiksolvervel_wdls.hpp>
#include <kdl/treejnttojacsolver.hpp>
#include <kdl_parser/kdl_parser.hpp>
#include <memory>

#include "peer.hpp"

namespace {

using namespace versus;

/// Trees are made by kdl_parser. Timed are Jacobians, inverse dynamics, and inverse kinematics by
/// damped least squares within limits. The poses of all links are computed by a walk over the
/// segments, because KDL's own function returns one link per call and starts at the root each time.
/// KDL has mass matrices and forward dynamics for chains only.
class Kdl final : public Peer {
 public:
  std::string load(const Model& model) override {
    model_ = model;
    if (!kdl_parser::treeFromFile(model.file, tree_)) return "kdl_parser cannot read the file";
    if (static_cast<int>(tree_.getNrOfJoints()) != model.n()) return "another number of joints";
    place_.assign(model.joints.size(), 0);
    list(tree_.getRootSegment(), 0);
    poses_.resize(segments_.size() + 1);
    const unsigned n = tree_.getNrOfJoints();
    J_.resize(n);
    for (KDL::JntArray* v : {&torques_, &q_min_, &q_max_, &start_, &answer_}) v->resize(n);
    to_own(model.lower.data(), q_min_);
    to_own(model.upper.data(), q_max_);
    poser_ = std::make_unique<KDL::TreeFkSolverPos_recursive>(tree_);
    jacobian_ = std::make_unique<KDL::TreeJntToJacSolver>(tree_);
    newton_ = std::make_unique<KDL::TreeIdSolver_RNE>(tree_, KDL::Vector(0, 0, -9.81));
    for (const int tip : model.tips) ends_.push_back(model.links[static_cast<std::size_t>(tip)]);
    step_ = std::make_unique<KDL::TreeIkSolverVel_wdls>(tree_, ends_);
    const Eigen::Index rows = 6 * static_cast<Eigen::Index>(ends_.size());
    Eigen::MatrixXd weights =
        Eigen::MatrixXd::Zero(rows, rows);  // positions count, rotations do not
    for (Eigen::Index k = 0; k < rows; k += 6) weights.diagonal().segment<3>(k).setOnes();
    step_->setWeightTS(weights);
    step_->setLambda(VERSUS_KDL_LAMBDA);
    // KDL stops by the norm of all tips' errors together.
    solver_ = std::make_unique<KDL::TreeIkSolverPos_NR_JL>(
        tree_, ends_, q_min_, q_max_, *poser_, *step_, VERSUS_KDL_ITERATIONS, kReachTolerance);
    return {};
  }

  bool offers(Task task) const override {
    return task == Task::Poses || task == Task::Jacobian || task == Task::InverseDynamics;
  }

  void prepare(Task, const std::vector<Sample>& samples) override {
    inputs_.assign(samples.size(), Input{});
    for (std::size_t k = 0; k < samples.size(); ++k) {
      Input& in = inputs_[k];
      for (KDL::JntArray* v : {&in.q, &in.qd, &in.qdd}) v->resize(tree_.getNrOfJoints());
      to_own(samples[k].q.data(), in.q);
      to_own(samples[k].qd.data(), in.qd);
      to_own(samples[k].qdd.data(), in.qdd);
    }
  }

  void run(Task task, int sample) override {
    const Input& in = inputs_[static_cast<std::size_t>(sample)];
    if (task == Task::Poses) {
      for (std::size_t k = 0; k < segments_.size(); ++k) {
        poses_[k + 1] =
            poses_[segments_[k].parent] * segments_[k].segment->pose(in.q(segments_[k].q));
      }
    } else if (task == Task::Jacobian) {
      jacobian_->JntToJac(in.q, J_, ends_.front());
    } else {
      newton_->CartToJnt(in.q, in.qd, in.qdd, no_forces_, torques_);
    }
  }

  void read(Task task, double* out) override {
    const std::size_t n = place_.size();
    if (task == Task::Poses) {
      for (const std::string& name : model_.links) {
        KDL::Frame pose = KDL::Frame::Identity();
        for (std::size_t k = 0; k < segments_.size(); ++k) {
          if (segments_[k].segment->getName() == name) pose = poses_[k + 1];
        }
        for (int c = 0; c < 3; ++c) {
          for (int r = 0; r < 3; ++r) *out++ = pose.M(r, c);
        }
        for (int r = 0; r < 3; ++r) *out++ = pose.p(r);
      }
    } else if (task == Task::Jacobian) {
      for (std::size_t k = 0; k < n; ++k) {
        for (unsigned r = 0; r < 6; ++r) out[6 * k + r] = J_(r, place_[k]);
      }
    } else {
      for (std::size_t k = 0; k < n; ++k) out[k] = torques_(place_[k]);
    }
  }

  bool reaches() const override { return true; }

  void prepare(const Reach& reach) override {
    targets_.clear();
    for (std::size_t k = 0; k < ends_.size(); ++k) {
      const double* p = reach.targets.data() + 3 * k;
      targets_[ends_[k]] = KDL::Frame(KDL::Vector(p[0], p[1], p[2]));
    }
    const std::size_t n = model_.joints.size();
    starts_.assign(1 + reach.uniforms.size() / n, start_);
    to_own(reach.start.data(), starts_[0]);
    for (std::size_t s = 1; s < starts_.size(); ++s) {
      for (std::size_t i = 0; i < n; ++i) {
        const double u = reach.uniforms[(s - 1) * n + i];
        starts_[s](place_[i]) = model_.lower[i] + u * (model_.upper[i] - model_.lower[i]);
      }
    }
  }

  bool reach() override {
    for (const KDL::JntArray& start : starts_) {
      if (solver_->CartToJnt(start, targets_, answer_) >= 0) return true;
    }
    return false;
  }

  void read(double* q) override {
    for (std::size_t i = 0; i < place_.size(); ++i) q[i] = answer_(place_[i]);
  }

 private:
  struct Input {
    KDL::JntArray q, qd, qdd;
  };
  struct Step {
    const KDL::Segment* segment;
    unsigned q;
    std::size_t parent;  // index in poses_, where 0 is the root
  };

  /// Lists the segments below a segment, parents first.
  void list(KDL::SegmentMap::const_iterator at, std::size_t parent) {
    for (const KDL::SegmentMap::const_iterator& child : at->second.children) {
      const KDL::TreeElement& element = child->second;
      segments_.push_back({&element.segment, element.q_nr, parent});
      const KDL::Joint& joint = element.segment.getJoint();
      const auto found = std::find(model_.joints.begin(), model_.joints.end(), joint.getName());
      if (joint.getType() != KDL::Joint::None && found != model_.joints.end()) {
        place_[static_cast<std::size_t>(found - model_.joints.begin())] = element.q_nr;
      }
      list(child, segments_.size());
    }
  }

  void to_own(const double* values, KDL::JntArray& own) const {
    for (std::size_t i = 0; i < place_.size(); ++i) own(place_[i]) = values[i];
  }

  Model model_;
  KDL::Tree tree_;
  std::vector<unsigned> place_;  // index of each of our coordinates
  std::vector<Step> segments_;
  std::vector<KDL::Frame> poses_;
  std::vector<std::string> ends_;
  std::vector<Input> inputs_;
  KDL::Jacobian J_;
  KDL::JntArray torques_, q_min_, q_max_, start_, answer_;
  KDL::WrenchMap no_forces_;
  KDL::Frames targets_;
  std::vector<KDL::JntArray> starts_;
  std::unique_ptr<KDL::TreeFkSolverPos_recursive> poser_;
  std::unique_ptr<KDL::TreeJntToJacSolver> jacobian_;
  std::unique_ptr<KDL::TreeIdSolver_RNE> newton_;
  std::unique_ptr<KDL::TreeIkSolverVel_wdls> step_;
  std::unique_ptr<KDL::TreeIkSolverPos_NR_JL> solver_;
};

}  // namespace

VERSUS_MODULE("kdl", VERSUS_KDL_VERSION, Kdl)
