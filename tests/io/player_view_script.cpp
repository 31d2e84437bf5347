// The player's camera and geometry: projections of known points, the first view, edges, normals,
// arrows, shaders.

#include "clothctl/io/detail/player_view_script.hpp"

#include <limits>
#include <regex>
#include <string>

#include "io/script_text.hpp"
#include "support/catch.hpp"

using clothctl::PlayerRecorder;
using clothctl::PlayerScene;
using clothctl::Points;
using namespace clothctl::detail;
using clothctl_test::check_in_page;
using clothctl_test::page_of;

namespace {

/// Returns the scripts up to the geometry and then the checks of a test.
std::string with(const char* checks) {
  return clothctl_test::joined({kPlayerDataScript, kPlayerShaders, kPlayerGeometryScript,
                                "const tick = () => {};\n", R"js(
const poses = [];
for (let yaw = -7; yaw < 7; yaw += .9) {
  for (let pitch = -1.57; pitch < 1.58; pitch += .314) poses.push([yaw, pitch]);
}
// Normalised device coordinates and w.
const seen = (m, p) => {
  const c = [0, 1, 2, 3].map(i => m[i] * p[0] + m[4 + i] * p[1] + m[8 + i] * p[2] + m[12 + i]);
  return [c[0] / c[3], c[1] / c[3], c[2] / c[3], c[3]];
};
)js",
                                checks});
}

}  // namespace

TEST_CASE("shaders and geometry make no outside request and write no markup",
          "[player_view_script]") {
  clothctl_test::check_stays_inside(kPlayerShaders);
  clothctl_test::check_stays_inside(kPlayerGeometryScript);
}

TEST_CASE("the camera's axes are orthonormal and right-handed, with z up", "[player_view_script]") {
  check_in_page(page_of(), with(R"js(
for ([camera.yaw, camera.pitch] of poses) {
  const { right, up, back } = axes();
  near('lengths', [norm(right), norm(up), norm(back)], [1, 1, 1]);
  near('angles', [dot(right, up), dot(up, back), dot(back, right)], [0, 0, 0]);
  near('right-handed axes', cross(right, up), back);
  check('upright', right[2] === 0 && up[2] >= 0);
  near('eye', sub(eyeOf(), camera.target), back.map(x => x * camera.distance));
}
)js"));
}

TEST_CASE("known points are projected to their positions", "[player_view_script]") {
  check_in_page(page_of(), with(R"js(
camera.distance = 2;
camera.target = [.3, -.2, .5];
for ([camera.yaw, camera.pitch] of poses) {
  for (const aspect of [.5, 1, 1.6]) {
    const { matrix, near: closest, eye, right, up, back } = cameraMatrix(aspect);
    const edge = 2 * Math.tan(Math.PI / 12);
    const [x, y, , w] = seen(matrix, camera.target);
    near('target in the middle', [x, y, w], [0, 0, 2], 1e-5);
    // The shorter side of the view spans 30 degrees.
    const topmost = add(camera.target, up, edge / Math.min(1, aspect));
    near('top edge', seen(matrix, topmost).slice(0, 2), [0, 1], 1e-5);
    const rightmost = add(camera.target, right, edge * Math.max(1, aspect));
    near('right edge', seen(matrix, rightmost).slice(0, 2), [1, 0], 1e-5);
    near('nearest', seen(matrix, add(eye, back, -closest))[2], -1, 1e-4);
    near('farthest', seen(matrix, add(eye, back, -(2 + 14 * diagonal)))[2], 1, 1e-4);
    const nearer = seen(matrix, add(camera.target, back, .1))[2];
    check('nearer is in front', nearer < seen(matrix, camera.target)[2]);
  }
}
)js"));
}

TEST_CASE("fitting shows everything at any aspect ratio without much empty space",
          "[player_view_script]") {
  check_in_page(page_of(), with(R"js(
check('something is watched', watched.length > 5 * 9);
for ([camera.yaw, camera.pitch] of poses) {
  for (const aspect of [.3, 1, 3]) {
    fitCamera(aspect);
    const { matrix } = cameraMatrix(aspect), all = watched.map(p => seen(matrix, p));
    const inside = ([x, y, , w]) => w > 0 && Math.abs(x) <= 1 && Math.abs(y) <= 1;
    check('all in sight', all.every(inside));
    const reach = Math.max(...all.flatMap(([x, y]) => [Math.abs(x), Math.abs(y)]));
    check('little empty space', reach > .6);
  }
}
// The view includes the tips of arrows.
check('tips', watched.some(p => p[2] > .7 + .1 * diagonal));
)js"));
}

TEST_CASE("the front view faces a hanging sheet from -y for either orientation of its triangles",
          "[player_view_script]") {
  const char* const checks = R"js(
check('hangs', hangs);
[camera.yaw, camera.pitch] = presets.front;
near('from -y', axes().back, [0, -1, 0]);
[camera.yaw, camera.pitch] = presets.top;
near('from above, x to the right', [...axes().back, ...axes().right], [0, 0, 1, 1, 0, 0]);
[camera.yaw, camera.pitch] = presets.side;
near('from +x', axes().back, [1, 0, 0]);
)js";
  check_in_page(page_of(), with(checks) + "check('front first', !flipped);");
  PlayerScene scene;
  for (int v : {0, 1, 3, 4}) {
    scene.triangles.push_back({v, v + 4, v + 1});
    scene.triangles.push_back({v, v + 3, v + 4});
  }
  check_in_page(page_of(scene), with(checks) + "check('back first', flipped);");
}

TEST_CASE("border and inner edges of a grid are distinguished, and normals point the same way",
          "[player_view_script]") {
  check_in_page(page_of(), with(R"js(
const pairs = list => {
  const out = [];
  for (let i = 0; i < list.length; i += 2) out.push(list[i] + '-' + list[i + 1]);
  return out.sort().join(' ');
};
check('border ' + pairs(border), pairs(border) === '0-1 0-3 1-2 2-5 3-6 5-8 6-7 7-8');
check('inner edges without diagonals ' + pairs(inner), pairs(inner) === '1-4 3-4 4-5 4-7');
computeNormals();
for (let i = 0; i < N; ++i) near('normal', unit([...normals.slice(3 * i, 3 * i + 3)]), [0, -1, 0]);
computeNormals();
// The middle vertex has six triangles with a doubled area of 0.01 m² each.
near('normals are not accumulated', normals[13], -.06, 1e-5);
)js"));
}

TEST_CASE("lines have six corners each and skip points that are not finite",
          "[player_view_script]") {
  check_in_page(page_of(), with(R"js(
const lines = new Lines(3);
lines.add([0, 0, 0], [3, 4, 0], 7);
lines.add([0, 0, 0], [NaN, 0, 0]);
lines.add([3, 4, 0], [3, 4, 2]);
near('count', [lines.count, lines.length], [2, 7]);
near('first corner', [...lines.data.slice(0, 10)], [0, 0, 0, 3, 4, 0, 0, -1, 0, 7]);
near('last corner', [...lines.data.slice(110, 120)], [3, 4, 0, 3, 4, 2, 0, 1, 5, 0]);
lines.clear();
near('clear', [lines.count, lines.length], [0, 0]);
const curve = curveLines(actual, 0);
near('a curve joins its frames', [curve.count, curve.length], [F - 1, .08]);
edgeLines(lines, [0, 1, 0, 3]);
near('edges', [lines.count, lines.length], [2, .2], 1e-4);
)js"));
}

TEST_CASE("an arrow ends at its scaled vector and has unit normals", "[player_view_script]") {
  check_in_page(page_of(), with(R"js(
near('the 95th percentile of arrows is a fifth of the scene', arrowUnit * 5, .2 * diagonal);
state.arrowScale = .5;
near('corners', buildArrows(1), kSides * 9);
let top = -Infinity;
for (let i = 0; i < kSides * 9; ++i) {
  const row = [...arrowSolid.slice(6 * i, 6 * i + 6)];
  near('normal', norm(row.slice(3)), 1, 1e-5);
  top = Math.max(top, row[2]);
}
near('tip', top, .7 + .5 * 3 * arrowUnit, 1e-5);
state.arrowScale = 1e-6;
near('an invisible arrow has no corners', buildArrows(1), 0);
)js"));
  const double bad = std::numeric_limits<double>::quiet_NaN();
  PlayerRecorder recorder({}, 1, 0, 3);
  Points<double> tails = Points<double>::Zero(3, 3), arrows = Points<double>::Ones(3, 3);
  tails(0, 0) = arrows(2, 1) = bad;
  arrows.col(2).setZero();
  recorder.add_frame(Points<double>::Zero(3, 1), Points<double>(3, 0), Points<double>(3, 0), tails,
                     arrows);
  check_in_page(*recorder.page(), with(R"js(
near('none is drawn', buildArrows(0), 0);
check('scale', Number.isFinite(arrowUnit) && watched.every(p => p.every(Number.isFinite)));
)js"));
}

TEST_CASE("a rope, a point and an empty scene have a view", "[player_view_script]") {
  const char* const checks = R"js(
check('does not hang', !hangs);
fitCamera(1.5);
check('finite', [...cameraMatrix(1.5).matrix, groundHeight, cell, arrowUnit].every(Number.isFinite)
  && camera.distance > 0);
)js";
  PlayerScene rope;
  rope.segments = {{0, 1}, {1, 2}};
  check_in_page(page_of(rope), with(checks));
  for (const int count : {0, 1}) {
    PlayerRecorder recorder({}, count, 0, 0);
    recorder.add_frame(Points<double>::Constant(3, count, 2.0), Points<double>(3, 0),
                       Points<double>(3, 0), Points<double>(3, 0), Points<double>(3, 0));
    check_in_page(*recorder.page(), with(checks));
  }
}

TEST_CASE("round numbers are 1, 2 or 5 times a power of ten, near the given number",
          "[player_view_script]") {
  check_in_page(page_of(), with(R"js(
for (let x = 1e-5; x < 1e6; x *= 1.07) {
  const round = nice(x), lead = round / 10 ** Math.floor(Math.log10(round) + 1e-9);
  check('lead of ' + round, [1, 2, 5].some(d => Math.abs(lead - d) < 1e-6));
  check(round + ' near ' + x, round / x < 1.7 && x / round < 1.8);
}
check('the ground is below the scene', groundHeight === 0 || groundHeight < low[2]);
)js"));
}

TEST_CASE("the outputs of a vertex shader are the inputs of its fragment shader",
          "[player_view_script]") {
  check_in_page(page_of(), with(R"js(
const names = (source, kind) => {
  const found = [...source.matchAll(new RegExp(kind + ' (\\w+) ([^;]+);', 'g'))];
  return found.flatMap(m => m[2].split(',').map(n => m[1] + ' ' + n.trim()));
};
for (const [name, [vertex, fragment]] of Object.entries(shaders)) {
  const given = names(vertex, 'varying'), taken = names(fragment, 'varying');
  check(`${name}: ${given} / ${taken}`, given.sort().join() === taken.sort().join());
  for (const source of [vertex, fragment]) {
    for (const [open, close] of ['()', '{}', '[]']) {
      check(name + ': ' + open, source.split(open).length === source.split(close).length);
    }
    const kinds = ['attribute', 'uniform', 'varying'];
    for (const declared of kinds.flatMap(kind => names(source, kind))) {
      const word = declared.split(' ')[1];
      check(`${name}: ${word} is used`,
        source.match(new RegExp('\\b' + word + '\\b', 'g')).length > 1);
    }
    check(name + ': floats have a point',
      !/(?<!\w)\d/.test(source.replace(/\d*\.\d*|\d+e-?\d+/g, '')));
  }
  check(name + ': sets its position', /gl_Position =/.test(vertex));
  check(name + ': sets its colour', /gl_FragColor =/.test(fragment));
  // A uniform of both shaders has one type.
  for (const u of names(vertex, 'uniform')) {
    const other = names(fragment, 'uniform').find(v => v.split(' ')[1] === u.split(' ')[1]);
    check(`${name}: ${u}`, other === undefined || other === u);
  }
}
)js"));
}
