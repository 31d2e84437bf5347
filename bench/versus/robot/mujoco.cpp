#include <mujoco/mujoco.h>

#include <algorithm>
#include <memory>

#include "peer.hpp"

namespace {

using namespace versus;

/// The parts of mj_forward that a robot without contact needs. MuJoCo merges links that do not move
/// relative to each other (its default for URDF), so their poses are computed from those of its
/// bodies. The mass matrix stays sparse.
class Mujoco final : public Peer {
 public:
  std::string load(const Model& model) override {
    model_ = model;
    char error[1000] = "";
    own_.reset(mj_loadXML(model.file.c_str(), nullptr, error, sizeof error));
    if (!own_) return error;
    data_.reset(mj_makeData(own_.get()));
    const mjModel* m = own_.get();
    if (m->nv != model.n() || m->nq != model.n()) return "another number of coordinates";
    q_.clear();
    v_.clear();
    for (const std::string& name : model.joints) {
      const int joint = mj_name2id(m, mjOBJ_JOINT, name.c_str());
      if (joint < 0) return "no joint " + name;
      q_.push_back(m->jnt_qposadr[joint]);
      v_.push_back(m->jnt_dofadr[joint]);
    }
    frames_.clear();
    for (std::size_t k = 0; k < model.links.size(); ++k) {
      Frame frame{0, {}};
      double* const placement = model_.placements.data() + 12 * k;
      std::copy_n(placement, 12, frame.offset);
      if (model.movers[k] >= 0) {
        const int joint = mj_name2id(
            m, mjOBJ_JOINT, model.joints[static_cast<std::size_t>(model.movers[k])].c_str());
        frame.body = m->jnt_bodyid[joint];
        const char* name = mj_id2name(m, mjOBJ_BODY, frame.body);
        const auto main = std::find(model.links.begin(), model.links.end(),
                                    std::string(name != nullptr ? name : ""));
        if (main == model.links.end()) return "no link of a body's name";
        const double* carrier = model.placements.data() + 12 * (main - model.links.begin());
        for (int r = 0; r < 3; ++r) {  // carrier⁻¹ · placement
          frame.offset[9 + r] = 0;
          for (int i = 0; i < 3; ++i)
            frame.offset[9 + r] += carrier[3 * r + i] * (placement[9 + i] - carrier[9 + i]);
          for (int c = 0; c < 3; ++c) {
            frame.offset[3 * c + r] = 0;
            for (int i = 0; i < 3; ++i)
              frame.offset[3 * c + r] += carrier[3 * r + i] * placement[3 * c + i];
          }
        }
      }
      frames_.push_back(frame);
    }
    poses_.assign(12 * frames_.size(), 0.0);
    J_.assign(static_cast<std::size_t>(6 * m->nv), 0.0);
    for (std::vector<double>* v : {&answer_, &rest_})
      v->assign(static_cast<std::size_t>(m->nv), 0.0);
    return {};
  }

  bool offers(Task) const override { return true; }

  void prepare(Task, const std::vector<Sample>& samples) override {
    const std::size_t n = q_.size();
    inputs_.assign(samples.size(), {});
    for (std::size_t k = 0; k < samples.size(); ++k) {
      Sample& in = inputs_[k];
      const Sample& from = samples[k];
      for (std::vector<double>* v : {&in.q, &in.qd, &in.qdd, &in.torques, &in.diagonal})
        v->assign(n, 0.0);
      for (std::size_t i = 0; i < n; ++i) {
        const std::size_t q = static_cast<std::size_t>(q_[i]), v = static_cast<std::size_t>(v_[i]);
        in.q[q] = from.q[i];
        in.qd[v] = from.qd[i];
        in.qdd[v] = from.qdd[i];
        in.torques[v] = from.torques[i];
        in.diagonal[v] = from.diagonal[i];
      }
    }
  }

  void run(Task task, int sample) override {
    const mjModel* m = own_.get();
    mjData* d = data_.get();
    const Sample& in = inputs_[static_cast<std::size_t>(sample)];
    std::copy(in.q.begin(), in.q.end(), d->qpos);
    mj_kinematics(m, d);
    if (task == Task::Poses) {
      for (std::size_t k = 0; k < frames_.size(); ++k) place(frames_[k], poses_.data() + 12 * k);
      return;
    }
    mj_comPos(m, d);
    switch (task) {
      case Task::Poses: return;
      case Task::Jacobian: {
        const Frame& tip = frames_[static_cast<std::size_t>(model_.tips[0])];
        double pose[12];
        place(tip, pose);
        mj_jac(m, d, J_.data(), J_.data() + 3 * m->nv, pose + 9, tip.body);
        return;
      }
      case Task::InverseDynamics:
        std::copy(in.qd.begin(), in.qd.end(), d->qvel);
        std::copy(in.qdd.begin(), in.qdd.end(), d->qacc);
        mj_comVel(m, d);
        mj_rne(m, d, 1, answer_.data());
        return;
      case Task::MassMatrix: mj_crb(m, d); return;
      case Task::ForwardDynamics:
      case Task::DampedDynamics:
        std::copy(in.qd.begin(), in.qd.end(), d->qvel);
        mj_crb(m, d);
        if (task == Task::DampedDynamics) {
          for (int i = 0; i < m->nv; ++i)
            d->qM[m->dof_Madr[i]] += in.diagonal[static_cast<std::size_t>(i)];
        }
        mj_factorM(m, d);
        mj_comVel(m, d);
        mj_rne(m, d, 0, rest_.data());
        for (std::size_t i = 0; i < rest_.size(); ++i) rest_[i] = in.torques[i] - rest_[i];
        mj_solveM(m, d, answer_.data(), rest_.data(), 1);
        return;
    }
  }

  void read(Task task, double* out) override {
    const std::size_t n = v_.size();
    const auto at = [&](std::size_t i) { return static_cast<std::size_t>(v_[i]); };
    if (task == Task::Poses) {
      std::copy(poses_.begin(), poses_.end(), out);
    } else if (task == Task::Jacobian) {
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t r = 0; r < 6; ++r) out[6 * i + r] = J_[n * r + at(i)];
      }
    } else if (task == Task::MassMatrix) {
      std::vector<double> M(n * n);
      mj_fullM(own_.get(), M.data(), data_->qM);
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t k = 0; k < n; ++k) out[n * i + k] = M[n * at(i) + at(k)];
      }
    } else {
      for (std::size_t i = 0; i < n; ++i) out[i] = answer_[at(i)];
    }
  }

 private:
  struct Frame {
    int body;
    double offset[12];
  };
  struct Free {
    void operator()(mjModel* m) const { mj_deleteModel(m); }
    void operator()(mjData* d) const { mj_deleteData(d); }
  };

  /// The pose of a link, R by columns and p.
  void place(const Frame& frame, double* pose) const {
    const double* R = data_->xmat + 9 * frame.body;  // row-major
    const double* p = data_->xpos + 3 * frame.body;
    const double* offset = frame.offset;
    for (int c = 0; c < 4; ++c) {
      for (int r = 0; r < 3; ++r) {
        pose[3 * c + r] = R[3 * r] * offset[3 * c] + R[3 * r + 1] * offset[3 * c + 1] +
                          R[3 * r + 2] * offset[3 * c + 2];
      }
    }
    for (int r = 0; r < 3; ++r) pose[9 + r] += p[r];
  }

  Model model_;
  std::unique_ptr<mjModel, Free> own_;
  std::unique_ptr<mjData, Free> data_;
  std::vector<int> q_, v_;  // index of each of our coordinates
  std::vector<Frame> frames_;
  std::vector<Sample> inputs_;
  std::vector<double> poses_, J_, answer_, rest_;
};

}  // namespace

VERSUS_MODULE("mujoco", mj_versionString(), Mujoco)
