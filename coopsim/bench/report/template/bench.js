"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
if (data.pooled) { // the mean over all scenarios stands before them
  data.scenarios.unshift(data.pooled.name);
  data.conditions.forEach((condition) => (condition.scenario += 1));
  data.conditions.unshift(...data.pooled.at.map((at) => ({ scenario: 0, at })));
  for (const [name, rows] of Object.entries(data.values)) rows.forEach((row, k) => row.unshift(...data.pooled.values[name][k]));
}
const state = { metric: data.metrics[0], at: data.axes.map((axis) => axis.mildest), hidden: new Set() };
const visible = () => data.policies.map((_, k) => k).filter((k) => !state.hidden.has(k));

const make = (name, attributes = {}, text = null) => {
  const made = document.createElement(name);
  Object.assign(made, attributes);
  if (text !== null) made.textContent = text;
  return made;
};
const option = (text, value, selected) => new Option(text, value, selected, selected);

/** Whether names stand at the ends of lines, in place of a legend. */
const labelled = () => fitBeside(data.policies);

/** Mean and interval of a policy in a condition; null where there is none. */
function pointAt(policy, condition) {
  const [mean, low, high] = data.values[state.metric.name][policy][condition];
  return mean === null ? null : { policy, condition, mean, low, high };
}

const conditions = data.conditions.map((condition, k) => ({ ...condition, k }));
const held = (condition, free) => condition.at.every((value, axis) => axis === free || value === state.at[axis]);
const whereText = (condition) =>
  data.axes.map((axis, k) => `${axis.title} ${axis.texts[condition.at[k]]}`).join(", ");

function describe(output, point) {
  const { policy, condition, mean, low, high, rate } = point;
  const interval = low === null ? "" : ` (${+low.toPrecision(3)} to ${+high.toPrecision(3)})`;
  const parts = [data.policies[policy], whereText(data.conditions[condition]), rate === undefined ? "" : `${Math.round(rate)} bytes/s`];
  output.value = `${parts.filter((part) => part).join(", ")}: ${+mean.toPrecision(4)}${interval}`;
}

const each = document.getElementById("each");
let later = []; // what draws the charts of each scenario, when they are asked for

function panel(panels, title, points, vertical, draw, scenario) {
  const figure = panels.appendChild(make("figure"));
  const caption = figure.appendChild(make("figcaption"));
  caption.append(make("b", {}, title));
  const output = caption.appendChild(make("output"));
  if (points.length) figure.append(draw(points, vertical, (point) => describe(output, point), scenario));
  else caption.append(make("span", { className: "dim" }, "not run"));
}

/** A chart over all scenarios, and later one of each of them, with a vertical scale of their own. */
function panelsOf(title, pointsOf, draw) {
  const plots = document.getElementById("plots");
  const panels = plots.lastChild ?? plots.appendChild(make("div", { className: "panels" }));
  const points = pointsOf(0);
  if (points.length) panel(panels, title, points, verticalScale(points), draw, data.scenarios[0]);
  if (!data.pooled) return;
  later.push(() => {
    const all = data.scenarios.map((_, scenario) => pointsOf(scenario)).slice(1);
    if (!all.flat().length) return;
    each.append(make("h3", {}, title));
    const row = each.appendChild(make("div", { className: "panels" }));
    const vertical = verticalScale(all.flat());
    all.forEach((points, k) => panel(row, data.scenarios[k + 1], points, vertical, draw, data.scenarios[k + 1]));
  });
}

function drawEach() {
  if (!each.open) return;
  later.forEach((draws) => draws());
  later = [];
}
each.ontoggle = drawEach;

/** A chart in words: the values of each policy from left to right. */
const inWords = (title, points) =>
  [...new Set(points.map(({ policy }) => policy))].reduce((text, policy) => {
    const values = points.filter((point) => point.policy === policy).map(({ mean }) => +mean.toPrecision(3));
    return `${text} ${data.policies[policy]}: ${values.join(", ")}.`;
  }, `${title}.`);

function series(svg, policy) {
  return svg.appendChild(element("g", { class: "series", "data-policy": policy }));
}

function curve(axis, free) {
  RIGHT = labelled() ? widthOf(data.policies) : 14;
  const horizontal = axisScale(axis);
  const pointsOf = (scenario) =>
    conditions
      .filter((condition) => condition.scenario === scenario && held(condition, free))
      .flatMap((condition) => visible().map((policy) => pointAt(policy, condition.k)))
      .filter((point) => point !== null);
  panelsOf(`${state.metric.name} against ${axis.title}`, pointsOf, (points, vertical, tell, scenario) => {
    const words = inWords(`${state.metric.name} against ${axis.title}, ${scenario}`, points);
    const svg = frameOf(horizontal, vertical, axis.label, state.metric.name, words);
    const shown = [...new Set(points.map((point) => point.policy))];
    const ends = [];
    shown.forEach((policy, n) => {
      // Side by side by a pixel or two, so that whiskers do not hide each other.
      const shift = (n - (shown.length - 1) / 2) * Math.min(3, 14 / shown.length);
      const xOf = (point) => horizontal.place(axis.values[data.conditions[point.condition].at[free]]) + shift;
      const mine = points.filter((point) => point.policy === policy).sort((a, b) => xOf(a) - xOf(b));
      const group = series(svg, policy);
      const { color, dash } = look(policy);
      const line = mine.map((point) => `${xOf(point).toFixed(1)},${vertical.place(point.mean).toFixed(1)}`).join(" ");
      if (!axis.named) group.append(element("polyline", { points: line, fill: "none", stroke: color, "stroke-width": 1.8, "stroke-dasharray": dash }));
      for (const point of mine) group.append(pointOf(policy, xOf(point), point, vertical, tell));
      const last = mine[mine.length - 1];
      ends.push({ policy, x: xOf(last), y: vertical.place(last.mean) });
    });
    if (RIGHT > 14) labelEnds(svg, ends);
    return svg;
  });
}

function againstBytes() {
  const rates = data.values[data.bytes];
  const rateOf = (point) => rates[point.policy][point.condition][0];
  const pointsOf = (scenario) =>
    conditions
      .filter((condition) => condition.scenario === scenario)
      .flatMap((condition) => visible().map((policy) => pointAt(policy, condition.k)))
      .filter((point) => point !== null && rateOf(point) !== null)
      .map((point) => ({ ...point, rate: rateOf(point) }));
  const everything = data.scenarios.flatMap((_, scenario) => pointsOf(scenario));
  if (!everything.some((point) => point.rate > 0)) return;
  RIGHT = 14;
  const horizontal = bytesScale(everything.map((point) => point.rate));
  const chosen = (point) => held(data.conditions[point.condition], -1);
  panelsOf(`${state.metric.name} against bytes per second`, pointsOf, (points, vertical, tell, scenario) => {
    const words = inWords(`${state.metric.name} against bytes per second, ${scenario}`, points.filter(chosen));
    const svg = frameOf(horizontal, vertical, "bytes per second that an agent broadcasts, log scale", state.metric.name, words);
    const competing = points.filter((point) => chosen(point) && !data.bounds.includes(point.policy));
    const front = frontOf(competing, state.metric.less);
    const steps = front.map((point, k) => {
      const [x, y] = [horizontal.place(point.rate), vertical.place(point.mean)];
      return k ? `H${x.toFixed(1)}V${y.toFixed(1)}` : `M${x.toFixed(1)},${y.toFixed(1)}`;
    });
    if (front.length) svg.append(element("path", { d: `${steps.join("")}H${WIDTH - RIGHT}`, class: "front" }));
    for (const point of [...points.filter((each) => !chosen(each)), ...points.filter(chosen)]) {
      series(svg, point.policy).append(pointOf(point.policy, horizontal.place(point.rate), point, vertical, tell, !chosen(point)));
    }
    const taken = [];
    const named = labelled() ? points.filter((point) => chosen(point) && !front.includes(point)) : [];
    for (const point of [...front.reverse(), ...named]) {
      const [x, y, name] = [horizontal.place(point.rate), vertical.place(point.mean), data.policies[point.policy]];
      const width = 6.5 * name.length;
      const late = x + 8 + width > WIDTH - 4;
      const left = late ? x - 8 - width : x + 8;
      // Names that would overlap, or have no room, are left out; the legend has them all.
      if (left < LEFT || taken.some(([l, w, top]) => Math.abs(top - y) < 13 && left < l + w && l < left + width)) continue;
      taken.push([left, width, y]);
      const text = { x: x + (late ? -8 : 8), y: y - 7, "text-anchor": late ? "end" : "start", class: "name" };
      svg.append(element("text", text, name));
    }
    return svg;
  });
}

function draw() {
  document.querySelectorAll("[data-metric]").forEach((part) => (part.hidden = part.dataset.metric !== state.metric?.name));
  document.getElementById("plots").replaceChildren();
  each.replaceChildren(...[...each.children].slice(0, 1)); // its summary
  later = [];
  if (state.metric) data.axes.forEach(curve);
  if (state.metric && data.bytes in data.values) againstBytes();
  document.getElementById("curves").hidden = !document.querySelector("#plots figure");
  drawEach();
}

function swatch(policy) {
  const { color, dash, marker: kind } = look(policy);
  const svg = element("svg", { width: 30, height: 14, "aria-hidden": "true" });
  svg.append(element("line", { x1: 1, x2: 29, y1: 7, y2: 7, stroke: color, "stroke-width": 1.8, "stroke-dasharray": dash }));
  svg.append(marker(kind, 15, 7, 3.8, { fill: color }));
  return svg;
}

const legend = document.getElementById("legend");
legend.hidden = labelled();
each.hidden = !data.pooled;
data.policies.forEach((name, k) => {
  const button = legend.appendChild(make("button", { type: "button" }));
  button.append(swatch(k), name);
  button.setAttribute("aria-pressed", "true");
  const fade = (on) =>
    document.querySelectorAll(".series").forEach((each) => each.classList.toggle("faded", on && each.dataset.policy !== String(k)));
  button.onpointerenter = () => fade(!state.hidden.has(k));
  button.onpointerleave = () => fade(false);
  button.onclick = () => {
    state.hidden.has(k) ? state.hidden.delete(k) : state.hidden.add(k);
    button.setAttribute("aria-pressed", String(!state.hidden.has(k)));
    draw();
  };
});

const metricChoice = document.getElementById("metric");
data.metrics.forEach(({ name, less }, k) => metricChoice.add(option(less ? `${name} (less is better)` : name, k, k === 0)));
metricChoice.onchange = () => { state.metric = data.metrics[Number(metricChoice.value)]; draw(); };

data.axes.forEach((axis, k) => {
  const choice = make("select", { autocomplete: "off" });
  axis.texts.forEach((text, n) => choice.add(option(text, n, n === state.at[k])));
  choice.onchange = () => { state.at[k] = Number(choice.value); draw(); };
  const label = make("label", {}, `at ${axis.title} `);
  label.append(choice);
  document.getElementById("held").append(label);
});

document.querySelectorAll("table.sortable").forEach((table) => {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = head.querySelector("button");
    if (!button) return;
    button.onclick = () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const key = (line) => {
        const { dataset, textContent } = line.cells[column];
        return dataset.key === undefined ? textContent : dataset.key === "" ? null : Number(dataset.key);
      };
      const order = (a, b) => (typeof a === "string" ? a.localeCompare(b) : a - b) * (down ? -1 : 1);
      const lines = [...table.tBodies[0].rows].map((line) => [key(line), line]);
      // Rows without a value stay below, in either order.
      lines.sort(([a], [b]) => (a === null || b === null ? (a === null) - (b === null) : order(a, b)));
      table.tBodies[0].append(...lines.map(([, line]) => line));
    };
  });
});

/** Let a figure's slider and button play `count` frames; returns what shows one. */
function playing(figure, count, dt_s, show, first = 0) {
  const [button, slider] = [figure.querySelector(".player button"), figure.querySelector("input")];
  let timer = null;
  slider.max = count - 1;
  slider.value = first;
  const seek = (index) => { slider.value = index; show(Number(slider.value)); };
  button.onclick = () => {
    button.textContent = timer === null ? "Pause" : "Play";
    clearInterval(timer);
    timer = timer !== null ? null : setInterval(() => seek((Number(slider.value) + 1) % count), dt_s * 1000);
  };
  slider.oninput = () => show(Number(slider.value));
  new ResizeObserver(() => show(Number(slider.value))).observe(figure);
  return seek;
}
const LAYERS = { points: true, truth: true, tracks: true, ids: false };

/** The place of a scene's agent in a frame, or the middle of all where it is gone. */
function placeOf({ frames, agent }, index) {
  const { agents, origin } = frames[index];
  return (agents.find(([name]) => name === agent) ?? [null, ...origin]).slice(1, 3);
}

document.querySelectorAll("[data-pair]").forEach((figure) => {
  const pair = data.pairs[figure.dataset.pair];
  const sides = pair.sides.map((side) => decodeScene({ ...data.drawing, ...pair, ...side }));
  const clock = figure.querySelector("output");
  const frameAt = (button) => Math.round((button.dataset.s - pair.start_s) / pair.dt_s);
  const moments = [...figure.querySelectorAll(".pair > :first-child .moment")].map(frameAt); // the last tells most
  const canvases = [...figure.querySelectorAll("canvas")];
  const seek = playing(figure, Math.max(...sides.map((side) => side.frames.length)), pair.dt_s, (wanted) => {
    canvases.forEach((canvas) => {
      const side = sides[canvas.dataset.side];
      const index = Math.min(wanted, side.frames.length - 1); // after a crash, or the episode, it stands
      const view = { agent: side.agent, eye: pair.eye ?? placeOf(side, index), span: pair.span, layers: LAYERS };
      drawFromAbove(canvas, side, index, side.runs[0], view);
      if (side.lies) drawLies(canvas, side, index, view);
      if (side.marks) drawMarks(canvas, side, index, view);
    });
    clock.value = `${(pair.start_s + wanted * pair.dt_s).toFixed(1)} s`;
  }, Math.max(0, ...moments));
  figure.querySelectorAll(".moment").forEach((button) => {
    button.onclick = () => seek(frameAt(button));
  });
});

draw();
