#pragma once

// Solves the contacts and joints of one island: bodies that touch or hang together. With the
// velocities v of the bodies, contact rows J_c, joint rows J_j, and the softness R of the joints,
//
//   M (v - v_free) = J_cᵀ λ + J_jᵀ μ,     J_j v + R μ + bias = 0,     J_c v and λ as in a contact
//
// The joints are eliminated: the contacts see the mobility of bodies that hang together,
//
//   W = J_c M⁻¹ J_cᵀ - X A⁻¹ Xᵀ,     X = J_c M⁻¹ J_jᵀ,     A = J_j M⁻¹ J_jᵀ + R
//
// and ContactSolver solves them with Newton's method. An island with more contacts or joint rows
// than there is room for is swept, block by block (Gauss–Seidel), from the impulses of the last
// step: a contact by its exact solution, a joint by its own block of A.
//
// Contacts are springs and dampers (detail/contact_sample.hpp) with c = h²/(β κ m), m the heaviest
// mass of the island, and c d = h (1/β - 1). A step then removes the share β of an overlap, and
// the softness adds 1/(κ m) to the diagonal: little beside the mobility of any body, but enough to
// make the many contacts of a face a regular problem. A weight m g sinks by g h²/(β κ) if it rests
// on one contact.

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "clothctl/contact/contact_solver.hpp"
#include "clothctl/linalg/small_cholesky.hpp"
#include "clothctl/linalg/tiled_cholesky.hpp"
#include "clothctl/sim/detail/rigid_state.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What all islands of a step share.
template <RealScalar Scalar>
struct IslandRules {
  Scalar h, beta, stiffness, push_speed, bounce_speed, velocity_tolerance;
  int newton_contacts, joint_rows, sweeps;
};

/// How the solve of an island ended.
template <RealScalar Scalar>
struct IslandReport {
  bool solved = true;
  Scalar force = Scalar(0), velocity = Scalar(0);
  int newton_steps = 0, sweeps = 0;
};

/// Solves islands one after the other with its own memory.
template <RealScalar Scalar>
class IslandSolver {
 public:
  using Contact = RigidContact<Scalar>;
  using Body = SolverBody<Scalar>;
  using Joint = JointState<Scalar>;

  /// Makes room for Newton's method with up to `contacts` contacts and `joint_rows` rows, and for
  /// sweeps with up to `all` contacts. Allocates.
  void reserve(Index contacts, Index joint_rows, std::size_t all) {
    if (contacts != newton_room_ || joint_rows != joint_room_) {
      solver_.reserve(contacts, contacts);
      samples_.resize(static_cast<std::size_t>(contacts));
      A_.setConstant(joint_rows, joint_rows, Scalar(0));
      scale_.setConstant(joint_rows, Scalar(0));
      X_.setConstant(joint_rows, 3 * contacts, Scalar(0));
      mu_.setConstant(joint_rows, Scalar(0));
      newton_room_ = contacts;
      joint_room_ = joint_rows;
    }
    own_.reserve(kJointRows);
    arms_.reserve(all);
    blocks_.reserve(all);
  }

  /// Solves the island of the given contacts and joints, and changes velocities and memory.
  /// `masses` is the heaviest mass of the island, kg.
  IslandReport<Scalar> solve(const IslandRules<Scalar>& rules, const Scalar& heaviest,
                             std::span<const int> contacts, std::span<const int> joints,
                             std::vector<Body>& bodies, std::vector<Contact>& all_contacts,
                             std::vector<Joint>& all_joints);

  // The contacts of the island as one side (concept ImpulseResponse): "point" i moves with the
  // relative velocity of contact i.
  Index point_count() const { return static_cast<Index>(contacts_.size()); }
  void velocities(Eigen::Ref<VectorX<Scalar>> u) const {
    for (std::size_t i = 0; i < contacts_.size(); ++i)
      u.template segment<3>(3 * static_cast<Index>(i)) = relative_velocity(i);
  }
  void add_mobility(Eigen::Ref<MatrixX<Scalar>> W) const;
  void apply(const Eigen::Ref<const VectorX<Scalar>>& p) {
    for (std::size_t i = 0; i < contacts_.size(); ++i)
      push(i, p.template segment<3>(3 * static_cast<Index>(i)));
  }

 private:
  struct Arms {
    Vector3<Scalar> a, b;
  };
  /// What the sweeps know of a contact.
  struct Block {
    Matrix3<Scalar> F, D;
    Vector3<Scalar> soft, shift;
  };

  Contact& contact(std::size_t i) const {
    return (*all_contacts_)[static_cast<std::size_t>(contacts_[i])];
  }
  Joint& joint(std::size_t k) const { return (*all_joints_)[static_cast<std::size_t>(joints_[k])]; }
  Body& body(int n) const { return n < 0 ? ground_ : (*bodies_)[static_cast<std::size_t>(n)]; }
  bool moves(int n) const { return n >= 0 && Scalar(0) < body(n).lightness; }
  Vector3<Scalar> relative_velocity(std::size_t i) const {
    const Contact& c = contact(i);
    return body(c.a).at(arms_[i].a) - body(c.b).at(arms_[i].b) - c.sample.drift;
  }
  void push(std::size_t i, const Vector3<Scalar>& p) const {
    const Contact& c = contact(i);
    const Vector3<Scalar> none = Vector3<Scalar>::Constant(Scalar(0));
    if (moves(c.a)) body(c.a).push(p, arms_[i].a, none);
    if (moves(c.b)) body(c.b).push(-p, arms_[i].b, none);
  }
  void push_joint(std::size_t k, const typename Joint::Column& mu) const {
    Joint& j = joint(k);
    // What nothing moves may belong to several islands: it is not written to.
    Body A = body(j.a), B = body(j.b);
    j.push(mu, A, B);
    if (moves(j.a)) body(j.a) = A;
    if (moves(j.b)) body(j.b) = B;
  }

  void prepare(const IslandRules<Scalar>& rules, const Scalar& heaviest);
  Matrix3<Scalar> own_mobility(std::size_t i) const {
    Matrix3<Scalar> W = Matrix3<Scalar>::Constant(Scalar(0));
    const Contact& c = contact(i);
    if (moves(c.a)) body(c.a).add_mobility(arms_[i].a, arms_[i].a, Scalar(1), W);
    if (moves(c.b)) body(c.b).add_mobility(arms_[i].b, arms_[i].b, Scalar(1), W);
    return W;
  }
  /// The couplings of two joints through the bodies that they share, with softness where they are
  /// the same joint.
  typename Joint::Block joint_block(const Joint& j, const Joint& other) const;
  bool factor_joints();
  void correct_joints();
  void couple_joints();
  bool newton(const IslandRules<Scalar>& rules, IslandReport<Scalar>& report);
  void sweep_all(const IslandRules<Scalar>& rules, IslandReport<Scalar>& report);
  void prepare_sweeps(const IslandRules<Scalar>& rules);
  Scalar sweep_contact(std::size_t i) const;
  Scalar sweep_joint(std::size_t k);
  void judge_sweeps(const IslandRules<Scalar>& rules, IslandReport<Scalar>& report) const;
  Vector3<Scalar> local_velocity(std::size_t i) const {
    const Block& block = blocks_[i];
    const Vector3<Scalar> l = block.F * contact(i).sample.impulse;
    return block.F * relative_velocity(i) + block.soft.cwiseProduct(l) + block.shift;
  }

  ContactSolver<Scalar> solver_{settings()};
  static ContactSolverSettings<Scalar> settings() {
    ContactSolverSettings<Scalar> out;
    out.rounds = 1;
    out.newton_steps = 25;
    return out;
  }
  std::vector<ContactSample<Scalar>> samples_;
  /// A, then its factor; the diagonal of A; the block of one joint.
  MatrixX<Scalar> A_, X_;
  VectorX<Scalar> scale_, mu_;
  SmallCholesky<Scalar> own_;
  std::vector<Arms> arms_;
  std::vector<Block> blocks_;
  Index newton_room_ = -1, joint_room_ = -1, joint_rows_ = 0;
  mutable Body ground_;

  std::span<const int> contacts_, joints_;
  std::vector<Body>* bodies_ = nullptr;
  std::vector<Contact>* all_contacts_ = nullptr;
  std::vector<Joint>* all_joints_ = nullptr;
};

template <RealScalar Scalar>
IslandReport<Scalar> IslandSolver<Scalar>::solve(
    const IslandRules<Scalar>& rules, const Scalar& heaviest, std::span<const int> contacts,
    std::span<const int> joints, std::vector<Body>& bodies, std::vector<Contact>& all_contacts,
    std::vector<Joint>& all_joints) {
  contacts_ = contacts;
  joints_ = joints;
  bodies_ = &bodies;
  all_contacts_ = &all_contacts;
  all_joints_ = &all_joints;
  joint_rows_ = 0;
  for (std::size_t k = 0; k < joints_.size(); ++k) joint_rows_ += joint(k).rows();
  const Index most = (std::min)(newton_room_, static_cast<Index>(rules.newton_contacts));
  const bool room = static_cast<Index>(contacts.size()) <= most && joint_rows_ <= joint_room_;
  prepare(rules, heaviest);
  IslandReport<Scalar> report;
  if (!room || !newton(rules, report)) sweep_all(rules, report);
  return report;
}

template <RealScalar Scalar>
void IslandSolver<Scalar>::prepare(const IslandRules<Scalar>& rules, const Scalar& heaviest) {
  const Scalar h = rules.h, beta = rules.beta;
  arms_.resize(contacts_.size());
  for (std::size_t i = 0; i < contacts_.size(); ++i) {
    Contact& c = contact(i);
    arms_[i] = {c.position - body(c.a).x, c.position - body(c.b).x};
    const Matrix3<Scalar> W = own_mobility(i);
    const Scalar across = c.sample.normal.dot(W * c.sample.normal);
    Scalar softness = Scalar(1) / (rules.stiffness * heaviest);
    const Scalar least = Scalar(64) * scalar_traits<Scalar>::epsilon() * across;
    Scalar gap = Scalar(0) < c.gap ? Scalar(c.gap / beta) : c.gap;
    const Scalar deepest = -rules.push_speed * h / beta;
    if (gap < deepest) gap = deepest;
    const Scalar approach = c.sample.normal.dot(relative_velocity(i));
    if (Scalar(0) < c.restitution && approach < -rules.bounce_speed &&
        c.gap + h * approach < Scalar(0)) {
      gap = c.restitution * approach * h / beta;
      softness *= Scalar(0.01);
    }
    // A hard impact leaves the speed of the approach times softness / mobility.
    const Scalar hard = Scalar(-10) * rules.push_speed;
    if (approach < hard) softness *= hard / approach;
    if (softness < least) softness = least;
    const Scalar compliance = softness * h * h / beta, old = c.sample.compliance;
    if (Scalar(0) < old) c.sample.offset *= compliance / old;  // the load of its spring stays
    c.sample.compliance = c.sample.tangential_compliance = compliance;
    c.sample.damping = h * (Scalar(1) / beta - Scalar(1)) / compliance;
    c.sample.gap = gap;
  }
}

template <RealScalar Scalar>
auto IslandSolver<Scalar>::joint_block(const Joint& j, const Joint& other) const ->
    typename Joint::Block {
  typename Joint::Block block = Joint::Block::Constant(Scalar(0));
  for (const int n : {j.a, j.b}) {
    if (moves(n)) Joint::add_coupling(j, other, n, body(n), block);
  }
  if (&j != &other) return block;
  const Scalar calm = Scalar(1e4) * scalar_traits<Scalar>::epsilon();
  for (int r = 0; r < j.rows(); ++r) block(r, r) += calm * block(r, r) + j.softness;
  return block;
}

template <RealScalar Scalar>
bool IslandSolver<Scalar>::factor_joints() {
  Eigen::Ref<MatrixX<Scalar>> A = A_.topLeftCorner(joint_rows_, joint_rows_);
  Index row = 0;
  for (std::size_t k = 0; k < joints_.size(); ++k) {
    const Joint& j = joint(k);
    Index col = 0;
    for (std::size_t l = 0; l <= k; ++l) {
      const Joint& other = joint(l);
      A.block(row, col, j.rows(), other.rows()) =
          joint_block(j, other).topLeftCorner(j.rows(), other.rows());
      col += other.rows();
    }
    row += j.rows();
  }
  scale_.head(joint_rows_) = A.diagonal();
  return all_finite(scale_.head(joint_rows_)) &&
         cholesky_in_place<Scalar>(A, scale_.head(joint_rows_), Scalar(0)) == joint_rows_;
}

template <RealScalar Scalar>
void IslandSolver<Scalar>::correct_joints() {
  for (int round = 0; round < 2; ++round) {  // the second for what the first leaves by rounding
    Index row = 0;
    for (std::size_t k = 0; k < joints_.size(); ++k) {
      const Joint& j = joint(k);
      const typename Joint::Column r =
          j.velocity(body(j.a), body(j.b)) + j.bias + j.softness * j.impulse;
      for (Index i = 0; i < j.rows(); ++i) mu_[row + i] = -r[i];
      row += j.rows();
    }
    solve_lower<Scalar>(A_.data(), A_.rows(), joint_rows_, mu_.data());
    solve_upper<Scalar>(A_.data(), A_.rows(), joint_rows_, mu_.data());
    row = 0;
    for (std::size_t k = 0; k < joints_.size(); ++k) {
      Joint& j = joint(k);
      typename Joint::Column change = Joint::Column::Constant(Scalar(0));
      for (Index i = 0; i < j.rows(); ++i) change[i] = mu_[row + i];
      row += j.rows();
      j.impulse += change;
      push_joint(k, change);
    }
  }
}

template <RealScalar Scalar>
void IslandSolver<Scalar>::couple_joints() {
  X_.leftCols(3 * point_count()).setConstant(Scalar(0));
  for (std::size_t i = 0; i < contacts_.size(); ++i) {
    const Contact& c = contact(i);
    const Index col = 3 * static_cast<Index>(i);
    Index row = 0;
    for (std::size_t k = 0; k < joints_.size(); ++k) {
      const Joint& j = joint(k);
      for (const bool on_a : {true, false}) {
        const int n = on_a ? c.a : c.b;
        const Matrix3<Scalar> r = cross_matrix<Scalar>(on_a ? arms_[i].a : arms_[i].b);
        for (const bool of_a : {true, false}) {
          if (!moves(n) || n != (of_a ? j.a : j.b)) continue;
          const Scalar sign = on_a == of_a ? Scalar(1) : Scalar(-1);
          const typename Joint::Rows turned = (of_a ? j.turn_a : j.turn_b) * body(n).inverse;
          // Transposed: J_j M⁻¹ J_cᵀ, with [r]ᵀ = -[r].
          const typename Joint::Rows block = sign * (body(n).lightness * j.point + turned * r);
          X_.block(row, col, j.rows(), 3) += block.topRows(j.rows());
        }
      }
      row += j.rows();
    }
  }
  for (Index col = 0; col < 3 * point_count(); ++col)
    solve_lower<Scalar>(A_.data(), A_.rows(), joint_rows_, X_.col(col).data());
}

template <RealScalar Scalar>
void IslandSolver<Scalar>::add_mobility(Eigen::Ref<MatrixX<Scalar>> W) const {
  const Scalar one(1);
  for (std::size_t j = 0; j < contacts_.size(); ++j) {
    const Contact& q = contact(j);
    for (std::size_t i = 0; i <= j; ++i) {
      const Contact& p = contact(i);
      Matrix3<Scalar> block = Matrix3<Scalar>::Constant(Scalar(0));
      if (p.a == q.a && moves(p.a)) body(p.a).add_mobility(arms_[i].a, arms_[j].a, one, block);
      if (p.b == q.b && moves(p.b)) body(p.b).add_mobility(arms_[i].b, arms_[j].b, one, block);
      if (p.a == q.b && moves(p.a)) body(p.a).add_mobility(arms_[i].a, arms_[j].b, -one, block);
      if (p.b == q.a && moves(p.b)) body(p.b).add_mobility(arms_[i].b, arms_[j].a, -one, block);
      const Index row = 3 * static_cast<Index>(i), col = 3 * static_cast<Index>(j);
      if (joint_rows_ > 0)
        block -= X_.block(0, row, joint_rows_, 3)
                     .transpose()
                     .lazyProduct(X_.block(0, col, joint_rows_, 3));
      W.template block<3, 3>(row, col) += block;
      if (i != j) W.template block<3, 3>(col, row) += block.transpose();
    }
  }
}

template <RealScalar Scalar>
bool IslandSolver<Scalar>::newton(const IslandRules<Scalar>& rules, IslandReport<Scalar>& report) {
  for (std::size_t k = 0; k < joints_.size(); ++k) joint(k).impulse.setConstant(Scalar(0));
  if (joint_rows_ > 0) {
    if (!factor_joints()) return false;
    correct_joints();
    couple_joints();
  }
  if (contacts_.empty()) return true;
  for (std::size_t i = 0; i < contacts_.size(); ++i) {
    samples_[i] = contact(i).sample;
    // The side's velocities are those seen from B, without the drift.
    samples_[i].drift.setConstant(Scalar(0));
    samples_[i].a = {};
    samples_[i].b = {};
    samples_[i].a.side = 0;
    samples_[i].a.point[0] = static_cast<int>(i);
  }
  const std::span<ContactSample<Scalar>> samples(samples_.data(), contacts_.size());
  const ContactReport<Scalar> found = solver_.solve(samples, rules.h, *this);
  report.newton_steps = found.newton_steps;
  report.sweeps = found.sweeps;
  if (found.status != ContactStatus::Solved && found.status != ContactStatus::NotConverged) {
    for (std::size_t k = 0; k < joints_.size(); ++k) push_joint(k, -joint(k).impulse);
    return false;
  }
  report.force = found.force_residual;
  report.velocity = found.velocity_residual;
  report.solved =
      found.status == ContactStatus::Solved || found.velocity_residual < rules.velocity_tolerance;
  for (std::size_t i = 0; i < contacts_.size(); ++i) {
    ContactSample<Scalar>& to = contact(i).sample;
    to.impulse = samples_[i].impulse;
    to.offset = samples_[i].offset;
    to.state = samples_[i].state;
    push(i, to.impulse);
  }
  if (joint_rows_ > 0) correct_joints();
  return true;
}

template <RealScalar Scalar>
void IslandSolver<Scalar>::prepare_sweeps(const IslandRules<Scalar>& rules) {
  const Scalar h = rules.h;
  blocks_.resize(contacts_.size());
  for (std::size_t i = 0; i < contacts_.size(); ++i) {
    ContactSample<Scalar>& s = contact(i).sample;
    Block& block = blocks_[i];
    block.F = contact_frame<Scalar>(s.normal);
    const Matrix3<Scalar> W = own_mobility(i), turned = block.F * W;
    const Scalar soft = h + s.compliance * s.damping;
    block.soft = Vector3<Scalar>::Constant(s.compliance / (h * soft));
    block.D = turned * block.F.transpose();
    for (int k = 0; k < 3; ++k) block.D(k, k) += block.soft[k];
    block.shift = block.F * s.offset / soft;
    block.shift[0] = s.gap / soft;
    const Vector3<Scalar> guess = block.F * s.impulse;
    s.impulse = block.F.transpose() * project_to_cone<Scalar>(guess, s.friction);
    push(i, s.impulse);
  }
  for (std::size_t k = 0; k < joints_.size(); ++k) push_joint(k, joint(k).impulse);
}

template <RealScalar Scalar>
Scalar IslandSolver<Scalar>::sweep_contact(std::size_t i) const {
  using std::sqrt;
  ContactSample<Scalar>& s = contact(i).sample;
  const Block& block = blocks_[i];
  const Vector3<Scalar> old = block.F * s.impulse;
  const Vector3<Scalar> rest = local_velocity(i) - block.D * old;
  const Vector3<Scalar> found = solve_single_contact<Scalar>(block.D, rest, s.friction);
  if (!all_finite(found)) return Scalar(0);
  const Vector3<Scalar> change = block.F.transpose() * Vector3<Scalar>(found - old);
  s.impulse = block.F.transpose() * found;
  push(i, change);
  return sqrt(change.squaredNorm()) * block.D(0, 0);
}

template <RealScalar Scalar>
Scalar IslandSolver<Scalar>::sweep_joint(std::size_t k) {
  using std::abs;
  Joint& j = joint(k);
  const typename Joint::Block block = joint_block(j, j);
  const typename Joint::Column r =
      j.velocity(body(j.a), body(j.b)) + j.bias + j.softness * j.impulse;
  own_.resize(j.rows());
  for (int c = 0; c < j.rows(); ++c) {
    for (int i = c; i < j.rows(); ++i) own_(i, c) = block(i, c);
  }
  typename Joint::Column change = Joint::Column::Constant(Scalar(0));
  Scalar worst(0);
  for (int i = 0; i < j.rows(); ++i) {
    change[i] = -r[i];
    if (worst < abs(r[i])) worst = abs(r[i]);
  }
  if (own_.solve(change.head(j.rows())) >= 0 || !all_finite(change)) return Scalar(0);
  j.impulse += change;
  push_joint(k, change);
  return worst;
}

template <RealScalar Scalar>
void IslandSolver<Scalar>::sweep_all(const IslandRules<Scalar>& rules,
                                     IslandReport<Scalar>& report) {
  prepare_sweeps(rules);
  for (int round = 0; round < rules.sweeps; ++round) {
    Scalar change(0);
    for (std::size_t k = 0; k < joints_.size(); ++k) {
      const Scalar now = sweep_joint(k);
      if (change < now) change = now;
    }
    for (std::size_t i = 0; i < contacts_.size(); ++i) {
      const Scalar now = sweep_contact(round % 2 == 0 ? i : contacts_.size() - 1 - i);
      if (change < now) change = now;
    }
    ++report.sweeps;
    if (change < Scalar(0.1) * rules.velocity_tolerance) break;
  }
  judge_sweeps(rules, report);
}

template <RealScalar Scalar>
void IslandSolver<Scalar>::judge_sweeps(const IslandRules<Scalar>& rules,
                                        IslandReport<Scalar>& report) const {
  using std::sqrt;
  for (std::size_t i = 0; i < contacts_.size(); ++i) {
    ContactSample<Scalar>& s = contact(i).sample;
    const Block& block = blocks_[i];
    const Vector3<Scalar> l = block.F * s.impulse, u = local_velocity(i);
    const Scalar rho_n = Scalar(1) / block.D(0, 0);
    const Scalar rho_t = Scalar(2) / (block.D(1, 1) + block.D(2, 2));
    const Scalar rho = rho_n < rho_t ? rho_n : rho_t;
    const Vector3<Scalar> off = natural_map<Scalar>(l, u, s.friction, rho);
    const Scalar size = sqrt(off.squaredNorm());
    if (report.force < size / rules.h) report.force = size / rules.h;
    if (report.velocity < size / rho) report.velocity = size / rho;
    const ContactState state = contact_equation<Scalar>(l, u, s.friction, rho_n, rho_t).branch;
    end_contact<Scalar>(block.F, l, state, rules.h, s);
  }
  for (std::size_t k = 0; k < joints_.size(); ++k) {
    const Joint& j = joint(k);
    const typename Joint::Column r =
        j.velocity(body(j.a), body(j.b)) + j.bias + j.softness * j.impulse;
    for (int i = 0; i < j.rows(); ++i) {
      if (report.velocity < r[i]) report.velocity = r[i];
      if (report.velocity < -r[i]) report.velocity = -r[i];
    }
  }
  report.solved = report.velocity < rules.velocity_tolerance;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
