"use strict";

// Drawing in three dimensions with plain WebGL2: meshes, points, and lines that are some pixels wide.
const SPACE_SHADERS = {
  mesh: [`
    uniform mat4 view; uniform float cut; // what stands up is cut at this height over its own foot
    in vec4 place; in vec4 paint; // x, y, z, and the foot's z
    out vec3 spot; out vec4 shown; out float far;
    void main() {
      spot = vec3(place.xy, min(place.z, place.w + cut));
      shown = paint;
      gl_Position = view * vec4(spot, 1.0);
      far = gl_Position.w;
    }`, `
    uniform vec3 back; uniform float shaded, reach; uniform vec3 sun;
    in vec3 spot; in vec4 shown; in float far;
    void main() {
      vec3 side = normalize(cross(dFdx(spot), dFdy(spot)));
      float light = mix(1.0, 0.82 + 0.18 * dot(side, sun), shaded);
      pixel = vec4(mix(shown.rgb * light, back, smoothstep(0.35 * reach, reach, far)), shown.a);
    }`],
  points: [`
    uniform mat4 view; uniform vec3 eye, color, road; uniform float size, nearest, reach, ratio;
    in vec4 place; // x, y, z, and whether it is on the ground
    out vec3 shown; out float far;
    void main() {
      vec3 spot = place.xyz + vec3(0.0, 0.0, 0.12 * place.w); // over the ground, not in it
      gl_Position = distance(spot, eye) < nearest ? vec4(2.0, 2.0, 2.0, 1.0) : view * vec4(spot, 1.0);
      far = smoothstep(0.4 * reach, reach, gl_Position.w);
      gl_PointSize = ratio * clamp(size * 42.0 / gl_Position.w, 1.5, size);
      shown = mix(color, road, 0.5 * place.w);
    }`, `
    uniform vec3 back;
    in vec3 shown; in float far;
    void main() {
      vec2 off = gl_PointCoord - 0.5;
      if (dot(off, off) > 0.25) discard; // round
      pixel = vec4(mix(shown, back, far), 1.0);
    }`],
  lines: [`
    uniform mat4 view; uniform vec2 size; uniform float reach, fade, ratio;
    in vec2 corner; in vec3 from, to; in vec4 paint; in vec2 style; // width in px, length of a dash in m
    out vec4 shown; out float along; out float dash;
    void main() {
      vec4 a = view * vec4(from, 1.0), b = view * vec4(to, 1.0);
      const float LEAST = 0.1; // behind the eye there is nothing to divide by
      if (a.w < LEAST && b.w < LEAST) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
      if (a.w < LEAST) a = mix(a, b, (LEAST - a.w) / (b.w - a.w));
      else if (b.w < LEAST) b = mix(b, a, (LEAST - b.w) / (a.w - b.w));
      vec2 ahead = b.xy / b.w * size - a.xy / a.w * size;
      ahead = length(ahead) > 1e-4 ? normalize(ahead) : vec2(1.0, 0.0);
      gl_Position = mix(a, b, corner.x);
      gl_Position.xy += vec2(-ahead.y, ahead.x) * corner.y * style.x * ratio * gl_Position.w / size;
      along = corner.x * distance(from, to);
      dash = style.y;
      shown = vec4(paint.rgb, paint.a * fade * (1.0 - smoothstep(0.4 * reach, reach, gl_Position.w)));
    }`, `
    in vec4 shown; in float along; in float dash;
    void main() {
      if (dash > 0.0 && fract(along / dash) > 0.55) discard;
      pixel = shown;
    }`],
};

/** Columns of an array for a program's inputs, by name: their number of floats. */
const SPACE_COLUMNS = {
  solid: { place: 4 },
  mesh: { place: 4, paint: 4 },
  points: { place: 4 },
  lines: { from: 3, to: 3, paint: 4, style: 2 },
};

/** What draws on a canvas; null where the browser has no WebGL2, or draws none. */
function makeSpaceGl(canvas) {
  const probe = document.createElement("canvas").getContext("webgl2");
  if (!probe) return null;
  const soft = /swiftshader|llvmpipe|software/i.test(String(probe.getParameter((probe.getExtension("WEBGL_debug_renderer_info") ?? { UNMASKED_RENDERER_WEBGL: probe.RENDERER }).UNMASKED_RENDERER_WEBGL)));
  probe.getExtension("WEBGL_lose_context")?.loseContext();
  // Smooth edges take a processor twice as long.
  const gl = canvas.getContext("webgl2", { antialias: !soft, alpha: false });
  return gl && new SpaceGl(gl);
}

class SpaceGl {
  constructor(gl) {
    this.gl = gl;
    this.build();
  }

  /** Make everything that a lost context takes away. */
  build() {
    const { gl } = this;
    this.programs = {};
    for (const [name, [vertex, fragment]] of Object.entries(SPACE_SHADERS)) {
      const program = gl.createProgram();
      for (const [kind, text, out] of [[gl.VERTEX_SHADER, vertex, ""], [gl.FRAGMENT_SHADER, fragment, "out vec4 pixel;"]]) {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, `#version 300 es\nprecision highp float;\n${out}${text}`);
        gl.compileShader(shader);
        gl.attachShader(program, shader);
      }
      gl.linkProgram(program);
      if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
        throw new Error(`${name}: ${gl.getProgramInfoLog(program)}`);
      }
      const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
      const uniforms = Array.from({ length: count }, (_, k) => gl.getActiveUniform(program, k));
      this.programs[name] = {
        program,
        uniforms: uniforms.map(({ name: uniform, type }) => [uniform, type, gl.getUniformLocation(program, uniform)]),
      };
    }
    this.quad = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.quad);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, -0.5, 0, 0.5, 1, -0.5, 1, 0.5]), gl.STATIC_DRAW);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthFunc(gl.LEQUAL);
  }

  /** An array on the card: `kind` names its columns, `faces` are corners of triangles in it. */
  array(kind, faces = null) {
    const { gl } = this;
    const [program, instanced] = [kind === "solid" ? "mesh" : kind, kind === "lines"];
    const made = { program, instanced, vertices: gl.createVertexArray(), buffer: gl.createBuffer(), count: 0, faces: faces !== null };
    made.stride = Object.values(SPACE_COLUMNS[kind]).reduce((sum, width) => sum + width, 0);
    gl.bindVertexArray(made.vertices);
    const enable = (name, width, stride, offset, divisor) => {
      const place = gl.getAttribLocation(this.programs[program].program, name);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, width, gl.FLOAT, false, 4 * stride, 4 * offset);
      gl.vertexAttribDivisor(place, divisor);
    };
    if (instanced) {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.quad);
      enable("corner", 2, 2, 0, 0);
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, made.buffer);
    let offset = 0;
    for (const [name, width] of Object.entries(SPACE_COLUMNS[kind])) {
      enable(name, width, made.stride, offset, instanced ? 1 : 0);
      offset += width;
    }
    if (faces) {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
      made.count = faces.length;
    }
    gl.bindVertexArray(null);
    return made;
  }

  fill(array, floats) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, array.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, floats, gl.DYNAMIC_DRAW);
    if (!array.faces) array.count = floats.length / array.stride;
    return array;
  }

  /** Draw an array with uniforms by name; `paint` is the colour of one that has no column of colours. */
  draw(array, values, paint = null) {
    const { gl } = this;
    if (!array.count) return;
    const { program, uniforms } = this.programs[array.program];
    gl.useProgram(program);
    for (const [name, type, place] of uniforms) {
      const value = values[name];
      if (type === gl.FLOAT_MAT4) gl.uniformMatrix4fv(place, false, value);
      else if (type === gl.FLOAT_VEC3) gl.uniform3fv(place, value);
      else if (type === gl.FLOAT_VEC2) gl.uniform2fv(place, value);
      else gl.uniform1f(place, value);
    }
    gl.bindVertexArray(array.vertices);
    if (paint) gl.vertexAttrib4f(gl.getAttribLocation(program, "paint"), ...paint);
    if (array.instanced) gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, array.count);
    else if (array.faces) gl.drawElements(gl.TRIANGLES, array.count, gl.UNSIGNED_INT, 0);
    else gl.drawArrays(array.program === "points" ? gl.POINTS : gl.TRIANGLES, 0, array.count);
    gl.bindVertexArray(null);
  }
}
