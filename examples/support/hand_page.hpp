#pragma once

// The page of a run with hands: the sheet and the hands as one mesh, and the forces of the fingers
// on both sides.

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/io/html_player.hpp"
#include "support/hand_grasp.hpp"

namespace program {

/// The page.
class HandPage {
 public:
  using Points = clothctl::Points<double>;

  /// `scene` has the triangles of the sheet; those of the hands are added.
  HandPage(clothctl::PlayerScene scene, clothctl::Index sheet_vertices, clothctl::Index features,
           std::vector<GraspingHand*> hands)
      : hands_(std::move(hands)),
        recorder_(with_hands(std::move(scene), sheet_vertices), vertices(sheet_vertices), features,
                  GraspingHand::kArrows * static_cast<clothctl::Index>(hands_.size())) {}

  /// Records a frame with features where they are and where they shall be (3×features, m).
  void add_frame(const Points& sheet, const Points& features, const Points& targets, double dt) {
    Points all(3, vertices(sheet.cols()));
    all.leftCols(sheet.cols()) = sheet;
    const clothctl::Index arrows =
        GraspingHand::kArrows * static_cast<clothctl::Index>(hands_.size());
    Points places = Points::Zero(3, arrows), forces = places;
    clothctl::Index column = sheet.cols(), arrow = 0;
    for (GraspingHand* hand : hands_) {
      Points shape(3, hand->shape().vertices.cols());
      hand->place_shape(shape);
      all.middleCols(column, shape.cols()) = shape;
      hand->add_arrows(dt, arrow, places, forces);
      column += shape.cols();
      arrow += GraspingHand::kArrows;
    }
    mark_phases();
    recorder_.add_frame(all, features, targets, places, forces);
  }
  /// The content of the page.
  clothctl::PlayerScene& scene() { return recorder_.scene(); }
  /// Writes player.html to a folder.
  std::string write(const std::string& folder) const {
    const auto written = recorder_.write(folder + "/player.html");
    return written ? std::string() : written.error();
  }

 private:
  clothctl::Index vertices(clothctl::Index sheet) const {
    for (const GraspingHand* hand : hands_) sheet += hand->shape().vertices.cols();
    return sheet;
  }
  clothctl::PlayerScene with_hands(clothctl::PlayerScene scene, clothctl::Index sheet) const {
    int first = static_cast<int>(sheet);
    for (const GraspingHand* hand : hands_) {
      for (const auto& t : hand->shape().triangles)
        scene.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
      first += static_cast<int>(hand->shape().vertices.cols());
    }
    scene.arrow_name = "Forces on sheet and fingers";
    scene.mesh_name = "Sheet and hands";
    return scene;
  }

  /// Marks the next frame where a hand is in another phase than in the last one.
  void mark_phases() {
    std::string now;
    for (const GraspingHand* hand : hands_)
      now.append(now.empty() ? "" : ", ").append(to_string(hand->figures().last.phase));
    if (now == phases_) return;
    recorder_.mark(now);
    phases_ = std::move(now);
  }

  std::vector<GraspingHand*> hands_;
  std::string phases_;
  clothctl::PlayerRecorder recorder_;
};

}  // namespace program
