// 3-D view of scene, vehicle, plan, trail and LiDAR points, in plain WebGL 2. It draws only when something has changed.

import { css, sized } from "./charts.js";
import { Drawings, SEGMENT_FRAGMENT, SEGMENT_VERTEX } from "./drawings.js";
import { IDENTITY, cross, lookAt, minus, multiply, perspective, pose, unit } from "./matrices.js";

const MESH_VERTEX = `#version 300 es
in vec3 at; in vec4 colour; uniform mat4 world, screen; out vec3 where_; out vec4 paint;
void main() { vec4 w = world * vec4(at, 1.0); where_ = w.xyz; paint = colour; gl_Position = screen * w; }`;
const MESH_FRAGMENT = `#version 300 es
precision highp float; in vec3 where_; in vec4 paint; uniform vec3 eye, sky; out vec4 colour;
void main() {
  vec3 n = normalize(cross(dFdx(where_), dFdy(where_)));
  float light = 0.55 + 0.45 * max(0.0, dot(n, normalize(vec3(0.35, -0.5, 0.8))));
  float haze = clamp((distance(eye, where_) - 150.0) / 500.0, 0.0, 0.92);
  colour = vec4(mix(paint.rgb * light, sky, haze), 1.0);
}`;
const LINE_VERTEX = `#version 300 es
in vec3 at; uniform mat4 world, screen; uniform float size;
void main() { gl_Position = screen * world * vec4(at, 1.0); gl_Position.z -= 0.0004 * gl_Position.w; gl_PointSize = size; }`;
const LINE_FRAGMENT = `#version 300 es
precision highp float; uniform vec4 paint; out vec4 colour; void main() { colour = paint; }`;

const FOV = 0.9,
  TAP_PX = 6;

export class View3d {
  // `texts`: element over the canvas for the texts of drawings.
  constructor(canvas, note, texts) {
    this.canvas = canvas;
    this.note = note;
    this.target = [0, 0, 2];
    this.yaw = -2.2;
    this.pitch = 0.45;
    this.distance = 24;
    this.follow = true;
    this.vehicle = null;
    this.lines = new Map();
    this.dirty = false;
    this.scene = null;
    this.actors = []; // meshes of people and vehicles
    this.places = []; // place of each: x, y, z [m], yaw [rad]
    this.bodies = new Map(); // meshes by name of the vehicle; the name of the shown one is empty
    this.onTap = null; // called with the place of a tap or click, in pixels of the canvas
    this.others = {}; // pose [p, q] of each other vehicle, by name
    const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
    this.gl = gl;
    if (!gl) {
      note.textContent = "no 3-D view: WebGL 2 is off in this browser";
      return;
    }
    this.mesh = program(gl, MESH_VERTEX, MESH_FRAGMENT);
    this.line = program(gl, LINE_VERTEX, LINE_FRAGMENT);
    this.drawings = new Drawings(gl, program(gl, SEGMENT_VERTEX, SEGMENT_FRAGMENT).program, texts);
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      location.reload();
    });
    this.listen();
    new ResizeObserver(() => this.touch()).observe(canvas);
  }

  setScene(buffer) {
    const gl = this.gl;
    if (!gl) return;
    if (this.scene) {
      gl.deleteBuffer(this.scene.buffer);
      gl.deleteVertexArray(this.scene.array);
      this.scene = null;
    }
    const count = buffer.byteLength >= 4 ? new DataView(buffer).getUint32(0, true) : 0;
    if (count) this.scene = meshOf(gl, this.mesh, new Uint8Array(buffer, 4, 16 * count), count);
    for (const actor of this.actors) {
      gl.deleteBuffer(actor.buffer);
      gl.deleteVertexArray(actor.array);
    }
    this.actors = [];
    this.places = [];
    let at = 4 + 16 * count;
    const numbers = new DataView(buffer),
      actors = at + 4 <= buffer.byteLength ? numbers.getUint32(at, true) : 0;
    at += 4;
    for (let k = 0; k < actors; k++) {
      this.places.push([0, 4, 8, 12].map((offset) => numbers.getFloat32(at + offset, true)));
      const corners = numbers.getUint32(at + 16, true);
      this.actors.push(meshOf(gl, this.mesh, new Uint8Array(buffer, at + 20, 16 * corners), corners));
      at += 20 + 16 * corners;
    }
    // In an empty scene a grid makes the speed visible.
    this.setLine("grid", count < 300 ? gridLines() : [], { mode: gl.LINES, colour: "--grid", alpha: 0.35 });
    this.touch();
  }

  setVehicle(rotors, name = "") {
    if (!this.gl) return;
    const old = this.bodies.get(name);
    if (old) {
      this.gl.deleteBuffer(old.buffer);
      this.gl.deleteVertexArray(old.array);
    }
    const { bytes, count } = vehicleMesh(rotors, name ? [128, 136, 146, 255] : [255, 96, 56, 255]);
    this.bodies.set(name, meshOf(this.gl, this.mesh, bytes, count));
  }

  setOthers(poses) {
    this.others = poses;
    this.touch();
  }

  // `points`: flat list x, y, z. `at`: pose [p, q] of their frame; null: the world.
  setLine(name, points, { mode, colour, alpha = 1, size = 1, at = null } = {}) {
    const gl = this.gl;
    if (!gl) return;
    let entry = this.lines.get(name);
    if (!entry) {
      entry = { buffer: gl.createBuffer(), array: gl.createVertexArray() };
      gl.bindVertexArray(entry.array);
      gl.bindBuffer(gl.ARRAY_BUFFER, entry.buffer);
      gl.enableVertexAttribArray(this.line.at);
      gl.vertexAttribPointer(this.line.at, 3, gl.FLOAT, false, 0, 0);
      this.lines.set(name, entry);
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, entry.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, points instanceof Float32Array ? points : new Float32Array(points), gl.DYNAMIC_DRAW);
    Object.assign(entry, { count: points.length / 3, mode: mode ?? gl.LINE_STRIP, colour, alpha, size, at });
    this.touch();
  }

  // `data`: segments as panes/drawings.js reads them; `texts`: rows of point, text and colour.
  setDrawings(data, texts) {
    if (!this.gl) return;
    this.drawings.set(data, texts);
    this.touch();
  }

  setActors(places) {
    if (places && places.length === this.actors.length) this.places = places;
  }

  setPose(p, q) {
    this.vehicle = { p, q };
    if (this.follow) this.target = [...p];
    this.touch();
  }

  touch() {
    if (this.dirty || !this.gl) return;
    this.dirty = true;
    requestAnimationFrame(() => {
      this.dirty = false;
      this.draw();
    });
  }

  eye() {
    const c = Math.cos(this.pitch);
    return [
      this.target[0] + this.distance * c * Math.cos(this.yaw),
      this.target[1] + this.distance * c * Math.sin(this.yaw),
      this.target[2] + this.distance * Math.sin(this.pitch),
    ];
  }

  draw() {
    const gl = this.gl;
    if (!this.canvas.clientWidth) return;
    const ratio = sized(this.canvas);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    const sky = rgb("--sky");
    gl.clearColor(...sky, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    const eye = this.eye();
    eye[2] = Math.max(eye[2], 0.3);
    const near = Math.max(0.05, this.distance / 100);
    const screen = multiply(
      perspective(FOV, this.canvas.width / this.canvas.height, near, near * 20000),
      lookAt(
        eye,
        this.target,
        Math.abs(this.pitch) > 1.55 ? [Math.cos(this.yaw + Math.PI), Math.sin(this.yaw + Math.PI), 0] : [0, 0, 1],
      ),
    );
    gl.useProgram(this.mesh.program);
    gl.uniformMatrix4fv(this.mesh.screen, false, screen);
    gl.uniform3fv(this.mesh.eye, eye);
    gl.uniform3fv(this.mesh.sky, sky);
    const show = (mesh, world) => {
      gl.uniformMatrix4fv(this.mesh.world, false, world);
      gl.bindVertexArray(mesh.array);
      gl.drawArrays(gl.TRIANGLES, 0, mesh.count);
    };
    if (this.scene) show(this.scene, IDENTITY);
    this.actors.forEach((actor, k) => {
      const [x, y, z, yaw] = this.places[k];
      show(actor, pose([x, y, z], [Math.cos(yaw / 2), 0, 0, Math.sin(yaw / 2)]));
    });
    // Vehicles are enlarged with the distance, so that they stay visible from afar.
    const shown = this.vehicle ? { ...this.others, "": [this.vehicle.p, this.vehicle.q] } : this.others;
    for (const [name, [p, q]] of Object.entries(shown)) {
      const body = this.bodies.get(name) ?? this.bodies.get("");
      if (body) show(body, pose(p, q, Math.max(1, this.distance * 0.07)));
    }
    gl.useProgram(this.line.program);
    gl.uniformMatrix4fv(this.line.screen, false, screen);
    for (const entry of this.lines.values()) {
      if (!entry.count) continue;
      gl.uniformMatrix4fv(this.line.world, false, entry.at ? pose(...entry.at) : IDENTITY);
      gl.uniform1f(this.line.size, entry.size * ratio);
      gl.uniform4fv(this.line.paint, [...rgb(entry.colour), entry.alpha]);
      gl.bindVertexArray(entry.array);
      gl.drawArrays(entry.mode, 0, entry.count);
    }
    gl.bindVertexArray(null);
    this.drawings.draw(screen, { width: this.canvas.width, height: this.canvas.height, ratio, near, fov: FOV });
  }

  // Return east and north of the point at height `z` that is seen at a pixel of the canvas; null above the horizon.
  groundAt(x, y, z) {
    const eye = this.eye();
    eye[2] = Math.max(eye[2], 0.3);
    const forward = unit(minus(this.target, eye)),
      right = unit(cross(forward, [0, 0, 1])),
      up = cross(right, forward),
      size = Math.tan(FOV / 2);
    const across =
        (((2 * x) / this.canvas.clientWidth - 1) * size * this.canvas.clientWidth) / this.canvas.clientHeight,
      above = (1 - (2 * y) / this.canvas.clientHeight) * size;
    const ray = forward.map((v, k) => v + across * right[k] + above * up[k]);
    if (ray[2] > -1e-3) return null;
    const far = (z - eye[2]) / ray[2];
    return far > 0 ? [eye[0] + far * ray[0], eye[1] + far * ray[1]] : null;
  }

  look(yaw, pitch, distance) {
    this.yaw = yaw;
    this.pitch = pitch;
    this.distance = distance;
    this.touch();
  }

  listen() {
    const canvas = this.canvas,
      fingers = new Map();
    let spread = 0,
      moved = 0; // pixels since the first finger came down
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      spread = 0;
      moved = fingers.size > 1 ? Infinity : 0;
    });
    const up = (event) => fingers.delete(event.pointerId);
    canvas.addEventListener("pointerup", (event) => {
      up(event);
      if (moved < TAP_PX) this.onTap?.(event.offsetX, event.offsetY);
    });
    canvas.addEventListener("pointercancel", up);
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const dx = event.clientX - before[0],
        dy = event.clientY - before[1];
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      moved += Math.hypot(dx, dy);
      if (fingers.size === 2) {
        const [a, b] = [...fingers.values()],
          now = Math.hypot(a[0] - b[0], a[1] - b[1]);
        if (spread) this.distance = clamp((this.distance * spread) / now, 1, 2000);
        spread = now;
      } else if (event.buttons & 2 || event.shiftKey) {
        const forward = unit(minus(this.target, this.eye())),
          right = unit(cross(forward, [0, 0, 1])),
          over = cross(right, forward);
        const step = this.distance * 0.0018;
        this.follow = false;
        this.target = this.target.map((v, k) => v - dx * step * right[k] + dy * step * over[k]);
      } else {
        this.yaw -= dx * 0.006;
        this.pitch = clamp(this.pitch + dy * 0.006, -0.1, 1.55);
      }
      this.touch();
    });
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.distance = clamp(this.distance * Math.exp(event.deltaY * 0.001), 1, 2000);
        this.touch();
      },
      { passive: false },
    );
  }
}

function clamp(v, low, high) {
  return Math.max(low, Math.min(high, v));
}

function rgb(name) {
  const text = css(name);
  return [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16) / 255);
}

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  const names = ["world", "screen", "eye", "sky", "paint", "size"];
  return {
    program: made,
    at: gl.getAttribLocation(made, "at"),
    colour: gl.getAttribLocation(made, "colour"),
    ...Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(made, name)])),
  };
}

// 16 bytes per corner: three floats and four colour bytes.
function meshOf(gl, { at, colour }, bytes, count) {
  const array = gl.createVertexArray(),
    buffer = gl.createBuffer();
  gl.bindVertexArray(array);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
  gl.enableVertexAttribArray(at);
  gl.vertexAttribPointer(at, 3, gl.FLOAT, false, 16, 0);
  gl.enableVertexAttribArray(colour);
  gl.vertexAttribPointer(colour, 4, gl.UNSIGNED_BYTE, true, 16, 12);
  gl.bindVertexArray(null);
  return { array, buffer, count };
}

function vehicleMesh(rotors, nose) {
  const corners = [];
  const add = (points, colour) => {
    for (const p of points) corners.push([p, colour]);
  };
  const box = ([x, y, z], [a, b, c], colour) => {
    for (let axis = 0; axis < 3; axis++)
      for (const side of [-1, 1]) {
        const half = [a, b, c],
          p = (s, t) => {
            const v = [0, 0, 0];
            v[axis] = side * half[axis];
            v[(axis + 1) % 3] = s * half[(axis + 1) % 3];
            v[(axis + 2) % 3] = t * half[(axis + 2) % 3];
            return [v[0] + x, v[1] + y, v[2] + z];
          };
        const quad = [p(-1, -1), p(1, -1), p(1, 1), p(-1, -1), p(1, 1), p(-1, 1)];
        add(side > 0 ? quad : quad.reverse(), colour);
      }
  };
  const dark = [40, 46, 56, 255],
    light = [236, 240, 244, 255];
  box([0, 0, 0], [0.09, 0.06, 0.03], dark);
  box([0.1, 0, 0.01], [0.03, 0.03, 0.02], nose);
  for (const [x, y, z] of rotors) {
    for (let k = 0; k < 6; k++) box([(x * k) / 6, (y * k) / 6, (z * k) / 6], [0.012, 0.012, 0.008], dark);
    const r = 0.13,
      disc = x > 0 ? nose : light;
    for (let k = 0; k < 16; k++) {
      const a = (k / 16) * 2 * Math.PI,
        b = ((k + 1) / 16) * 2 * Math.PI,
        h = z + 0.03;
      const u = [x + r * Math.cos(a), y + r * Math.sin(a), h],
        v = [x + r * Math.cos(b), y + r * Math.sin(b), h];
      add([[x, y, h], u, v], disc);
    }
  }
  const bytes = new ArrayBuffer(corners.length * 16),
    view = new DataView(bytes);
  corners.forEach(([p, colour], k) => {
    p.forEach((v, axis) => view.setFloat32(k * 16 + axis * 4, v, true));
    colour.forEach((v, c) => view.setUint8(k * 16 + 12 + c, v));
  });
  return { bytes: new Uint8Array(bytes), count: corners.length };
}

function gridLines() {
  const points = [];
  // Short pieces, because some drivers drop a line if one of its ends is behind the eye.
  for (let k = -200; k <= 200; k += 10)
    for (let s = -200; s < 200; s += 10) points.push(k, s, 0.03, k, s + 10, 0.03, s, k, 0.03, s + 10, k, 0.03);
  return points;
}
