#pragma once

// A plant whose sheet can tear, be cut and be sewn: it builds the next model from the changed
// network.
//
//   auto sheet = TearableSheet<MassSpring<double>>::create(model, limits).value();
//   sheet.advance(dt);  // finds broken springs
//   if (sheet.torn_count() > 0) {
//     // A new model. State and input follow it.
//     const auto remap = sheet.apply_topology_changes();
//     // So must all else that refers to vertices.
//     features = remap_features(features, remap.value());
//   }

#include <array>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/concepts/cloth.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/network/plastic_creep.hpp"
#include "clothctl/network/tearing.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A ClothPlant of a model that can be made again from a network and its settings
/// (`Model::create(network, settings)`, `network()`, `settings().pinned`): MassSpring,
/// PositionBased. All copies of a pinned vertex stay pinned.
template <class Model, RealScalar S = typename Model::Scalar>
requires ClothModel<Model, S>
class TearableSheet : private ModelPlant<Model, S> {
  using Plant = ModelPlant<Model, S>;

 public:
  /// The scalar type.
  using Scalar = S;

  /// Starts at the rest state of the model. A step finds at most `splits` broken springs, the most
  /// overloaded ones. Allocates. Fails when: `settings.validate()` finds a fault.
  static Result<TearableSheet> create(Model model, const TearSettings<Scalar>& settings,
                                      Index splits = 64) {
    if (std::string problem = settings.validate(); !problem.empty()) return Error{problem};
    TearableSheet sheet(std::move(model), settings);
    sheet.torn_.reserve_splits(splits);
    return sheet;
  }

  using Plant::apply;
  using Plant::check_input;
  using Plant::gravity_load;
  using Plant::input;
  using Plant::positions;
  using Plant::set_state;
  using Plant::state;
  using Plant::velocities;
  using Plant::vertex_count;
  /// Returns the model.
  const Model& model() const { return Plant::model(); }
  /// Returns the network of the model.
  const SpringNetwork<Scalar>& network() const { return model().network(); }

  /// Advances by `dt` (s) under the input that was applied last, and looks for broken springs.
  /// Never allocates. Fails when the step of the model fails; the state is then unchanged.
  [[nodiscard]] StepReport<Scalar> advance(Scalar dt) {
    const StepReport<Scalar> report = Plant::advance(dt);
    if (report.advanced) find_torn(network(), positions(), settings_, torn_);
    return report;
  }

  /// Returns the number of springs that were found broken in the last step.
  Index torn_count() const { return torn_.count(); }
  /// Returns the springs that were found broken in the last step.
  const TornSprings<Scalar>& torn() const { return torn_; }

  /// Tears the sheet at the broken springs. Returns the remap from the old vertices; it is the
  /// identity when nothing could be split. Allocates. Fails when: state or input could not be
  /// stepped; the sheet is then unchanged.
  Result<Remap<Scalar>> apply_topology_changes() {
    Result<Tear<Scalar>> tear = clothctl::apply_topology_changes(network(), torn_);
    if (!tear) return Error{tear.error()};
    return take(std::move(tear.value().change));
  }
  /// Cuts the sheet along a polyline (3×k, m) drawn on it as it is now. Allocates. Fails when
  /// `cut_network` fails; the sheet is then unchanged.
  Result<Remap<Scalar>> cut(const std::type_identity_t<PointsView<Scalar>>& polyline,
                            const CutSettings<Scalar>& settings = {}) {
    return take_result(cut_network<Scalar>(network(), positions(), polyline, settings));
  }
  /// The same with a polyline that is drawn on the rest positions of the network.
  Result<Remap<Scalar>> cut_at_rest(const std::type_identity_t<PointsView<Scalar>>& polyline,
                                    const CutSettings<Scalar>& settings = {}) {
    return take_result(
        cut_network<Scalar>(network(), network().rest_positions, polyline, settings));
  }
  /// Joins pairs of border vertices, for example when a seam has pulled them together. Allocates.
  /// Fails when `stitch_network` fails; the sheet is then unchanged.
  Result<Remap<Scalar>> stitch(const std::vector<std::array<int, 2>>& pairs) {
    return take_result(stitch_network(network(), pairs));
  }
  /// Lets the rest lengths creep for `dt` (s) and makes a new model if any changed. Returns the
  /// largest relative change. Allocates. Fails when: a setting or dt is out of range, or the state
  /// is not finite.
  Result<Scalar> creep(const CreepSettings<Scalar>& settings, Scalar dt) {
    SpringNetwork<Scalar> next = network();
    if (std::string problem = settings.validate(); !problem.empty()) return Error{problem};
    const Scalar change = creep_rest_lengths(next, positions(), settings, dt);
    if (change < Scalar(0))
      return Error{"creep needs a finite state and a step, got dt = " + number_text(dt)};
    if (!(Scalar(0) < change)) return change;
    auto made = Model::create(std::move(next), model().settings());
    if (!made) return Error{made.error()};
    Plant::set_model(std::move(made).value());
    return change;
  }

 private:
  TearableSheet(Model model, const TearSettings<Scalar>& settings)
      : Plant(std::move(model)), settings_(settings) {}

  Result<Remap<Scalar>> take_result(Result<NetworkChange<Scalar>> change) {
    if (!change) return Error{change.error()};
    return take(std::move(change).value());
  }

  /// Makes the model of a changed network and carries state and input over.
  Result<Remap<Scalar>> take(NetworkChange<Scalar> change) {
    if (std::string problem = check_step_input(state(), input(), Scalar(1), vertex_count());
        !problem.empty())
      return Error{std::move(problem)};
    auto settings = model().settings();
    settings.pinned = change.remap.all_copies(settings.pinned);
    auto made = Model::create(std::move(change.network), std::move(settings));
    if (!made) return Error{made.error()};
    Plant::set_model(std::move(made).value());
    set_state(remap_state(state(), change.remap));
    apply(remap_input(input(), change.remap));
    torn_.clear();
    return Result<Remap<Scalar>>(std::move(change.remap));
  }

  TearSettings<Scalar> settings_;
  TornSprings<Scalar> torn_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
