#include "contender.hpp"

#include "clothctl/cloth/mass_spring_rollout.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/prediction/coarse_predictor.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"
#include "clothctl/prediction/rollout_predictor.hpp"
#include "clothctl/prediction/sheet_sampling.hpp"

namespace planner_bench {

namespace {

template <class Scalar>
AnyPredictor linearised(const MassSpring<double>& model,
                        const ResponseSettings<Scalar>& settings = {}) {
  using Response = WatchedResponse<Scalar>;
  return AnyPredictor(LinearisedPredictor<Response, double>(Response(model, settings)),
                      seen().inner);
}

/// A rollout in the way of the programs: without bending in the matrix up to 33×33 vertices.
auto rolled(const MassSpring<double>& model, CoarseFactors factors) {
  RolloutModelSettings settings;
  settings.factors = factors;
  settings.bending_in_matrix = model.vertex_count() > 33 * 33;
  settings.integration = model.settings().integration;
  ResponseSettings<float> response;
  response.bending_in_matrix = settings.bending_in_matrix;
  RolloutSettings steps;
  steps.step_tolerance = 0.5;
  return RolloutPredictor<MassSpringRollout<double>, AnyPredictor>(
      MassSpringRollout<double>(model, settings), linearised<float>(model, response), steps);
}

AnyPredictor predictor(const Scene& scene, Prediction prediction) {
  double& sum = seen().predict;
  switch (prediction) {
    case Prediction::Linearised: return AnyPredictor(linearised<double>(scene.model), sum);
    case Prediction::LinearisedFloat: return AnyPredictor(linearised<float>(scene.model), sum);
    case Prediction::Rollout: return AnyPredictor(rolled(scene.model, {}), sum);
    case Prediction::Coarse: break;
  }
  const GridMesh<double> grid = make_grid<double>(kCoarse, kCoarse, 0.5, 0.5).value();
  const MassSpring<double> model =
      MassSpring<double>::create(sheet_network(grid, Material<double>()).value(),
                                 scene.model.settings())
          .value();
  auto inner = rolled(model, CoarseFactors::fitted());
  return AnyPredictor(
      CoarsePredictor<decltype(inner)>(sample_grids(scene.grid, grid), std::move(inner)), sum);
}

std::string name_of(Prediction prediction, GripInput input) {
  const std::string end = input == GripInput::Pose ? ", poses" : "";
  switch (prediction) {
    case Prediction::Linearised: return "linearised, double" + end;
    case Prediction::LinearisedFloat: return "linearised, float" + end;
    case Prediction::Rollout: return "rollout" + end;
    default: return "rollout of 17x17" + end;
  }
}

class Ours final : public Contender {
 public:
  using Planning = Planner<AnyPredictor, PlannerSetup<double>, WatchedBox>;

  Ours(const Scene& scene, Index horizon, Prediction prediction, GripInput input)
      : Contender(name_of(prediction, input), false,
                  input == GripInput::Force && (prediction == Prediction::Linearised ||
                                                prediction == Prediction::LinearisedFloat)),
        scene_(scene),
        planner_(Planning::create(scene.setup,
                                  scene.settings(input, horizon,
                                                 prediction == Prediction::Rollout ||
                                                     prediction == Prediction::Coarse),
                                  predictor(scene, prediction), scene.frames.front().x)
                     .value()),
        result_(planner_.make_result()) {}

  bool plan(const Frame& frame, Phases& times) override {
    const auto target = [&](Index i, double t) { return scene_.target(i, t); };
    seen().linearise = seen().qp = seen().predict = seen().inner = 0;
    times = {};
    PlanStatus status;
    {
      const Stopwatch watch(times.total);
      status = planner_.plan(frame.x, frame.v, frame.t, target, result_);
    }
    const Seen& s = seen();
    times.linearise = s.linearise;
    times.response = s.inner - s.linearise;
    times.rollout = s.predict - s.inner;
    times.qp = s.qp;
    times.stack = times.total - s.predict - s.qp;
    first = result_.plan.col(0);
    d = s.d;
    z = s.z;
    return status == PlanStatus::Planned && !result_.used_rows;
  }

 private:
  const Scene& scene_;
  Planning planner_;
  PlanResult<double> result_;
};

}  // namespace

std::unique_ptr<Contender> make_planner(const Scene& scene, Index horizon, Prediction prediction,
                                        GripInput input) {
  return std::make_unique<Ours>(scene, horizon, prediction, input);
}

}  // namespace planner_bench
