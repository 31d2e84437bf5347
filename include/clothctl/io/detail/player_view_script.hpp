#pragma once

// The second part of the page's script: shaders, the orbiting camera, and the geometry that changes
// in each frame.

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Shader sources (WebGL 1). Lines are screen-aligned quadrilaterals with round ends, so that they
/// can have any width and have smooth edges.
inline constexpr char kPlayerShaders[] = R"js(
const shaders = {
  backdrop: [`attribute vec2 corner; varying float v_up;
void main() { v_up = corner.y * .5 + .5; gl_Position = vec4(corner, 0., 1.); }`,
  `uniform vec3 top, bottom; varying float v_up;
void main() { gl_FragColor = vec4(mix(bottom, top, v_up), 1.); }`],
  // Lit from above and from the camera's upper left; the two sides of a sheet differ in colour.
  surface: [`attribute vec3 position, normal; uniform mat4 camera;
varying vec3 v_normal, v_position;
void main() {
  v_normal = normal;
  v_position = position;
  gl_Position = camera * vec4(position, 1.);
}`,
  `uniform vec3 eye, light, front, back; uniform float gloss; varying vec3 v_normal, v_position;
void main() {
  vec3 n = normalize(v_normal), v = normalize(eye - v_position);
  bool outside = dot(n, v) >= 0.;
  if (!outside) n = -n;
  vec3 albedo = pow(outside ? front : back, vec3(2.2));
  float key = max(0., (dot(n, light) + .25) / 1.25), sky = .5 + .5 * n.z;
  float grazing = pow(1. - max(0., dot(n, v)), 3.);
  vec3 h = normalize(light + v);
  float shine = pow(max(0., dot(n, h)), 24.) * gloss;
  vec3 ambient = mix(vec3(.30, .27, .26), vec3(.42, .46, .52), sky);
  vec3 colour = albedo * (ambient + key * vec3(.74, .71, .66)) + shine + grazing * .08 * albedo;
  gl_FragColor = vec4(pow(colour, vec3(1. / 2.2)), 1.);
}`],
  flat: [`attribute vec3 position; uniform mat4 camera; uniform vec3 centre; varying float v_far;
void main() {
  v_far = length(position - centre);
  gl_Position = camera * vec4(position, 1.);
  gl_Position.z -= 2e-5 * gl_Position.w;
}`,
  `uniform vec4 colour; uniform float reach; varying float v_far;
void main() {
  float fade = reach > 0. ? 1. - smoothstep(.25, 1., v_far / reach) : 1.;
  gl_FragColor = vec4(colour.rgb, colour.a * fade);
}`],
  shadow: [`attribute vec3 position; uniform mat4 camera; uniform float ground;
void main() {
  float height = position.z - ground;
  gl_Position = camera * vec4(position.xy - vec2(.18, -.12) * height, ground, 1.);
}`,
  `uniform vec4 colour; void main() { gl_FragColor = colour; }`],
  line: [`attribute vec3 a, b; attribute vec2 corner; attribute float along, stamp;
uniform mat4 camera; uniform vec2 viewport; uniform float width, near, lift;
varying vec4 v_screen; varying float v_along, v_stamp;
void main() {
  vec4 p = camera * vec4(a, 1.), q = camera * vec4(b, 1.);
  if (p.w < near && q.w > near) p = mix(p, q, (near - p.w) / (q.w - p.w));
  else if (q.w < near && p.w > near) q = mix(q, p, (near - q.w) / (p.w - q.w));
  vec2 s = p.xy / p.w * viewport * .5, e = q.xy / q.w * viewport * .5, d = e - s;
  float size = length(d), h = width * .5 + 1.;
  d = size > 1e-4 ? d / size : vec2(1., 0.);
  vec4 c = corner.x < .5 ? p : q;
  vec2 shift = vec2(-d.y, d.x) * corner.y * h + d * (corner.x * 2. - 1.) * h;
  gl_Position = c;
  gl_Position.xy += shift / (viewport * .5) * c.w;
  gl_Position.z -= lift * c.w;
  v_screen = vec4(corner.x < .5 ? -h : size + h, corner.y * h, size, 1.) * c.w;
  v_along = along; v_stamp = stamp;
}`,
  `uniform vec4 colour; uniform vec3 top, bottom; uniform vec2 viewport;
uniform float width, dash, now, veil, round_shade, least;
varying vec4 v_screen; varying float v_along, v_stamp;
void main() {
  vec3 s = v_screen.xyz / v_screen.w;
  float off = length(vec2(max(max(-s.x, s.x - s.z), 0.), s.y));
  float alpha = clamp(width * .5 + .5 - off, 0., 1.);
  if (dash > 0. && fract(v_along / dash) > .56) alpha = 0.;
  if (alpha < least) discard;
  vec3 behind = mix(bottom, top, gl_FragCoord.y / viewport.y), c = colour.rgb;
  if (round_shade > 0.) {
    float r = clamp(abs(s.y) / (width * .5), 0., 1.);
    c *= mix(.62, 1.12, sqrt(1. - r * r));
  }
  gl_FragColor = vec4(mix(c, behind, max(veil, v_stamp > now ? .72 : 0.)), alpha * colour.a);
}`],
  // A disc with a rim; `hollow` leaves only the rim.
  marker: [`attribute vec3 position; uniform mat4 camera; uniform float size;
void main() {
  gl_Position = camera * vec4(position, 1.);
  gl_Position.z -= 2e-3 * gl_Position.w;
  gl_PointSize = size;
}`,
  `uniform vec4 colour; uniform vec3 rim; uniform float size, hollow;
void main() {
  float r = length(gl_PointCoord - .5) * size, edge = size * .5 - 1., inner = edge - size * .15;
  float alpha = clamp(edge - r + .5, 0., 1.);
  if (hollow > .5) alpha *= clamp(r - inner + .5, 0., 1.);
  if (alpha < .02) discard;
  vec3 filled = mix(colour.rgb, rim, clamp(r - inner + .5, 0., 1.));
  gl_FragColor = vec4(hollow > .5 ? colour.rgb : filled, alpha * colour.a);
}`]
};
)js";

/// The camera, and the geometry of the mesh that does not need WebGL.
inline constexpr char kPlayerGeometryScript[] = R"js(
// Camera on a sphere around `target`; z is up. `axes` are right, up and backward.
const camera = { yaw: 0, pitch: .3, distance: 1, target: middle.slice() };
const kField = 30 * Math.PI / 180;
const axes = () => {
  const cy = Math.cos(camera.yaw), sy = Math.sin(camera.yaw);
  const cp = Math.cos(camera.pitch), sp = Math.sin(camera.pitch);
  const back = [cp * cy, cp * sy, sp], right = [-sy, cy, 0];
  return { right, back, up: cross(back, right) };
};
const eyeOf = () => add(camera.target, axes().back, camera.distance);
const cameraMatrix = aspect => {
  const { right, up, back } = axes(), eye = eyeOf();
  const near = camera.distance * .02, far = camera.distance + 14 * diagonal;
  const f = 1 / Math.tan(kField / 2), g = aspect < 1 ? f * aspect : f;
  const view = new Float32Array([
    right[0], up[0], back[0], 0,
    right[1], up[1], back[1], 0,
    right[2], up[2], back[2], 0,
    -dot(right, eye), -dot(up, eye), -dot(back, eye), 1
  ]);
  const lens = new Float32Array([
    g / aspect, 0, 0, 0,
    0, g, 0, 0,
    0, 0, (far + near) / (near - far), -1,
    0, 0, 2 * far * near / (near - far), 0
  ]);
  return { matrix: multiply(lens, view), near, eye, right, up, back };
};
const points = positionsAt(0, new Float32Array(N * 3));
const point = i => [points[3 * i], points[3 * i + 1], points[3 * i + 2]];

// Faces a hanging sheet from its broad side (the one nearer to -y); looks at a lying one from -y.
let broad = [0, 0, 0];
for (let i = 0; i < triangles.length; i += 3) {
  const p = point(triangles[i]);
  broad = add(broad, cross(sub(point(triangles[i + 1]), p), sub(point(triangles[i + 2]), p)));
}
const hangs = Math.hypot(broad[0], broad[1]) > .6 * norm(broad) && norm(broad) > 0;
const turn = broad[1] > 1e-9 * norm(broad) ? Math.PI : 0;
const frontYaw = hangs ? Math.atan2(broad[1], broad[0]) + turn : -Math.PI / 2;
// The side of a sheet that the first view shows is its front in colour.
const flipped = dot(broad, [Math.cos(frontYaw), Math.sin(frontYaw), hangs ? 0 : 1]) < 0;
const presets = {
  fit: [frontYaw + .5, hangs ? .24 : .5],
  front: [frontYaw, 0],
  side: [frontYaw + Math.PI / 2, 0],
  top: [frontYaw, Math.PI / 2]
};

// An edge of one triangle belongs to the border. An edge that is the longest of both its
// triangles is the diagonal of a grid cell.
const border = [], inner = [];
{
  const seen = new Map();
  for (let i = 0; i < triangles.length; i += 3) {
    const v = [triangles[i], triangles[i + 1], triangles[i + 2]];
    const size = [0, 1, 2].map(e => norm(sub(point(v[e]), point(v[(e + 1) % 3]))));
    for (let e = 0; e < 3; ++e) {
      const a = Math.min(v[e], v[(e + 1) % 3]), b = Math.max(v[e], v[(e + 1) % 3]);
      const longest = size[e] > 1.15 * Math.max(size[(e + 1) % 3], size[(e + 2) % 3]);
      const known = seen.get(a * N + b);
      if (known) {
        ++known.count;
        known.diagonal = known.diagonal && longest;
      } else {
        seen.set(a * N + b, { a, b, count: 1, diagonal: longest });
      }
    }
  }
  for (const e of seen.values()) {
    if (e.count === 1) border.push(e.a, e.b); else if (!e.diagonal) inner.push(e.a, e.b);
  }
}
const normals = new Float32Array(N * 3);
const computeNormals = () => {
  normals.fill(0);
  const p = points, n = normals;
  for (let i = 0; i < triangles.length; i += 3) {
    const a = 3 * triangles[i], b = 3 * triangles[i + 1], c = 3 * triangles[i + 2];
    const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];
    const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
    const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    n[a] += x; n[a + 1] += y; n[a + 2] += z;
    n[b] += x; n[b + 1] += y; n[b + 2] += z;
    n[c] += x; n[c + 1] += y; n[c + 2] += z;
  }
};

// Lines as 6 corners of 10 numbers: a, b, corner, along, stamp.
class Lines {
  constructor(capacity) {
    this.data = new Float32Array(capacity * 60);
    this.clear();
  }
  clear() {
    this.count = 0;
    this.length = 0;
  }
  add(a, b, stamp = 0) {
    if (!Number.isFinite(a[0] + a[1] + a[2] + b[0] + b[1] + b[2])) return;
    const start = this.length;
    this.length += norm(sub(b, a));
    let at = this.count * 60;
    for (const [end, side] of [[0, -1], [1, -1], [1, 1], [0, -1], [1, 1], [0, 1]]) {
      this.data.set([...a, ...b, end, side, end ? this.length : start, stamp], at);
      at += 10;
    }
    ++this.count;
  }
}
const edgeLines = (lines, edges) => {
  lines.clear();
  for (let i = 0; i < edges.length; i += 2) lines.add(point(edges[i]), point(edges[i + 1]));
};
const curveLines = (data, k) => {
  const lines = new Lines(Math.max(1, F - 1));
  for (let f = 1; f < F; ++f) {
    lines.add(columnAt(data, K, k, f - 1), columnAt(data, K, k, f), f - 1);
  }
  return lines;
};

// Arrows are shaded solids. The scale draws the 95th percentile of all lengths as a fifth of the
// scene.
const lengths = [];
for (let i = 0; i < F * A; ++i) {
  const size = Math.hypot(vectors[3 * i], vectors[3 * i + 1], vectors[3 * i + 2]);
  if (size > 0 && Number.isFinite(size)) lengths.push(size);
}
lengths.sort((a, b) => a - b);
const percentile = lengths[Math.floor(.95 * (lengths.length - 1))];
const arrowUnit = lengths.length ? .2 * diagonal / percentile : 0;
// What the first view must show: vertices of some frames, the curves, and the whole arrows.
const watched = [];
{
  const watch = p => { if (Number.isFinite(p[0] + p[1] + p[2])) watched.push(p); };
  const rows = Math.min(F, 40), stride = Math.max(1, Math.floor(N * rows / 8000));
  for (let r = 0; r < rows; ++r) {
    const f = Math.floor(r * (F - 1) / Math.max(1, rows - 1)), at = f * N * 3;
    for (let i = r % stride; i < N; i += stride) {
      const q = at + 3 * i;
      watch([0, 1, 2].map(c => scene.low[c] + scene.size[c] * quantised[q + c] / 65535));
    }
    for (let k = 0; k < K; ++k) {
      watch(columnAt(actual, K, k, f));
      watch(columnAt(target, K, k, f));
    }
    for (let i = 0; i < A; ++i) {
      watch(add(columnAt(origins, A, i, f), columnAt(vectors, A, i, f), arrowUnit));
    }
  }
  if (!watched.length) watched.push(low, high);
}
// Centres all of this in the view, and goes as near as it can while all of it stays in sight.
const fitCamera = aspect => {
  const { right, up, back } = axes(), t = Math.tan(kField / 2);
  const tall = aspect < 1 ? t / aspect : t, wide = tall * aspect;
  camera.target = middle.slice();
  for (let pass = 0; pass < 4; ++pass) {
    let distance = diagonal * .1, box = [Infinity, -Infinity, Infinity, -Infinity];
    const seen = watched.map(w => {
      const p = sub(w, camera.target);
      return [dot(p, right), dot(p, up), dot(p, back)];
    });
    for (const [x, y, z] of seen) {
      distance = Math.max(distance, z + Math.max(Math.abs(x) / wide, Math.abs(y) / tall));
    }
    for (const [x, y, z] of seen) {
      const scale = distance / Math.max(1e-9, distance - z);
      box = [
        Math.min(box[0], x * scale), Math.max(box[1], x * scale),
        Math.min(box[2], y * scale), Math.max(box[3], y * scale)
      ];
    }
    camera.distance = distance * 1.13;
    if (pass === 3) continue;
    camera.target = add(camera.target, right, (box[0] + box[1]) / 2);
    camera.target = add(camera.target, up, (box[2] + box[3]) / 2);
  }
};
const kSides = 10;
const arrowSolid = new Float32Array(A * kSides * 9 * 6);   // 9 corners a side, position and normal
const buildArrows = frame => {
  let at = 0;
  for (let i = 0; i < A; ++i) {
    const from = columnAt(origins, A, i, frame);
    const vector = columnAt(vectors, A, i, frame).map(x => x * arrowUnit * state.arrowScale);
    const length = norm(vector);
    if (!(length > .004 * diagonal)) continue;
    if (!Number.isFinite(from[0] + from[1] + from[2] + length)) continue;
    const axis = unit(vector), away = Math.abs(axis[2]) < .9 ? [0, 0, 1] : [1, 0, 0];
    const u = unit(cross(axis, away)), v = cross(axis, u);
    const head = Math.min(.034 * diagonal, .5 * length);
    const thick = Math.min(.0042, .06 * length / diagonal) * diagonal;
    const wide = Math.min(.0125 * diagonal, .38 * head);
    const neck = add(from, axis, length - head), tip = add(from, axis, length);
    const put = (p, n) => {
      arrowSolid.set(p, at);
      arrowSolid.set(n, at + 3);
      at += 6;
    };
    for (let s = 0; s < kSides; ++s) {
      const angles = [s, s + 1].map(j => 2 * Math.PI * j / kSides);
      const [d, e] = angles.map(x => add(u.map(c => c * Math.cos(x)), v, Math.sin(x)));
      const [a, b] = [add(from, d, thick), add(from, e, thick)];
      const [g, h] = [add(neck, d, thick), add(neck, e, thick)];
      put(a, d); put(b, e); put(h, e); put(a, d); put(h, e); put(g, d);
      const slope = wide / head, cone = x => unit(add(x, axis, slope));
      put(add(neck, d, wide), cone(d));
      put(add(neck, e, wide), cone(e));
      put(tip, cone(unit(add(d, e))));
    }
  }
  return at / 6;
};

// The ground lies at z = 0 where the scene stands on it, else a little below everything.
const groundHeight = low[2] > -.01 * diagonal && low[2] < diagonal ? 0 : low[2] - .06 * diagonal;
const nice = x => {
  const p = 10 ** Math.floor(Math.log10(x)), lead = x / p;
  return p * (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10);
};
const cell = nice(diagonal / 8);
)js";

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
