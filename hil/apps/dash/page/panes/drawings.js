// Drawings of scripts in the 3-D view: segments with a width and a colour, one instanced draw call for all, and texts.

const BYTES = 32; // of a segment: two ends [m], width (in pixels; negative: metres), four colour bytes

export const SEGMENT_VERTEX = `#version 300 es
in vec3 begin, end; in float width; in vec4 colour; uniform mat4 screen; uniform vec2 pixels; uniform float near, perMetre, ratio;
out vec4 paint;
void main() {
  vec4 a = screen * vec4(begin, 1.0), b = screen * vec4(end, 1.0);
  paint = colour;
  if (a.w < near && b.w < near) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  if (a.w < near) a = mix(a, b, (near - a.w) / (b.w - a.w));  // cut off behind the eye
  if (b.w < near) b = mix(b, a, (near - b.w) / (a.w - b.w));
  vec2 way = (b.xy / b.w - a.xy / a.w) * 0.5 * pixels;
  float length_ = length(way);
  vec2 ahead = length_ > 1e-4 ? way / length_ : vec2(1.0, 0.0);
  vec4 p = (gl_VertexID >> 1) == 0 ? a : b;
  float across = width < 0.0 ? max(-width * perMetre / p.w, 1.5 * ratio) : width * ratio;
  float along = length_ > 1e-4 ? 0.0 : across;  // a point is a square
  vec2 offset = (float(gl_VertexID & 1) - 0.5) * across * vec2(-ahead.y, ahead.x) + (float(gl_VertexID >> 1) - 0.5) * along * ahead;
  gl_Position = p + vec4(offset * 2.0 / pixels * p.w, -0.0004 * p.w, 0.0);
}`;
export const SEGMENT_FRAGMENT = `#version 300 es
precision highp float; in vec4 paint; out vec4 colour; void main() { colour = paint; }`;

export class Drawings {
  // `made`: the program of the two shaders. `box`: element over the view that holds the texts.
  constructor(gl, made, box) {
    this.gl = gl;
    this.made = made;
    this.box = box;
    this.count = 0;
    this.texts = []; // [element, x, y, z]
    this.buffer = gl.createBuffer();
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    for (const [name, size, kind, at] of [
      ["begin", 3, gl.FLOAT, 0],
      ["end", 3, gl.FLOAT, 12],
      ["width", 1, gl.FLOAT, 24],
      ["colour", 4, gl.UNSIGNED_BYTE, 28],
    ]) {
      const location = gl.getAttribLocation(made, name);
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, size, kind, kind === gl.UNSIGNED_BYTE, BYTES, at);
      gl.vertexAttribDivisor(location, 1);
    }
    gl.bindVertexArray(null);
    this.uniforms = Object.fromEntries(
      ["screen", "pixels", "near", "perMetre", "ratio"].map((name) => [name, gl.getUniformLocation(made, name)]),
    );
  }

  set(data, texts) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    this.count = Math.floor(data.byteLength / BYTES);
    this.texts = texts.map(([p, text, [r, g, b, a]]) => {
      const element = document.createElement("span");
      element.textContent = text;
      element.style.color = `rgb(${r} ${g} ${b} / ${a / 255})`;
      return [element, ...p];
    });
    this.box.replaceChildren(...this.texts.map(([element]) => element));
  }

  draw(screen, { width, height, ratio, near, fov }) {
    const gl = this.gl,
      u = this.uniforms;
    if (this.count) {
      gl.useProgram(this.made);
      gl.uniformMatrix4fv(u.screen, false, screen);
      gl.uniform2f(u.pixels, width, height);
      gl.uniform1f(u.near, near);
      gl.uniform1f(u.perMetre, height / (2 * Math.tan(fov / 2)));
      gl.uniform1f(u.ratio, ratio);
      gl.bindVertexArray(this.array);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.count);
      gl.bindVertexArray(null);
    }
    for (const [element, x, y, z] of this.texts) {
      const [cx, cy, , cw] = [0, 1, 2, 3].map(
        (r) => screen[r] * x + screen[4 + r] * y + screen[8 + r] * z + screen[12 + r],
      );
      element.hidden = cw < near;
      element.style.left = `${50 + (50 * cx) / cw}%`;
      element.style.top = `${50 - (50 * cy) / cw}%`;
    }
  }
}
