"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
const state = { metric: data.metrics[0], at: data.axes.map((axis) => axis.mildest), hidden: new Set() };
const visible = () => data.policies.map((_, k) => k).filter((k) => !state.hidden.has(k));

const make = (name, attributes = {}, text = null) => {
  const made = document.createElement(name);
  Object.assign(made, attributes);
  if (text !== null) made.textContent = text;
  return made;
};
const option = (text, value, selected) => new Option(text, value, selected, selected);

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

/** A panel per scenario, all with the same vertical scale; with one scenario, all plots stand in one grid. */
function panelsOf(title, pointsOf, draw) {
  const all = data.scenarios.map((_, scenario) => pointsOf(scenario));
  if (!all.flat().length) return;
  const plots = document.getElementById("plots");
  const alone = data.scenarios.length === 1;
  if (!alone) plots.append(make("h3", {}, title));
  const panels = (alone && plots.lastChild) || plots.appendChild(make("div", { className: "panels" }));
  const vertical = verticalScale(all.flat());
  all.forEach((points, scenario) => {
    const figure = panels.appendChild(make("figure"));
    const caption = figure.appendChild(make("figcaption"));
    caption.append(make("b", {}, alone ? title : data.scenarios[scenario]));
    const output = caption.appendChild(make("output"));
    if (points.length) figure.append(draw(points, vertical, (point) => describe(output, point), data.scenarios[scenario]));
    else caption.append(make("span", { className: "dim" }, "not run"));
  });
}

function series(svg, policy) {
  return svg.appendChild(element("g", { class: "series", "data-policy": policy }));
}

function curve(axis, free) {
  const horizontal = axisScale(axis);
  const pointsOf = (scenario) =>
    conditions
      .filter((condition) => condition.scenario === scenario && held(condition, free))
      .flatMap((condition) => visible().map((policy) => pointAt(policy, condition.k)))
      .filter((point) => point !== null);
  panelsOf(`${state.metric.name} against ${axis.title}`, pointsOf, (points, vertical, tell, scenario) => {
    const svg = frameOf(horizontal, vertical, axis.label, state.metric.name, `${state.metric.name} against ${axis.title}, ${scenario}`);
    const shown = [...new Set(points.map((point) => point.policy))];
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
    });
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
  const horizontal = bytesScale(everything.map((point) => point.rate));
  const chosen = (point) => held(data.conditions[point.condition], -1);
  panelsOf(`${state.metric.name} against bytes per second`, pointsOf, (points, vertical, tell, scenario) => {
    const description = `${state.metric.name} against bytes per second, ${scenario}`;
    const svg = frameOf(horizontal, vertical, "bytes per second that an agent broadcasts, log scale", state.metric.name, description);
    const front = frontOf(points.filter(chosen), state.metric.less);
    const steps = front.map((point, k) => {
      const [x, y] = [horizontal.place(point.rate), vertical.place(point.mean)];
      return k ? `H${x.toFixed(1)}V${y.toFixed(1)}` : `M${x.toFixed(1)},${y.toFixed(1)}`;
    });
    if (front.length) svg.append(element("path", { d: `${steps.join("")}H${WIDTH - RIGHT}`, class: "front" }));
    for (const point of [...points.filter((each) => !chosen(each)), ...points.filter(chosen)]) {
      series(svg, point.policy).append(pointOf(point.policy, horizontal.place(point.rate), point, vertical, tell, !chosen(point)));
    }
    const taken = [];
    for (const point of front.reverse()) {
      const [x, y, name] = [horizontal.place(point.rate), vertical.place(point.mean), data.policies[point.policy]];
      const late = x > WIDTH * 0.6;
      const [left, width] = [late ? x - 8 - 6.5 * name.length : x + 8, 6.5 * name.length];
      // Names that would overlap are left out; the legend has them all.
      if (taken.some(([l, w, top]) => Math.abs(top - y) < 13 && left < l + w && l < left + width)) continue;
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
  if (state.metric) data.axes.forEach(curve);
  if (state.metric && data.bytes in data.values) againstBytes();
  document.getElementById("curves").hidden = !document.getElementById("plots").childElementCount;
}

function swatch(policy) {
  const { color, dash, marker: kind } = look(policy);
  const svg = element("svg", { width: 30, height: 14, "aria-hidden": "true" });
  svg.append(element("line", { x1: 1, x2: 29, y1: 7, y2: 7, stroke: color, "stroke-width": 1.8, "stroke-dasharray": dash }));
  svg.append(marker(kind, 15, 7, 3.8, { fill: color }));
  return svg;
}

const legend = document.getElementById("legend");
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
function playing(figure, count, dt_s, show) {
  const [button, slider] = [figure.querySelector(".player button"), figure.querySelector("input")];
  let timer = null;
  slider.max = count - 1;
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
  const canvases = [...figure.querySelectorAll("canvas")];
  const seek = playing(figure, Math.max(...sides.map((side) => side.frames.length)), pair.dt_s, (wanted) => {
    canvases.forEach((canvas) => {
      const side = sides[canvas.dataset.side];
      const index = Math.min(wanted, side.frames.length - 1); // after a crash, or the episode, it stands
      const view = { agent: side.agent, eye: pair.eye ?? placeOf(side, index), span: pair.span, layers: LAYERS };
      drawFromAbove(canvas, side, index, side.runs[0].tracks, view);
      if (side.lies) drawLies(canvas, side, index, view);
      if (side.marks) drawMarks(canvas, side, index, view);
    });
    clock.value = `${(pair.start_s + wanted * pair.dt_s).toFixed(1)} s`;
  });
  figure.querySelectorAll(".moment").forEach((button) => {
    button.onclick = () => seek(Math.round((button.dataset.s - pair.start_s) / pair.dt_s));
  });
});

draw();
