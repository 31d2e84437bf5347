// The fixed parts of a player page: defaults are as documented, and omitted parts are filled in.

#include "clothctl/io/player_scene.hpp"

#include <string>
#include <type_traits>

#include "io/script_text.hpp"
#include "support/catch.hpp"

using clothctl::PlayerScene;

static_assert(std::is_aggregate_v<PlayerScene>);

TEST_CASE("the defaults of a scene are 50 frames a second, forces in newtons, every frame scored",
          "[player_scene]") {
  const PlayerScene scene;
  CHECK(scene.dt == 0.02);
  CHECK(scene.arrow_name == "Forces");
  CHECK(scene.arrow_unit == "N");
  CHECK(scene.scored_frames == 0);
  CHECK((scene.title.empty() && scene.subtitle.empty()));
  CHECK((scene.triangles.empty() && scene.segments.empty() && scene.figures.empty() &&
         scene.feature_names.empty()));
}

TEST_CASE("a default scene makes a page that plays", "[player_scene]") {
  const std::string page = clothctl_test::page_of();
  clothctl_test::check_in_page(page, clothctl_test::all_scripts() + R"js(
check('title', document.title === 'Motion' && $('title').textContent === 'Motion');
check('hidden', $('subtitle').hidden && $('figures-card').hidden && !$('plot-card').hidden);
check('features are numbered: ' + $('legend').textContent,
  /^feature 0.*feature 1/.test($('legend').textContent));
check('playing', state.playing);
)js");
}

TEST_CASE("all texts of a scene are shown as text", "[player_scene]") {
  PlayerScene scene;
  scene.title = "Sheet <b>1</b>";
  scene.subtitle = "50 g/m² & more";
  scene.figures = {{"Mean", "7.5 mm"}, {"<i>", "</table>"}};
  scene.feature_names = {"left"};  // the second one gets a number
  scene.arrow_name = "Pull <u>";
  scene.arrow_unit = "mN";
  scene.dt = 0.5;
  const std::string page = clothctl_test::page_of(scene);
  clothctl_test::check_in_page(page, clothctl_test::all_scripts() + R"js(
check('title', document.title === 'Sheet <b>1</b>' && $('title').textContent === document.title);
check('subtitle', $('subtitle').textContent === '50 g/m² & more' && !$('subtitle').hidden);
const rows = $('figures').children.map(row => row.children.map(c => c.textContent));
check('figures ' + rows, JSON.stringify(rows) === '[["Mean","7.5 mm"],["<i>","</table>"]]'
  && !$('figures-card').hidden);
check('features', /^left.*feature 1/.test($('legend').textContent));
const arrows = $('layers').children.find(label => label.textContent.includes('Pull <u>'));
check('arrows', arrows !== undefined && arrows.title === 'Largest: 6.00 mN');
check('length', $('length').textContent === '2.00');
check('nothing of it became markup', pasted.every(html => !/<[biu]>|table/.test(html)));
)js");
}
