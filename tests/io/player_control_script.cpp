// The player's controls on the whole page: playback, keys, pointers, layers, and address options,
// also malformed ones.

#include "clothctl/io/detail/player_control_script.hpp"

#include <string>

#include "io/script_text.hpp"
#include "support/catch.hpp"

using clothctl::PlayerRecorder;
using clothctl::PlayerScene;
using clothctl::Points;
using clothctl_test::check_in_page;
using clothctl_test::page_of;

namespace {

/// Returns the whole script, started with an address, and then the checks of a test.
std::string started(const std::string& hash, const char* checks) {
  return "location.hash = '" + hash + "';\n" + clothctl_test::all_scripts() + R"js(
const press = (key, event = {}) => window.fire('keydown', { key, target: document.body, ...event });
// Advances the clock.
let clock = 1000;
const after = milliseconds => { if (!last) screen(clock); screen(clock += milliseconds); };
)js" + checks;
}

}  // namespace

TEST_CASE("the control script makes no outside request and writes no markup",
          "[player_control_script]") {
  clothctl_test::check_stays_inside(clothctl::detail::kPlayerControlScript);
}

TEST_CASE("playback keeps the time of the recording at any speed", "[player_control_script]") {
  check_in_page(page_of(), started("", R"js(
const label = () => $('play').getAttribute('aria-label');
check('plays from the start', state.playing && state.frame === 0 && label() === 'Pause');
after(20);
near('a frame of 0.02 s', state.frame, 1);
after(10);
near('half a frame', state.frame, 1.5);
$('speed').value = '0.5';
$('speed').fire('change');
after(20);
near('half the speed', state.frame, 2);
check('time and frame are shown', $('now').textContent === '0.04' && $('scrub').value === 2);
check('length is shown', $('length').textContent === '0.08');
after(1e6);
near('playback repeats from the start', state.frame, 0);
after(1e-9);
$('loop').click();
check('repeat is off', !state.loop && $('loop').getAttribute('aria-pressed') === 'false');
after(1e6);
check('stays at the end', !state.playing && state.frame === F - 1 && label() === 'Play');
screen();
check('requests no further refresh', screen() === 0);
$('play').click();
check('plays again from the start', state.playing && state.frame === 0);
)js"));
}

TEST_CASE("the page follows the system's settings for motion and colours",
          "[player_control_script]") {
  check_in_page(
      page_of(),
      "media['(prefers-reduced-motion: reduce)'] = { matches: true };\n" +
          started("", "check('still', !state.playing); check('light', theme() === 'light');"));
  check_in_page(
      page_of(),
      "media['(prefers-color-scheme: dark)'] = Object.assign(new Target(), { matches: true });\n" +
          started("", R"js(
check('dark', theme() === 'dark');
const background = () => document.querySelectorAll('[data-feature]')[1].style.background;
check('with its colours', background() === palette.dark[1]);
media['(prefers-color-scheme: dark)'].matches = false;
media['(prefers-color-scheme: dark)'].fire('change');
check('follows', theme() === 'light' && background() === palette.light[1]);
)js"));
}

TEST_CASE("keys step, seek, play and switch layers", "[player_control_script]") {
  check_in_page(page_of(), started("#paused", R"js(
const frames = keys => keys.map(([key, event]) => (press(key, event), state.frame));
near('steps', frames([['.'], ['ArrowRight'], [','], ['ArrowLeft'], ['ArrowLeft']]),
  [1, 2, 1, 0, 0]);
near('ends', frames([['End'], ['.'], ['Home'], ['ArrowRight', { shiftKey: true }]]), [4, 4, 0, 4]);
setFrame(1.4);
near('whole frames from a half', frames([['.'], [',']]), [2, 1]);
for (const [name, , key, there] of layers) {
  press(key.toUpperCase());
  check(name + ' off', there && !state.show[name] && !boxes[name].checked);
  press(key.toLowerCase());
  check(name + ' on', state.show[name] && boxes[name].checked);
}
press('d');
check('theme', theme() === 'dark');
check('space plays', press(' ').defaultPrevented === true && state.playing);
press('.');
check('a step stops', !state.playing);
const distance = camera.distance;
press('+');
check('nearer', camera.distance < distance);
press('3');
near('top', camera.pitch, Math.PI / 2);
check('unknown keys are not handled', press('q').defaultPrevented === undefined);
)js"));
}

TEST_CASE("keys with other meanings keep them", "[player_control_script]") {
  check_in_page(page_of(), started("#paused", R"js(
const left = (key, event) => {
  const prevented = press(key, event).defaultPrevented;
  check(key + ' is left', prevented === undefined && state.frame === 0 && !state.playing);
};
for (const held of ['ctrlKey', 'metaKey', 'altKey']) left('.', { [held]: true });
left('ArrowRight', { target: $('speed') });
left('End', { target: Object.assign($('scrub'), { type: 'range' }) });
left(' ', { target: $('back') });
press(' ', { target: $('scrub') });
check('a slider lets space play', state.playing);
setPlaying(false);
canvas.focused = true;
const yaw = camera.yaw;
press('ArrowRight', { target: canvas });
check('arrows turn the view that has the focus', camera.yaw !== yaw && state.frame === 0);
)js"));
}

TEST_CASE("buttons, slider and plot seek", "[player_control_script]") {
  check_in_page(page_of(), started("", R"js(
$('scrub').value = '3';
$('scrub').fire('input');
check('slider', state.frame === 3 && !state.playing);
near('buttons', ['forth', 'back', 'back', 'first', 'back'].map(id => ($(id).click(), state.frame)),
  [4, 3, 2, 0, 0]);
plot.fire('pointerdown', { pointerId: 1, clientX: plotX(2, 800) });
near('plot', state.frame, 2);
plot.fire('pointermove', { pointerId: 1, clientX: 5000 });
near('dragged beyond its end', state.frame, 4);
plot.fire('pointermove', { pointerId: 2, clientX: 0 });
near('a pointer that is not pressed does nothing', state.frame, 4);
check('the slider ends at the last frame', $('scrub').max === 4);
)js"));
}

TEST_CASE("pointers orbit, pan and zoom within limits", "[player_control_script]") {
  check_in_page(page_of(), started("#paused", R"js(
const move = (id, x, y, event = {}) => {
  canvas.fire('pointermove', { pointerId: id, clientX: x, clientY: y, ...event });
};
const down = (id, x, y) => canvas.fire('pointerdown', { pointerId: id, clientX: x, clientY: y });
const { yaw, pitch, target: before } = camera, { right, up } = axes();
down(1, 100, 100);
move(1, 120, 90);
near('orbit', [camera.yaw, camera.pitch], [yaw - .15, pitch - .075]);
move(1, 120, 1e6);
near('the camera stops at the top', camera.pitch, Math.PI / 2);
[camera.yaw, camera.pitch] = [yaw, pitch];
move(1, 420, 1e6, { shiftKey: true });
// Half of the shorter side is 15 degrees.
const half = Math.tan(Math.PI / 12) * camera.distance;
near('the scene follows a pan', sub(camera.target, before), right.map(x => -x * half), 1e-6);
canvas.fire('pointerup', { pointerId: 1 });
move(1, 0, 0);
near('no rotation without a pressed pointer', [camera.yaw, camera.pitch], [yaw, pitch]);
down(1, 0, 0);
down(2, 100, 0);
const distance = camera.distance;
move(2, 200, 0);
near('two fingers twice as far apart', camera.distance, distance / 2);
for (let i = 0; i < 1000; ++i) canvas.fire('wheel', { deltaY: -1e9, deltaMode: 0 });
near('nearest', camera.distance, .02 * diagonal);
for (let i = 0; i < 1000; ++i) canvas.fire('wheel', { deltaY: 1e9, deltaMode: 2 });
near('farthest', camera.distance, 20 * diagonal);
observers[0]();
near('a view that was moved is not fitted again', camera.distance, 20 * diagonal);
canvas.fire('dblclick');
check('fitted', camera.distance < 10 * diagonal && !moved);
)js"));
}

TEST_CASE("layers that a scene does not have cannot be switched on or off",
          "[player_control_script]") {
  PlayerScene rope;
  rope.segments = {{0, 1}};
  check_in_page(page_of(rope), started("", R"js(
check('rope', $('layers').textContent.includes('Rope') && boxes.lines === undefined);
press('w');
check('no mesh lines', state.show.lines === true);
const range = document.getElementById('arrow-length');
range.value = '-1';
range.fire('input');
near('length of arrows', state.arrowScale, .5);
toggle('ground');
check('hiding the ground hides the size of its grid', $('grid-size').hidden);
)js"));
}

TEST_CASE("a recording of one frame does not play", "[player_control_script]") {
  PlayerRecorder recorder({}, 1, 0, 0);
  const Points<double> none(3, 0);
  recorder.add_frame(Points<double>::Zero(3, 1), none, none, none, none);
  check_in_page(*recorder.page(), started("", R"js(
$('play').click();
press(' ');
after(100);
check('still', !state.playing && state.frame === 0 && $('now').textContent === '0.00');
check('slider without length', $('scrub').style['--fill'] === '0%');
)js"));
}

TEST_CASE("the last mark is shown in the view", "[player_control_script]") {
  clothctl::PlayerRecorder recorder = clothctl_test::swinging_sheet();
  check_in_page(*recorder.page(), started("#paused", R"js(
screen();
check('none', $('mark').textContent === '');
scene.marks.push([1, 'close'], [3, 'hold <b>']);
const markAt = f => { setFrame(f); screen(); return $('mark').textContent; };
check('before', markAt(0) === '' && markAt(.5) === '');
check('first', markAt(1) === 'close' && markAt(2.9) === 'close');
check('second, as text', markAt(3) === 'hold <b>' && markAt(4) === 'hold <b>');
check('back', markAt(0) === '');
)js"));
}

TEST_CASE("the options in the address are applied", "[player_control_script]") {
  check_in_page(
      page_of(),
      started("#frame=3&paused&theme=dark&speed=0.5&yaw=30&pitch=20&zoom=2&hide=arrows,ground",
              R"js(
check('frame', state.frame === 3 && !state.playing);
check('theme', theme() === 'dark');
check('speed', state.speed === .5 && $('speed').value === '0.5');
near('camera', [camera.yaw, camera.pitch], [Math.PI / 6, Math.PI / 9]);
const near_ = camera.distance;
fit();
near('zoom', camera.distance / near_, 2);
check('hidden', Object.keys(state.show).filter(n => !state.show[n]).join() === 'arrows,ground');
location.hash = '#view=top&frame=1';
window.fire('hashchange');
check('a new address', camera.pitch === Math.PI / 2 && state.frame === 1 && theme() === 'dark');
)js"));
}

TEST_CASE("malformed addresses leave the page working", "[player_control_script]") {
  for (const char* hash : {"#frame=abc&paused",
                           "#frame=-7",
                           "#frame=1e999",
                           "#frame=NaN&zoom=NaN&yaw=NaN&pitch=NaN",
                           "#yaw=1e999&paused",
                           "#pitch=-1e999",
                           "#zoom=1e999",
                           "#zoom=-1",
                           "#zoom=1e-300",
                           "#speed=1e9",
                           "#speed=0",
                           "#theme=__proto__",
                           "#view=constructor&paused",
                           "#view=__proto__&paused",
                           "#view=toString",
                           "#hide=__proto__,constructor",
                           "#hide=toString,,nothing",
                           "#%E0%A4%A",
                           "#=&&==",
                           "#theme=<script>"}) {
    INFO(hash);
    check_in_page(page_of(), started(hash, R"js(
check('frame', Number.isInteger(state.frame) && state.frame >= 0 && state.frame < F);
check('camera ' + JSON.stringify(camera),
  [camera.yaw, camera.pitch, camera.distance, ...camera.target].every(Number.isFinite));
check('distance', camera.distance >= .02 * diagonal && camera.distance <= 20 * diagonal);
check('theme', ['light', 'dark'].includes(theme()) && state.speed === 1);
check('layers', Object.keys(state.show).length === 6
  && Object.values(state.show).every(shown => shown === true));
check('prototypes are unchanged', !('checked' in Object.prototype) && !('checked' in Object));
check('later options are applied', state.playing !== /paused/.test(location.hash));
screen();
)js"));
  }
}
