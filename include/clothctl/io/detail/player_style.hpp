#pragma once

// The style sheet of the player page, with a light and a dark colour scheme. The system chooses the
// scheme, or the attribute `data-theme` does.

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The style sheet of the page.
inline constexpr char kPlayerStyle[] = R"css(
:root {
  color-scheme: light;
  --bg: #f3f4f6; --panel: #ffffff; --raised: #f6f7f9; --ink: #12161c; --muted: #5b6573;
  --faint: #8a94a3; --line: #e1e5ea; --accent: #2456e6; --accent-ink: #ffffff; --arrow: #c2185b;
  --shadow: 0 1px 2px rgb(16 24 40 / .05);
  --stage-top: #fcfdfe; --stage-bottom: #dfe5ec;
}
:root[data-theme="dark"] {
  color-scheme: dark;
  --bg: #0b0d11; --panel: #13161c; --raised: #1b1f27; --ink: #edf0f5; --muted: #9aa4b3;
  --faint: #6d7786; --line: #262b35; --accent: #7aa2ff; --accent-ink: #0b0d11; --arrow: #ff6fa5;
  --shadow: none;
  --stage-top: #232933; --stage-bottom: #0f1217;
}
*, *::before, *::after { box-sizing: border-box; }
html { height: 100%; -webkit-text-size-adjust: 100%; }
body {
  margin: 0; min-height: 100%; background: var(--bg); color: var(--ink);
  font: 14px/1.45 "Inter", system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue",
    "Noto Sans", Arial, sans-serif;
  -webkit-font-smoothing: antialiased; font-variant-numeric: tabular-nums;
}
button, select, input { font: inherit; color: inherit; }
:focus-visible { outline: 2px solid var(--accent); outline-offset: 2px; }
[hidden] { display: none !important; }
.page {
  display: grid; gap: 12px; padding: 14px 16px 16px; min-height: 100vh; min-height: 100dvh;
  grid-template: "head head" auto "stage side" minmax(320px, 1fr) "plot side" auto
    / minmax(0, 1fr) 272px;
}
.head { grid-area: head; display: flex; align-items: center; gap: 16px; padding: 0 2px; }
.head div { flex: 1; min-width: 0; }
h1 {
  margin: 0; font-size: 19px; line-height: 1.25; font-weight: 650; letter-spacing: -.014em;
  overflow-wrap: anywhere;
}
.subtitle { margin: 1px 0 0; color: var(--muted); overflow-wrap: anywhere; }
h2 { margin: 0; font-size: 12px; font-weight: 600; color: var(--muted); letter-spacing: .01em; }
.card {
  background: var(--panel); border: 1px solid var(--line); border-radius: 14px;
  box-shadow: var(--shadow);
}
.icon {
  display: inline-grid; place-items: center; width: 34px; height: 34px; padding: 0; border: 0;
  border-radius: 9px; background: transparent; cursor: pointer; transition: background .12s;
}
.icon:hover { background: var(--raised); }
.icon svg {
  width: 18px; height: 18px; fill: none; stroke: currentColor; stroke-width: 1.8;
  stroke-linecap: round; stroke-linejoin: round;
}
.icon svg .solid { fill: currentColor; }
.icon.primary {
  background: var(--accent); color: var(--accent-ink); border-radius: 50%; width: 38px;
  height: 38px;
}
.icon.primary:hover { filter: brightness(1.08); }
.icon[aria-pressed="true"] { color: var(--accent); background: var(--raised); }
.icon[aria-pressed="false"] { color: var(--faint); }

.stage {
  grid-area: stage; position: relative; display: flex; flex-direction: column; overflow: hidden;
  min-height: 0;
}
.view {
  position: relative; flex: 1; min-height: 240px;
  background: linear-gradient(var(--stage-top), var(--stage-bottom));
}
.view canvas {
  position: absolute; inset: 0; width: 100%; height: 100%; display: block; touch-action: none;
  cursor: grab; border-radius: 13px 13px 0 0;
}
.view canvas:active { cursor: grabbing; }
.view canvas:focus-visible { outline-offset: -3px; }
.presets {
  position: absolute; top: 10px; right: 10px; display: flex; padding: 3px; border-radius: 10px;
  border: 1px solid var(--line); background: var(--panel); box-shadow: var(--shadow);
}
.presets button {
  border: 0; background: transparent; border-radius: 7px; padding: 3px 10px; font-size: 12px;
  font-weight: 550; color: var(--muted); cursor: pointer;
}
.presets button:hover { background: var(--raised); color: var(--ink); }
.triad {
  position: absolute; left: 8px; bottom: 8px; width: 64px; height: 64px; pointer-events: none;
}
.triad text {
  font-size: 10px; font-weight: 600; fill: var(--muted); text-anchor: middle;
  dominant-baseline: central;
}
.triad line { stroke-width: 1.8; stroke-linecap: round; }
.grid-size {
  position: absolute; right: 14px; bottom: 10px; font-size: 11px; color: var(--muted);
  pointer-events: none;
}
.mark {
  position: absolute; left: 50%; top: 12px; transform: translateX(-50%); padding: 3px 10px;
  border-radius: 9px; background: var(--panel); border: 1px solid var(--line); font-weight: 600;
  font-size: 12px; max-width: 60%; overflow: hidden; text-overflow: ellipsis; white-space: nowrap;
  pointer-events: none;
}
.mark:empty { display: none; }
.notice {
  position: absolute; inset: 0; display: grid; place-items: center; padding: 24px;
  text-align: center; color: var(--muted);
}
.notice p { max-width: 46ch; }
.notice strong { display: block; color: var(--ink); font-size: 15px; margin-bottom: 4px; }
.transport {
  display: flex; align-items: center; gap: 4px; padding: 8px 12px;
  border-top: 1px solid var(--line);
}
.transport .clock {
  margin: 0 6px; white-space: nowrap; color: var(--muted); font-size: 13px; min-width: 104px;
  text-align: right;
}
.transport .clock b { color: var(--ink); font-weight: 600; }
.transport input[type="range"] { flex: 1; min-width: 60px; margin: 0 8px; }
select {
  appearance: none; border: 1px solid var(--line); background: var(--panel); border-radius: 9px;
  height: 32px; padding: 0 10px; cursor: pointer; font-size: 13px;
  font-weight: 550; text-align: center;
}
select:hover { background: var(--raised); }
input[type="range"] {
  appearance: none; -webkit-appearance: none; height: 20px; background: transparent;
  cursor: pointer; --fill: 0%;
}
input[type="range"]::-webkit-slider-runnable-track {
  height: 4px; border-radius: 2px;
  background: linear-gradient(to right, var(--accent) var(--fill), var(--line) var(--fill));
}
input[type="range"]::-moz-range-track { height: 4px; border-radius: 2px; background: var(--line); }
input[type="range"]::-moz-range-progress {
  height: 4px; border-radius: 2px; background: var(--accent);
}
input[type="range"]::-webkit-slider-thumb {
  -webkit-appearance: none; width: 16px; height: 16px; margin-top: -6px; border-radius: 50%;
  background: var(--accent); border: 2.5px solid var(--panel);
  box-shadow: 0 0 0 1px var(--accent);
}
input[type="range"]::-moz-range-thumb {
  width: 12px; height: 12px; border-radius: 50%; background: var(--accent);
  border: 2.5px solid var(--panel);
}

.plot { grid-area: plot; padding: 10px 12px 6px; min-width: 0; }
.plot-head {
  display: flex; flex-wrap: wrap; align-items: baseline; gap: 4px 16px; padding: 0 4px 4px;
}
.plot-head h2 { margin-right: auto; }
.legend { display: flex; flex-wrap: wrap; gap: 2px 16px; font-size: 12.5px; color: var(--muted); }
.legend b {
  display: inline-block; color: var(--ink); font-weight: 600; min-width: 54px; margin-left: 6px;
  text-align: right;
}
.legend i {
  display: inline-block; width: 14px; height: 3px; border-radius: 2px; vertical-align: middle;
  margin-right: 6px;
}
.legend .dashed {
  height: 1px; background: repeating-linear-gradient(90deg, var(--ink) 0 4px, transparent 4px 7px);
}
.plot canvas { display: block; width: 100%; height: 150px; touch-action: none; cursor: ew-resize; }

.side { grid-area: side; display: flex; flex-direction: column; gap: 12px; min-height: 0; }
.side section { padding: 13px 14px; }
.side h2 { margin-bottom: 7px; }
.figures { min-height: 0; }
table { border-collapse: collapse; width: 100%; font-size: 13px; }
th, td {
  padding: 4.5px 0; border-top: 1px solid var(--line); vertical-align: baseline;
  overflow-wrap: anywhere;
}
tr:first-child > * { border-top: 0; }
th { text-align: left; font-weight: 400; color: var(--muted); padding-right: 12px; }
td { text-align: right; font-weight: 600; }
.layers label {
  display: flex; align-items: center; gap: 9px; padding: 4px 0; cursor: pointer; font-size: 13px;
}
.layers kbd { margin-left: auto; }
.layers .swatch { width: 22px; height: 12px; flex: none; }
.layers .length {
  display: grid; grid-template-columns: auto 1fr; align-items: center; gap: 10px;
  padding: 2px 0 4px 24px; color: var(--muted); font-size: 12.5px;
}
.layers .length input { width: 100%; min-width: 0; }
input[type="checkbox"] {
  appearance: none; -webkit-appearance: none; width: 15px; height: 15px; margin: 0;
  border-radius: 4.5px; border: 1.5px solid var(--faint); display: grid; place-items: center;
  cursor: pointer; flex: none;
}
input[type="checkbox"]:checked { background: var(--accent); border-color: var(--accent); }
input[type="checkbox"]:checked::after {
  content: ""; width: 8px; height: 4px; margin-top: -2px; border: solid var(--accent-ink);
  border-width: 0 0 1.8px 1.8px; transform: rotate(-45deg);
}
kbd {
  font: 600 11px/1 ui-monospace, "SF Mono", Menlo, Consolas, monospace; color: var(--muted);
  border: 1px solid var(--line); border-bottom-width: 2px; border-radius: 5px; padding: 2px 5px;
  background: var(--raised); white-space: nowrap;
}
details summary {
  cursor: pointer; list-style: none; display: flex; align-items: center; font-size: 12px;
  font-weight: 600; color: var(--muted);
}
details summary::-webkit-details-marker { display: none; }
details summary::after {
  content: ""; width: 6px; height: 6px; margin-left: auto; border: solid currentColor;
  border-width: 0 1.6px 1.6px 0; transform: rotate(45deg) translate(-2px, -2px);
}
details[open] summary::after { transform: rotate(225deg) translate(-1px, -1px); }
details table { margin-top: 8px; font-size: 12.5px; }
details td { font-weight: 400; color: var(--muted); }
details th { white-space: nowrap; }
.plain { font-size: 13px; padding: 24px; max-width: 60ch; margin: auto; }
)css";

/// The part of the style sheet for narrow windows and for the accessibility settings of the reader.
inline constexpr char kPlayerStyleNarrow[] = R"css(
@media (max-width: 860px) {
  .page {
    grid-template: "head" auto "stage" auto "plot" auto "side" auto / minmax(0, 1fr);
    align-content: start; padding: 12px;
  }
  .view { min-height: min(58vh, 120vw); }
  .side {
    display: grid; grid-template-columns: repeat(auto-fit, minmax(240px, 1fr)); align-items: start;
  }
}
@media (max-width: 560px) {
  .page { padding: 10px; gap: 10px; }
  h1 { font-size: 17px; }
  .transport { flex-wrap: wrap; justify-content: center; padding: 6px 10px 8px; }
  .transport input[type="range"] { order: -1; flex: 1 0 100%; margin: 2px 0; height: 26px; }
  .transport .clock { margin-left: auto; min-width: 0; }
  .transport #first { display: none; }
  .plot { padding: 10px 8px 4px; }
  .plot-head h2 { flex-basis: 100%; }
  .triad { width: 52px; height: 52px; }
}
@media (pointer: coarse) {
  .icon { width: 40px; height: 40px; }
  .layers label { padding: 7px 0; }
  .presets button { padding: 8px 12px; }
}
@media (prefers-reduced-motion: reduce) { * { transition: none !important; } }
)css";

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
