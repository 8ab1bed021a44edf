"use strict";

// Charts in SVG. A series is a policy: its colour, dash and marker are those of `coopsim.viz.charts`.
const DASHES_OF = ["", "6 4", "2 3"];
const MARKERS = ["circle", "square", "diamond", "triangle", "down", "cross"];
const [WIDTH, HEIGHT, LEFT, TOP, BOTTOM] = [460, 300, 44, 10, 44];
let RIGHT = 14; // more where names stand at the ends of lines

const look = (k) => {
  const [color, dash, kind] = data.looks[k];
  return { color, dash: DASHES_OF[dash], marker: MARKERS[kind] };
};

/** A name on one line, or on two where its parameters begin. */
const linesOf = (name) => {
  const at = name.search(/[( ]/);
  return at > 0 ? [name.slice(0, at), name.slice(at).trim()] : [name];
};
const [MOST_LABELS, LABEL_PX] = [6, 165];
const pen = document.createElement("canvas").getContext("2d");
pen.font = "12px system-ui, sans-serif"; // as `.plot` has it
const widthOf = (names) => Math.max(...names.flatMap(linesOf).map((line) => pen.measureText(line).width)) + 12;
const fitBeside = (names) => names.length <= MOST_LABELS && widthOf(names) <= LABEL_PX;

/** Places that rise as the given ones do, and are `gap` apart: moved as little as need be. */
function spread(places, gap, low, high) {
  const order = places.map((_, k) => k).sort((a, b) => places[a] - places[b]);
  const found = [];
  let least = low;
  for (const k of order) least = (found[k] = Math.max(places[k], least)) + gap;
  let most = high;
  for (const k of order.reverse()) most = (found[k] = Math.min(found[k], most)) - gap;
  return found;
}

/** Names at the right of a chart, level with the ends of their lines or moved apart. */
function labelEnds(svg, ends) {
  const gap = Math.max(...ends.map(({ policy }) => linesOf(data.policies[policy]).length)) * 13 + 2;
  const places = spread(ends.map(({ y }) => y), gap, TOP + 6, HEIGHT - BOTTOM);
  ends.forEach(({ policy, x, y }, k) => {
    const [left, color] = [WIDTH - RIGHT + 6, look(policy).color];
    if (x < left - 14 || Math.abs(places[k] - y) > 3) {
      svg.append(element("path", { d: `M${x + 5},${y}L${left - 2},${places[k]}`, stroke: color, class: "lead" }));
    }
    const lines = linesOf(data.policies[policy]);
    const text = svg.appendChild(element("text", { x: left, y: places[k] + 4 - 6.5 * (lines.length - 1), class: "name" }));
    lines.forEach((line, n) => text.append(element("tspan", { x: left, dy: 13 * (n > 0) }, line)));
  });
}

function element(name, attributes = {}, text = null) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== null) made.textContent = text;
  return made;
}

function marker(kind, x, y, r, attributes) {
  if (kind === "circle") return element("circle", { cx: x, cy: y, r, ...attributes });
  const shapes = {
    square: [[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]],
    diamond: [[0, -1.3], [1.3, 0], [0, 1.3], [-1.3, 0]],
    triangle: [[0, -1.3], [1.2, 0.9], [-1.2, 0.9]],
    down: [[0, 1.3], [1.2, -0.9], [-1.2, -0.9]],
    cross: [[-1.2, -0.4], [-0.4, -0.4], [-0.4, -1.2], [0.4, -1.2], [0.4, -0.4], [1.2, -0.4],
            [1.2, 0.4], [0.4, 0.4], [0.4, 1.2], [-0.4, 1.2], [-0.4, 0.4], [-1.2, 0.4]],
  };
  const points = shapes[kind].map(([u, v]) => `${(x + u * r).toFixed(1)},${(y + v * r).toFixed(1)}`).join(" ");
  return element("polygon", { points, ...attributes });
}

/** Round numbers that cover a range, about `count` of them. */
function ticksOf(low, high, count = 5) {
  const step = nice((high - low) / count || 1);
  const first = Math.floor(low / step + 1e-9);
  const last = Math.ceil(high / step - 1e-9);
  return Array.from({ length: last - first + 1 }, (_, k) => +((first + k) * step).toPrecision(10));
}

/** The vertical scale: of the means, and of whiskers as far as they do not dwarf what they belong to. */
function verticalScale(points) {
  const means = points.map((point) => point.mean);
  let [low, high] = [Math.min(...means), Math.max(...means)];
  const reach = Math.max(high - low, Math.abs(high) * 0.05, 1e-9) * 0.6;
  const known = points.filter((point) => point.low !== null);
  low = Math.max(low - reach, Math.min(low, ...known.map((point) => point.low)));
  high = Math.min(high + reach, Math.max(high, ...known.map((point) => point.high)));
  const ticks = ticksOf(low, high);
  const [least, most] = [ticks[0], ticks[ticks.length - 1]];
  return { ticks, place: (value) => HEIGHT - BOTTOM - ((value - least) / (most - least || 1)) * (HEIGHT - TOP - BOTTOM) };
}

const inner = (share) => LEFT + 14 + share * (WIDTH - LEFT - RIGHT - 28);

/** The horizontal scale of an axis: even steps of its unit, or of its logarithm if it has no end ("no limit"). */
function axisScale(axis) {
  if (axis.named) return namesScale(axis.texts);
  const endless = axis.values.includes(null);
  const known = axis.values.filter((value) => value !== null);
  const of = (value) => (endless ? Math.log10(value) : value);
  const [low, high] = [of(known[0]), of(known[known.length - 1])];
  const room = endless && known.length > 1 ? 0.82 : 1;
  const share = (value) => {
    if (value === null) return 1;
    return known.length < 2 || high === low ? 0 : (room * (of(value) - low)) / (high - low);
  };
  const place = (value) => inner(share(value));
  let end = -Infinity; // labels that would run into the one before are left out
  const ticks = axis.values.flatMap((value) => {
    const text = value === null ? "no limit" : String(value);
    const [x, half] = [place(value), 4 * text.length + 3];
    if (x - half < end) return [];
    end = x + half;
    return [[x, text]];
  });
  return { place, ticks };
}

/** Names side by side, on two lines where one has no room; `half` is the room of a name to either side. */
function namesScale(texts) {
  const place = (k) => inner((k + 0.5) / texts.length);
  const half = (WIDTH - LEFT - RIGHT - 28) / texts.length / 2;
  const lines = texts.some((text) => 3.2 * text.length > half) ? 2 : 1;
  const letters = Math.floor((lines * half) / 3.2);
  const cut = (text) => (text.length > letters ? `${text.slice(0, letters - 1)}…` : text);
  return { place, ticks: texts.map((text, k) => [place(k), cut(text), k % lines]), names: true, lines };
}

/** Bytes per second by their logarithm; nothing sent has a place of its own on the left. */
function bytesScale(rates) {
  const sent = rates.filter((rate) => rate > 0);
  const start = rates.some((rate) => rate === 0) ? 0.15 : 0;
  const [least, most] = [Math.min(...sent), Math.max(...sent)];
  const digits = most / least > 200 ? [1] : [1, 2, 5];
  const round = Array.from({ length: 15 }, (_, power) => digits.map((digit) => digit * 10 ** power)).flat();
  const from = round.findLastIndex((rate) => rate <= least);
  const marks = round.slice(Math.max(from, 0), round.findIndex((rate) => rate > most) + 1);
  const [low, high] = [Math.log10(marks[0]), Math.log10(marks[marks.length - 1])];
  const place = (rate) => inner(rate > 0 ? start + ((1 - start) * (Math.log10(rate) - low)) / (high - low) : 0);
  const ticks = marks.map((rate) => [place(rate), short(rate)]);
  return start ? { place, ticks: [[place(0), "0"], ...ticks], gap: inner(start / 2) } : { place, ticks };
}

function short(value) {
  const [unit, size] = [["M", 1e6], ["k", 1e3], ["", 1]].find(([, size]) => Math.abs(value) >= size) ?? ["", 1];
  return `${+(value / size).toPrecision(3)} ${unit}`.trim();
}

/** Axes, grid and labels of a plot. */
function frameOf(horizontal, vertical, xTitle, yTitle, description) {
  const svg = element("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "plot", role: "img", "aria-label": description });
  for (const value of vertical.ticks) {
    const y = vertical.place(value);
    svg.append(element("line", { x1: LEFT, x2: WIDTH - RIGHT, y1: y, y2: y, class: "grid" }));
    svg.append(element("text", { x: LEFT - 6, y: y + 4, "text-anchor": "end" }, short(value)));
  }
  for (const [x, text, line = 0] of horizontal.ticks) {
    svg.append(element("text", { x, y: HEIGHT - BOTTOM + 16 + 14 * line, "text-anchor": "middle" }, text));
    svg.append(element("line", { x1: x, x2: x, y1: HEIGHT - BOTTOM, y2: HEIGHT - BOTTOM + 4, class: "grid" }));
  }
  if (horizontal.gap) {
    const [x, y] = [horizontal.gap, HEIGHT - BOTTOM];
    svg.append(element("path", { d: `M${x - 5},${y + 5}l4,-10m6,0l-4,10`, class: "gap" }));
  }
  if (horizontal.lines !== 2) {
    svg.append(element("text", { x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 8, "text-anchor": "middle" }, xTitle));
  }
  const middle = (TOP + HEIGHT - BOTTOM) / 2;
  svg.append(element("text", { x: 0, y: 0, "text-anchor": "middle", transform: `translate(11 ${middle}) rotate(-90)` }, yTitle));
  return svg;
}

/** A mean with its whisker, and a larger target to point at. */
function pointOf(policy, x, point, vertical, tell, small = false) {
  const { color, marker: kind } = look(policy);
  const group = element("g", small ? { opacity: 0.3 } : {});
  const y = vertical.place(point.mean);
  const cut = (value) => Math.min(Math.max(vertical.place(value), TOP - 4), HEIGHT - BOTTOM);
  if (!small && point.low !== null) {
    group.append(element("line", { x1: x, x2: x, y1: cut(point.low), y2: cut(point.high), stroke: color, class: "whisker" }));
  }
  group.append(marker(kind, x, y, small ? 2.6 : 4, { fill: color, class: "mark" }));
  const target = element("circle", { cx: x, cy: y, r: small ? 5 : 10, fill: "transparent" });
  target.onpointerenter = target.onclick = () => tell(point);
  group.append(target);
  return group;
}

/** The points that no other beats: fewer bytes and a better value. */
function frontOf(points, less) {
  const better = (a, b) => (less ? a < b : a > b);
  const front = [];
  for (const point of [...points].sort((a, b) => a.rate - b.rate || (less ? 1 : -1) * (a.mean - b.mean))) {
    if (!front.length || better(point.mean, front[front.length - 1].mean)) front.push(point);
  }
  return front;
}
