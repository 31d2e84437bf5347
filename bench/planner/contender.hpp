#pragma once

// What takes part: the paper's procedure with a third-party QP solver, and our planners.

#include <memory>
#include <string>
#include <utility>

#include "../versus/qp/solver.hpp"
#include "step.hpp"
#include "watch.hpp"

namespace planner_bench {

/// Plans one frame after the other.
class Contender {
 public:
  Contender(std::string name, bool baseline, bool same_model)
      : name_(std::move(name)), baseline_(baseline), same_model_(same_model) {}
  virtual ~Contender() = default;

  /// Plans a frame and takes its times. Returns false when there is no optimal plan.
  virtual bool plan(const Frame& frame, Phases& times) = 0;
  /// The QP of the last frame, if it is the paper's.
  virtual const versus::Problem* problem() const { return nullptr; }

  const std::string& name() const { return name_; }
  bool is_baseline() const { return baseline_; }
  /// Whether its optimum is that of the paper's QP.
  bool has_same_model() const { return same_model_; }

  /// Of the last frame: forces on the held vertices in its first frame (N), the coefficients of all
  /// frames, and the multipliers of their bounds.
  VectorX<double> first, d, z;

 private:
  std::string name_;
  bool baseline_, same_model_;
};

/// The paper's procedure; `solver` solves its QPs cold.
std::unique_ptr<Contender> make_baseline(const Scene& scene, Index horizon, Factor factor,
                                         const versus::Entry& solver);

/// How a planner predicts.
enum class Prediction {
  Linearised,       ///< double precision: the baseline's model exactly
  LinearisedFloat,  ///< the response in single precision
  Rollout,          ///< of the whole sheet, quasi-Newton in single precision
  Coarse            ///< rollout of a sheet of 17×17 vertices
};

/// The number of vertices along a side of the coarse sheet.
inline constexpr int kCoarse = 17;

/// Our planner.
std::unique_ptr<Contender> make_planner(const Scene& scene, Index horizon, Prediction prediction,
                                        GripInput input);

}  // namespace planner_bench
