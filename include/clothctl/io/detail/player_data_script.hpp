#pragma once

// The first part of the page's script: decodes the embedded data, holds the state of the page and
// defines small vector functions.

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Decoding, state, colours, and the operations on vectors and 4×4 matrices (column major) that the
/// view needs.
inline constexpr char kPlayerDataScript[] = R"js(
const $ = id => document.getElementById(id);
const scene = JSON.parse($('scene').textContent);
const decode = id => {
  const text = atob($('data-' + id).textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
  return bytes.buffer;
};
const N = scene.vertices, F = scene.frames, K = scene.features.length, A = scene.arrows;
const dt = scene.dt;
const quantised = new Uint16Array(decode('positions'));   // F × N × 3
const triangles = new Uint32Array(decode('triangles'));   // 3 indices each
const segments = new Uint32Array(decode('segments'));     // 2 indices each
const solids = new Float32Array(decode('solids'));        // 9 coordinates a triangle
const actual = new Float32Array(decode('actual'));        // F × K × 3
const target = new Float32Array(decode('target'));        // F × K × 3
const origins = new Float32Array(decode('origins'));      // F × A × 3
const vectors = new Float32Array(decode('vectors'));      // F × A × 3

const state = {
  frame: 0, playing: false, loop: true, speed: 1, arrowScale: 1,
  show: { surface: true, lines: true, actual: true, target: true, arrows: true, ground: true }
};
const clamp = (x, low, high) => Math.min(high, Math.max(low, x));

// Linear interpolation between the two nearest recorded frames.
const blend = frame => {
  const first = clamp(Math.floor(frame), 0, F - 1), second = Math.min(first + 1, F - 1);
  return [first, second, clamp(frame - first, 0, 1)];
};
const positionsAt = (frame, out) => {
  const [f, g, w] = blend(frame), a = f * N * 3, b = g * N * 3;
  const low = scene.low, step = scene.size.map(s => s / 65535);
  for (let i = 0, n = N * 3, c = 0; i < n; ++i, c = c === 2 ? 0 : c + 1) {
    out[i] = low[c] + step[c] * (quantised[a + i] * (1 - w) + quantised[b + i] * w);
  }
  return out;
};
const columnAt = (data, count, index, frame) => {
  const [f, g, w] = blend(frame), a = (f * count + index) * 3, b = (g * count + index) * 3;
  return [0, 1, 2].map(c => data[a + c] * (1 - w) + data[b + c] * w);
};

const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0]
];
const norm = a => Math.hypot(a[0], a[1], a[2]);
const unit = a => { const n = norm(a) || 1; return [a[0] / n, a[1] / n, a[2] / n]; };
const multiply = (a, b) => {
  const out = new Float32Array(16);
  for (let j = 0; j < 4; ++j) for (let i = 0; i < 4; ++i) {
    let sum = 0;
    for (let k = 0; k < 4; ++k) sum += a[4 * k + i] * b[4 * j + k];
    out[4 * j + i] = sum;
  }
  return out;
};

// Distance of each feature to its target in each frame, and its mean over the scored frames.
const errors = new Float32Array(F * K);
for (let i = 0; i < F * K; ++i) {
  const [dx, dy, dz] = [0, 1, 2].map(c => actual[3 * i + c] - target[3 * i + c]);
  errors[i] = Math.hypot(dx, dy, dz);
}
const scored = scene.scored > 0 ? Math.min(scene.scored, F) : F;
let meanError = 0, errorCount = 0, largestError = 0;
for (let i = 0; i < F * K; ++i) {
  if (!Number.isFinite(errors[i])) continue;
  largestError = Math.max(largestError, errors[i]);
  if (i < scored * K) { meanError += errors[i]; ++errorCount; }
}
meanError = errorCount ? meanError / errorCount : NaN;

// What the camera must see: the box of the mesh over all frames, the curves and the arrows' tails.
const low = scene.low.slice(), high = scene.low.map((x, c) => x + scene.size[c]);
for (const data of [actual, target, origins]) {
  for (let i = 0; i < data.length; ++i) {
    if (!Number.isFinite(data[i])) continue;
    low[i % 3] = Math.min(low[i % 3], data[i]);
    high[i % 3] = Math.max(high[i % 3], data[i]);
  }
}
const diagonal = norm(sub(high, low)) > 1e-6 ? norm(sub(high, low)) : 1;
const middle = low.map((x, c) => (x + high[c]) / 2);

const palette = {
  light: ['#1f5fe0', '#e2590b', '#0d8f6f', '#8b3fd1', '#b8860b', '#0891b2', '#c026a3', '#5f6b7a'],
  dark: ['#6ea3ff', '#ff9448', '#34d3a6', '#c08bff', '#f2c14b', '#45cbe8', '#f277dd', '#a3aebd']
};
const theme = () => document.documentElement.dataset.theme;
const colourOf = k => palette[theme()][k % 8];
const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const rgb = hex => [1, 3, 5].map(i => parseInt(hex.slice(i, i + 2), 16) / 255);

// Functions that paint what changes. `invalidate` lets them run once in the next screen refresh.
const painters = [];
let asked = false;
const invalidate = () => {
  if (asked) return;
  asked = true;
  requestAnimationFrame(now => {
    asked = false;
    tick(now);
    for (const paint of painters) paint();
  });
};
)js";

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
