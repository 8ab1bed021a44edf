"use strict";

// Numbers come as integers in base64: `unit` metres, or `turn` radians, to the step.
const scene = JSON.parse(document.getElementById("data").textContent);
const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
const boxesOf = (text) => new Int32Array(bytes(text));
const BOX = 6; // id, x, y, length, width, yaw
const frames = scene.frames.map((frame) => ({
  ...frame,
  points: new Int16Array(bytes(frame.points)), // from the frame's origin
  truth: boxesOf(frame.truth),
}));
const runs = scene.runs.map((run) => ({
  ...run,
  tracks: run.tracks.map((frame) => Object.fromEntries(Object.entries(frame).map(([name, text]) => [name, boxesOf(text)]))),
}));

// Side by side: two different policies, else the first and the last run; a single run needs one panel.
const rival = runs.findIndex((run) => run.group !== runs[0].group);
const names = [...new Set(scene.frames.flatMap((frame) => frame.agents.map(([name]) => name)))];
const state = { frame: 0, playing: false, agent: names[0], shown: [0, rival < 0 ? runs.length - 1 : rival], speed: 1 };
const layers = { points: true, truth: true, tracks: true, ids: false };
const SPAN_M = 150;
const TRAIL_S = 1;
const home = () => ({ x: 0, y: 0, span: SPAN_M });
let view = home(); // of its centre: metres from the scene's home, or from the agent that it follows
const far = (frame) => Math.hypot(...frame.origin) > SPAN_M / 4;
let follow = scene.frames.some(far); // who drives away would soon be out of sight

const percent = (share) => `${share * 100}%`;
const trackColor = (id) =>
  `hsl(${((id * scene.hue_step) % 1) * 360} ${percent(scene.saturation)} ${percent(scene.lightness)})`;

// Colour says the policy, the dash which of its runs: runs of a policy that come out alike look alike.
const COLORS = ["#2f7fc1", "#d4601c", "#2a9260", "#b0529e", "#a07d13", "#5f6ad4"]; // 3:1 on white and on black
const DASHES = [[], [7, 4], [2, 3], [12, 3, 2, 3]];
const groups = [...new Set(runs.map((run) => run.group))];
const runColor = (run) => COLORS[groups.indexOf(run.group) % COLORS.length];
const runDash = (run) => DASHES[runs.filter((other) => other.group === run.group).indexOf(run) % DASHES.length];

if (runs.length < 2) document.querySelector('#panels canvas[data-panel="1"]').parentElement.remove();
const panels = [...document.querySelectorAll("#panels canvas")];

function fit(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio);
  const height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [context, canvas.clientWidth, canvas.clientHeight];
}

const spot = (boxes, k) => [boxes[k + 1] * scene.unit, boxes[k + 2] * scene.unit];

/** The world's point in the middle of the panels. */
function eye() {
  const { agents, origin } = frames[state.frame];
  const [, x, y] = agents.find(([name]) => name === state.agent) ?? [null, ...origin];
  return follow ? [x + view.x, y + view.y] : [view.x, view.y];
}

/** Text on a dark halo, to be read over points and boxes. */
function write(context, text, x, y) {
  context.save();
  context.strokeStyle = scene.colors.background;
  context.lineWidth = 3;
  context.lineJoin = "round";
  context.strokeText(text, x, y);
  context.restore();
  context.fillText(text, x, y);
}

function drawPanel(canvas, run) {
  const [context, width, height] = fit(canvas);
  const scale = width / view.span;
  const [eyeX, eyeY] = eye();
  const toX = (x) => width / 2 + (x - eyeX) * scale;
  const toY = (y) => height / 2 - (y - eyeY) * scale;
  context.fillStyle = scene.colors.background;
  context.fillRect(0, 0, width, height);
  const fill = (polygons, color) => {
    context.fillStyle = color;
    context.beginPath();
    for (const polygon of polygons) {
      polygon.forEach(([x, y], k) => (k ? context.lineTo(toX(x), toY(y)) : context.moveTo(toX(x), toY(y))));
      context.closePath();
    }
    context.fill("nonzero");
  };
  for (const [name, polygons] of Object.entries(scene.map)) fill(polygons, scene.colors[name]);
  const frame = frames[state.frame];
  if (layers.points) {
    context.fillStyle = scene.colors.point;
    const { points, origin } = frame;
    for (let k = 0; k < points.length; k += 2) {
      context.fillRect(toX(origin[0] + points[k] * scene.unit), toY(origin[1] + points[k + 1] * scene.unit), 1.2, 1.2);
    }
  }
  const outline = (boxes, k, grow = 0) => {
    const [x, y] = spot(boxes, k);
    const [length, width_] = [boxes[k + 3] * scene.unit, boxes[k + 4] * scene.unit];
    const yaw = boxes[k + 5] * scene.turn;
    const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
    const [a, b] = [length / 2 + grow, width_ / 2 + grow];
    const corner = (u, v) => [toX(x + u * cos - v * sin), toY(y + u * sin + v * cos)];
    context.beginPath();
    context.moveTo(...corner(a, b));
    context.lineTo(...corner(-a, b));
    context.lineTo(...corner(-a, -b));
    context.lineTo(...corner(a, -b));
    context.closePath();
    context.moveTo(...corner(a, 0));
    context.lineTo(...corner(a * 0.4, 0));
    return [toX(x), toY(y)];
  };
  if (layers.truth) {
    context.strokeStyle = scene.colors.truth;
    context.lineWidth = 1;
    for (let k = 0; k < frame.truth.length; k += BOX) {
      outline(frame.truth, k);
      context.stroke();
    }
  }
  context.font = "12px system-ui, sans-serif";
  if (layers.tracks) drawTracks(context, run, outline, toX, toY);
  for (const [name, x, y, riding] of frame.agents) {
    context.globalAlpha = name === state.agent ? 1 : 0.7;
    context.fillStyle = scene.colors.agent;
    context.beginPath();
    context.arc(toX(x), toY(y), riding ? 4 : 6, 0, 7);
    context.fill();
    write(context, name, toX(x) + 8, toY(y) - 8);
  }
  context.globalAlpha = 1;
  drawScaleBar(context, scale, height);
}

function drawTracks(context, run, outline, toX, toY) {
  const now = run.tracks[state.frame][state.agent] ?? [];
  const first = Math.max(0, state.frame - Math.round(TRAIL_S / scene.dt_s));
  for (let k = 0; k < now.length; k += BOX) {
    const id = now[k];
    context.strokeStyle = context.fillStyle = trackColor(id);
    context.lineWidth = 1.5;
    context.beginPath();
    let started = false;
    for (let past = first; past <= state.frame; past++) {
      const boxes = run.tracks[past][state.agent] ?? [];
      for (let j = 0; j < boxes.length; j += BOX) {
        if (boxes[j] !== id) continue;
        const [x, y] = spot(boxes, j);
        started ? context.lineTo(toX(x), toY(y)) : context.moveTo(toX(x), toY(y));
        started = true;
      }
    }
    context.stroke();
    context.lineWidth = 2;
    const [x, y] = outline(now, k, 0.15);
    context.stroke();
    if (layers.ids) write(context, String(id), x + 6, y - 6);
  }
}

const nice = (least) => {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((digit) => digit * power >= least * 0.999);
};

function drawScaleBar(context, scale, height) {
  const metres = nice(60 / scale);
  context.fillStyle = scene.colors.text;
  context.fillRect(12, height - 14, metres * scale, 3);
  write(context, `${+metres.toPrecision(1)} m`, 12, height - 20);
}

function drawChart() {
  const canvas = document.getElementById("chart");
  const [context, width, height] = fit(canvas);
  const style = getComputedStyle(document.documentElement);
  context.font = "12px system-ui, sans-serif";
  const swatch = 28;
  const column = swatch + 24 + Math.max(...runs.map((run) => context.measureText(run.label).width));
  const [left, right, top] = [56, 20, 12];
  const perLine = Math.max(1, Math.floor((width - left) / column));
  const bottom = 30 + 20 * Math.ceil(runs.length / perLine);
  const count = frames.length;
  const toX = (k) => left + (count < 2 ? 0 : (k / (count - 1)) * (width - left - right));
  const low = Math.floor(Math.min(0, ...runs.flatMap((run) => run.score)) * 4) / 4;
  const toY = (value) => top + ((1 - value) / (1 - low)) * (height - top - bottom);
  const line = (points) => {
    context.beginPath();
    points.forEach((point, k) => (k ? context.lineTo(...point) : context.moveTo(...point)));
    context.stroke();
  };
  context.clearRect(0, 0, width, height);
  context.strokeStyle = style.getPropertyValue("--line");
  context.fillStyle = style.getPropertyValue("--dim");
  context.lineWidth = 1;
  context.textAlign = "right";
  for (let value = low; value <= 1.001; value += 0.25) {
    line([[left, toY(value)], [width - right, toY(value)]]);
    context.fillText(value.toFixed(2), left - 8, toY(value) + 4);
  }
  context.textAlign = "center";
  const seconds = (count - 1) * scene.dt_s;
  const step = nice(Math.max(scene.dt_s, (seconds * 64) / (width - left - right)));
  for (let n = 0; n * step <= seconds + 1e-9; n++) {
    context.fillText(`${+(n * step).toPrecision(6)} s`, toX((n * step) / scene.dt_s), height - bottom + 18);
  }
  context.save();
  context.translate(12, (top + height - bottom) / 2);
  context.rotate(-Math.PI / 2);
  context.fillText("reward", 0, 0);
  context.restore();
  context.textAlign = "left";
  runs.forEach((run, n) => {
    context.strokeStyle = runColor(run);
    context.lineWidth = panels.some((panel) => state.shown[panel.dataset.panel] === n) ? 2.4 : 1.2;
    context.setLineDash(runDash(run));
    line(run.score.map((value, k) => [toX(k), toY(value)]));
    const [x, y] = [left + (n % perLine) * column, height - bottom + 38 + 20 * Math.floor(n / perLine)];
    line([[x, y - 4], [x + swatch, y - 4]]);
    context.fillStyle = style.getPropertyValue("--ink");
    context.fillText(run.label, x + swatch + 6, y);
  });
  context.setLineDash([]);
  context.strokeStyle = style.getPropertyValue("--ink");
  context.lineWidth = 1;
  line([[toX(state.frame), top], [toX(state.frame), height - bottom]]);
  canvas.onclick = (event) => go(Math.round(((event.offsetX - left) / (width - left - right)) * (count - 1)));
}

function draw() {
  panels.forEach((canvas) => drawPanel(canvas, runs[state.shown[canvas.dataset.panel]]));
  drawChart();
  document.getElementById("time").value = state.frame;
  document.getElementById("clock").value = `${(state.frame * scene.dt_s).toFixed(1)} s`;
}

function go(frame) {
  state.frame = Math.min(Math.max(frame, 0), frames.length - 1);
  draw();
}

let since = 0;
function tick(now) {
  if (!state.playing) return;
  const due = (scene.dt_s * 1000) / state.speed;
  if (now - since >= due) {
    since = now - ((now - since) % due); // no drift from the screen's own rhythm
    go((state.frame + 1) % frames.length);
  }
  requestAnimationFrame(tick);
}
function toggle() {
  state.playing = !state.playing;
  document.getElementById("play").textContent = state.playing ? "Pause" : "Play";
  if (state.playing) requestAnimationFrame(tick);
}

document.getElementById("play").onclick = toggle;
document.addEventListener("keydown", (event) => {
  if (event.key === " " && !["BUTTON", "SELECT", "INPUT"].includes(event.target.tagName)) {
    event.preventDefault();
    toggle();
  }
});
const slider = document.getElementById("time");
slider.max = frames.length - 1;
slider.oninput = () => go(Number(slider.value));
document.getElementById("speed").onchange = (event) => (state.speed = Number(event.target.value));
const option = (text, value, selected) => new Option(text, value, selected, selected);
const agents = document.getElementById("agent");
names.forEach((name) => agents.add(option(name, name, name === state.agent)));
agents.onchange = () => { state.agent = agents.value; draw(); };
document.querySelectorAll("select[data-panel]").forEach((select) => {
  const panel = Number(select.dataset.panel);
  runs.forEach((run, k) => select.add(option(run.label, k, k === state.shown[panel])));
  select.onchange = () => { state.shown[panel] = Number(select.value); draw(); };
});
const following = document.getElementById("follow");
following.checked = follow;
following.onchange = () => { follow = following.checked; view = home(); draw(); };
document.querySelectorAll("[data-layer]").forEach((box) => {
  box.onchange = () => { layers[box.dataset.layer] = box.checked; draw(); };
});

panels.forEach((canvas) => {
  const touches = new Map();
  const zoom = (factor, x, y) => {
    const scale = view.span / canvas.clientWidth;
    const [dx, dy] = [(x - canvas.clientWidth / 2) * scale, (canvas.clientHeight / 2 - y) * scale];
    const span = Math.min(Math.max(view.span * factor, 15), 2000);
    const applied = span / view.span;
    view = { x: view.x + dx * (1 - applied), y: view.y + dy * (1 - applied), span };
    draw();
  };
  canvas.onwheel = (event) => {
    if (!event.ctrlKey) return; // a plain wheel scrolls the page
    event.preventDefault();
    zoom(Math.exp(event.deltaY / 600), event.offsetX, event.offsetY);
  };
  canvas.onpointerdown = (event) => {
    canvas.setPointerCapture(event.pointerId);
    touches.set(event.pointerId, event);
  };
  canvas.onpointermove = (event) => {
    const before = touches.get(event.pointerId);
    if (!before) return;
    if (touches.size === 2) {
      const other = [...touches.entries()].find(([id]) => id !== event.pointerId)[1];
      const apart = (a) => Math.hypot(a.offsetX - other.offsetX, a.offsetY - other.offsetY) || 1;
      zoom(apart(before) / apart(event), other.offsetX, other.offsetY);
    } else {
      const scale = view.span / canvas.clientWidth;
      view = {
        ...view,
        x: view.x - (event.offsetX - before.offsetX) * scale,
        y: view.y + (event.offsetY - before.offsetY) * scale,
      };
      draw();
    }
    touches.set(event.pointerId, event);
  };
  canvas.onpointerup = canvas.onpointercancel = (event) => touches.delete(event.pointerId);
  canvas.ondblclick = () => { view = home(); draw(); };
});

new ResizeObserver(draw).observe(document.body);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
draw();
