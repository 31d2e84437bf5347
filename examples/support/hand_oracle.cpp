#include "support/hand_oracle.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <vector>

#include "clothctl/io/file.hpp"
#include "clothctl/robot/inverse_dynamics.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "clothctl/robot/stable_pd.hpp"
#include "support/options.hpp"

namespace program {

namespace {

using clothctl::Body;
using clothctl::Index;
using clothctl::JointType;
using clothctl::KinematicTree;
using clothctl::MatrixX;
using clothctl::VectorX;
using Json = nlohmann::json;
using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;

void raise(double& worst, double error) {
  if (!clothctl::is_finite(error)) error = std::numeric_limits<double>::infinity();
  worst = std::max(worst, error);
}

/// The fields of a file. A missing or wrong field ends the program.
class Oracle {
 public:
  explicit Oracle(const std::string& path) : path_(path) {
    const std::string text = must(clothctl::read_file(path));
    try {
      root_ = Json::parse(text);
    } catch (const Json::exception& e) {
      refuse(path + ": " + e.what());
    }
    if (!root_.is_object()) refuse(path + ": is not a JSON object");
  }

  const Json& root() const { return root_; }

  [[noreturn]] void fail(const std::string& where, const std::string& what) const {
    refuse(path_ + ": " + where + what);
  }

  /// Returns a field of an object.
  const Json& field(const Json& object, const std::string& where, const char* name) const {
    if (!object.is_object()) fail(where, "is not an object");
    const auto found = object.find(name);
    if (found == object.end()) fail(where, std::string(name) + " is missing");
    return *found;
  }
  double number(const Json& value, const std::string& where) const {
    if (!value.is_number()) fail(where, "is not a number: " + shown(value));
    const double number = value.get<double>();
    if (!clothctl::is_finite(number)) fail(where, "is not finite");
    return number;
  }
  std::string text(const Json& value, const std::string& where) const {
    if (!value.is_string()) fail(where, "is not a text: " + shown(value));
    return value.get<std::string>();
  }
  /// Returns a list of `size` numbers.
  Vector vector(const Json& value, const std::string& where, Index size) const {
    if (!value.is_array()) fail(where, "is not a list of numbers: " + shown(value));
    if (static_cast<Index>(value.size()) != size)
      fail(where,
           "has " + std::to_string(value.size()) + " entries, must have " + std::to_string(size));
    Vector out(size);
    const std::string list = where.substr(0, where.find_last_not_of(' ') + 1);
    for (Index i = 0; i < size; ++i) {
      out[i] = number(value[static_cast<std::size_t>(i)], list + "[" + std::to_string(i) + "] ");
    }
    return out;
  }
  Matrix matrix(const Json& value, const std::string& where, Index rows, Index cols) const {
    if (!value.is_array() || static_cast<Index>(value.size()) != rows)
      fail(where, "is not a list of " + std::to_string(rows) + " rows");
    Matrix out(rows, cols);
    for (Index i = 0; i < rows; ++i) {
      out.row(i) =
          vector(value[static_cast<std::size_t>(i)], where + "row " + std::to_string(i) + " ", cols)
              .transpose();
    }
    return out;
  }

  static std::string shown(const Json& value) {
    const std::string text = value.dump(-1, ' ', true, Json::error_handler_t::replace);
    return text.size() > 40 ? text.substr(0, 40) + "..." : text;
  }

 private:
  std::string path_;
  Json root_;
};

/// Returns the tree's coordinate for each joint in the file's order.
template <class Scalar>
std::vector<Index> match_joints(const KinematicTree<Scalar>& tree, const std::string& model,
                                const Oracle& file) {
  const Json& names = file.field(file.root(), "", "joint_order");
  if (!names.is_array()) file.fail("joint_order ", "is not a list of names");
  std::vector<Index> order;
  for (std::size_t k = 0; k < names.size(); ++k) {
    const std::string where = "joint_order[" + std::to_string(k) + "] ",
                      name = file.text(names[k], where);
    const int body = tree.find_joint(name);
    if (body < 0) file.fail(where, "'" + name + "' is not a joint of " + model);
    const Body<Scalar>& found = tree.bodies()[static_cast<std::size_t>(body)];
    if (found.type == JointType::Free || found.follows)
      file.fail(where, "'" + name + "' is free or follows another joint in " + model);
    if (std::find(order.begin(), order.end(), found.velocity) != order.end())
      file.fail(where, "'" + name + "' occurs twice");
    order.push_back(found.velocity);
  }
  for (const Body<Scalar>& body : tree.bodies()) {
    if (std::find(order.begin(), order.end(), body.velocity) == order.end())
      file.fail("joint_order ", "lacks joint '" + body.name + "' of " + model);
  }
  return order;
}

template <class Scalar>
class Comparison {
 public:
  Comparison(const KinematicTree<Scalar>& tree, const std::string& model, const std::string& path)
      : tree_(tree),
        model_(model),
        file_(path),
        order_(match_joints(tree, model, file_)),
        work_(tree),
        mass_work_(tree) {
    const Json& root = file_.root();
    n_ = tree.nv();
    link_ = link(file_.text(file_.field(root, "", "jacobian_link"), "jacobian_link "),
                 "jacobian_link ");
    work_.gravity =
        file_.vector(file_.field(root, "", "gravity"), "gravity ", 3).template cast<Scalar>();
    const Json& gains = file_.field(root, "", "spd");
    const auto gain = [&](const char* name) {
      return static_cast<Scalar>(
          file_.number(file_.field(gains, "spd ", name), std::string("spd ") + name + " "));
    };
    auto settings = clothctl::StablePdSettings<Scalar>::uniform(n_, gain("kp"), gain("kd"));
    settings.dt = gain("h");
    settings.limit_torques = settings.feed_gravity = settings.feed_velocity = false;
    clothctl::Result<Controller> made = Controller::create(tree, settings);
    if (!made) file_.fail("spd: ", made.error());
    pd_.push_back(std::move(made).value());
  }

  OracleErrors run() {
    const Json& samples = file_.field(file_.root(), "", "samples");
    if (!samples.is_array() || samples.empty())
      file_.fail("samples ", "is not a list with a sample in it");
    const int count = static_cast<int>(samples.size());
    for (int s = 0; s < count; ++s)
      compare(samples[static_cast<std::size_t>(s)], "sample " + std::to_string(s) + ": ");
    errors_.samples = count;
    return errors_;
  }

 private:
  using Controller = clothctl::StablePd<KinematicTree<Scalar>>;
  using Vec = VectorX<Scalar>;

  int link(const std::string& name, const std::string& where) const {
    const int found = tree_.find_link(name);
    if (found < 0) file_.fail(where, "'" + name + "' is not a link of " + model_);
    return found;
  }
  Vector read(const Json& sample, const std::string& where, const char* name) const {
    const Vector given = file_.vector(file_.field(sample, where, name), where + name + " ", n_);
    Vector out(n_);
    for (Index k = 0; k < n_; ++k) out[order_[static_cast<std::size_t>(k)]] = given[k];
    return out;
  }

  /// The largest difference, relative to the largest entry. If all entries are zero, like gravity's
  /// for an upright arm, it is relative to `unit`, the size of the sample's other entries.
  static double relative(const Vec& found, const Vector& expected, double unit) {
    const double size = expected.cwiseAbs().maxCoeff();
    return (found.template cast<double>() - expected).cwiseAbs().maxCoeff() /
           (size > 1e-12 * unit ? size : unit);
  }

  void compare(const Json& sample, const std::string& where) {
    const Vector q = read(sample, where, "q"), qd = read(sample, where, "qd"),
                 qdd = read(sample, where, "qdd");
    const Vector target = read(sample, where, "qbar"), gravity = read(sample, where, "gravity");
    const Vector bias = read(sample, where, "coriolis") + gravity,
                 fd_tau = read(sample, where, "fd_tau");
    const Matrix jacobian =
        file_.matrix(file_.field(sample, where, "jacobian"), where + "jacobian ", 6, n_);
    const Matrix mass =
        file_.matrix(file_.field(sample, where, "mass_matrix"), where + "mass_matrix ", n_, n_);
    Vec at(tree_.nq()), out(n_), out_qdd(n_);
    for (const Body<Scalar>& body : tree_.bodies())
      at[body.position] = static_cast<Scalar>(q[body.velocity]);
    const Vec speed = qd.template cast<Scalar>(), zero = Vec::Zero(n_);
    clothctl::forward_kinematics<Scalar>(tree_, at, work_.body_poses);
    compare_links(file_.field(sample, where, "fk"), where + "fk ");

    MatrixX<Scalar> J(6, n_), M(n_, n_);
    clothctl::link_jacobian<Scalar>(tree_, work_.body_poses, link_, J);
    clothctl::mass_matrix<Scalar>(tree_, work_.body_poses, mass_work_, M);
    const double mass_size = mass.cwiseAbs().maxCoeff(), unit = std::max(mass_size, 1e-300);
    for (Index k = 0; k < n_; ++k) {
      const Index i = order_[static_cast<std::size_t>(k)];
      raise(errors_.jacobian,
            (J.col(i).template cast<double>() - jacobian.col(k)).cwiseAbs().maxCoeff());
      for (Index l = 0; l < n_; ++l) {
        const double entry = static_cast<double>(M(i, order_[static_cast<std::size_t>(l)]));
        raise(errors_.mass, std::abs(entry - mass(k, l)) / unit);
      }
    }
    using clothctl::inverse_dynamics;
    inverse_dynamics<Scalar>(tree_, work_.body_poses, zero, zero, work_.gravity, work_.inverse,
                             out);
    raise(errors_.gravity, relative(out, gravity, unit));
    inverse_dynamics<Scalar>(tree_, work_.body_poses, speed, zero, work_.gravity, work_.inverse,
                             out);
    raise(errors_.bias, relative(out, bias, unit));
    inverse_dynamics<Scalar>(tree_, work_.body_poses, speed, qdd.template cast<Scalar>(),
                             work_.gravity, work_.inverse, out);
    raise(errors_.rnea, relative(out, read(sample, where, "rnea_tau"), unit));
    const clothctl::DynamicsReport solved = clothctl::forward_dynamics<Scalar>(
        tree_, work_.body_poses, speed, fd_tau.template cast<Scalar>(), Vec(), work_.gravity,
        work_.forward, out);
    const Vector expected_qdd = read(sample, where, "fd_qdd");
    const bool dynamics_solved = solved.status == clothctl::DynamicsStatus::Solved;
    raise(errors_.fd, dynamics_solved ? relative(out, expected_qdd, 1)
                                      : std::numeric_limits<double>::infinity());
    const clothctl::PdReport report =
        pd_[0].solve(tree_, at, speed, positions(target), Vec(), Vec(), work_, out, out_qdd);
    const Vector expected_tau = read(sample, where, "spd_tau"),
                 expected_spd = read(sample, where, "spd_qdd");
    const bool controlled = report.status == clothctl::PdStatus::Solved;
    raise(errors_.spd_tau,
          controlled ? relative(out, expected_tau, unit) : std::numeric_limits<double>::infinity());
    raise(errors_.spd_qdd, controlled ? relative(out_qdd, expected_spd, 1)
                                      : std::numeric_limits<double>::infinity());
  }

  Vec positions(const Vector& by_velocity) const {
    Vec out(tree_.nq());
    for (const Body<Scalar>& body : tree_.bodies())
      out[body.position] = static_cast<Scalar>(by_velocity[body.velocity]);
    return out;
  }

  void compare_links(const Json& links, const std::string& where) {
    if (!links.is_object() || links.empty())
      file_.fail(where, "is not an object with a link in it");
    for (const auto& [name, pose] : links.items()) {
      const std::string here = where + name + " ";
      const clothctl::Pose<Scalar> found =
          clothctl::link_pose(tree_, work_.body_poses, link(name, where));
      const Vector p = file_.vector(file_.field(pose, here, "p"), here + "p ", 3);
      const Vector w = file_.vector(file_.field(pose, here, "quat_wxyz"), here + "quat_wxyz ", 4);
      if (!(std::abs(w.norm() - 1) < 1e-6)) file_.fail(here, "quat_wxyz is not a unit quaternion");
      const Eigen::Matrix3d R =
          Eigen::Quaterniond(w[0], w[1], w[2], w[3]).normalized().toRotationMatrix();
      raise(errors_.fk, (found.p.template cast<double>() - p).cwiseAbs().maxCoeff());
      raise(errors_.fk, (found.R.template cast<double>() - R).cwiseAbs().maxCoeff());
    }
  }

  const KinematicTree<Scalar>& tree_;
  const std::string& model_;
  Oracle file_;
  std::vector<Index> order_;
  clothctl::KinematicTreeWorkspace<Scalar> work_;
  clothctl::MassMatrixWorkspace<Scalar> mass_work_;
  std::vector<Controller> pd_;
  Index n_ = 0;
  int link_ = 0;
  OracleErrors errors_;
};

}  // namespace

bool OracleErrors::within(double tolerance) const {
  const double worst = std::max({fk, jacobian, mass, bias, gravity, rnea, spd_qdd, spd_tau});
  return worst <= tolerance && fd <= std::max(1e-6, tolerance);
}

template <class Scalar>
OracleErrors compare_with_oracle(const KinematicTree<Scalar>& tree, const std::string& model,
                                 const std::string& path) {
  return Comparison<Scalar>(tree, model, path).run();
}

template OracleErrors compare_with_oracle<double>(const KinematicTree<double>&, const std::string&,
                                                  const std::string&);
template OracleErrors compare_with_oracle<float>(const KinematicTree<float>&, const std::string&,
                                                 const std::string&);

}  // namespace program
