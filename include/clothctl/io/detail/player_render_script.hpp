#pragma once

// The third part of the page's script: draws the scene with WebGL. Without WebGL the rest of the
// page still works.

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The renderer. `build` makes all GPU objects. It runs again after the browser restores a lost
/// context.
inline constexpr char kPlayerRenderScript[] = R"js(
const canvas = $('gl');
let gl = null, gpu = null;
const fail = text => {
  gpu = null;
  $('notice-text').textContent = text;
  $('notice').hidden = false;
  canvas.hidden = $('presets').hidden = $('grid-size').hidden = true;
  $('triad').setAttribute('hidden', '');
};
const build = () => {
  gl.getExtension('OES_element_index_uint');
  const programs = {};
  for (const [name, [vertex, fragment]] of Object.entries(shaders)) {
    const program = gl.createProgram();
    for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, 'precision highp float;\n' + source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      throw new Error(name + ': ' + gl.getProgramInfoLog(program));
    }
    const uniforms = {}, attributes = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); ++i) {
      const { name: u, type } = gl.getActiveUniform(program, i);
      const at = gl.getUniformLocation(program, u);
      uniforms[u] = {
        [gl.FLOAT]: x => gl.uniform1f(at, x),
        [gl.FLOAT_VEC2]: x => gl.uniform2fv(at, x),
        [gl.FLOAT_VEC3]: x => gl.uniform3fv(at, x),
        [gl.FLOAT_VEC4]: x => gl.uniform4fv(at, x),
        [gl.FLOAT_MAT4]: x => gl.uniformMatrix4fv(at, false, x)
      }[type];
    }
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_ATTRIBUTES); ++i) {
      const { name: a } = gl.getActiveAttrib(program, i);
      attributes[a] = gl.getAttribLocation(program, a);
    }
    programs[name] = { program, uniforms, attributes };
  }
  const buffer = (data, usage = gl.STATIC_DRAW, kind = gl.ARRAY_BUFFER) => {
    const made = gl.createBuffer();
    gl.bindBuffer(kind, made);
    gl.bufferData(kind, data, usage);
    return made;
  };
  const Indices = N > 65535 ? Uint32Array : Uint16Array;
  const grid = [];
  const cells = 40, reach = cells * cell;
  const cx = Math.round(middle[0] / cell) * cell, cy = Math.round(middle[1] / cell) * cell;
  const z = groundHeight;
  for (let i = -cells; i <= cells; ++i) {
    for (let j = -cells; j < cells; ++j) {
      grid.push(cx + i * cell, cy + j * cell, z, cx + i * cell, cy + (j + 1) * cell, z);
      grid.push(cx + j * cell, cy + i * cell, z, cx + (j + 1) * cell, cy + i * cell, z);
    }
  }
  const solid = [];
  for (let i = 0; i < solids.length; i += 9) {
    const [a, b, c] = [0, 3, 6].map(k => Array.from(solids.subarray(i + k, i + k + 3)));
    const n = unit(cross(sub(b, a), sub(c, a)));
    for (const p of [a, b, c]) solid.push(...p, ...n);
  }
  const keep = lines => {
    return { buffer: buffer(lines.data.subarray(0, lines.count * 60)), count: lines.count };
  };
  gpu = {
    programs, indexType: N > 65535 ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT,
    corners: buffer(new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1])),
    position: buffer(points, gl.DYNAMIC_DRAW), normal: buffer(normals, gl.DYNAMIC_DRAW),
    triangles: buffer(new Indices(triangles), gl.STATIC_DRAW, gl.ELEMENT_ARRAY_BUFFER),
    inner: buffer(new Indices(inner), gl.STATIC_DRAW, gl.ELEMENT_ARRAY_BUFFER),
    grid: buffer(new Float32Array(grid)), gridCount: grid.length / 3,
    gridReach: Math.min(reach, 2.6 * diagonal),
    solid: buffer(new Float32Array(solid)), solidCount: solid.length / 6,
    scratch: gl.createBuffer(),
    border: new Lines(border.length / 2),
    rope: new Lines(segments.length / 2),
    gaps: new Lines(Math.max(1, K)),
    actual: [...Array(K).keys()].map(k => keep(curveLines(actual, k))),
    target: [...Array(K).keys()].map(k => keep(curveLines(target, k)))
  };
};

const bind = (program, name, data, size, stride = 0, offset = 0) => {
  gl.bindBuffer(gl.ARRAY_BUFFER, data);
  gl.enableVertexAttribArray(program.attributes[name]);
  gl.vertexAttribPointer(program.attributes[name], size, gl.FLOAT, false, stride, offset);
};
const use = (name, values) => {
  const program = gpu.programs[name];
  gl.useProgram(program.program);
  for (let i = 0; i < 6; ++i) gl.disableVertexAttribArray(i);
  for (const [u, value] of Object.entries(values)) {
    if (program.uniforms[u]) program.uniforms[u](value);
  }
  return program;
};
const upload = data => {
  gl.bindBuffer(gl.ARRAY_BUFFER, gpu.scratch);
  gl.bufferData(gl.ARRAY_BUFFER, data, gl.STREAM_DRAW);
  return gpu.scratch;
};

const paintView = () => {
  const ratio = Math.min(window.devicePixelRatio || 1, 2), box = canvas.getBoundingClientRect();
  const width = Math.max(1, Math.round(box.width * ratio));
  const height = Math.max(1, Math.round(box.height * ratio));
  const { matrix, near, eye, right, up, back } = cameraMatrix(width / height);
  for (const mark of $('triad').children) {
    const c = Number(mark.dataset.axis), reach = mark.tagName === 'text' ? 25 : 17;
    const x = right[c] * reach, y = -up[c] * reach, line = mark.tagName === 'line';
    mark.setAttribute(line ? 'x2' : 'x', x);
    mark.setAttribute(line ? 'y2' : 'y', y);
  }
  if (!gpu) return;
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const frame = state.frame, show = state.show, dark = theme() === 'dark';
  const top = rgb(css('--stage-top')), bottom = rgb(css('--stage-bottom'));
  const ink = rgb(css('--ink')), panel = rgb(css('--panel'));
  positionsAt(frame, points);
  gl.viewport(0, 0, width, height);
  gl.clear(gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
  gl.disable(gl.DEPTH_TEST);
  gl.depthMask(false);
  bind(use('backdrop', { top, bottom }), 'corner', gpu.corners, 2);
  gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  gl.enable(gl.DEPTH_TEST);
  gl.depthFunc(gl.LEQUAL);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  gl.bindBuffer(gl.ARRAY_BUFFER, gpu.position);
  gl.bufferSubData(gl.ARRAY_BUFFER, 0, points);

  if (show.ground) {
    const centre = [middle[0], middle[1], groundHeight];
    const colour = [...ink, dark ? .16 : .13];
    const ground = use('flat', { camera: matrix, centre, reach: gpu.gridReach, colour });
    bind(ground, 'position', gpu.grid, 3);
    gl.drawArrays(gl.LINES, 0, gpu.gridCount);
    if (show.surface && triangles.length && eye[2] > groundHeight) {
      gl.enable(gl.STENCIL_TEST);
      gl.stencilFunc(gl.EQUAL, 0, 255);
      gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
      const black = [0, 0, 0, dark ? .3 : .09];
      const shadow = use('shadow', { camera: matrix, ground: groundHeight, colour: black });
      bind(shadow, 'position', gpu.position, 3);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gpu.triangles);
      gl.drawElements(gl.TRIANGLES, triangles.length, gpu.indexType, 0);
      gl.disable(gl.STENCIL_TEST);
    }
  }

  const lit = { camera: matrix, eye, light: unit(add(add(back, right, -.55), [0, 0, 1], .75)) };
  const usual = {
    camera: matrix, near, viewport: [width, height], top, bottom,
    dash: 0, now: 1e9, veil: 0, lift: 4e-4, round_shade: 0, least: .02
  };
  const strokes = (data, count, values) => {
    if (!count) return;
    const program = use('line', { ...usual, ...values, width: values.width * ratio });
    const parts = [
      ['a', 3, 0], ['b', 3, 12], ['corner', 2, 24], ['along', 1, 32], ['stamp', 1, 36]
    ];
    for (const [name, size, offset] of parts) bind(program, name, data, size, 40, offset);
    gl.drawArrays(gl.TRIANGLES, 0, count * 6);
  };
  const stream = (lines, values) => {
    if (!lines.count) return;
    strokes(upload(lines.data.subarray(0, lines.count * 60)), lines.count, values);
  };

  gl.depthMask(true);
  if (gpu.solidCount) {
    const colour = dark ? [.36, .39, .44] : [.58, .61, .66];
    const program = use('surface', { ...lit, gloss: .03, front: colour, back: colour });
    bind(program, 'position', gpu.solid, 3, 24, 0);
    bind(program, 'normal', gpu.solid, 3, 24, 12);
    // A coarse sheet dips into round solids by a fraction of its thickness.
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(2, 800);
    gl.drawArrays(gl.TRIANGLES, 0, gpu.solidCount);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }
  if (show.surface && triangles.length) {
    computeNormals();
    gl.bindBuffer(gl.ARRAY_BUFFER, gpu.normal);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, normals);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    const sides = dark ? [[.80, .77, .72], [.50, .60, .68]] : [[.93, .90, .85], [.66, .75, .82]];
    const [front, back] = flipped ? [sides[1], sides[0]] : sides;
    const program = use('surface', { ...lit, gloss: .045, front, back });
    bind(program, 'position', gpu.position, 3);
    bind(program, 'normal', gpu.normal, 3);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gpu.triangles);
    gl.drawElements(gl.TRIANGLES, triangles.length, gpu.indexType, 0);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }
  if (show.surface && segments.length) {
    edgeLines(gpu.rope, segments);
    // The solid core hides what lies behind it, then the smooth rim is laid over.
    const rope = {
      colour: [...(dark ? [.80, .74, .66] : [.66, .55, .44]), 1],
      width: clamp(1800 / segments.length, 1.5, 6.5), round_shade: 1, lift: 0
    };
    stream(gpu.rope, { ...rope, least: .98 });
    gl.depthMask(false);
    stream(gpu.rope, { ...rope, lift: 2e-5 });
    gl.depthMask(true);
  }
  const arrowCorners = show.arrows ? buildArrows(frame) : 0;
  if (arrowCorners) {
    const colour = rgb(css('--arrow')), data = upload(arrowSolid.subarray(0, arrowCorners * 6));
    const program = use('surface', { ...lit, gloss: .1, front: colour, back: colour });
    bind(program, 'position', data, 3, 24, 0);
    bind(program, 'normal', data, 3, 24, 12);
    gl.drawArrays(gl.TRIANGLES, 0, arrowCorners);
  }
  gl.depthMask(false);
  if (triangles.length && show.lines) {
    const alpha = show.surface ? clamp(9 / Math.sqrt(inner.length), .07, .2) : .45;
    const colour = [.1, .13, .18, alpha];
    const mesh = use('flat', { camera: matrix, centre: middle, reach: 0, colour });
    bind(mesh, 'position', gpu.position, 3);
    if (!show.surface && dark) gpu.programs.flat.uniforms.colour([.85, .9, 1, .4]);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gpu.inner);
    gl.drawElements(gl.LINES, inner.length, gpu.indexType, 0);
  }
  if (triangles.length && (show.surface || show.lines)) {
    edgeLines(gpu.border, border);
    stream(gpu.border, { colour: dark ? [.93, .95, 1, .5] : [.16, .2, .27, .55], width: 1.3 });
  }

  // Curves and markers: what the sheet hides is drawn veiled first.
  for (const [order, veil] of [[gl.GREATER, .76], [gl.LEQUAL, 0]]) {
    gl.depthFunc(order);
    for (let k = 0; k < K; ++k) {
      const colour = [...rgb(colourOf(k)), 1];
      const light = [...rgb(colourOf(k)).map((c, i) => c + .38 * (top[i] - c)), 1];
      const dashed = { colour: light, width: 1.8, dash: diagonal / 55, veil };
      const plain = { colour, width: 2.4, now: frame, veil };
      if (show.target) strokes(gpu.target[k].buffer, gpu.target[k].count, dashed);
      if (show.actual) strokes(gpu.actual[k].buffer, gpu.actual[k].count, plain);
    }
    if (show.actual && show.target) {
      gpu.gaps.clear();
      for (let k = 0; k < K; ++k) {
        gpu.gaps.add(columnAt(actual, K, k, frame), columnAt(target, K, k, frame));
      }
      stream(gpu.gaps, { colour: [...ink, 1], width: 1.3, veil });
    }
    for (let k = 0; k < K; ++k) {
      const alpha = veil ? .3 : 1;
      for (const [data, hollow, wanted] of [[target, 1, show.target], [actual, 0, show.actual]]) {
        const p = columnAt(data, K, k, frame);
        if (!wanted || !Number.isFinite(p[0] + p[1] + p[2])) continue;
        const size = (hollow ? 15 : 12) * ratio, colour = [...rgb(colourOf(k)), alpha];
        const marker = use('marker', { camera: matrix, size, hollow, colour, rim: panel });
        bind(marker, 'position', upload(new Float32Array(p)), 3);
        gl.drawArrays(gl.POINTS, 0, 1);
      }
    }
  }
  gl.depthMask(true);
};
const startView = () => {
  const options = {
    alpha: false, antialias: true, stencil: true, powerPreference: 'high-performance',
    preserveDrawingBuffer: false
  };
  try {
    gl = canvas.getContext('webgl', options) || canvas.getContext('experimental-webgl', options);
  } catch (e) {
    gl = null;
  }
  if (!gl) {
    return fail('This browser offers no WebGL. Playback, the plot and the figures work all the '
      + 'same; switch on hardware acceleration to see the motion in space.');
  }
  if (N > 65535 && !gl.getExtension('OES_element_index_uint')) {
    return fail('This mesh has more vertices than this device can index.');
  }
  try {
    build();
  } catch (e) {
    return fail('The graphics driver refused a shader. ' + e.message);
  }
  canvas.addEventListener('webglcontextlost', e => { e.preventDefault(); gpu = null; });
  canvas.addEventListener('webglcontextrestored', () => { build(); invalidate(); });
};
)js";

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
