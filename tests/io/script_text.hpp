#pragma once

// Helpers for tests of the player page: finds names in its texts, and runs its scripts in node (if
// installed) with a small stand-in for the browser.

#include <cstdlib>
#include <filesystem>
#include <initializer_list>
#include <regex>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/io/file.hpp"
#include "clothctl/io/html_player.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// Returns every match of the first group of `pattern`.
inline std::vector<std::string> all_matches(const std::string& text, const std::string& pattern) {
  const std::regex expression(pattern);
  std::vector<std::string> out;
  for (std::sregex_iterator at(text.begin(), text.end(), expression), end; at != end; ++at)
    out.push_back((*at)[1].str());
  return out;
}

/// Returns the matches without repetition.
inline std::set<std::string> distinct_matches(const std::string& text, const std::string& pattern) {
  const std::vector<std::string> all = all_matches(text, pattern);
  return {all.begin(), all.end()};
}

inline std::string joined(std::initializer_list<const char*> parts) {
  std::string out;
  for (const char* part : parts) out.append(part);
  return out;
}

/// Returns all scripts in the order of the page.
inline std::string all_scripts() {
  using namespace clothctl::detail;
  return joined({kPlayerDataScript, kPlayerShaders, kPlayerGeometryScript, kPlayerRenderScript,
                 kPlayerPlotScript, kPlayerControlScript});
}

/// Checks that a text of the page makes no outside request, cannot end or hide its own element, and
/// does not turn text into code.
inline void check_stays_inside(const std::string& text) {
  for (const char* part :
       {"http:",       "https:",     "src=",          "srcset",         "@import",
        "url(",        "fetch(",     "import(",       "XMLHttpRequest", "WebSocket",
        "EventSource", "sendBeacon", "importScripts", "Worker",         "eval(",
        "Function(",   "innerHTML",  "outerHTML",     "document.write", "</script",
        "</style",     "<!--",       "localStorage",  "cookie",         "\r"}) {
    INFO(part);
    CHECK(text.find(part) == std::string::npos);
  }
}

/// Vertices of `swinging_sheet`: 3×3, 0.1 m apart, hanging from z = 0.7. Each frame moves them 0.02
/// m along y.
inline clothctl::Points<double> sheet_at(int frame) {
  clothctl::Points<double> x(3, 9);
  for (clothctl::Index i = 0; i < 9; ++i)
    x.col(i) << 0.1 * double(i % 3), 0.02 * frame, 0.5 + 0.1 * double(i / 3);
  return x;
}

/// Records 5 frames. The first two vertices are 0.02 m and 0.04 m above their targets. An arrow of
/// length 2 + frame pulls the last vertex up.
inline clothctl::PlayerRecorder swinging_sheet(clothctl::PlayerScene scene = {}) {
  if (scene.triangles.empty() && scene.segments.empty()) {
    for (int v : {0, 1, 3, 4}) {
      scene.triangles.push_back({v, v + 1, v + 4});
      scene.triangles.push_back({v, v + 4, v + 3});
    }
  }
  clothctl::PlayerRecorder recorder(std::move(scene), 9, 2, 1);
  for (int f = 0; f < 5; ++f) {
    const clothctl::Points<double> x = sheet_at(f);
    clothctl::Points<double> target = x.leftCols(2), arrow(3, 1);
    target.row(2).array() -= 0.02;
    target(2, 1) -= 0.02;
    arrow << 0, 0, 2 + f;
    recorder.add_frame(x, x.leftCols(2), target, x.rightCols(1), arrow);
  }
  return recorder;
}

/// Returns the page of that sheet in a scene.
inline std::string page_of(clothctl::PlayerScene scene = {}) {
  return *swinging_sheet(std::move(scene)).page();
}

/// A stand-in for the browser. It reads `pageText` into elements, requires matching tags, and
/// provides what the scripts use. `screen()` runs a screen refresh, `check` and `near` collect
/// failures, and `finish` prints them.
inline constexpr char kBrowser[] = R"js(
const failures = [];
const check = (what, holds) => { if (holds !== true) failures.push(what); };
const near = (what, got, wanted, tolerance = 1e-6) => {
  const a = [got].flat().map(Number), b = [wanted].flat().map(Number);
  const off = a.length !== b.length || a.some((x, i) => !(Math.abs(x - b[i]) <= tolerance));
  if (off) failures.push(`${what}: ${a.slice(0, 12)} instead of ${b.slice(0, 12)}`);
};
const finish = () => console.log(failures.slice(0, 20).join('\n') || 'fine');

const pasted = [];
class Target {
  listeners = {};
  addEventListener(name, f) { (this.listeners[name] ??= []).push(f); }
  fire(name, event = {}) {
    const e = { target: this, preventDefault() { e.defaultPrevented = true; }, ...event };
    for (const f of this.listeners[name] || []) f(e);
    return e;
  }
}
class Element extends Target {
  attributes = {}; nodes = []; dataset = {}; hidden = false; value = '';
  clientWidth = 800; clientHeight = 150;
  box = { left: 0, top: 0, width: 800, height: 600 };
  style = { setProperty(name, value) { this[name] = value; } };
  captured = new Set();
  constructor(tagName) { super(); this.tagName = tagName; }
  get children() { return this.nodes.filter(n => n instanceof Element); }
  get options() { return this.children; }
  get textContent() {
    return this.nodes.map(n => n instanceof Element ? n.textContent : n).join('');
  }
  set textContent(text) { this.nodes = [String(text)]; }
  append(...nodes) { this.nodes.push(...nodes.map(n => n instanceof Element ? n : String(n))); }
  insertAdjacentHTML(where, html) { pasted.push(html); }
  setAttribute(name, value) {
    this.attributes[name] = String(value);
    if (name === 'id') this.id = value;
    if (name === 'hidden') this.hidden = true;
    if (name.startsWith('data-')) this.dataset[name.slice(5)] = value;
  }
  getAttribute(name) { return this.attributes[name] ?? null; }
  getBoundingClientRect() { return this.box; }
  setPointerCapture(id) { this.captured.add(id); }
  hasPointerCapture(id) { return this.captured.has(id); }
  matches() { return this.focused === true; }
  getContext(kind) { return contexts[kind] ?? null; }
  click() { this.fire('click'); }
  walk(visit) { visit(this); for (const child of this.children) child.walk(visit); }
}
const parse = text => {
  const root = new Element('#document'), open = [root], top = () => open[open.length - 1];
  const tag =
    /<(\/?)([a-z][\w-]*)((?:\s+[\w:-]+(?:="[^"]*")?)*)\s*(\/?)>|<!doctype html>|([^<]+)/gyi;
  while (tag.lastIndex < text.length) {
    const at = tag.lastIndex, found = tag.exec(text);
    if (!found) throw new Error('no markup: ' + text.slice(at, at + 60));
    const [, slash, name, attributes, alone, words] = found;
    if (words !== undefined) { top().append(words); continue; }
    if (!name) continue;
    const drawn = name === 'svg' || open.some(e => e.tagName === 'svg');
    const shown = drawn ? name : name.toUpperCase();
    if (slash) {
      if (open.pop().tagName !== shown) throw new Error('unexpected end of ' + name);
      continue;
    }
    const element = new Element(shown);
    for (const [, key, value] of attributes.matchAll(/([\w:-]+)(?:="([^"]*)")?/g)) {
      if (key in element.attributes) throw new Error(key + ' twice in ' + name);
      element.setAttribute(key, value ?? '');
    }
    top().append(element);
    if (alone || ['meta', 'link', 'input'].includes(name)) continue;
    open.push(element);
    if (name !== 'script' && name !== 'style') continue;
    const end = text.indexOf('</' + name, tag.lastIndex);
    element.textContent = text.slice(tag.lastIndex, end);
    tag.lastIndex = end;
  }
  if (open.length > 1) throw new Error(top().tagName + ' is never ended');
  return root;
};
const page = parse(pageText), elements = [];
page.walk(e => elements.push(e));
const themes = {};
const sheet = elements.find(e => e.tagName === 'STYLE').textContent;
for (const [, dark, rules] of sheet.matchAll(/:root(\[data-theme="dark"\])?\s*\{([^}]*)\}/g)) {
  const variables = [...rules.matchAll(/(--[\w-]+):([^;]*);/g)];
  themes[dark ? 'dark' : 'light'] = Object.fromEntries(variables.map(m => [m[1], m[2]]));
}
// A pen that records each call with the current colour.
const pen2d = new Proxy({ calls: [], measureText: text => ({ width: 6 * text.length }) }, {
  get: (pen, name) => {
    if (name in pen) return pen[name];
    return (...values) => void pen.calls.push([name, ...values, pen.strokeStyle]);
  }
});
const contexts = { '2d': pen2d };
const document = {
  documentElement: elements.find(e => e.tagName === 'HTML'),
  body: elements.find(e => e.tagName === 'BODY'), title: '',
  getElementById(id) {
    let found = null;
    page.walk(e => { if (e.id === id) found ??= e; });
    return found;
  },
  createElement: name => new Element(name.toUpperCase()),
  querySelectorAll(what) {
    const all = [];
    page.walk(e => { if (what === '[data-feature]' && 'feature' in e.dataset) all.push(e); });
    return all;
  }
};
const media = {};
const window = Object.assign(new Target(), {
  innerWidth: 1280, innerHeight: 1200, devicePixelRatio: 1,
  matchMedia: query => media[query] ??= Object.assign(new Target(), { matches: false })
});
const location = { hash: '' };
const getComputedStyle = () => {
  const theme = themes[document.documentElement.dataset.theme];
  return { fontFamily: 'sans', getPropertyValue: name => theme[name] ?? themes.light[name] };
};
class Option extends Element {
  constructor(text, value) { super('OPTION'); this.append(text); this.value = String(value); }
}
const observers = [];
class ResizeObserver { constructor(f) { observers.push(f); } observe() {} }
let waiting = [];
const requestAnimationFrame = f => waiting.push(f);
const screen = (now = 0) => {
  const due = waiting;
  waiting = [];
  for (const f of due) f(now);
  return due.length;
};
)js";

/// Runs `script` with a page's stand-in for the browser, inside a function as in the page. Returns
/// what was printed.
inline std::string run_in_page(const std::string& page, const std::string& script) {
  std::string text = "const pageText = ";
  clothctl::detail::append_json(page, text);
  text.append(";\n")
      .append(kBrowser)
      .append("(() => {\n'use strict';\n")
      .append(script)
      .append("\nfinish();\n})();\n");
  REQUIRE(clothctl::write_file("clothctl_script.js", text).has_value());
  const int code = std::system("node clothctl_script.js > clothctl_script.txt 2>&1");
  const clothctl::Result<std::string> output = clothctl::read_file("clothctl_script.txt");
  std::filesystem::remove("clothctl_script.js");
  std::filesystem::remove("clothctl_script.txt");
  return (code == 0 ? "" : "node stopped: ") + (output ? *output : output.error());
}

/// Checks that all checks inside `script` pass. Warns and returns if node is missing.
inline void check_in_page(const std::string& page, const std::string& script) {
  static const bool there = [] {
    const int code = std::system("node -e \"atob(String())\" > clothctl_script.txt 2>&1");
    std::filesystem::remove("clothctl_script.txt");
    return code == 0;
  }();
  if (!there) {
    WARN(
        "skipped: running the scripts of the player page needs node (16 or newer), which is not "
        "installed");
    return;
  }
  CHECK(run_in_page(page, script) == "fine\n");
}

}  // namespace clothctl_test
