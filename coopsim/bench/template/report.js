"use strict";

// Numbers come as int16 in base64; `unit` metres (or radians) to the step.
const scene = JSON.parse(document.getElementById("data").textContent);
const decode = (text) => {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Int16Array(bytes.buffer);
};
const BOX = 6; // id, x, y, length, width, yaw
const frames = scene.frames.map((frame) => ({ points: decode(frame.points), truth: decode(frame.truth) }));
const runs = scene.runs.map((run) => ({
  ...run,
  tracks: run.tracks.map((frame) => Object.fromEntries(Object.entries(frame).map(([name, text]) => [name, decode(text)]))),
}));

const rival = runs.findIndex((run) => run.group !== runs[0].group); // side by side: two different policies
const state = { frame: 0, playing: false, agent: scene.agents[0], shown: [0, rival < 0 ? runs.length - 1 : rival], speed: 1 };
const layers = { points: true, truth: true, tracks: true, ids: false };
const home = () => ({ x: scene.centre[0], y: scene.centre[1], span: scene.span });
let view = home();

const hue = (id) => (id * 0.38196601125) % 1; // the same rule as in the library's pictures
const trackColor = (id) => `hsl(${hue(id) * 360} 75% 62%)`;
const runColor = (k) => `hsl(${(k * 360) / Math.max(runs.length, 1) + 200} 60% 50%)`;

function fit(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio);
  const height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [context, canvas.clientWidth, canvas.clientHeight];
}

function drawPanel(canvas, run) {
  const [context, width, height] = fit(canvas);
  const scale = width / view.span;
  const toX = (x) => width / 2 + (x - view.x) * scale;
  const toY = (y) => height / 2 - (y - view.y) * scale;
  context.clearRect(0, 0, width, height);
  const fill = (polygons, color) => {
    context.fillStyle = color;
    context.beginPath();
    for (const polygon of polygons) {
      polygon.forEach(([x, y], k) => (k ? context.lineTo(toX(x), toY(y)) : context.moveTo(toX(x), toY(y))));
      context.closePath();
    }
    context.fill("nonzero");
  };
  fill(scene.map.pavements, "#22262c");
  fill(scene.map.lanes, "#2c3037");
  fill(scene.map.crosswalks, "#464b54");
  fill(scene.map.buildings, "#3a3430");
  const frame = frames[state.frame];
  if (layers.points) {
    context.fillStyle = "#5f8496";
    const { points } = frame;
    for (let k = 0; k < points.length; k += 2) {
      context.fillRect(toX(points[k] * scene.unit), toY(points[k + 1] * scene.unit), 1.2, 1.2);
    }
  }
  const outline = (boxes, k, grow = 0) => {
    const [x, y, length, width_, yaw] = [1, 2, 3, 4, 5].map((n) => boxes[k + n] * (n === 5 ? scene.turn : scene.unit));
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
    context.strokeStyle = "#969ba2";
    context.lineWidth = 1;
    for (let k = 0; k < frame.truth.length; k += BOX) {
      outline(frame.truth, k);
      context.stroke();
    }
  }
  context.font = "12px system-ui, sans-serif";
  for (const [name, x, y, riding] of scene.frames[state.frame].agents) {
    context.fillStyle = name === state.agent ? "#ffce54" : "#a98a3c";
    context.beginPath();
    context.arc(toX(x), toY(y), riding ? 4 : 6, 0, 7);
    context.fill();
    context.fillText(name, toX(x) + 8, toY(y) - 8);
  }
  if (layers.tracks) drawTracks(context, run, outline, toX, toY);
}

function drawTracks(context, run, outline, toX, toY) {
  const now = run.tracks[state.frame]?.[state.agent] ?? [];
  const trail = run.tracks.slice(Math.max(0, state.frame - Math.round(1 / scene.dt_s)), state.frame + 1);
  for (let k = 0; k < now.length; k += BOX) {
    const id = now[k];
    context.strokeStyle = context.fillStyle = trackColor(id);
    context.lineWidth = 1.5;
    context.beginPath();
    let started = false;
    for (const past of trail) {
      const boxes = past[state.agent] ?? [];
      for (let j = 0; j < boxes.length; j += BOX) {
        if (boxes[j] !== id) continue;
        const spot = [toX(boxes[j + 1] * scene.unit), toY(boxes[j + 2] * scene.unit)];
        started ? context.lineTo(...spot) : context.moveTo(...spot);
        started = true;
      }
    }
    context.stroke();
    context.lineWidth = 2;
    const [x, y] = outline(now, k, 0.15);
    context.stroke();
    if (layers.ids) context.fillText(String(id), x + 6, y - 6);
  }
}

function drawChart() {
  const canvas = document.getElementById("chart");
  const [context, width, height] = fit(canvas);
  const style = getComputedStyle(document.documentElement);
  const [left, right, top, bottom] = [44, 12, 12, 26 + 20 * Math.ceil(runs.length / Math.max(1, Math.floor(width / 190)))];
  const count = frames.length;
  const toX = (k) => left + (count < 2 ? 0 : (k / (count - 1)) * (width - left - right));
  const values = runs.flatMap((run) => run.score);
  const low = Math.min(0, ...values);
  const toY = (value) => top + ((1 - value) / (1 - low)) * (height - top - bottom);
  context.clearRect(0, 0, width, height);
  context.font = "12px system-ui, sans-serif";
  context.strokeStyle = style.getPropertyValue("--line");
  context.fillStyle = style.getPropertyValue("--dim");
  context.lineWidth = 1;
  for (let value = Math.ceil(low * 4) / 4; value <= 1.001; value += 0.25) {
    context.beginPath();
    context.moveTo(left, toY(value));
    context.lineTo(width - right, toY(value));
    context.stroke();
    context.textAlign = "right";
    context.fillText(value.toFixed(2), left - 8, toY(value) + 4);
  }
  context.textAlign = "center";
  const step = Math.max(1, Math.round(count / 10 / 10) * 10);
  for (let k = 0; k < count; k += step) context.fillText(`${(k * scene.dt_s).toFixed(1)} s`, toX(k), height - bottom + 16);
  runs.forEach((run, n) => {
    context.strokeStyle = runColor(n);
    context.lineWidth = state.shown.includes(n) ? 2.2 : 1.1;
    context.beginPath();
    run.score.forEach((value, k) => (k ? context.lineTo(toX(k), toY(value)) : context.moveTo(toX(k), toY(value))));
    context.stroke();
  });
  context.strokeStyle = style.getPropertyValue("--ink");
  context.lineWidth = 1;
  context.beginPath();
  context.moveTo(toX(state.frame), top);
  context.lineTo(toX(state.frame), height - bottom);
  context.stroke();
  context.textAlign = "left";
  const perLine = Math.max(1, Math.floor(width / 190));
  runs.forEach((run, n) => {
    const [x, y] = [left + (n % perLine) * 190, height - bottom + 36 + 20 * Math.floor(n / perLine)];
    context.fillStyle = runColor(n);
    context.fillRect(x, y - 9, 14, 4);
    context.fillStyle = style.getPropertyValue("--ink");
    context.fillText(run.label, x + 20, y);
  });
  canvas.onclick = (event) => {
    const share = (event.offsetX - left) / (width - left - right);
    go(Math.round(share * (count - 1)));
  };
}

function draw() {
  document.querySelectorAll("#panels canvas").forEach((canvas) => drawPanel(canvas, runs[state.shown[canvas.dataset.panel]]));
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
    since = now;
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
scene.agents.forEach((name) => agents.add(option(name, name, name === state.agent)));
agents.onchange = () => { state.agent = agents.value; draw(); };
document.querySelectorAll("select[data-panel]").forEach((select) => {
  const panel = Number(select.dataset.panel);
  runs.forEach((run, k) => select.add(option(run.label, k, k === state.shown[panel])));
  select.onchange = () => { state.shown[panel] = Number(select.value); draw(); };
});
document.querySelectorAll("[data-layer]").forEach((box) => {
  box.onchange = () => { layers[box.dataset.layer] = box.checked; draw(); };
});

document.querySelectorAll("#panels canvas").forEach((canvas) => {
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
