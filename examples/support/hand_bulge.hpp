#pragma once

// The plan of a bulge: two fingertips push a sheet together that lies on a table.

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/grasp/static_contacts.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"
#include "clothctl/sim/world.hpp"

namespace program {

/// What it is about.
struct BulgeOptions {
  double dt = 0.02;        ///< of a frame, s
  long horizon = 10;       ///< frames
  double friction = 0.8;   ///< of the fingertips
  double spacing = 0.008;  ///< of the grid's vertices, m
  double seconds = 0.8;    ///< of the push
  double height = 0.025;   ///< of the bulge, m
  clothctl::Material<double> material;
  /// The fingertips as obstacles of the world, and where they shall come to along x, m.
  std::array<int, 2> fingertips{};
  std::array<double, 2> ends{};
};

/// Plans how the vertices that two fingers hold move such that the sheet makes a bulge: those under
/// the fingers go to the ends, and four in the middle go up.
class BulgePlan {
 public:
  using Vec = clothctl::Vector3<double>;
  using Points = clothctl::Points<double>;

  /// Sheet 0 of the world; the fingertips are at `tips` and segments 0 and 1 of the contacts. What
  /// is referred to must outlive the plan. Fails when: a finger holds nothing, or the planner
  /// refuses.
  static clothctl::Result<std::unique_ptr<BulgePlan>> create(
      const clothctl::World<double>& world, const clothctl::StaticContacts<double>& contacts,
      const clothctl::GridMesh<double>& grid, const BulgeOptions& options,
      const std::array<Vec, 2>& tips, const Vec& middle);

  /// Plans the frame at time t, s. Returns what went wrong.
  std::string make(double t);
  /// The vertices that a finger holds, and where the plan wants them at the end of the frame.
  std::vector<int> held(int finger) const {
    return grips_[static_cast<std::size_t>(finger)].vertices();
  }
  Points next(int finger) const;
  /// Where the features are: two under the fingertips, four in the middle.
  Points features() const;
  Vec target(clothctl::Index feature, double t) const;

 private:
  using Response = clothctl::MassSpringResponse<float>;
  using Predictor = clothctl::LinearisedPredictor<Response>;

  BulgePlan(const clothctl::World<double>& world, const clothctl::StaticContacts<double>& contacts,
            const clothctl::GridMesh<double>& grid, const BulgeOptions& options)
      : world_(world), contacts_(contacts), grid_(grid), options_(options) {}
  std::string start(const std::array<Vec, 2>& tips, const Vec& middle);
  /// Takes what the fingers hold; where one holds nothing, all stays.
  std::string take_grips();
  const Points& x() const { return world_.state(0).positions; }

  const clothctl::World<double>& world_;
  const clothctl::StaticContacts<double>& contacts_;
  const clothctl::GridMesh<double>& grid_;
  BulgeOptions options_;
  std::unique_ptr<Response> response_;
  std::unique_ptr<clothctl::Planner<Predictor>> planner_;
  clothctl::PlanResult<double> plan_;
  std::vector<clothctl::Grip<double>> grips_;
  Points start_;
  std::vector<clothctl::VertexSupport<double>> supports_;
};

}  // namespace program
