// The player's renderer with a stand-in for WebGL: each draw call must have everything that its
// shaders need, and hidden or invalid parts must not be drawn.

#include "clothctl/io/detail/player_render_script.hpp"

#include <limits>
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

// Constants are represented by their names. Uniforms and attributes are those that the shader
// sources declare. Each draw call checks that all of them were set for its program, with the right
// type and finite values, and that buffers are long enough.
constexpr char kStandIn[] = R"js(
const declared = (sources, kind) => {
  const pattern = new RegExp(kind + ' (\\w+) ([^;]+);', 'g');
  const found = sources.flatMap(s => [...s.matchAll(pattern)]);
  return [...new Map(found.flatMap(m => m[2].split(',').map(name => [name.trim(), m[1]])))];
};
const sizes = { FLOAT: 1, FLOAT_VEC2: 2, FLOAT_VEC3: 3, FLOAT_VEC4: 4, FLOAT_MAT4: 16 };
const typeOf = { float: 'FLOAT', vec2: 'FLOAT_VEC2', vec3: 'FLOAT_VEC3', vec4: 'FLOAT_VEC4',
  mat4: 'FLOAT_MAT4' };
const draws = [], bound = {}, arrays = [];
let current = null, linked = true, extension = true;
const given = (at, value, type) => {
  check(`${at.name} is of type ${type}`, at.type === type && at.program === current);
  const list = [value].flatMap(v => typeof v === 'number' ? v : [...v]);
  check(`${at.name} = ${list}`, list.length === sizes[type] && list.every(Number.isFinite));
  current.given.add(at.name);
};
const ready = vertices => {
  for (const u of current.uniforms) check('uniform ' + u[0], current.given.has(u[0]));
  current.attributes.forEach(([name], i) => {
    const a = arrays[i];
    const end = a ? a.offset + (vertices - 1) * (a.stride || 4 * a.size) + 4 * a.size : Infinity;
    check(`attribute ${name} reaches ${vertices} vertices`,
      Boolean(a?.on) && end <= a.buffer.data.byteLength);
  });
};
const functions = {
  createProgram: () => ({ sources: [], given: new Set() }),
  createShader: () => ({}),
  createBuffer: () => ({}),
  shaderSource: (shader, source) => { shader.source = source; },
  attachShader: (program, shader) => { program.sources.push(shader.source); },
  linkProgram: program => {
    program.uniforms = declared(program.sources, 'uniform');
    program.attributes = declared(program.sources, 'attribute');
  },
  getProgramParameter: (program, what) => ({
    LINK_STATUS: linked,
    ACTIVE_UNIFORMS: program.uniforms.length,
    ACTIVE_ATTRIBUTES: program.attributes.length
  })[what],
  getProgramInfoLog: () => 'no such thing',
  isContextLost: () => false,
  getExtension: () => extension ? {} : null,
  getActiveUniform: (program, i) => {
    const [name, type] = program.uniforms[i];
    return { name, type: typeOf[type] };
  },
  getUniformLocation: (program, name) => {
    return { program, name, type: typeOf[program.uniforms.find(u => u[0] === name)[1]] };
  },
  getActiveAttrib: (program, i) => ({ name: program.attributes[i][0] }),
  getAttribLocation: (program, name) => program.attributes.findIndex(a => a[0] === name),
  useProgram: program => { current = program; program.given.clear(); },
  uniform1f: (at, x) => given(at, x, 'FLOAT'),
  uniform2fv: (at, x) => given(at, x, 'FLOAT_VEC2'),
  uniform3fv: (at, x) => given(at, x, 'FLOAT_VEC3'),
  uniform4fv: (at, x) => given(at, x, 'FLOAT_VEC4'),
  uniformMatrix4fv: (at, transpose, x) => given(at, x, 'FLOAT_MAT4'),
  bindBuffer: (kind, buffer) => { check('a buffer', Boolean(buffer)); bound[kind] = buffer; },
  bufferData: (kind, data) => { bound[kind].data = data.slice(); },
  bufferSubData: (kind, offset, data) => {
    check('fits', data.byteLength <= bound[kind].data.byteLength);
    bound[kind].data.set(data);
  },
  enableVertexAttribArray: i => {
    check('attribute is known', i >= 0);
    arrays[i] = { ...arrays[i], on: true };
  },
  disableVertexAttribArray: i => { arrays[i] = { ...arrays[i], on: false }; },
  vertexAttribPointer: (i, size, type, normalised, stride, offset) => {
    const [name, kind] = current.attributes[i];
    check(name + ' has its size', sizes[typeOf[kind]] === size);
    arrays[i] = { ...arrays[i], buffer: bound.ARRAY_BUFFER, size, stride, offset };
  },
  drawArrays: (mode, first, count) => {
    ready(first + count);
    draws.push([name(), mode, count].join(' '));
  },
  drawElements: (mode, count, type, offset) => {
    const indices = bound.ELEMENT_ARRAY_BUFFER.data;
    const wanted = indices instanceof Uint32Array ? 'UNSIGNED_INT' : 'UNSIGNED_SHORT';
    check('index type', type === wanted && indices.length === count);
    ready(Math.max(...indices) + 1);
    draws.push([name(), mode, count].join(' '));
  }
};
const fakeGl = new Proxy(functions, {
  get: (all, key) => key in all ? all[key] : /^[A-Z_0-9]+$/.test(key) ? key : () => {}
});
)js";

constexpr char kUse[] = R"js(
const tick = () => {};
const name = () => Object.keys(gpu.programs).find(n => gpu.programs[n].program === current);
// Starts with WebGL. Reading a uniform that a program lacks is an error.
const start = () => {
  contexts.webgl = fakeGl;
  startView();
  for (const p of Object.values(gpu?.programs ?? {})) {
    p.uniforms = new Proxy(p.uniforms, {
      get: (all, u) => {
        check('a uniform named ' + u, u in all);
        return all[u];
      }
    });
  }
};
const painted = () => { draws.length = 0; paintView(); return draws.slice(); };
)js";

std::string with(const char* checks) {
  return clothctl_test::joined({kPlayerDataScript, kPlayerShaders, kPlayerGeometryScript,
                                kPlayerRenderScript, kUse, kStandIn, checks});
}

}  // namespace

TEST_CASE("the render script makes no outside request and writes no markup",
          "[player_render_script]") {
  clothctl_test::check_stays_inside(kPlayerRenderScript);
}

TEST_CASE("the picture of a sheet has all its parts, each with everything its shaders need",
          "[player_render_script]") {
  check_in_page(page_of(), with(R"js(
start();
for (const theme of ['light', 'dark']) {
  document.documentElement.dataset.theme = theme;
  for (const frame of [0, 1.3, F - 1]) {
    state.frame = frame;
    const all = painted();
    check('backdrop first', all[0] === 'backdrop TRIANGLE_STRIP 4');
    const parts = [
      'flat LINES ' + gpu.gridCount, 'shadow TRIANGLES 24', 'surface TRIANGLES 24',
      'surface TRIANGLES 90', 'flat LINES 8', 'line TRIANGLES 48'
    ];
    for (const part of parts) check(part + ' once', all.filter(d => d === part).length === 1);
    // Drawn veiled, then plain: 2 curves and 2 targets of 4 segments, 2 gaps in 1 call, 4 markers.
    check('curves', all.filter(d => d === 'line TRIANGLES 24').length === 8);
    check('gaps', all.filter(d => d === 'line TRIANGLES 12').length === 2);
    check('markers', all.filter(d => d === 'marker POINTS 1').length === 8);
  }
}
near('the canvas has its size', [canvas.width, canvas.height], [800, 600]);
near('the buffer has the current frame', gpu.position.data[1], .08, 1e-5);
)js"));
}

TEST_CASE("hidden layers are not drawn", "[player_render_script]") {
  check_in_page(page_of(), with(R"js(
start();
const without = (...names) => {
  for (const n of Object.keys(state.show)) state.show[n] = !names.includes(n);
  return painted();
};
check('surface', !without('surface').some(d => /^(surface|shadow) TRIANGLES 24/.test(d)));
check('lines', !without('lines').includes('flat LINES 8'));
const ground = d => d.startsWith('shadow') || d === 'flat LINES ' + gpu.gridCount;
check('ground', !without('ground').some(ground));
check('arrows', !without('arrows').includes('surface TRIANGLES 90'));
check('actual', without('actual').filter(d => d === 'line TRIANGLES 24').length === 4);
check('target', without('target').filter(d => d.startsWith('marker')).length === 4);
const all = ['surface', 'lines', 'ground', 'arrows', 'actual', 'target'];
check('all', without(...all).join() === 'backdrop TRIANGLE_STRIP 4');
camera.pitch = -.5;
check('no shadow seen from below', !without().some(d => d.startsWith('shadow')));
)js"));
}

TEST_CASE("a rope is drawn as core and rim without the parts of a sheet",
          "[player_render_script]") {
  PlayerScene scene;
  scene.segments = {{0, 1}, {1, 2}, {2, 5}};
  check_in_page(page_of(scene), with(R"js(
start();
const all = painted();
check('core and rim', all.filter(d => d === 'line TRIANGLES 18').length === 2);
check('no sheet', !all.some(d => d.startsWith('shadow') || d === 'surface TRIANGLES 24'));
)js"));
}

TEST_CASE("features and arrows that are not finite, and empty scenes, are not drawn",
          "[player_render_script]") {
  const double bad = std::numeric_limits<double>::quiet_NaN();
  PlayerRecorder lost({}, 1, 1, 1);
  for (int f = 0; f < 3; ++f) {
    const Points<double> nowhere = Points<double>::Constant(3, 1, bad);
    lost.add_frame(Points<double>::Zero(3, 1), nowhere, nowhere, nowhere, nowhere);
  }
  PlayerRecorder empty({}, 0, 0, 0);
  const Points<double> none(3, 0);
  empty.add_frame(none, none, none, none, none);
  for (const PlayerRecorder* recorder : {&lost, &empty}) {
    check_in_page(*recorder->page(), with(R"js(
start();
const room = 'backdrop TRIANGLE_STRIP 4,flat LINES ' + gpu.gridCount;
check('only backdrop and ground', painted().join() === room);
)js"));
  }
}

TEST_CASE("large meshes use wide indices, or the page says that the device has none",
          "[player_render_script]") {
  PlayerScene scene;
  scene.triangles = {{0, 1, 65536}};
  PlayerRecorder recorder(scene, 65537, 0, 0);
  Points<double> x = Points<double>::Zero(3, 65537);
  x(0, 1) = x(2, 65536) = 1;
  const Points<double> none(3, 0);
  recorder.add_frame(x, none, none, none, none);
  const std::string page = *recorder.page();
  check_in_page(page, with(R"js(
start();
check('drawn', painted().includes('surface TRIANGLES 3') && gpu.indexType === 'UNSIGNED_INT');
)js"));
  check_in_page(page, with(R"js(
extension = false;
start();
check('the limit is reported',
  !$('notice').hidden && /more vertices/.test($('notice-text').textContent));
check('nothing is drawn', painted().length === 0);
)js"));
}

TEST_CASE("without WebGL the page says so and the rest works", "[player_render_script]") {
  const char* const told = R"js(
check('notice', !$('notice').hidden && canvas.hidden && $('presets').hidden && $('grid-size').hidden
  && 'hidden' in $('triad').attributes);
check('nothing is drawn, nothing stops', painted().length === 0);
)js";
  check_in_page(page_of(), with("startView();\n") + told +
                               "check('reason', /no WebGL/.test($('notice-text').textContent));");
  check_in_page(
      page_of(),
      with("linked = false;\nstart();\n") + told +
          "check('shader', $('notice-text').textContent.includes('backdrop: no such thing'));");
  check_in_page(
      page_of(),
      with("canvas.getContext = () => { throw new Error('refused'); };\nstartView();\n") + told);
}

TEST_CASE("a lost context draws nothing until it is restored", "[player_render_script]") {
  check_in_page(page_of(), with(R"js(
start();
const before = painted();
check('a lost context can be restored', canvas.fire('webglcontextlost').defaultPrevented
  && painted().length === 0);
canvas.fire('webglcontextrestored');
check('requests a refresh', screen() === 1);
check('same picture', painted().join() === before.join());
)js"));
}

TEST_CASE("the axes in the corner rotate with the camera", "[player_render_script]") {
  check_in_page(page_of(), with(R"js(
camera.yaw = -Math.PI / 2;
camera.pitch = 0;
paintView();
const [x, , z] = $('triad').children;
near('x to the right', [x.attributes.x2, x.attributes.y2], [17, 0]);
near('z up', [z.attributes.x2, z.attributes.y2], [0, -17]);
)js"));
}
