#pragma once

// The fourth part of the page's script: the plot of errors over time, below the view.

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The plot: one curve for each feature, the mean as a dashed line, and a cursor to move through
/// time.
inline constexpr char kPlayerPlotScript[] = R"js(
const plot = $('plot'), pen = plot.getContext('2d');
const unitScale = largestError < .995 ? 1000 : 1, unitName = unitScale === 1000 ? 'mm' : 'm';
const digits = clamp(2 - Math.floor(Math.log10(Math.max(largestError * unitScale, .01))), 0, 3);
const shown = x => Number.isFinite(x) ? (x * unitScale).toFixed(digits) : '–';
const ticks = (limit, count) => {
  const step = nice(limit / count), out = [];
  for (let i = 0; i * step <= limit * (1 + 1e-9); ++i) out.push(i * step);
  return { step, out };
};
const tickText = (x, step) => x.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
const frame_ = { left: 40, right: 10, top: 8, bottom: 22 };
const plotX = (f, width) => {
  return frame_.left + (F > 1 ? f / (F - 1) : 0) * (width - frame_.left - frame_.right);
};
const paintPlot = () => {
  if (!K) return;
  const ratio = window.devicePixelRatio || 1, width = plot.clientWidth, height = plot.clientHeight;
  if (plot.width !== Math.round(width * ratio) || plot.height !== Math.round(height * ratio)) {
    plot.width = Math.round(width * ratio);
    plot.height = Math.round(height * ratio);
  }
  const ink = css('--ink'), muted = css('--muted'), line = css('--line'), panel = css('--panel');
  const limit = Math.max(largestError * unitScale * 1.06, .01), bottom = height - frame_.bottom;
  const y = v => bottom - v / limit * (bottom - frame_.top);
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = '11px ' + getComputedStyle(document.body).fontFamily;
  pen.lineWidth = 1;
  pen.fillStyle = muted;
  pen.strokeStyle = line;
  const vertical = ticks(limit, 3.2), span = (F - 1) * dt;
  const horizontal = ticks(Math.max(span, dt), clamp(width / 90, 2, 10));
  pen.textAlign = 'right';
  pen.textBaseline = 'middle';
  for (const v of vertical.out) {
    const at = Math.round(y(v)) + .5;
    pen.beginPath();
    pen.moveTo(frame_.left, at);
    pen.lineTo(width - frame_.right, at);
    pen.stroke();
    pen.fillText(tickText(v, vertical.step), frame_.left - 8, at);
  }
  pen.textBaseline = 'top';
  for (const t of horizontal.out) {
    if (t > span) continue;
    const text = tickText(t, horizontal.step) + ' s', x = plotX(t / dt, width);
    const half = pen.measureText(text).width / 2;
    pen.textAlign = 'center';
    pen.fillText(text, clamp(x, frame_.left - 8 + half, width - half - 1), bottom + 7);
  }
  if (scored < F) {
    pen.fillStyle = css('--raised');
    pen.globalAlpha = .8;
    const from = plotX(scored - 1, width);
    pen.fillRect(from, frame_.top, width - frame_.right - from, bottom - frame_.top);
    pen.globalAlpha = 1;
  }
  pen.strokeStyle = pen.fillStyle = muted;
  pen.lineWidth = 1;
  pen.textAlign = 'left';
  pen.textBaseline = 'top';
  let free = 0;
  for (const [from, text] of scene.marks) {
    if (from >= F) continue;
    const at = Math.round(plotX(from, width)) + .5;
    pen.setLineDash([2, 3]);
    pen.beginPath();
    pen.moveTo(at, frame_.top);
    pen.lineTo(at, bottom);
    pen.stroke();
    pen.setLineDash([]);
    const end = at + 8 + pen.measureText(text).width;
    if (at < free || end > width) continue;
    pen.fillText(text, at + 4, frame_.top);
    free = end;
  }
  pen.lineWidth = K > 8 ? 1 : 1.75;
  pen.lineJoin = 'round';
  for (let k = 0; k < K; ++k) {
    pen.strokeStyle = colourOf(k);
    pen.beginPath();
    let lifted = true;
    for (let f = 0; f < F; ++f) {
      const e = errors[f * K + k];
      if (!Number.isFinite(e)) { lifted = true; continue; }
      pen[lifted ? 'moveTo' : 'lineTo'](plotX(f, width), y(e * unitScale));
      lifted = false;
    }
    pen.stroke();
  }
  if (Number.isFinite(meanError)) {
    const at = Math.round(y(meanError * unitScale)) + .5;
    pen.strokeStyle = ink;
    pen.lineWidth = 1;
    pen.setLineDash([5, 4]);
    pen.beginPath();
    pen.moveTo(frame_.left, at);
    pen.lineTo(width - frame_.right, at);
    pen.stroke();
    pen.setLineDash([]);
  }
  const x = plotX(state.frame, width), accent = css('--accent');
  pen.strokeStyle = pen.fillStyle = accent;
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.moveTo(x, frame_.top - 3);
  pen.lineTo(x, bottom);
  pen.stroke();
  pen.beginPath();
  pen.moveTo(x - 5, bottom + 7);
  pen.lineTo(x + 5, bottom + 7);
  pen.lineTo(x, bottom);
  pen.fill();
  const [f, g, w] = blend(state.frame);
  for (let k = 0; k < K; ++k) {
    const e = errors[f * K + k] * (1 - w) + errors[g * K + k] * w;
    if (!Number.isFinite(e)) continue;
    if (legendValues[k]) legendValues[k].textContent = shown(e) + ' ' + unitName;
    pen.beginPath(); pen.arc(x, y(e * unitScale), K > 8 ? 2.5 : 4, 0, 2 * Math.PI);
    pen.fillStyle = colourOf(k); pen.fill();
    pen.strokeStyle = panel; pen.lineWidth = 1.5; pen.stroke();
  }
};
const legendValues = [];
const buildLegend = () => {
  if (!K) return void ($('plot-card').hidden = true);
  $('plot-unit').textContent = '(' + unitName + ')';
  const mean = shown(meanError) + ' ' + unitName, largest = shown(largestError) + ' ' + unitName;
  plot.setAttribute('aria-label', `Distance of ${K} features to their targets over time: `
    + `mean ${mean}, largest ${largest}. Drag to scrub.`);
  const add = (name, text) => {
    const item = document.createElement('span'), value = document.createElement('b');
    const swatch = document.createElement('i');
    value.textContent = text;
    item.append(swatch, name, value);
    $('legend').append(item);
    return [swatch, value];
  };
  if (K > 8) $('legend').append(K + ' features, largest ' + largest);
  else scene.features.forEach((name, k) => {
    const [swatch, value] = add(name || 'feature ' + k, '');
    swatch.dataset.feature = k;
    legendValues[k] = value;
  });
  if (Number.isFinite(meanError)) add('mean', mean)[0].className = 'dashed';
};
)js";

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
