#include <pinocchio/fwd.hpp>  // must come first

#include <algorithm>
#include <memory>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/parsers/urdf.hpp>

#include "peer.hpp"

namespace {

using namespace versus;
using Vector = Eigen::VectorXd;

/// The diagonal is Pinocchio's armature (rotor inertia). It computes only the upper half of the
/// mass matrix.
class Pinocchio final : public Peer {
 public:
  std::string load(const Model& model) override {
    names_ = model;
    model_ = pinocchio::Model();
    try {
      pinocchio::urdf::buildModel(model.file, model_);
    } catch (const std::exception& e) {
      return e.what();
    }
    model_.gravity.linear() = Eigen::Vector3d(0, 0, -9.81);
    if (model_.nv != model.n() || model_.nq != model.n()) return "another number of coordinates";
    place_.clear();
    for (const std::string& name : model.joints) {
      if (!model_.existJointName(name)) return "no joint " + name;
      place_.push_back(model_.idx_vs[model_.getJointId(name)]);
    }
    frames_.clear();
    for (const std::string& name : model.links) {
      if (!model_.existBodyName(name)) return "no link " + name;
      frames_.push_back(model_.getBodyId(name));
    }
    data_ = std::make_unique<pinocchio::Data>(model_);
    J_.setZero(6, model_.nv);
    return {};
  }

  bool offers(Task) const override { return true; }

  void prepare(Task, const std::vector<Sample>& samples) override {
    inputs_.clear();
    for (const Sample& s : samples) {
      inputs_.push_back(
          {to_own(s.q), to_own(s.qd), to_own(s.qdd), to_own(s.torques), to_own(s.diagonal)});
    }
    model_.armature.setZero();
  }

  void run(Task task, int sample) override {
    const Input& in = inputs_[static_cast<std::size_t>(sample)];
    pinocchio::Data& data = *data_;
    switch (task) {
      case Task::Poses: pinocchio::framesForwardKinematics(model_, data, in.q); return;
      case Task::Jacobian: {
        pinocchio::computeJointJacobians(model_, data, in.q);
        const pinocchio::FrameIndex tip = frames_[static_cast<std::size_t>(names_.tips[0])];
        pinocchio::updateFramePlacement(model_, data, tip);
        J_.setZero();
        pinocchio::getFrameJacobian(model_, data, tip, pinocchio::LOCAL_WORLD_ALIGNED, J_);
        return;
      }
      case Task::InverseDynamics: pinocchio::rnea(model_, data, in.q, in.qd, in.qdd); return;
      case Task::MassMatrix: pinocchio::crba(model_, data, in.q, kMassConvention); return;
      case Task::DampedDynamics: model_.armature = in.diagonal; [[fallthrough]];
      case Task::ForwardDynamics:
        pinocchio::aba(model_, data, in.q, in.qd, in.torques, kForwardConvention);
        return;
    }
  }

  void read(Task task, double* out) override {
    const pinocchio::Data& data = *data_;
    const std::size_t n = place_.size();
    if (task == Task::Poses) {
      for (const pinocchio::FrameIndex frame : frames_) {
        const pinocchio::SE3& pose = data.oMf[frame];
        const Eigen::Matrix3d R = pose.rotation();
        const Eigen::Vector3d p = pose.translation();
        out = std::copy_n(R.data(), 9, out);
        out = std::copy_n(p.data(), 3, out);
      }
    } else if (task == Task::Jacobian) {
      for (std::size_t i = 0; i < n; ++i) std::copy_n(J_.col(place_[i]).data(), 6, out + 6 * i);
    } else if (task == Task::MassMatrix) {
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t k = 0; k < n; ++k) {
          out[n * i + k] = data.M(std::min(place_[i], place_[k]), std::max(place_[i], place_[k]));
        }
      }
    } else {
      const Vector& answer = task == Task::InverseDynamics ? data.tau : data.ddq;
      for (std::size_t i = 0; i < n; ++i) out[i] = answer[place_[i]];
    }
  }

 private:
  // The variants that were faster here.
  static constexpr pinocchio::Convention kMassConvention = pinocchio::Convention::LOCAL;
  static constexpr pinocchio::Convention kForwardConvention = pinocchio::Convention::WORLD;

  struct Input {
    Vector q, qd, qdd, torques, diagonal;
  };

  Vector to_own(const std::vector<double>& values) const {
    Vector own(model_.nv);
    for (std::size_t i = 0; i < place_.size(); ++i) own[place_[i]] = values[i];
    return own;
  }

  Model names_;
  pinocchio::Model model_;
  std::unique_ptr<pinocchio::Data> data_;
  std::vector<Eigen::Index> place_;  // index of each of our coordinates
  std::vector<pinocchio::FrameIndex> frames_;
  std::vector<Input> inputs_;
  Eigen::Matrix<double, 6, Eigen::Dynamic> J_;
};

}  // namespace

VERSUS_MODULE("pinocchio", VERSUS_PINOCCHIO_VERSION, Pinocchio)
