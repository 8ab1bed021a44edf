"use strict";

// The player of an episode in three dimensions: orange is the chosen agent and what it sees itself, blue the others and
// what it knows by their messages alone, grey what is there.
const SPACE_COLORS = {
  dark: {
    agent: "#ffb52e", connected: "#56b4e9", truth: "#aab1b9", false: "#e0704a", ink: "#e3e6ea", back: "#161b22", sky: "#0f131a",
    ground: "#1a1f25", grass: "#1a231f", yard: "#20242a", parking: "#262b32", pavement: "#242a31", road: "#303741", marking: "#59616b",
    house: "#453d37", edge: "#85786c", plant: "#2c4434", thing: "#4a515a",
  },
  light: {
    agent: "#a85400", connected: "#0f6cb0", truth: "#5c636b", false: "#b5401c", ink: "#1d2126", back: "#f3f5f5", sky: "#dbe7f0",
    ground: "#e4e8e6", grass: "#d9e4d8", yard: "#dcdedb", parking: "#cdd2d5", pavement: "#d6dadc", road: "#c3c9ce", marking: "#f6f8f8",
    house: "#e2d8ca", edge: "#8d7f6d", plant: "#a9c3a4", thing: "#a2a9af",
  },
};
const SPACE_LIGHTS = { G: "#34c759", g: "#34c759", y: "#ffbe28", r: "#eb463c" };
const SPACE_KEYS = [["agent", "the chosen agent, its points, what it sees itself"], ["connected", "connected agents, their points, what it knows by message only"], ["truth", "what is there; dashed: it has no track"], ["false", "false track: nothing is there"]];
const CUT_M = 2.2; // height to which houses are drawn from outside
const NOT_NEAR_M = 7; // false tracks nearer to the driver's eye would be bars before it
const FAR_M = 60;
const MISSED_M = 70;
const FRESH_S = 0.8; // for so long what a message has just brought is ringed
const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
const spaceViews = []; // for scripts that take pictures

class SpacePlayer {
  constructor(host, told) {
    this.world = new SpaceWorld(told);
    this.canvas = make("canvas", { tabIndex: 0 });
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", host.getAttribute("aria-label"));
    this.gl = makeSpaceGl(this.canvas);
    if (!this.gl) return;
    this.host = host;
    this.state = { frame: 0, agent: told.names.indexOf(told.agent), view: "orbit", run: told.shown, playing: false };
    this.layers = { points: true, "false tracks": true, messages: true, "follow agent": false };
    this.controls();
    host.parentElement.hidden = false;
    this.canvas.addEventListener("webglcontextlost", (event) => { event.preventDefault(); this.static = null; });
    this.canvas.addEventListener("webglcontextrestored", () => { this.gl.build(); this.prepare().then(() => this.draw()); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.prepare().then(() => this.draw()));
    new IntersectionObserver((seen, observer) => {
      if (!seen.some((each) => each.isIntersecting)) return;
      observer.disconnect();
      this.start();
    }).observe(host);
  }

  async start() {
    await this.world.load(0);
    const last = this.world.count - 1;
    await this.world.load(last);
    const [one, other] = [0, last].map((k) => this.world.known.get(k).worlds[0].bodies.find(({ agent }) => agent === this.state.agent));
    this.follow.checked = this.layers["follow agent"] = Math.hypot(other?.x - one?.x, other?.y - one?.y) > FAR_M; // else it would drive out of sight
    this.home();
    await this.prepare();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    const asked = new URLSearchParams(location.hash.slice(1));
    if (asked.has("view")) this.choose("view", asked.get("view"));
    if (this.world.names.includes(asked.get("agent"))) this.choose("agent", this.world.names.indexOf(asked.get("agent")));
    await this.go(asked.has("t") ? Math.round((Number(asked.get("t")) - this.world.start_s) / this.world.dt_s) : 0);
    spaceViews.push(this);
  }

  /** Put the meshes, which never move, on the card, and take over the colours of the page. */
  async prepare() {
    const { gl } = this;
    this.colors = SPACE_COLORS[matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"];
    const meshes = await this.world.meshes();
    this.static = meshes.map((mesh) => ({ ...mesh, array: gl.fill(gl.array("solid", mesh.corners), mesh.places) }));
    const houses = this.static.filter(({ kind }) => kind === "house");
    const edge = [...rgb(this.colors.edge), 0.35];
    this.edges = houses.map((mesh) => gl.fill(gl.array("lines"), bendsOf(mesh, edge, 1)));
    this.arrays = { lines: gl.array("lines"), mesh: gl.array("mesh"), points: gl.array("points") };
  }

  controls() {
    const { host, world, state } = this;
    const bar = make("div", { className: "space-bar" });
    const select = (name, choices, value) => {
      const box = bar.appendChild(make("label", {}, `${name} `)).appendChild(make("select", { autocomplete: "off" }));
      choices.forEach(([key, text]) => box.add(option(text, key, key === value)));
      box.onchange = () => { this.choose(name, name === "view" ? box.value : Number(box.value)); this.draw(); };
      return box;
    };
    this.button = bar.appendChild(make("button", { type: "button", onclick: () => this.toggle() }, "Play"));
    this.slider = bar.appendChild(make("input", { type: "range", min: 0, max: world.count - 1, value: 0, autocomplete: "off" }));
    this.slider.setAttribute("aria-label", "frame");
    this.slider.oninput = () => this.go(Number(this.slider.value));
    this.clock = bar.appendChild(make("output"));
    this.selects = { view: select("view", [["orbit", "from outside"], ["seat", "driver's seat"]], state.view) };
    this.selects.agent = select("agent", world.names.map((name, k) => [k, name]), state.agent);
    if (world.runs.length > 1 && !world.together) this.selects.run = select("run", world.runs.map(({ label }, k) => [k, label]), state.run);
    for (const name of Object.keys(this.layers)) {
      const box = make("input", { type: "checkbox", checked: this.layers[name], autocomplete: "off" });
      box.onchange = () => { this.layers[name] = box.checked; this.home(); this.draw(); };
      if (name === "follow agent") this.follow = box;
      bar.appendChild(make("label")).append(box, ` ${name}`);
    }
    const keys = make("div", { className: "space-keys" });
    for (const [name, text] of SPACE_KEYS) keys.appendChild(make("span", {}, text)).prepend(make("i", { className: name }));
    const stage = make("div", { className: "space-stage" });
    this.words = make("canvas", { className: "space-words" });
    this.words.setAttribute("aria-hidden", "true");
    stage.append(this.canvas, this.words);
    host.append(bar, stage, keys);
    this.steer();
  }

  choose(name, value) {
    this.state[name] = value;
    if (this.selects[name]) this.selects[name].value = value;
    if (name !== "run") this.home();
  }

  /** Stand behind the chosen agent, or sit in it. */
  home() {
    const body = this.world.known.get(this.state.frame)?.worlds[0].bodies.find((each) => each.agent === this.state.agent);
    const seat = this.state.view === "seat";
    const turn = body?.yaw ?? 0;
    const all = this.world.known.get(0).worlds[0].bodies;
    this.still = all.reduce(([x, y], each) => [x + each.x / all.length, y + each.y / all.length], [0, 0]);
    this.eye = { turn: seat ? 0 : turn + 0.5, tilt: seat ? -0.03 : -0.55, away: 62, x: 0, y: 0 };
  }

  /** Look around by mouse, one or two fingers, and keys. */
  steer() {
    const { canvas } = this;
    const touches = new Map();
    const turn = (dx, dy) => {
      const sign = this.state.view === "seat" ? 0.6 : -1;
      this.eye.turn += sign * dx * 0.006;
      this.eye.tilt = Math.min(Math.max(this.eye.tilt - Math.abs(sign) * dy * 0.005, -1.5), this.state.view === "seat" ? 0.6 : -0.04);
    };
    const shift = (dx, dy) => {
      const [cos, sin, step] = [Math.cos(this.eye.turn), Math.sin(this.eye.turn), this.eye.away / 600];
      this.eye.x += (dy * cos - dx * sin) * step;
      this.eye.y += (dy * sin + dx * cos) * step;
    };
    const zoom = (factor) => (this.eye.away = Math.min(Math.max(this.eye.away * factor, 8), 400));
    canvas.onwheel = (event) => {
      if (!event.ctrlKey) return; // a plain wheel scrolls the page
      event.preventDefault();
      zoom(Math.exp(event.deltaY / 600));
      this.draw();
    };
    canvas.onpointerdown = (event) => {
      canvas.setPointerCapture(event.pointerId);
      touches.set(event.pointerId, [event.offsetX, event.offsetY]);
    };
    canvas.onpointermove = (event) => {
      const before = touches.get(event.pointerId);
      if (!before) return;
      const now = [event.offsetX, event.offsetY];
      const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
      const other = [...touches].find(([id]) => id !== event.pointerId)?.[1];
      if (other) {
        const apart = ([x, y]) => Math.hypot(x - other[0], y - other[1]) || 1;
        zoom(apart(before) / apart(now));
        shift(dx / 2, dy / 2);
      } else if (event.shiftKey || event.buttons === 2) shift(dx, dy);
      else turn(dx, dy);
      touches.set(event.pointerId, now);
      this.draw();
    };
    canvas.onpointerup = canvas.onpointercancel = (event) => touches.delete(event.pointerId);
    canvas.oncontextmenu = (event) => event.preventDefault();
    canvas.ondblclick = () => { this.home(); this.draw(); };
    const keys = { ArrowLeft: () => turn(20, 0), ArrowRight: () => turn(-20, 0), ArrowUp: () => turn(0, 16), ArrowDown: () => turn(0, -16), "+": () => zoom(0.9), "-": () => zoom(1.1), " ": () => this.toggle() };
    canvas.onkeydown = (event) => {
      if (!(event.key in keys)) return;
      event.preventDefault();
      event.stopPropagation();
      keys[event.key]();
      this.draw();
    };
  }

  async go(frame) {
    const wanted = Math.min(Math.max(frame, 0), this.world.count - 1);
    this.state.frame = wanted;
    // Those before it say what a message has just brought.
    const first = Math.max(0, wanted - Math.ceil((MEMORY_S + FRESH_S) / this.world.dt_s));
    await Promise.all(Array.from({ length: wanted - first + 1 }, (_, k) => this.world.load(first + k)));
    if (this.state.frame === wanted) this.draw();
  }

  toggle() {
    this.state.playing = !this.state.playing;
    this.button.textContent = this.state.playing ? "Pause" : "Play";
    const [since, first] = [performance.now(), this.state.frame];
    const tick = async (now) => {
      if (!this.state.playing) return;
      const due = (first + Math.max(0, Math.floor((now - since) / 1000 / this.world.dt_s))) % this.world.count; // a slow machine leaves frames out
      if (due !== this.state.frame) await this.go(due);
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  draw() {
    const { gl: { gl }, canvas, state, world } = this;
    if (!this.static || gl.isContextLost() || !world.known.has(state.frame)) return;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width) return;
    for (const each of [canvas, this.words]) {
      if (each.width !== Math.round(width * ratio) || each.height !== Math.round(height * ratio)) Object.assign(each, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    }
    this.pen = this.words.getContext("2d");
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.pen.clearRect(0, 0, width, height);
    this.pen.font = "600 12px system-ui, sans-serif";
    gl.enable(gl.SCISSOR_TEST);
    const beside = width >= 620;
    const sides = world.together ? [0, 1].map((k) => (beside ? [(k * width) / 2, 0, width / 2, height] : [0, ((1 - k) * height) / 2, width, height / 2])) : [[0, 0, width, height]];
    sides.forEach((part, side) => {
      const [x, y, w, h] = part.map((value) => Math.round(value * ratio));
      gl.viewport(x, y, w, h);
      gl.scissor(x, y, w, h);
      this.part(part, world.together ? side : 0, world.together ? side : state.run, ratio, height);
    });
    this.slider.value = state.frame;
    this.clock.value = `${(world.start_s + state.frame * world.dt_s).toFixed(1)} s`;
  }

  /** Draw one run into a part (x, y from below, width, height) of the canvas. */
  part([left, low, width, height], world, run, ratio, whole) {
    const { gl: space, colors, state } = this;
    const { gl } = space;
    const now = this.world.known.get(state.frame).worlds[world];
    const seat = state.view === "seat";
    const me = now.bodies.find(({ agent }) => agent === state.agent);
    const camera = this.camera(me, width / height, seat);
    const paint = Object.fromEntries(Object.entries(colors).map(([name, hex]) => [name, rgb(hex)]));
    const values = { view: camera.matrix, eye: camera.eye, back: paint.back, reach: seat ? 260 : 150 + 3 * this.eye.away, sun: [0.35, -0.5, 0.79], ratio, size: [(width * ratio) / 2, (height * ratio) / 2], cut: 1e6, shaded: 0, fade: 1 };
    gl.depthMask(true);
    gl.clearColor(...paint[seat ? "sky" : "back"], 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    for (const { kind, array } of this.static) {
      const layer = this.world.kinds.indexOf(kind);
      const flat = layer < this.world.flat;
      const under = flat ? this.world.flat - layer : 0; // what is painted later is over what is painted first
      gl.polygonOffset(under, 2 * under);
      space.draw(array, { ...values, shaded: flat ? 0 : 1, cut: !seat && kind === "house" ? CUT_M : 1e6 }, [...paint[kind], 1]);
    }
    const { shapes, notes } = this.shapes(now, world, run, me, paint, seat);
    gl.polygonOffset(0, 0);
    space.draw(space.fill(this.arrays.mesh, new Float32Array(shapes.triangles)), { ...values, shaded: 1 });
    gl.disable(gl.POLYGON_OFFSET_FILL);
    for (const body of this.layers.points ? now.bodies : []) {
      const color = body === me ? paint.agent : paint.connected;
      space.draw(space.fill(this.arrays.points, body.cloud), { ...values, color, road: paint.road, size: seat ? 2.8 : 3, nearest: seat ? 4 : 0 });
    }
    gl.depthMask(false);
    if (!seat) for (const edges of this.edges) space.draw(edges, values);
    space.fill(this.arrays.lines, new Float32Array(shapes.lines));
    gl.disable(gl.DEPTH_TEST); // what is hidden shines through
    space.draw(space.fill(this.arrays.mesh, new Float32Array(shapes.ghosts)), values);
    space.draw(this.arrays.lines, { ...values, fade: seat ? 0.6 : 0.3 });
    gl.enable(gl.DEPTH_TEST);
    space.draw(this.arrays.lines, values);
    this.write([left, whole - low - height, width, height], camera.matrix, notes, run);
  }

  /** What moves, as triangles and lines, and words with their places. */
  shapes(now, world, run, me, paint, seat) {
    const { state, layers } = this;
    const [shapes, notes] = [new SpaceShapes(), []];
    const { own, missed, tracks } = this.world.knowledge(state.frame, world, run, state.agent);
    const carriers = new Map(now.bodies.filter(({ carrier }) => carrier).map((body) => [body.carrier, body]));
    for (const body of now.truth) {
      if (seat && body === own) continue;
      shapes.body(body, [...(body === own ? paint.agent : carriers.has(body) ? paint.connected : paint.truth), 1]);
    }
    for (const body of now.bodies) {
      const color = body === me ? paint.agent : paint.connected;
      if (!body.carrier) this.mast(shapes, body, color);
      if (!(seat && body === me)) notes.push([body.x, body.y, (body.carrier?.h ?? body.height) + body.z + 0.8, this.world.names[body.agent], color]);
    }
    this.bars(shapes, now.lights, paint);
    const from = me ?? { x: 0, y: 0 };
    for (const body of missed) {
      if (Math.hypot(body.x - from.x, body.y - from.y) < MISSED_M) shapes.edges(shapes.corners(body, 0.15), [...paint.truth, 0.8], 1.2, 0.6);
    }
    const fresh = this.fresh(world, run, tracks);
    for (const track of tracks) {
      if (track.state === "told") shapes.ghost(track, [...paint.connected, seat ? 0.3 : 0.14]);
      if (track.state === "false") {
        const near = seat && Math.hypot(track.x - from.x, track.y - from.y) < NOT_NEAR_M;
        const sure = 0.2 + 0.4 * Math.min(Math.max(track.sure, 0), 1);
        if (layers["false tracks"] && !near) shapes.edges(shapes.corners(track), [...paint.false, sure], 1, 0.5);
        continue;
      }
      const color = track.state === "told" ? paint.connected : paint.agent;
      shapes.edges(shapes.corners(track, 0.1), [...color, 1], track.state === "told" ? 2.4 : 1.8);
      const age = fresh.get(track.body.id);
      if (age !== undefined) shapes.ring(track, 1.5 + 4 * age, [...paint.connected, 1 - age], 3);
    }
    for (const body of now.truth) {
      if (!this.world.runs[run].conflict.includes(body.id)) continue;
      const track = tracks.find((each) => each.body === body);
      const color = !track ? paint.ink : track.state === "told" ? paint.connected : paint.agent;
      shapes.ring(body, Math.hypot(body.l, body.w) / 2 + 1, [...color, 1], 2.5);
    }
    if (layers.messages && !seat && me) {
      const share = (state.frame % 5) / 4;
      const top = (body) => [body.x, body.y, body.z + body.height];
      for (const [to, sender] of this.world.known.get(state.frame).runs[run].arrived) {
        const source = now.bodies.find(({ agent }) => agent === sender);
        if (to === state.agent && source) shapes.arc(top(source), top(me), paint.connected, share);
      }
    }
    return { shapes, notes };
  }

  /** Shares of `FRESH_S` since a message first told of a body, by its id, where that was of late. */
  fresh(world, run, tracks) {
    const told = new Map(tracks.filter(({ state }) => state === "told").map(({ body }) => [body.id, 0]));
    const frames = Math.round(FRESH_S / this.world.dt_s);
    const open = new Set(told.keys());
    for (let past = 1; past <= frames && open.size && this.world.known.has(this.state.frame - past); past++) {
      const before = this.world.knowledge(this.state.frame - past, world, run, this.state.agent).tracks;
      const known = new Set(before.filter(({ state }) => state === "told").map(({ body }) => body.id));
      for (const id of open) known.has(id) ? told.set(id, past / frames) : open.delete(id);
    }
    return new Map([...told].filter(([id]) => !open.has(id)));
  }

  mast(shapes, { x, y, z, height }, color) {
    const [middle, pole] = [Math.min(height, 12) / 2, { x, y, l: 0.22, w: 0.22, yaw: 0 }];
    if (height <= 12) shapes.block(shapes.corners({ ...pole, z: z + middle, h: 2 * middle }), [...color, 1]);
    shapes.block(shapes.corners({ ...pole, z: z + height, l: 0.9, w: 0.9, h: 0.5 }), [...color, 1]);
  }

  /** Bars at stop lines with the lights' states, and a lamp beside each, which a driver sees. */
  bars(shapes, lights, paint) {
    const [hx, hy] = this.world.home;
    [...lights].forEach((letter, k) => {
      const bar = this.world.bars[k]?.map(([x, y, z]) => [x - hx, y - hy, z + 0.03]);
      if (!bar) return;
      const color = [...rgb(SPACE_LIGHTS[letter] ?? SPACE_LIGHTS.r), 1];
      shapes.quad(bar, color);
      const [x, y, z] = bar[0];
      shapes.block(shapes.corners({ x, y, z: z + 1.3, l: 0.1, w: 0.1, h: 2.6, yaw: 0 }), [...paint.thing, 1]);
      shapes.block(shapes.corners({ x, y, z: z + 2.9, l: 0.4, w: 0.4, h: 0.7, yaw: 0 }), color);
    });
  }

  camera(me, shape, seat) {
    const { eye: at } = this;
    const [cx, cy] = me && seat ? [me.x, me.y] : me && this.layers["follow agent"] ? [me.x + at.x, me.y + at.y] : [this.still[0] + at.x, this.still[1] + at.y];
    const heading = seat && me ? me.yaw + at.turn : at.turn;
    const ahead = [Math.cos(heading) * Math.cos(at.tilt), Math.sin(heading) * Math.cos(at.tilt), Math.sin(at.tilt)];
    const ground = me?.z ?? 0;
    const eye = seat && me
      ? [cx + 0.3 * ahead[0], cy + 0.3 * ahead[1], me.z + (me.carrier ? 0.82 * me.carrier.h : me.height)]
      : [cx - ahead[0] * at.away, cy - ahead[1] * at.away, ground - ahead[2] * at.away];
    const right = [Math.sin(heading), -Math.cos(heading), 0];
    const up = [right[1] * ahead[2], -right[0] * ahead[2], right[0] * ahead[1] - right[1] * ahead[0]];
    const [focus, near, far] = [1 / Math.tan((seat ? 0.62 : 0.44) * Math.min(1, 1.2 / shape + 0.4)), seat ? 0.3 : Math.max(0.5, at.away / 40), 1200];
    const rows = [right.map((value) => (value * focus) / shape), up.map((value) => value * focus), ahead.map((value) => (value * (far + near)) / (far - near)), ahead];
    const moved = rows.map((row) => -row.reduce((sum, value, k) => sum + value * eye[k], 0));
    moved[2] -= (2 * far * near) / (far - near);
    const matrix = new Float32Array([0, 1, 2].flatMap((column) => rows.map((row) => row[column])).concat(moved));
    return { matrix, eye };
  }

  /** Names over agents, and the run's where two are side by side, on a halo. */
  write([left, top, width, height], m, notes, run) {
    const { pen, colors } = this;
    const css = (color) => `rgb(${color.map((value) => Math.round(255 * value)).join(" ")})`;
    pen.textAlign = "center";
    const taken = [];
    for (const [x, y, z, text, color] of notes) {
      const [u, v, , w] = [0, 1, 2, 3].map((row) => m[row] * x + m[4 + row] * y + m[8 + row] * z + m[12 + row]);
      if (w < 1 || w > 200 || Math.abs(u) > w || Math.abs(v) > w) continue;
      const [at, line] = [left + ((u / w + 1) * width) / 2, top + ((1 - v / w) * height) / 2];
      if (taken.some(([a, b]) => Math.abs(a - at) < 46 && Math.abs(b - line) < 13)) continue; // one over another cannot be read
      taken.push([at, line]);
      pen.fillStyle = css(color);
      writeOnHalo(pen, colors.back, text, at, line);
    }
    pen.textAlign = "left";
    pen.fillStyle = colors.ink;
    if (this.world.together) writeOnHalo(pen, colors.back, this.world.runs[run].label, left + 12, top + 20);
  }
}

new SpacePlayer(document.querySelector("[data-space]"), data.space);
