#include "support/tear_history.hpp"

#include <nlohmann/json.hpp>

#include "clothctl/io/html_player.hpp"
#include "support/figure_text.hpp"
#include "support/options.hpp"

namespace program {

using clothctl::Index;
using clothctl::Remap;

void TearHistory::add_frame(const clothctl::Points<double>& x) {
  frames_.push_back(x);
  changes_before_.push_back(changes_.size());
}

void TearHistory::write(clothctl::PlayerScene scene, Index vertices, const std::string& folder,
                        const nlohmann::ordered_json& figures) const {
  for (const auto& [key, value] : figures.items())
    scene.figures.emplace_back(key, figure_text(value));
  std::vector<clothctl::Points<double>> shown = frames_;
  auto to_end = Remap<double>::identity(vertices, static_cast<Index>(scene.triangles.size()));
  std::size_t change = changes_.size();
  for (std::size_t i = frames_.size(); i-- > 0;) {
    while (change > changes_before_[i]) to_end = changes_[--change].then(to_end);
    shown[i] = to_end.interpolate(frames_[i]);
  }
  clothctl::PlayerRecorder page(std::move(scene), vertices, 0, 0);
  const clothctl::Points<double> none(3, 0);
  for (const auto& x : shown) page.add_frame(x, none, none, none, none);
  must(page.write(folder + "/player.html"));
}

}  // namespace program
