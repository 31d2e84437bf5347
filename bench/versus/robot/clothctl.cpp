#include "clothctl.hpp"

#include <algorithm>
#include <memory>

#include "clothctl/bridge/urdf.hpp"
#include "clothctl/config.hpp"
#include "clothctl/robot/forward_dynamics.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"

namespace versus {

namespace {

using namespace clothctl;
using namespace clothctl;
using Vector = VectorX<double>;

class Ours final : public Peer {
 public:
  std::string load(const Model& model) override {
    Result<UrdfModel<double>> read = read_urdf<double>(model.file);
    if (!read) return read.error();
    robot_ = std::make_unique<Robot>(std::move(read->tree), model);
    return {};
  }

  bool offers(Task) const override { return true; }

  void prepare(Task, const std::vector<Sample>& samples) override {
    const auto vector = [](const std::vector<double>& v) -> Vector {
      return Eigen::Map<const Vector>(v.data(), static_cast<Index>(v.size()));
    };
    inputs_.clear();
    for (const Sample& s : samples) {
      inputs_.push_back(
          {vector(s.q), vector(s.qd), vector(s.qdd), vector(s.torques), vector(s.diagonal)});
    }
  }

  void run(Task task, int sample) override {
    Robot& r = *robot_;
    const Input& in = inputs_[static_cast<std::size_t>(sample)];
    forward_kinematics<double>(r.tree, in.q, r.body_poses);
    switch (task) {
      case Task::Poses:
        for (std::size_t k = 0; k < r.poses.size(); ++k)
          r.poses[k] = link_pose(r.tree, r.body_poses, static_cast<int>(k));
        return;
      case Task::Jacobian: link_jacobian<double>(r.tree, r.body_poses, r.tips[0], r.J); return;
      case Task::InverseDynamics:
        inverse_dynamics<double>(r.tree, r.body_poses, in.qd, in.qdd, r.gravity, r.inverse,
                                 r.answer);
        return;
      case Task::MassMatrix: mass_matrix<double>(r.tree, r.body_poses, r.mass, r.M); return;
      case Task::ForwardDynamics:
      case Task::DampedDynamics:
        (void)forward_dynamics<double>(r.tree, r.body_poses, in.qd, in.torques,
                                       task == Task::DampedDynamics ? in.diagonal : r.none,
                                       r.gravity, r.forward, r.answer);
        return;
    }
  }

  void read(Task task, double* out) override {
    const Robot& r = *robot_;
    if (task == Task::Poses) {
      for (const Pose<double>& pose : r.poses) {
        out = std::copy_n(pose.R.data(), 9, out);
        out = std::copy_n(pose.p.data(), 3, out);
      }
    } else if (task == Task::Jacobian) {
      std::copy_n(r.J.data(), r.J.size(), out);
    } else if (task == Task::MassMatrix) {
      std::copy_n(r.M.data(), r.M.size(), out);
    } else {
      std::copy_n(r.answer.data(), r.answer.size(), out);
    }
  }

  bool reaches() const override { return true; }

  void prepare(const Reach& reach) override {
    Robot& r = *robot_;
    r.tasks.clear();
    for (std::size_t k = 0; k < r.tips.size(); ++k) {
      const double* target = reach.targets.data() + 3 * k;
      r.tasks.push_back(IkTask<double>::position(r.tips[k], Vector3<double>::Zero(),
                                                 {target[0], target[1], target[2]}));
    }
    r.answer = Eigen::Map<const Vector>(reach.start.data(), r.tree.nq());
    uniforms_ = reach.uniforms;
  }

  bool reach() override {
    Robot& r = *robot_;
    std::size_t next = 0;
    const auto uniform = [&] { return uniforms_[next++ % uniforms_.size()]; };
    const int restarts = static_cast<int>(uniforms_.size()) / static_cast<int>(r.tree.nq());
    return r.ik.solve(r.tree, r.tasks, Vector(), r.answer, restarts, uniform).status ==
           IkStatus::Reached;
  }

  void read(double* q) override { std::copy_n(robot_->answer.data(), robot_->answer.size(), q); }

 private:
  struct Input {
    Vector q, qd, qdd, torques, diagonal;
  };
  struct Robot {
    KinematicTree<double> tree;
    BodyPoses<double> body_poses;
    InverseDynamicsWorkspace<double> inverse;
    MassMatrixWorkspace<double> mass;
    ForwardDynamicsWorkspace<double> forward;
    std::vector<int> tips;
    Vector3<double> gravity = standard_gravity<double>();
    std::vector<Pose<double>> poses;
    MatrixX<double> J, M;
    Vector answer, none;
    std::vector<IkTask<double>> tasks;
    InverseKinematics<KinematicTree<double>> ik;

    Robot(KinematicTree<double> t, const Model& model)
        : tree(std::move(t)),
          body_poses(tree),
          inverse(tree),
          mass(tree),
          forward(tree),
          tips(model.tips),
          ik(tree, static_cast<int>(tips.size()), settings()) {
      const Index n = tree.nv();
      poses.resize(tree.links().size());
      J.setZero(6, n);
      M.setZero(n, n);
      answer.setZero(n);
    }
    static IkSettings<double> settings() {
      IkSettings<double> chosen;
      chosen.tolerance = kReachTolerance;
      return chosen;
    }
  };

  std::unique_ptr<Robot> robot_;
  std::vector<Input> inputs_;
  std::vector<double> uniforms_;
};

}  // namespace

std::string describe(const std::string& file, const std::string& tips, Model& model) {
  const Result<UrdfModel<double>> read = read_urdf<double>(file);
  if (!read) return read.error();
  const KinematicTree<double>& tree = read->tree;
  model = Model();
  model.file = file;
  for (const Body<double>& body : tree.bodies()) {
    if (body.type == JointType::Free || body.follows)
      return file + ": joint \"" + body.name + "\" does not have exactly one coordinate";
    model.joints.push_back(body.name);
  }
  for (const Link<double>& link : tree.links()) {
    if (link.body >= 0 && link.name.find(tips) != std::string::npos)
      model.tips.push_back(static_cast<int>(model.links.size()));
    model.links.push_back(link.name);
    model.movers.push_back(link.body);
    const Pose<double>& place = link.placement;
    model.placements.insert(model.placements.end(), place.R.data(), place.R.data() + 9);
    model.placements.insert(model.placements.end(), place.p.data(), place.p.data() + 3);
  }
  if (model.tips.empty()) return file + ": no link has \"" + tips + "\" in its name";
  for (Index i = 0; i < tree.nq(); ++i) {
    const double turn = 3.141592653589793;
    model.lower.push_back(is_unbounded(tree.lower()[i]) ? -turn : tree.lower()[i]);
    model.upper.push_back(is_unbounded(tree.upper()[i]) ? turn : tree.upper()[i]);
  }
  return {};
}

Entry clothctl_entry() {
  return {"clothctl", CLOTHCTL_VERSION_STRING, [] { return static_cast<Peer*>(new Ours); }};
}

}  // namespace versus
