#pragma once

// The last part of the page's script: playback, controls, keys, pointers and the options in the
// page's address.

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Playback, controls and their labels, keys, pointers, and address options such as
/// `#frame=120&paused&theme=dark`.
inline constexpr char kPlayerControlScript[] = R"js(
let last = 0;
const setFrame = frame => { state.frame = clamp(frame, 0, F - 1); invalidate(); };
const setPlaying = playing => {
  if (playing && state.frame >= F - 1) state.frame = 0;
  state.playing = playing && F > 1;
  last = 0;
  $('play').setAttribute('aria-label', state.playing ? 'Pause' : 'Play');
  const pause = 'M8 6.5h2.2v11H8zM13.8 6.5H16v11h-2.2z', play = 'M8.5 6v12l9.5-6z';
  $('play-shape').setAttribute('d', state.playing ? pause : play);
  invalidate();
};
const seek = frame => { setPlaying(false); setFrame(Math.round(frame)); };
const tick = now => {
  if (!state.playing) return;
  if (last) state.frame += Math.min(.25, (now - last) / 1000) * state.speed / dt;
  last = now;
  if (state.frame > F - 1) {
    if (state.loop) state.frame = 0; else { state.frame = F - 1; setPlaying(false); }
  }
  if (state.playing) invalidate();
};
const paintControls = () => {
  const scrub = $('scrub'), time = (state.frame * dt).toFixed(2);
  scrub.value = Math.round(state.frame);
  scrub.style.setProperty('--fill', (F > 1 ? 100 * state.frame / (F - 1) : 0) + '%');
  scrub.setAttribute('aria-valuetext', time + ' s, frame ' + Math.round(state.frame));
  $('now').textContent = time;
  const passed = scene.marks.filter(([frame]) => frame <= state.frame + 1e-9);
  const text = passed.length ? passed[passed.length - 1][1] : '';
  if ($('mark').textContent !== text) $('mark').textContent = text;
};
const setTheme = name => {
  document.documentElement.dataset.theme = name;
  for (const swatch of document.querySelectorAll('[data-feature]')) {
    swatch.style.background = colourOf(Number(swatch.dataset.feature));
  }
  invalidate();
};
const setLoop = on => { state.loop = on; $('loop').setAttribute('aria-pressed', on); };
// Until the reader moves the camera, the scene is fitted anew whenever the view changes its size.
let moved = false;
const fit = () => {
  const box = $('view').getBoundingClientRect();
  moved = false;
  fitCamera(box.width / Math.max(1, box.height));
  invalidate();
};
const setView = name => { [camera.yaw, camera.pitch] = presets[name]; fit(); };
const orbit = (dx, dy) => {
  moved = true;
  camera.yaw -= dx;
  camera.pitch = clamp(camera.pitch + dy, -Math.PI / 2, Math.PI / 2);
  invalidate();
};
const pan = (dx, dy) => {
  const { right, up } = axes(), box = canvas.getBoundingClientRect();
  moved = true;
  const side = Math.max(1, Math.min(box.width, box.height));
  const scale = 2 * Math.tan(kField / 2) * camera.distance / side;
  camera.target = add(add(camera.target, right, -dx * scale), up, dy * scale);
  invalidate();
};
const zoom = factor => {
  moved = true;
  camera.distance = clamp(camera.distance * factor, .02 * diagonal, 20 * diagonal);
  invalidate();
};

const arrowName = scene.arrowName;
// The drawing beside each layer's name, 22 × 12.
const icons = {
  sheet: '<rect x="1" y="1" width="20" height="10" rx="2.5" fill="#cdbfa9" '
    + 'stroke="currentColor" stroke-opacity=".35"/>',
  rope: '<path d="M2 8c6-8 12 4 18-4" stroke="#a88d6f" stroke-width="4" fill="none" '
    + 'stroke-linecap="round"/>',
  lines: '<path d="M1 1.5h20M1 6h20M1 10.500h20M3 1v10M8 1v10M14 1v10M19 1v10" '
    + 'stroke="currentColor" stroke-opacity=".45" fill="none"/>',
  actual: '<path d="M1 9c6-10 12 6 20-6" stroke="currentColor" stroke-width="2.2" fill="none" '
    + 'stroke-linecap="round"/>',
  target: '<path d="M1 9c6-10 12 6 20-6" stroke="currentColor" stroke-opacity=".65" '
    + 'stroke-width="1.8" stroke-dasharray="3.5 2.5" fill="none"/>',
  arrows: '<path d="M1 6h13" stroke="var(--arrow)" stroke-width="2.4" stroke-linecap="round"/>'
    + '<path d="M13 2l8 4-8 4z" fill="var(--arrow)"/>',
  ground: '<path d="M5 1h12l4 10H1zM9 1 7.5 11M13 1l1.5 10M3.5 6h15" stroke="currentColor" '
    + 'stroke-opacity=".5" fill="none"/>'
};
const sheet = triangles.length > 0;
// Name, label, key, whether the scene has it, drawing.
const layers = [
  ['surface', scene.meshName || (sheet ? 'Sheet' : 'Rope'), 'C', N > 0,
    sheet ? icons.sheet : icons.rope],
  ['lines', 'Mesh lines', 'W', sheet, icons.lines],
  ['actual', 'Path of features', 'P', K > 0, icons.actual],
  ['target', 'Target', 'T', K > 0, icons.target],
  ['arrows', arrowName, 'F', A > 0, icons.arrows],
  ['ground', 'Ground', 'G', true, icons.ground]
];
const boxes = {};
const toggle = (name, on = !state.show[name]) => {
  if (!boxes[name]) return;
  state.show[name] = boxes[name].checked = on;
  $('grid-size').hidden = !state.show.ground;
  invalidate();
};
const buildPanels = () => {
  document.title = scene.title || 'Motion';
  $('title').textContent = scene.title || 'Motion';
  $('subtitle').textContent = scene.subtitle;
  $('subtitle').hidden = !scene.subtitle;
  $('figures-card').hidden = !scene.figures.length;
  const row = (body, head, cell) => {
    const tr = document.createElement('tr');
    const th = document.createElement('th'), td = document.createElement('td');
    th.scope = 'row';
    th.append(head);
    td.append(cell);
    tr.append(th, td);
    body.append(tr);
  };
  for (const [name, value] of scene.figures) row($('figures'), name, value);
  for (const [name, text, key, there, icon] of layers) {
    if (!there) continue;
    const label = document.createElement('label'), kbd = document.createElement('kbd');
    const box = boxes[name] = document.createElement('input');
    box.type = 'checkbox';
    box.checked = state.show[name];
    box.addEventListener('change', () => toggle(name, box.checked));
    kbd.textContent = key;
    label.append(box);
    label.insertAdjacentHTML('beforeend',
      `<svg class="swatch" viewBox="0 0 22 12" aria-hidden="true">${icon}</svg>`);
    label.append(text, kbd);
    $('layers').append(label);
    if (name !== 'arrows') continue;
    const length = document.createElement('label'), range = document.createElement('input');
    length.className = 'length';
    const limits = { min: '-2', max: '2', step: '0.1', value: '0' };
    Object.assign(range, { type: 'range', ...limits, id: 'arrow-length' });
    range.addEventListener('input', () => {
      state.arrowScale = 2 ** Number(range.value);
      range.style.setProperty('--fill', 25 * (Number(range.value) + 2) + '%');
      invalidate();
    });
    range.style.setProperty('--fill', '50%');
    length.append('Length', range);
    $('layers').append(length);
    if (!lengths.length) continue;
    label.title = 'Largest: ' + lengths[lengths.length - 1].toPrecision(3) + ' ' + scene.arrowUnit;
  }
  const help = [
    ['space', 'play or pause'],
    [', .', 'step a frame'],
    ['← →', 'step; with shift ten frames'],
    ['Home End', 'first, last frame'],
    ['1 2 3 R', 'front, side, top, fit'],
    ['+ −', 'zoom'],
    ['drag', 'orbit'],
    ['shift drag', 'pan (or right button)'],
    ['wheel', 'zoom'],
    ['two fingers', 'pan and zoom']
  ];
  for (const [keys, text] of help) {
    const kbd = document.createElement('kbd');
    kbd.textContent = keys;
    row($('keys-body'), kbd, text);
  }
  for (const speed of [.1, .25, .5, 1, 2, 4]) {
    $('speed').append(new Option(speed + '×', speed, speed === 1, speed === 1));
  }
  const centimetres = +(cell * 100).toPrecision(3), metres = +cell.toPrecision(3);
  $('grid-size').textContent = 'grid ' + (cell < .995 ? centimetres + ' cm' : metres + ' m');
  $('scrub').max = F - 1;
  $('length').textContent = ((F - 1) * dt).toFixed(2);
  if (window.innerWidth > 860 && window.innerHeight > 1000) $('keys').open = true;
};

const listen = () => {
  $('play').addEventListener('click', () => setPlaying(!state.playing));
  $('first').addEventListener('click', () => seek(0));
  $('back').addEventListener('click', () => seek(Math.ceil(state.frame) - 1));
  $('forth').addEventListener('click', () => seek(Math.floor(state.frame) + 1));
  $('loop').addEventListener('click', () => setLoop(!state.loop));
  $('scrub').addEventListener('input', () => seek(Number($('scrub').value)));
  $('speed').addEventListener('change', () => { state.speed = Number($('speed').value); });
  $('theme').addEventListener('click', () => setTheme(theme() === 'dark' ? 'light' : 'dark'));
  for (const button of $('presets').children) {
    button.addEventListener('click', () => setView(button.dataset.view));
  }

  const scrubPlot = e => {
    const box = plot.getBoundingClientRect(), inside = box.width - frame_.left - frame_.right;
    seek((e.clientX - box.left - frame_.left) / Math.max(1, inside) * (F - 1));
  };
  plot.addEventListener('pointerdown', e => {
    plot.setPointerCapture(e.pointerId);
    scrubPlot(e);
  });
  plot.addEventListener('pointermove', e => {
    if (plot.hasPointerCapture(e.pointerId)) scrubPlot(e);
  });

  const fingers = new Map();
  canvas.addEventListener('contextmenu', e => e.preventDefault());
  canvas.addEventListener('pointerdown', e => {
    canvas.setPointerCapture(e.pointerId);
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
  });
  canvas.addEventListener('pointermove', e => {
    const before = fingers.get(e.pointerId);
    if (!before) return;
    const now = [e.clientX, e.clientY], dx = now[0] - before[0], dy = now[1] - before[1];
    if (fingers.size === 1) {
      if (e.shiftKey || e.buttons & 6) pan(dx, dy); else orbit(dx * .0075, dy * .0075);
    } else if (fingers.size === 2) {
      const [other] = [...fingers].filter(([id]) => id !== e.pointerId).map(([, p]) => p);
      const gap = p => Math.max(1, Math.hypot(p[0] - other[0], p[1] - other[1]));
      zoom(gap(before) / gap(now));
      pan(dx / 2, dy / 2);
    }
    fingers.set(e.pointerId, now);
  });
  for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) {
    canvas.addEventListener(end, e => fingers.delete(e.pointerId));
  }
  canvas.addEventListener('wheel', e => {
    e.preventDefault();
    zoom(Math.exp(clamp(e.deltaY * [1, 16, 100][e.deltaMode], -240, 240) * .0012));
  }, { passive: false });
  canvas.addEventListener('dblclick', () => setView('fit'));

  window.addEventListener('keydown', e => {
    if (e.ctrlKey || e.metaKey || e.altKey || e.defaultPrevented) return;
    const tag = e.target.tagName, typed = e.key.length === 1 ? e.key.toLowerCase() : e.key;
    const slider = tag === 'INPUT' && e.target.type === 'range';
    if (tag === 'SELECT' || (slider && /^(Arrow|Home|End|Page)/.test(e.key))) return;
    if (typed === ' ' && /^(BUTTON|INPUT|SUMMARY)$/.test(tag) && e.target.id !== 'scrub') return;
    const inView = e.target === canvas && canvas.matches(':focus-visible');
    const step = e.shiftKey ? 10 : 1;
    const turns = {
      ArrowLeft: [-.1, 0], ArrowRight: [.1, 0], ArrowUp: [0, .1], ArrowDown: [0, -.1]
    };
    const actions = {
      ' ': () => setPlaying(!state.playing),
      ',': () => seek(Math.ceil(state.frame) - 1),
      '.': () => seek(Math.floor(state.frame) + 1),
      ArrowLeft: () => seek(Math.ceil(state.frame) - step),
      ArrowRight: () => seek(Math.floor(state.frame) + step),
      Home: () => seek(0),
      End: () => seek(F - 1),
      r: () => setView('fit'),
      1: () => setView('front'),
      2: () => setView('side'),
      3: () => setView('top'),
      '+': () => zoom(.87),
      '=': () => zoom(.87),
      '-': () => zoom(1.15),
      d: () => $('theme').click(),
      l: () => setLoop(!state.loop)
    };
    for (const [name, , key] of layers) actions[key.toLowerCase()] = () => toggle(name);
    const action = inView && turns[e.key] ? () => orbit(...turns[e.key]) : actions[typed];
    if (!action) return;
    e.preventDefault();
    action();
  });
  // Painted within the observer, so that no frame is shown stretched.
  const resized = new ResizeObserver(() => {
    if (!moved) fit();
    for (const paint of painters) paint();
  });
  resized.observe($('view'));
  resized.observe(plot);
  const system = window.matchMedia('(prefers-color-scheme: dark)');
  system.addEventListener('change', () => setTheme(system.matches ? 'dark' : 'light'));
  window.addEventListener('hashchange', readAddress);
};

// #frame=120&paused&theme=dark&speed=0.5&view=top&yaw=30&pitch=20&zoom=1.5&hide=arrows,ground
const readAddress = () => {
  const options = new URLSearchParams(location.hash.slice(1));
  const number = name => Number(options.get(name));
  const angle = name => Number.isFinite(number(name)) ? number(name) * Math.PI / 180 : 0;
  if (options.has('theme')) setTheme(options.get('theme') === 'dark' ? 'dark' : 'light');
  if (Object.keys(presets).includes(options.get('view'))) setView(options.get('view'));
  if (options.has('yaw')) camera.yaw = angle('yaw');
  if (options.has('pitch')) camera.pitch = clamp(angle('pitch'), -Math.PI / 2, Math.PI / 2);
  if (options.has('yaw') || options.has('pitch')) fit();
  if (number('zoom') > 0) zoom(1 / number('zoom'));
  for (const name of (options.get('hide') || '').split(',')) {
    if (Object.keys(state.show).includes(name)) toggle(name, false);
  }
  if ([...$('speed').options].some(o => o.value === options.get('speed'))) {
    $('speed').value = options.get('speed');
    state.speed = number('speed');
  }
  if (options.has('frame')) setFrame(Math.round(number('frame')) || 0);
  if (options.has('paused')) setPlaying(false);
};

setTheme(window.matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light');
buildPanels();
buildLegend();
setTheme(theme());
startView();
painters.push(paintView, paintPlot, paintControls);
listen();
setView('fit');
setPlaying(!window.matchMedia('(prefers-reduced-motion: reduce)').matches);
readAddress();
)js";

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
