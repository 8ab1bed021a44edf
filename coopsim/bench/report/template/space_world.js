"use strict";

// What a view in three dimensions shows: the numbers of the page, unpacked, and shapes made of them.
const inflated = async (text) => {
  const stream = new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Response(stream).arrayBuffer();
};

class SpaceWorld {
  constructor(told) {
    Object.assign(this, told);
    this.count = Math.max(...told.worlds.map((frames) => frames.length));
    this.loaded = new Map();
    this.known = new Map();
    this.learnt = new Map();
  }

  /** Meshes by kind, each with places (x, y, z, foot) about `home`, and the corners of its triangles. */
  async meshes() {
    return Promise.all(this.solids.map(async ([kind, vertices, faces, text]) => {
      const whole = new Int32Array(await inflated(text));
      const places = new Float32Array(4 * vertices);
      for (let column = 0; column < 4; column++) {
        for (let k = 0, at = 0; k < vertices; k++) {
          at += whole[column * vertices + k];
          places[4 * k + column] = at * this.units.length - (this.home[column] ?? 0);
        }
      }
      const corners = new Uint32Array(3 * faces);
      for (let k = 0; k < 3 * faces; k++) corners[k] = whole[4 * vertices + (k % 3) * faces + Math.floor(k / 3)];
      return { kind, places, corners };
    }));
  }

  /** Unpack a frame, of all worlds and runs; a frame is unpacked once. */
  load(index) {
    if (!this.loaded.has(index)) {
      const at = (frames) => frames[Math.min(index, frames.length - 1)];
      const worlds = Promise.all(this.worlds.map((frames) => this.world(at(frames))));
      const runs = Promise.all(this.runs.map(({ frames }) => this.run(at(frames))));
      this.loaded.set(index, Promise.all([worlds, runs]).then(([all, reported]) => {
        this.known.set(index, { worlds: all, runs: reported });
      }));
    }
    return this.loaded.get(index);
  }

  box(rows, k, width) {
    const { length, angle, score } = this.units;
    const [id, x, y, z, l, w, h, yaw, sure] = rows.subarray(k * width, (k + 1) * width);
    const [hx, hy] = this.home;
    return { id, x: x * length - hx, y: y * length - hy, z: z * length, l: l * length, w: w * length, h: h * length, yaw: yaw * angle, sure: (sure ?? 0) * score };
  }

  async world({ agents, count, lights, data: text }) {
    const buffer = await inflated(text);
    const whole = new Int32Array(buffer, 0, 5 * agents.length + 8 * count);
    const { length, angle } = this.units;
    this.home ??= [whole[0] * length, whole[1] * length];
    const truth = Array.from({ length: count }, (_, k) => ({ ...this.box(whole.subarray(5 * agents.length), k, 8), seen: new Set() }));
    let at = 4 * whole.length;
    const seen = agents.map(() => new Uint8Array(buffer, (at += count) - count, count));
    const clouds = agents.map(([, , points]) => new Uint8Array(buffer, (at += 6 * points) - 6 * points, 6 * points));
    const bodies = agents.map(([agent, rides, points], n) => {
      const [x, y, z, yaw, height] = whole.subarray(5 * n, 5 * n + 5);
      seen[n].forEach((saw, k) => saw && truth[k].seen.add(agent));
      const masks = new Uint8Array(buffer, points ? at : 0, points ? Math.ceil(points / 8) : 0);
      at += masks.length;
      const place = [x * length, y * length, z * length];
      const body = { agent, x: place[0] - this.home[0], y: place[1] - this.home[1], z: place[2], yaw: yaw * angle, height: height * length };
      const carrier = rides ? nearestTo(truth, body) : null;
      return { ...body, carrier, cloud: this.cloud(clouds[n], masks, points, body) };
    });
    return { bodies, truth, lights };
  }

  /** Points (x, y, z, whether on the ground) about `home`. */
  cloud(planes, masks, count, body) {
    const made = new Float32Array(4 * count);
    for (let column = 0; column < 3; column++) {
      const start = [body.x, body.y, body.z][column];
      for (let k = 0, at = 0; k < count; k++) {
        at = ((at + planes[column * count + k] + 256 * planes[(column + 3) * count + k]) << 16) >> 16; // wraps as int16
        made[4 * k + column] = at * this.units.cloud + start;
      }
    }
    for (let k = 0; k < count; k++) made[4 * k + 3] = (masks[k >> 3] >> (k & 7)) & 1;
    return made;
  }

  async run({ tracks, data: text, arrived }) {
    const rows = new Int32Array(await inflated(text));
    let at = 0;
    const found = tracks.map(([agent, count]) => [agent, Array.from({ length: count }, () => this.box(rows, at++, 9))]);
    return { tracks: new Map(found), arrived };
  }

  /** The frames up to `index` of the last `seconds`, the newest first, as far as they are unpacked. */
  recent(index, seconds, world, run) {
    const first = Math.max(0, index - Math.round(seconds / this.dt_s));
    const numbers = Array.from({ length: index - first + 1 }, (_, k) => index - k);
    return numbers.filter((k) => this.known.has(k)).map((k) => ({ world: this.known.get(k).worlds[world], run: this.known.get(k).runs[run] }));
  }

  /**
   * What an agent knows in a frame: its tracks, each with the body that it is on and whether it is "own", "told" or
   * "false", and the bodies without one. Told: it does not see the body, which a sender whose message came of late saw.
   */
  knowledge(index, world, run, agent) {
    const key = [index, world, run, agent].join();
    if (!this.learnt.has(key)) this.learnt.set(key, this.judge(index, world, run, agent));
    return this.learnt.get(key);
  }

  judge(index, world, run, agent) {
    const [now, ...past] = this.recent(index, MEMORY_S, world, run);
    const senders = new Set([now, ...past].flatMap((each) => each.run.arrived.filter(([to]) => to === agent).map(([, from]) => from)));
    const sawIt = new Set([now, ...past].flatMap((each) => each.world.truth.filter((body) => [...body.seen].some((name) => senders.has(name))).map(({ id }) => id)));
    const own = now.world.bodies.find((body) => body.agent === agent)?.carrier;
    now.world.bodies.forEach((body) => senders.has(body.agent) && body.carrier && sawIt.add(body.carrier.id));
    const tracks = (now.run.tracks.get(agent) ?? []).map((track) => {
      const body = nearestTo(now.world.truth, track, BESIDE_M);
      const state = !body ? "false" : !body.seen.has(agent) && sawIt.has(body.id) ? "told" : "own";
      return { ...track, body, state };
    });
    const met = new Set(tracks.map(({ body }) => body));
    const missed = now.world.truth.filter((body) => !met.has(body) && body !== own);
    return { own, missed, tracks: tracks.filter(({ body }) => !own || body !== own) };
  }
}

const MEMORY_S = 1; // for so long trackers keep what they no longer see

/** The body whose outline is nearest to a place on the ground, no farther than `reach` metres; else null. */
function nearestTo(truth, { x, y }, reach = 1.5) {
  let [best, nearest] = [null, reach];
  for (const body of truth) {
    const [dx, dy, cos, sin] = [x - body.x, y - body.y, Math.cos(body.yaw), Math.sin(body.yaw)];
    const apart = Math.hypot(Math.max(Math.abs(dx * cos + dy * sin) - body.l / 2, 0), Math.max(Math.abs(dy * cos - dx * sin) - body.w / 2, 0));
    // Of several that overlap the place, the one with the nearest middle.
    const rank = apart + 1e-3 * Math.hypot(dx, dy);
    if (apart <= reach && rank < (best === null ? Infinity : nearest)) [best, nearest] = [body, rank];
  }
  return best;
}

/** Triangles and lines of a frame, gathered as plain numbers. */
class SpaceShapes {
  constructor() {
    this.lines = [];
    this.triangles = [];
    this.ghosts = [];
  }

  line(a, b, color, width, dash = 0) {
    this.lines.push(...a, ...b, ...color, width, dash);
  }

  /** Corners of an upright box: below and then above, counter-clockwise; `lo` and `hi` are shares of its height. */
  corners({ x, y, z, l, w, h, yaw }, grow = 0, lo = 0, hi = 1, from = -1, to = 1, slim = 1) {
    const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
    const at = (u, v, t) => {
      const [a, b] = [(u * l) / 2 + Math.sign(u) * grow, v * ((slim * w) / 2 + grow)];
      return [x + a * cos - b * sin, y + a * sin + b * cos, z + (t - 0.5) * h];
    };
    return [lo, hi].flatMap((t) => [at(to, 1, t), at(from, 1, t), at(from, -1, t), at(to, -1, t)]);
  }

  edges(corners, color, width, dash = 0) {
    for (let k = 0; k < 4; k++) {
      const next = (k + 1) % 4;
      this.line(corners[k], corners[next], color, width, dash);
      this.line(corners[k + 4], corners[next + 4], color, width, dash);
      this.line(corners[k], corners[k + 4], color, width, dash);
    }
  }

  block(corners, color, into = this.triangles) {
    for (const [a, b, c, d] of [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]) {
      for (const k of [a, b, c, a, c, d]) into.push(...corners[k], -1e4, ...color);
    }
  }

  /** A box that shines through all that stands before it. */
  ghost(box, color) {
    this.block(this.corners(box), color, this.ghosts);
  }

  quad(corners, color) {
    for (const k of [0, 1, 2, 0, 2, 3]) this.triangles.push(...corners[k], -1e4, ...color);
  }

  /** A body: a car of two blocks, a person of two, anything else of one. */
  body(box, color) {
    if (box.l > 3 && box.l < 6.2 && box.h < 2.4) {
      this.block(this.corners(box, 0, 0.12, 0.58), color);
      this.block(this.corners(box, 0, 0.58, 1, -0.72, 0.3, 0.86), color);
    } else if (box.h > 1.2 && box.l < 1.3) {
      this.block(this.corners(box, 0, 0, 0.82, -0.7, 0.7, 0.8), color);
      this.block(this.corners(box, 0, 0.84, 1, -0.3, 0.3, 0.4), color);
    } else this.block(this.corners(box, 0, 0.06, 1), color);
  }

  ring({ x, y, z, h }, radius, color, width) {
    const at = (k) => [x + radius * Math.cos((k * Math.PI) / 16), y + radius * Math.sin((k * Math.PI) / 16), z - h / 2 + 0.15];
    for (let k = 0; k < 32; k++) this.line(at(k), at(k + 1), color, width);
  }

  /** A message's way, with a light that runs along it: `share` of the way. */
  arc(a, b, color, share) {
    const rise = 1 + 0.07 * Math.hypot(b[0] - a[0], b[1] - a[1]);
    const at = (t) => [0, 1, 2].map((k) => a[k] + (b[k] - a[k]) * t + (k === 2 ? 4 * rise * t * (1 - t) : 0));
    for (let k = 0; k < 24; k++) {
      const glow = Math.exp(-((7 * (k / 24 - share)) ** 2));
      this.line(at(k / 24), at((k + 1) / 24), [...color, 0.35 + 0.65 * glow], 1.4 + 2.2 * glow);
    }
  }
}

/** The edges of a mesh at which its faces bend, as lines. */
function bendsOf({ places, corners }, color, width) {
  const shapes = new SpaceShapes();
  const edges = new Map();
  const point = (k) => [places[4 * k], places[4 * k + 1], places[4 * k + 2]];
  for (let k = 0; k < corners.length; k += 3) {
    const [a, b, c] = [0, 1, 2].map((n) => point(corners[k + n]));
    const [u, v] = [[0, 1, 2].map((n) => b[n] - a[n]), [0, 1, 2].map((n) => c[n] - a[n])];
    const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const size = Math.hypot(...normal) || 1;
    for (const [from, to] of [[a, b], [b, c], [c, a]]) {
      const key = [from, to].map((each) => each.map((value) => Math.round(50 * value)).join()).sort().join(";");
      const known = edges.get(key);
      if (!known) edges.set(key, { from, to, normal, size, bent: true });
      else known.bent = normal.reduce((sum, value, n) => sum + value * known.normal[n], 0) / size / known.size < 0.9;
    }
  }
  for (const { from, to, bent } of edges.values()) if (bent) shapes.line(from, to, color, width);
  return new Float32Array(shapes.lines);
}
