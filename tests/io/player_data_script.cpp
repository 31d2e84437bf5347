// The page's script decodes the recorded data, blends frames and measures errors; its vectors and
// matrices are correct.

#include "clothctl/io/detail/player_data_script.hpp"

#include <limits>
#include <string>

#include "io/script_text.hpp"
#include "support/catch.hpp"

using clothctl::PlayerRecorder;
using clothctl::PlayerScene;
using clothctl::Points;
using clothctl::detail::kPlayerDataScript;
using clothctl_test::check_in_page;
using clothctl_test::page_of;

namespace {

/// Returns the script and then the checks of a test.
std::string with(const char* checks) {
  std::string script(kPlayerDataScript);
  script.append("const tick = () => {};\n").append(checks);
  return script;
}

}  // namespace

TEST_CASE("the data script makes no outside request and writes no markup", "[player_data_script]") {
  clothctl_test::check_stays_inside(kPlayerDataScript);
}

TEST_CASE("every frame decodes to the recorded values", "[player_data_script]") {
  check_in_page(page_of(), with(R"js(
check('counts', N === 9 && F === 5 && K === 2 && A === 1 && dt === .02);
const out = new Float32Array(3 * N);
for (let f = 0; f < F; ++f) {
  positionsAt(f, out);
  for (let i = 0; i < N; ++i) {
    const wanted = [.1 * (i % 3), .02 * f, .5 + .1 * Math.floor(i / 3)];
    near('vertex', [...out.slice(3 * i, 3 * i + 3)], wanted, .2 / 131070 + 1e-6);
  }
  // Floats are stored exactly.
  const feature = [.1, .02 * f, .5].map(Math.fround);
  check('feature', columnAt(actual, K, 1, f).every((x, c) => x === feature[c]));
  check('target', columnAt(target, K, 1, f)[2] === Math.fround(.46));
  check('arrow', columnAt(vectors, A, 0, f)[2] === 2 + f);
  check('its origin', columnAt(origins, A, 0, f)[0] === Math.fround(.2));
}
near('triangles', [...triangles],
  [0, 1, 4, 0, 4, 3, 1, 2, 5, 1, 5, 4, 3, 4, 7, 3, 7, 6, 4, 5, 8, 4, 8, 7], 0);
check('no segments', segments.length === 0);
)js"));
}

TEST_CASE("frames are interpolated, and constant beyond both ends", "[player_data_script]") {
  check_in_page(page_of(), with(R"js(
const out = new Float32Array(3 * N), y = frame => positionsAt(frame, out)[1];
near('quarter', y(1.25), .025, 1e-5);
near('before', y(-3), 0, 1e-5);
near('after', y(4.5), .08, 1e-5);
near('columns are interpolated', columnAt(vectors, A, 0, 2.5), [0, 0, 4.5]);
near('last', columnAt(vectors, A, 0, 1e9), [0, 0, 6]);
near('blend', blend(3.75), [3, 4, .75]);
near('blend at the end', blend(4).slice(0, 2), [4, 4]);
)js"));
}

TEST_CASE("errors are distances, and their mean is over the scored frames",
          "[player_data_script]") {
  PlayerScene scene;
  scene.scored_frames = 2;
  Points<double> x = clothctl_test::sheet_at(0), nowhere = x.leftCols(2);
  nowhere(1, 0) = std::numeric_limits<double>::quiet_NaN();
  Points<double> far = x.leftCols(2);
  far(0, 1) += 3;
  far(1, 1) += 4;
  PlayerRecorder recorder(scene, 9, 2, 0);
  const Points<double> none(3, 0);
  recorder.add_frame(x, nowhere, far, none, none);  // NaN and 5
  recorder.add_frame(x, x.leftCols(2), x.leftCols(2), none, none);
  recorder.add_frame(x, x.leftCols(2), far, none, none);  // not scored
  check_in_page(*recorder.page(), with(R"js(
check('unknown', Number.isNaN(errors[0]));
near('known', [...errors].slice(1), [5, 0, 0, 0, 5]);
near('mean', meanError, 5 / 3);
near('largest', largestError, 5);
check('NaN does not change the box', [...low, ...high].every(Number.isFinite));
near('targets widen the box', [high[0], high[1]], [3.1, 4]);
)js"));
  check_in_page(
      page_of(),
      with(
          "near('all frames', [meanError, largestError], [.03, .04]); near('scored', scored, 5);"));
  scene.scored_frames = 1000;
  check_in_page(page_of(scene), with("near('at most all frames', scored, F);"));
}

TEST_CASE("scenes without size, features or mesh give finite numbers", "[player_data_script]") {
  const Points<double> none(3, 0);
  PlayerRecorder empty({}, 0, 0, 0);
  empty.add_frame(none, none, none, none, none);
  check_in_page(*empty.page(), with(R"js(
near('diagonal', diagonal, 1);
check('no mean of nothing', Number.isNaN(meanError) && largestError === 0);
check('nothing to place', positionsAt(0, new Float32Array(0)).length === 0);
)js"));
  PlayerRecorder still({}, 1, 0, 0);
  still.add_frame(Eigen::Vector3d(1, 2, 3), none, none, none, none);
  check_in_page(*still.page(), with(R"js(
near('one frame', [...positionsAt(.7, new Float32Array(3))], [1, 2, 3]);
near('middle', middle, [1, 2, 3]);
)js"));
}

TEST_CASE("texts with markup arrive unchanged", "[player_data_script]") {
  PlayerScene scene;
  scene.title = "</script><script>alert(1)</script><!-- \" ' & \\ \n \xe2\x80\xa8 \xff";
  scene.feature_names = {"${1}", "`"};
  check_in_page(page_of(scene), with(R"js(
check('title', scene.title ===
  '<' + '/script><script>alert(1)<' + '/script><' + '!-- " \' & \\ \n \u2028 \ufffd');
check('names', scene.features[0] === '${1}' && scene.features[1] === '`');
)js"));
}

TEST_CASE("vector and matrix functions match algebra, and colours are readable",
          "[player_data_script]") {
  check_in_page(page_of(), with(R"js(
const a = [1, -2, 3], b = [.5, 4, -1];
const apply = (m, x) => {
  return [0, 1, 2, 3].map(i => x.reduce((sum, c, j) => sum + m[4 * j + i] * c, 0));
};
near('cross is at right angles', [dot(cross(a, b), a), dot(cross(a, b), b)], [0, 0]);
near('Lagrange', dot(cross(a, b), cross(a, b)), dot(a, a) * dot(b, b) - dot(a, b) ** 2);
near('cross of axes', cross([1, 0, 0], [0, 1, 0]), [0, 0, 1]);
near('add undoes sub', add(sub(a, b), b), a);
near('scaled', add(a, b, -2), [0, -10, 5]);
near('unit', unit([0, 3, 4]), [0, .6, .8]);
near('unit of nothing', unit([0, 0, 0]), [0, 0, 0]);
const m = Float32Array.from({ length: 16 }, (_, i) => Math.sin(3 * i));
const n = Float32Array.from({ length: 16 }, (_, i) => Math.cos(5 * i));
const x = [1, 2, 3, 4];
near('product applies right, then left', apply(multiply(m, n), x), apply(m, apply(n, x)), 1e-4);
near('rgb', rgb('#ff8000'), [1, 128 / 255, 0]);
near('clamp', [clamp(-1, 0, 2), clamp(3, 0, 2), clamp(1, 0, 2)], [0, 2, 1]);
document.documentElement.dataset.theme = 'dark';
check('colours repeat', colourOf(9) === colourOf(1) && colourOf(0) === palette.dark[0]);
check('all colours are read by rgb',
  [...palette.light, ...palette.dark].every(c => /^#[0-9a-f]{6}$/.test(c)));
)js"));
}

TEST_CASE("several requests for a refresh paint once", "[player_data_script]") {
  check_in_page(page_of(), with(R"js(
let painted = 0;
painters.push(() => ++painted);
invalidate(); invalidate(); invalidate();
near('one refresh', [screen(16), painted], [1, 1], 0);
near('no second repaint', [screen(32), painted], [0, 1], 0);
invalidate();
near('a new request repaints', [screen(48), painted], [1, 2], 0);
)js"));
}
