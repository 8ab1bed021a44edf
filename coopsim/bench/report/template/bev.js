"use strict";

// The bird's-eye view of all pages. Numbers come as integers in base64: `unit` metres, or `turn` radians, to the step.
const BOX = 6; // id, x, y, length, width, yaw
const TRAIL_S = 1;
const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
const boxesOf = (text) => new Int32Array(bytes(text));

const decodeScene = (scene) => ({
  ...scene,
  frames: scene.frames.map((frame) => ({
    ...frame,
    points: new Int16Array(bytes(frame.points)), // from the frame's origin
    truth: boxesOf(frame.truth),
  })),
  runs: scene.runs.map((run) => ({
    ...run,
    tracks: run.tracks.map((frame) => Object.fromEntries(Object.entries(frame).map(([name, text]) => [name, boxesOf(text)]))),
  })),
});

const percent = (share) => `${share * 100}%`;
const trackColor = (scene, id) =>
  `hsl(${((id * scene.hue_step) % 1) * 360} ${percent(scene.saturation)} ${percent(scene.lightness)})`;

function fit(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio);
  const height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [context, canvas.clientWidth, canvas.clientHeight];
}

const nice = (least) => {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((digit) => digit * power >= least * 0.999);
};

/** Draw one frame of a run as `agent` knows it: `eye` is the world's point in the middle, `span` metres the width. */
function drawFromAbove(canvas, scene, index, run, { agent, eye, span, layers }) {
  const [context, width, height] = fit(canvas);
  const scale = width / span;
  const toX = (x) => width / 2 + (x - eye[0]) * scale;
  const toY = (y) => height / 2 - (y - eye[1]) * scale;
  const spot = (boxes, k) => [toX(boxes[k + 1] * scene.unit), toY(boxes[k + 2] * scene.unit)];
  context.fillStyle = scene.colors.background;
  context.fillRect(0, 0, width, height);
  const fill = (polygons, color, edge = false) => {
    context.fillStyle = color;
    context.beginPath();
    for (const polygon of polygons) {
      polygon.forEach(([x, y], k) => (k ? context.lineTo(toX(x), toY(y)) : context.moveTo(toX(x), toY(y))));
      context.closePath();
    }
    if (edge) context.stroke(); // under all of them, so that no joint has a kerb
    context.fill("nonzero");
  };
  const { bars, ...ground } = scene.map;
  context.strokeStyle = scene.colors.kerb;
  context.lineWidth = 2;
  for (const [name, polygons] of Object.entries(ground)) fill(polygons, scene.colors[name], name === "pavements");
  const frame = scene.frames[index];
  [...frame.lights].forEach((letter, k) => fill([bars[k]], scene.colors[letter]));
  if (layers.points) {
    context.fillStyle = scene.colors.point;
    const { points, origin } = frame;
    for (let k = 0; k < points.length; k += 2) {
      context.fillRect(toX(origin[0] + points[k] * scene.unit), toY(origin[1] + points[k + 1] * scene.unit), 1.2, 1.2);
    }
  }
  const outline = (boxes, k, grow = 0, crossed = false) => {
    traceBox(context, scene, boxes, k, spot(boxes, k), scale, grow, crossed);
    context.stroke();
  };
  if (layers.truth) {
    context.strokeStyle = scene.colors.truth;
    context.lineWidth = 1;
    for (let k = 0; k < frame.truth.length; k += BOX) outline(frame.truth, k);
  }
  context.font = "12px system-ui, sans-serif";
  const write = (text, x, y) => writeOnHalo(context, scene.colors.background, text, x, y);
  context.lineWidth = 1;
  const colorOf = (name) => scene.colors[name === agent ? "agent" : "connected"];
  for (const [name, x, y, riding] of frame.agents) {
    context.fillStyle = context.strokeStyle = colorOf(name);
    const body = riding ? bodyAt(scene, frame.truth, x, y) : null;
    if (body === null) {
      context.beginPath();
      context.arc(toX(x), toY(y), riding ? 4 : 6, 0, 7);
      context.fill();
      continue;
    }
    outline(frame.truth, body);
    if (name === agent) context.fill();
  }
  if (layers.tracks) {
    drawTracks(context, scene, index, run.tracks, agent, { spot, outline, write, ids: layers.ids });
    drawNews(context, scene, frame.truth, run.news[index]?.[agent] ?? [], spot, scale);
  }
  for (const [name, x, y] of frame.agents) {
    context.fillStyle = colorOf(name);
    write(name, toX(x) + 8, toY(y) - 8);
  }
  const metres = nice(60 / scale); // the scale's bar
  context.fillStyle = scene.colors.text;
  context.fillRect(12, height - 14, metres * scale, 3);
  write(`${+metres.toPrecision(1)} m`, 12, height - 20);
}

/** Rings that spread about what a message has just told of, by ids in `news` with the share of their time that is over. */
function drawNews(context, scene, truth, news, spot, scale) {
  const ages = new Map(news);
  context.save();
  context.strokeStyle = scene.colors.connected;
  context.lineWidth = 2.5;
  for (let k = 0; k < truth.length; k += BOX) {
    const age = ages.get(truth[k]);
    if (age === undefined) continue;
    context.globalAlpha = 1 - age;
    context.beginPath();
    context.arc(...spot(truth, k), (1.5 + 4 * age) * scale, 0, 7);
    context.stroke();
  }
  context.restore();
}

/** The path of a box about a `spot` of the canvas, with a line to its front, or `crossed` out. */
function traceBox(context, scene, boxes, k, [x, y], scale, grow = 0, crossed = false) {
  const yaw = boxes[k + 5] * scene.turn;
  const [cos, sin] = [Math.cos(yaw) * scale, Math.sin(yaw) * scale];
  const [a, b] = [(boxes[k + 3] * scene.unit) / 2 + grow, (boxes[k + 4] * scene.unit) / 2 + grow];
  const corner = (u, v) => [x + u * cos - v * sin, y - u * sin - v * cos];
  context.beginPath();
  context.moveTo(...corner(a, b));
  context.lineTo(...corner(-a, b));
  context.lineTo(...corner(-a, -b));
  context.lineTo(...corner(a, -b));
  context.closePath();
  const lines = crossed ? [[a, b, -a, -b], [a, -b, -a, b]] : [[a, 0, a * 0.4, 0]];
  for (const [u, v, w, z] of lines) {
    context.moveTo(...corner(u, v));
    context.lineTo(...corner(w, z));
  }
}

const BESIDE_M = 2; // as `coopsim.viz.false_tracks` has it

/** How far a place (in steps) is outside of a box, in metres. */
function outside(scene, boxes, k, x, y) {
  const [dx, dy, yaw] = [(x - boxes[k + 1]) * scene.unit, (y - boxes[k + 2]) * scene.unit, boxes[k + 5] * scene.turn];
  const along = Math.abs(dx * Math.cos(yaw) + dy * Math.sin(yaw)) - (boxes[k + 3] * scene.unit) / 2;
  const across = Math.abs(dy * Math.cos(yaw) - dx * Math.sin(yaw)) - (boxes[k + 4] * scene.unit) / 2;
  return Math.hypot(Math.max(along, 0), Math.max(across, 0));
}

/** The place in `truth` of the body in which an agent at x, y (metres) rides; null where there is none. */
function bodyAt(scene, truth, x, y) {
  let [best, nearest] = [null, 1.5];
  for (let k = 0; k < truth.length; k += BOX) {
    const apart = Math.hypot(truth[k + 1] * scene.unit - x, truth[k + 2] * scene.unit - y);
    if (apart < nearest) [best, nearest] = [k, apart];
  }
  return best;
}

/** Whether nothing is where a track is: neither a body nor something beside one. */
function isFalse(scene, truth, boxes, k) {
  for (let j = 0; j < truth.length; j += BOX) {
    if (outside(scene, truth, j, boxes[k + 1], boxes[k + 2]) <= BESIDE_M) return false;
  }
  return true;
}

/** Tracks, each with where it was in the last second; with `ids` in the colours of their ids. False ones are crossed out. */
function drawTracks(context, scene, index, tracks, agent, { spot, outline, write, ids }) {
  const first = Math.max(0, index - Math.round(TRAIL_S / scene.dt_s));
  const now = tracks[index][agent] ?? [];
  for (let k = 0; k < now.length; k += BOX) {
    const id = now[k];
    if (isFalse(scene, scene.frames[index].truth, now, k)) {
      context.strokeStyle = context.fillStyle = scene.colors.false;
      context.lineWidth = 1;
      outline(now, k, 0, true);
      continue;
    }
    context.strokeStyle = context.fillStyle = ids ? trackColor(scene, id) : scene.colors.track;
    context.lineWidth = 1.5;
    context.beginPath();
    let started = false;
    for (let past = first; past <= index; past++) {
      const boxes = tracks[past][agent] ?? [];
      for (let j = 0; j < boxes.length; j += BOX) {
        if (boxes[j] !== id) continue;
        started ? context.lineTo(...spot(boxes, j)) : context.moveTo(...spot(boxes, j));
        started = true;
      }
    }
    context.stroke();
    context.lineWidth = 2;
    outline(now, k, 0.15);
    const [x, y] = spot(now, k);
    if (ids) write(String(id), x + 6, y - 6);
  }
}

/** Over a view from above, in the lie's colour: boxes that are claimed, filled; denied, dashed; and who lies. */
function drawLies(canvas, scene, index, { eye, span }) {
  const context = canvas.getContext("2d");
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const scale = width / span;
  const place = (x, y) => [width / 2 + (x - eye[0]) * scale, height / 2 - (y - eye[1]) * scale];
  const { claimed, denied, stated } = scene.lies[index];
  const boxes = (text, grow, draw) => {
    const rows = boxesOf(text);
    for (let k = 0; k < rows.length; k += BOX) {
      traceBox(context, scene, rows, k, place(rows[k + 1] * scene.unit, rows[k + 2] * scene.unit), scale, grow);
      draw();
    }
  };
  context.save();
  context.strokeStyle = context.fillStyle = scene.colors.lie;
  context.lineWidth = 2;
  boxes(claimed, 0.3, () => {
    context.globalAlpha = 0.35;
    context.fill();
    context.globalAlpha = 1;
    context.stroke();
  });
  context.setLineDash([4, 3]);
  boxes(denied, 0.5, () => context.stroke());
  context.setLineDash([]);
  for (const [name, x, y] of scene.frames[index].agents) {
    if (!(name in stated)) continue;
    const [at, said] = [place(x, y), stated[name] ? place(...stated[name]) : place(x, y)];
    context.beginPath();
    context.arc(...at, 9, 0, 7);
    context.moveTo(...at);
    context.lineTo(...said);
    context.moveTo(said[0] - 4, said[1] - 4);
    context.lineTo(said[0] + 4, said[1] + 4);
    context.moveTo(said[0] - 4, said[1] + 4);
    context.lineTo(said[0] + 4, said[1] - 4);
    context.stroke();
  }
  context.restore();
}

/** Over a view from above: messages that arrive, rings about what must not be touched, and a star where it was. */
function drawMarks(canvas, scene, index, { agent, eye, span }) {
  const context = canvas.getContext("2d");
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const place = (x, y) => [width / 2 + ((x - eye[0]) * width) / span, height / 2 - ((y - eye[1]) * width) / span];
  const { met, arrived, crash } = scene.marks[index];
  const spots = Object.fromEntries(scene.frames[index].agents.map(([name, x, y]) => [name, place(x, y)]));
  context.lineWidth = 2;
  context.strokeStyle = scene.colors.connected;
  for (const name of arrived) {
    context.beginPath();
    context.moveTo(...spots[name]);
    context.lineTo(...spots[agent]);
    context.stroke();
  }
  for (const [x, y, known] of met) {
    context.strokeStyle = known ? scene.colors.track : scene.colors.hidden;
    context.beginPath();
    context.arc(...place(x, y), 13, 0, 7);
    context.stroke();
  }
  if (!crash) return;
  const [x, y] = place(...scene.crash);
  context.strokeStyle = scene.colors.crash;
  context.beginPath();
  for (let k = 0; k < 20; k++) {
    const [reach, turn] = [k % 2 ? 24 : 12, (k * Math.PI) / 10];
    context.lineTo(x + reach * Math.cos(turn), y + reach * Math.sin(turn));
  }
  context.closePath();
  context.stroke();
}

/** Text on a dark halo, to be read over points and boxes. */
function writeOnHalo(context, halo, text, x, y) {
  context.save();
  context.strokeStyle = halo;
  context.lineWidth = 3;
  context.lineJoin = "round";
  context.strokeText(text, x, y);
  context.restore();
  context.fillText(text, x, y);
}
