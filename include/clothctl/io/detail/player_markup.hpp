#pragma once

// The elements of the player page without any data. The script inserts the texts of a scene as text
// nodes, never as markup.

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The beginning of the page up to the text of the title. Its content policy forbids every network
/// request.
inline constexpr char kPlayerHead[] =
    R"html(<!doctype html>
<html lang="en" data-theme="light">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
content="default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:">
<meta name="generator" content="clothctl">
<link rel="icon" href="data:image/svg+xml,)html"
    R"html(%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E)html"
    R"html(%3Cpath d='M2 3c4-2 8 2 12 0v10c-4 2-8-2-12 0z' fill='%232456e6'/%3E%3C/svg%3E">
<title>)html";

/// The visible elements.
inline constexpr char kPlayerBody[] = R"html(
<noscript><p class="plain">This page plays back a recorded motion and needs JavaScript,
  which is switched off here.</p></noscript>
<div class="page">
  <header class="head">
    <div><h1 id="title"></h1><p class="subtitle" id="subtitle"></p></div>
    <button class="icon" id="theme" type="button" aria-label="Switch between light and dark"
      title="Light / dark (D)">
      <svg viewBox="0 0 24 24" aria-hidden="true">
        <circle cx="12" cy="12" r="8.5"/><path class="solid" d="M12 3.5a8.5 8.5 0 0 1 0 17z"/>
      </svg>
    </button>
  </header>
  <main class="stage card">
    <div class="view" id="view">
      <canvas id="gl" tabindex="0" role="img"
        aria-label="Three-dimensional view. Drag to orbit, arrow keys orbit while it has the focus."
      ></canvas>
      <div class="notice" id="notice" hidden>
        <p><strong>No 3-D view here</strong><span id="notice-text"></span></p>
      </div>
      <div class="presets" id="presets" role="group" aria-label="View">
        <button type="button" data-view="front" title="Front (1)">Front</button>
        <button type="button" data-view="side" title="Side (2)">Side</button>
        <button type="button" data-view="top" title="Top (3)">Top</button>
        <button type="button" data-view="fit" title="Fit all (R)">Fit</button>
      </div>
      <svg class="triad" id="triad" viewBox="-32 -32 64 64" aria-hidden="true">
        <line data-axis="0" stroke="#e0483f"/>
        <line data-axis="1" stroke="#3a9d4f"/>
        <line data-axis="2" stroke="#3f74e0"/>
        <text data-axis="0">x</text><text data-axis="1">y</text><text data-axis="2">z</text>
      </svg>
      <span class="grid-size" id="grid-size"></span>
      <span class="mark" id="mark" role="status"></span>
    </div>
    <div class="transport" role="group" aria-label="Playback">
      <button class="icon" id="first" type="button" aria-label="To the first frame"
        title="First frame (Home)">
        <svg viewBox="0 0 24 24" aria-hidden="true">
          <path d="M6 6v12"/><path class="solid" d="M18 6.5v11L9.5 12z"/>
        </svg>
      </button>
      <button class="icon" id="back" type="button" aria-label="One frame back"
        title="One frame back (,)">
        <svg viewBox="0 0 24 24" aria-hidden="true"><path d="M14.5 6.5 9 12l5.5 5.5"/></svg>
      </button>
      <button class="icon primary" id="play" type="button" aria-label="Play"
        title="Play / pause (space)">
        <svg viewBox="0 0 24 24" aria-hidden="true">
          <path class="solid" id="play-shape" d="M8.5 6v12l9.5-6z"/>
        </svg>
      </button>
      <button class="icon" id="forth" type="button" aria-label="One frame on"
        title="One frame on (.)">
        <svg viewBox="0 0 24 24" aria-hidden="true"><path d="M9.5 6.5 15 12l-5.5 5.5"/></svg>
      </button>
      <input id="scrub" type="range" min="0" value="0" step="1" aria-label="Frame">
      <span class="clock"><b id="now">0.00</b> / <span id="length">0.00</span> s</span>
      <select id="speed" aria-label="Speed" title="Speed"></select>
      <button class="icon" id="loop" type="button" aria-label="Repeat" aria-pressed="true"
        title="Repeat (L)">
        <svg viewBox="0 0 24 24" aria-hidden="true">
          <path d="M17 3.5 20 6.5 17 9.5M4 11.5v-1a4 4 0 0 1 4-4h12
            M7 20.5 4 17.5 7 14.5M20 12.5v1a4 4 0 0 1-4 4H4"/>
        </svg>
      </button>
    </div>
  </main>
  <section class="plot card" id="plot-card" aria-label="Error over time">
    <div class="plot-head">
      <h2>Distance to target <span id="plot-unit"></span></h2>
      <div class="legend" id="legend"></div>
    </div>
    <canvas id="plot" role="img"
      aria-label="Error of each feature over time. Drag to scrub."></canvas>
  </section>
  <aside class="side" aria-label="Figures and layers">
    <section class="card figures" id="figures-card">
      <h2>Summary</h2>
      <table><tbody id="figures"></tbody></table>
    </section>
    <section class="card layers"><h2>Show</h2><div id="layers"></div></section>
    <section class="card">
      <details id="keys">
        <summary>Keyboard and pointer</summary>
        <table><tbody id="keys-body"></tbody></table>
      </details>
    </section>
  </aside>
</div>
)html";

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
