#pragma once

// The page of a run with hands: the sheet and the hands as one mesh, and the forces of the fingers
// on both sides.

#include <string>
#include <utility>
#include <vector>

#include "clothctl/io/html_player.hpp"
#include "support/hand_view.hpp"

namespace program {

/// The page.
class HandPage {
 public:
  using Points = clothctl::Points<double>;

  /// `scene` has the triangles of the sheet; those of the hands are added. The views must outlive
  /// the page.
  HandPage(clothctl::PlayerScene scene, clothctl::Index sheet_vertices, clothctl::Index features,
           std::vector<const HandView*> hands)
      : hands_(std::move(hands)),
        recorder_(with_hands(std::move(scene), sheet_vertices), vertices(sheet_vertices), features,
                  arrows()) {}

  /// Records a frame with features where they are and where they shall be (3×features, m).
  /// `phase`: what the hands do.
  void add_frame(const Points& sheet, const Points& features, const Points& targets, double dt,
                 const std::string& phase) {
    Points all(3, vertices(sheet.cols()));
    all.leftCols(sheet.cols()) = sheet;
    Points places = Points::Zero(3, arrows()), forces = places;
    clothctl::Index column = sheet.cols(), arrow = 0;
    for (const HandView* hand : hands_) {
      Points shape(3, hand->shape().vertices.cols());
      hand->place(shape);
      all.middleCols(column, shape.cols()) = shape;
      hand->add_arrows(dt, arrow, places, forces);
      column += shape.cols();
      arrow += hand->arrow_count();
    }
    recorder_.mark(phase);
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
    for (const HandView* hand : hands_) sheet += hand->shape().vertices.cols();
    return sheet;
  }
  clothctl::Index arrows() const {
    clothctl::Index sum = 0;
    for (const HandView* hand : hands_) sum += hand->arrow_count();
    return sum;
  }
  clothctl::PlayerScene with_hands(clothctl::PlayerScene scene, clothctl::Index sheet) const {
    int first = static_cast<int>(sheet);
    for (const HandView* hand : hands_) {
      for (const auto& t : hand->shape().triangles)
        scene.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
      first += static_cast<int>(hand->shape().vertices.cols());
    }
    scene.arrow_name = "Forces on sheet and fingers";
    scene.mesh_name = hands_.size() == 1 ? "Sheet and hand" : "Sheet and hands";
    return scene;
  }

  std::vector<const HandView*> hands_;
  clothctl::PlayerRecorder recorder_;
};

}  // namespace program
