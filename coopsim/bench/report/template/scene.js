// Runs side by side from above, frame by frame, and their reward over time. In a block, so that names stay its own.
{
const scene = decodeScene({ ...data.drawing, ...data.scene });
const { frames, runs } = scene;

// Side by side: two different policies, else the first and the last run; a single run needs one panel.
const rival = runs.findIndex((run) => run.group !== runs[0].group);
const names = [...new Set(frames.flatMap((frame) => frame.agents.map(([name]) => name)))];
const state = { frame: 0, playing: false, agent: names[0], shown: [0, rival < 0 ? runs.length - 1 : rival], speed: 1 };
const layers = { points: true, truth: true, tracks: true, ids: false };
const SPAN_M = 150;
const home = () => ({ x: 0, y: 0, span: SPAN_M });
let view = home(); // of its centre: metres from the scene's home, or from the agent that it follows
const far = (frame) => Math.hypot(...frame.origin) > SPAN_M / 4;
let follow = frames.some(far); // an agent that drives away would soon be out of sight

// Colour says the policy, the dash which of its runs: runs of a policy that come out alike look alike.
const DASHES = [[], [7, 4], [2, 3], [12, 3, 2, 3]];
const runColor = (run) => look(data.policies.indexOf(run.group)).color; // as in the curves
const runDash = (run) => DASHES[runs.filter((other) => other.group === run.group).indexOf(run) % DASHES.length];

if (runs.length < 2) document.querySelector('#panels canvas[data-panel="1"]').parentElement.remove();
const panels = [...document.querySelectorAll("#panels canvas")];

/** The world's point in the middle of the panels. */
function eye() {
  const { agents, origin } = frames[state.frame];
  const [, x, y] = agents.find(([name]) => name === state.agent) ?? [null, ...origin];
  return follow ? [x + view.x, y + view.y] : [view.x, view.y];
}

const BEGINS_S = 1; // for so long trackers believe in what they could not yet check

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
  const begun = toX(Math.min(BEGINS_S / scene.dt_s, count - 1));
  context.globalAlpha = 0.1;
  context.fillRect(left, top, begun - left, height - bottom - top);
  context.globalAlpha = 1;
  context.fillText("trackers begin", left + 6, top + 12);
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
  const shown = { agent: state.agent, eye: eye(), span: view.span, layers };
  panels.forEach((canvas) => drawFromAbove(canvas, scene, state.frame, runs[state.shown[canvas.dataset.panel]], shown));
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
const moment = /^#t=([0-9.]+)$/.exec(location.hash); // a link to a moment, in seconds
go(moment ? Math.round(Number(moment[1]) / scene.dt_s) : 0);
}
