#pragma once

// The layers of a world: the sheets that meet themselves and each other as one list of vertices,
// kept apart after each step (contact/sheet_impacts.hpp).

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/contact/sheet_impacts.hpp"
#include "clothctl/sim/detail/world_sheet.hpp"
#include "clothctl/sim/world_setup.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The sheets of a world that meet.
template <RealScalar Scalar>
class WorldLayers {
 public:
  /// All sheets of the world; those that do not meet have `first` = -1.
  using Sheets = std::vector<std::unique_ptr<WorldSheet<Scalar>>>;

  /// Gives each sheet that meets others its place in the list and makes all memory. Returns an
  /// empty string, or what is wrong. Allocates.
  std::string prepare(const Sheets& sheets, const std::vector<WorldSheetSetup<Scalar>>& setups,
                      const Scalar& friction);

  /// Takes the positions at the start of a step.
  void begin(const Sheets& sheets) {
    for_each(sheets, [this](const WorldSheet<Scalar>& sheet, Index n) {
      before_.middleCols(sheet.first, n) = sheet.state.positions;
    });
  }

  /// Keeps the layers apart after all sheets have made their step of `dt` (s).
  SheetImpactReport keep_apart(const Sheets& sheets, const Scalar& dt);

  /// Calls visit(sheet, contact, impulse) for what obstacles held up in the last `keep_apart`, with
  /// the impulse on the sheet, N s.
  template <class Visit>
  void for_each_support(const Sheets& sheets, Visit visit) const {
    std::size_t i = 0;
    for_each(sheets, [&](const WorldSheet<Scalar>& sheet, Index) {
      for (const ObstacleContact<Scalar>& contact : sheet.contacts.contacts()) {
        if (i == supports_.size()) return;
        visit(sheet, contact, supports_[i++].impulse);
      }
    });
  }

 private:
  /// Calls visit(sheet, number of vertices) for the sheets that meet.
  template <class Visit>
  static void for_each(const Sheets& sheets, Visit visit) {
    for (const auto& sheet : sheets) {
      if (sheet->first >= 0) visit(*sheet, sheet->state.positions.cols());
    }
  }

  std::optional<SheetImpacts<Scalar>> impacts_;
  Points<Scalar> before_;
  VectorX<Scalar> inverse_mass_;
  ClothState<Scalar> state_;
  std::vector<SheetSupport<Scalar>> supports_;
};

template <RealScalar Scalar>
std::string WorldLayers<Scalar>::prepare(const Sheets& sheets,
                                         const std::vector<WorldSheetSetup<Scalar>>& setups,
                                         const Scalar& friction) {
  std::vector<std::array<int, 3>> triangles;
  SheetImpactSettings<Scalar> settings;
  settings.thickness = Scalar(0);
  settings.friction = friction;
  Index count = 0;
  std::size_t room = 0;
  const auto moved = [&count](auto list) {
    for (int& v : list) v += static_cast<int>(count);
    return list;
  };
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    WorldSheet<Scalar>& sheet = *sheets[i];
    sheet.first = setups[i].meets_sheets ? count : Index(-1);
    if (!setups[i].meets_sheets) continue;
    for (const auto& t : sheet.mesh.triangles) triangles.push_back(moved(t));
    for (const auto& p : setups[i].joined) settings.joined.push_back(moved(p));
    if (settings.thickness < setups[i].thickness) settings.thickness = setups[i].thickness;
    count += sheet.mesh.vertex_count();
    room += sheet.contacts.capacity();
  }
  impacts_.reset();
  before_.resize(3, count);
  if (count == 0) return {};
  for_each(sheets, [this](const WorldSheet<Scalar>& sheet, Index n) {
    before_.middleCols(sheet.first, n) = sheet.mesh.rest_positions;
  });
  Result<SheetImpacts<Scalar>> made = SheetImpacts<Scalar>::create(before_, triangles, settings);
  if (!made) return made.error();
  impacts_.emplace(std::move(made).value());
  supports_.reserve(room);
  impacts_->reserve(Index(40) * count + static_cast<Index>(room));
  state_ = {before_, before_};
  inverse_mass_.setConstant(count, Scalar(0));
  return {};
}

template <RealScalar Scalar>
SheetImpactReport WorldLayers<Scalar>::keep_apart(const Sheets& sheets, const Scalar& dt) {
  supports_.clear();
  if (!impacts_) return {};
  for_each(sheets, [&](const WorldSheet<Scalar>& sheet, Index n) {
    sheet.add_supports(dt, supports_);
    state_.positions.middleCols(sheet.first, n) = sheet.state.positions;
    state_.velocities.middleCols(sheet.first, n) = sheet.state.velocities;
    sheet.write_inverse_masses(inverse_mass_.segment(sheet.first, n));
  });
  const SheetImpactReport report = impacts_->resolve(before_, inverse_mass_, dt, state_, supports_);
  for_each(sheets, [this](WorldSheet<Scalar>& sheet, Index n) {
    sheet.state.positions = state_.positions.middleCols(sheet.first, n);
    sheet.state.velocities = state_.velocities.middleCols(sheet.first, n);
  });
  return report;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
