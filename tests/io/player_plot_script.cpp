// The player's plot: ticks, units, positions of points, gaps where the error is unknown, the
// legend.

#include "clothctl/io/detail/player_plot_script.hpp"

#include <limits>
#include <string>

#include "io/script_text.hpp"
#include "support/catch.hpp"

using clothctl::Index;
using clothctl::PlayerRecorder;
using clothctl::PlayerScene;
using clothctl::Points;
using namespace clothctl::detail;
using clothctl_test::check_in_page;

namespace {

std::string with(const char* checks) {
  return clothctl_test::joined({kPlayerDataScript, kPlayerGeometryScript, kPlayerPlotScript,
                                "const tick = () => {};\n", R"js(
// The drawn points of curve k, a list for each uninterrupted part.
const stretches = k => {
  pen.calls.length = 0;
  paintPlot();
  const out = [];
  for (const [what, x, y, colour] of pen.calls) {
    if (colour !== colourOf(k) || !['moveTo', 'lineTo'].includes(what)) continue;
    if (what === 'moveTo') out.push([]);
    out[out.length - 1].push([x, y]);
  }
  return out;
};
const words = () => pen.calls.filter(c => c[0] === 'fillText').map(c => c[1]);
)js",
                                checks});
}

/// Returns the page of `frames` frames with `features` features whose error is `error`.
std::string page_with_error(int frames, Index features, double error, PlayerScene scene = {}) {
  PlayerRecorder recorder(std::move(scene), 0, features, 0);
  const Points<double> none(3, 0), target = Points<double>::Zero(3, features);
  Points<double> actual = target;
  for (Index i = 0; i < features; ++i) actual(1, i) = error;
  for (int f = 0; f < frames; ++f) recorder.add_frame(none, actual, target, none, none);
  return *recorder.page();
}

}  // namespace

TEST_CASE("the plot script makes no outside request and writes no markup", "[player_plot_script]") {
  clothctl_test::check_stays_inside(kPlayerPlotScript);
}

TEST_CASE("ticks are round numbers, start at zero and cover the range", "[player_plot_script]") {
  check_in_page(page_with_error(2, 1, 0.1), with(R"js(
for (let limit = .003; limit < 3e4; limit *= 1.13) {
  for (const count of [2, 3.2, 7, 10]) {
    const { step, out } = ticks(limit, count), last = out[out.length - 1];
    check('from zero', out[0] === 0);
    near('steps', out, out.map((_, i) => i * step));
    check(`${out} covers ${limit}`, last <= limit * (1 + 1e-8) && last + step > limit);
    const steps = out.length - 1;
    check(`${steps} steps for ${count}`, steps <= 2 * count && steps >= Math.floor(count / 2));
    near('texts are the numbers', out.map(x => tickText(x, step)), out, 1e-9 * limit);
  }
}
check('texts', tickText(.5, .5) === '0.5' && tickText(20, 10) === '20'
  && tickText(.06, .02) === '0.06');
)js"));
}

TEST_CASE("errors below a metre are shown in millimetres, with enough digits to differ",
          "[player_plot_script]") {
  const auto shows = [](double error, const std::string& text) {
    check_in_page(page_with_error(2, 1, error),
                  with("") +
                      "check(shown(largestError) + unitName, shown(largestError) + unitName === '" +
                      text + "');\ncheck('unknown', shown(NaN) === '–');\n");
  };
  shows(0.04, "40.0mm");
  shows(0.4, "400mm");
  shows(0.0012345, "1.23mm");
  shows(0, "0.000mm");
  shows(1.5, "1.50m");
  shows(2500, "2500m");
}

TEST_CASE("curves are drawn at the positions of frame and error", "[player_plot_script]") {
  check_in_page(clothctl_test::page_of(), with(R"js(
const [first] = stretches(0), [second] = stretches(1), place = mm => 128 - mm / (40 * 1.06) * 120;
near('from side to side', first.slice(0, F).map(p => p[0]), [40, 227.5, 415, 602.5, 790]);
near('20 mm', first.slice(0, F).map(p => p[1]), Array(F).fill(place(20)), 1e-3);
near('40 mm', second.slice(0, F).map(p => p[1]), Array(F).fill(place(40)), 1e-3);
const mean = Math.round(place(30)) + .5;
const at = (what, x) => pen.calls.some(c => c[0] === what && c[1] === x && c[2] === mean);
check('a line at the mean of 30 mm', at('moveTo', 40) && at('lineTo', 790));
check('ticks of both axes', words().includes('20') && words().includes('0.00 s'));
state.frame = 2.5;
paintPlot();
near('cursor', plotX(state.frame, 800), 508.75);
check('drawn', pen.calls.some(c => c[0] === 'lineTo' && c[1] === 508.75 && c[2] === 128));
check('all scored', !pen.calls.some(c => c[0] === 'fillRect'));
window.devicePixelRatio = 2;
paintPlot();
near('pixels of a high-resolution screen', [plot.width, plot.height], [1600, 300]);
)js"));
}

TEST_CASE("frames that are not scored are shaded", "[player_plot_script]") {
  PlayerScene scene;
  scene.scored_frames = 3;
  check_in_page(clothctl_test::page_of(scene), with(R"js(
paintPlot();
const [shade] = pen.calls.filter(c => c[0] === 'fillRect');
near('from the last scored frame to the right', [shade[1], shade[1] + shade[3]],
  [plotX(2, 800), 790]);
)js"));
}

TEST_CASE("marks are lines with texts that neither overlap nor leave the plot",
          "[player_plot_script]") {
  PlayerRecorder recorder = clothctl_test::swinging_sheet();  // 5 frames, 187.5 pixels apart
  recorder.mark("behind the last frame");
  CHECK(recorder.page()->find("[5,\"behind") != std::string::npos);
  check_in_page(*recorder.page(), with(R"js(
const lines = () => {
  pen.calls.length = 0;
  paintPlot();
  return pen.calls.filter(c => c[0] === 'lineTo' && c[2] === 128 && c[1] % 1 === .5).map(c => c[1]);
};
const before = lines();
check('not behind the end', !words().includes('behind the last frame'));
scene.marks.splice(0, 1, [0, 'close'], [1, 'a text of more than a frame'], [2, 'hidden'],
  [4, 'too near to the right side']);
near('a line each', lines().length - before.length, 4);
check('texts', words().includes('close') && words().includes('a text of more than a frame'));
check('no overlap', words().includes('hidden'));
check('not outside', !words().includes('too near to the right side'));
scene.marks[1][1] = 'a text that is a good deal longer than a frame';
lines();
check('not over another', !words().includes('hidden'));
)js"));
}

TEST_CASE("a curve is interrupted where its error is unknown", "[player_plot_script]") {
  PlayerRecorder recorder({}, 0, 1, 0);
  const Points<double> none(3, 0);
  for (int f = 0; f < 6; ++f) {
    Points<double> actual = Points<double>::Constant(3, 1, 0.1);
    if (f == 2) actual(0, 0) = std::numeric_limits<double>::quiet_NaN();
    if (f == 3) actual(1, 0) = std::numeric_limits<double>::infinity();
    recorder.add_frame(none, actual, Points<double>::Zero(3, 1), none, none);
  }
  check_in_page(*recorder.page(), with(R"js(
near('stretches', stretches(0).map(s => s.length), [2, 2]);
check('only numbers are drawn',
  pen.calls.every(c => c.every(x => typeof x !== 'number' || Number.isFinite(x))));
state.frame = 2;
paintPlot();
check('no marker there', !pen.calls.slice(-12).some(c => c[0] === 'arc'));
)js"));
}

TEST_CASE("one frame, and errors of zero, are drawn with finite numbers", "[player_plot_script]") {
  for (const int frames : {1, 2}) {
    for (const double error : {0.0, 1e-12, 1e6, std::numeric_limits<double>::quiet_NaN()}) {
      check_in_page(page_with_error(frames, 1, error), with(R"js(
for (const width of [0, 30, 800]) {
  plot.clientWidth = width;
  paintPlot();
}
check('numbers', pen.calls.every(c => c.every(x => typeof x !== 'number' || Number.isFinite(x))));
)js"));
    }
  }
}

TEST_CASE("the legend names up to eight features, counts more, and hides without features",
          "[player_plot_script]") {
  PlayerScene scene;
  scene.feature_names = {"<b>left</b>"};
  check_in_page(page_with_error(2, 2, 0.0125, scene), with(R"js(
buildLegend();
paintPlot();
const legend = $('legend').textContent;
check(legend, legend === '<b>left</b>12.5 mmfeature 112.5 mmmean12.5 mm');
check('no text on the curves', !pen.calls.some(c => c[0] === 'fillText' && /mean/.test(c[1])));
check('unit', $('plot-unit').textContent === '(mm)');
const swatches = document.querySelectorAll('[data-feature]');
near('swatches', swatches.map(s => s.dataset.feature), [0, 1], 0);
)js"));
  check_in_page(page_with_error(2, 9, 0.0125), with(R"js(
buildLegend();
paintPlot();
check('many', $('legend').textContent === '9 features, largest 12.5 mmmean12.5 mm'
  && !$('plot-card').hidden);
)js"));
  check_in_page(page_with_error(2, 0, 0), with(R"js(
buildLegend();
paintPlot();
check('none', $('plot-card').hidden && pen.calls.length === 0);
)js"));
}
