// 4 x 4 matrices in the column-major order of WebGL, and rotations from quaternions w-x-y-z. The world's z axis is up.

export function multiply(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++)
    for (let r = 0; r < 4; r++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[k * 4 + r] * b[c * 4 + k];
      out[c * 4 + r] = sum;
    }
  return out;
}

export function perspective(fovRad, aspect, near, far) {
  const f = 1 / Math.tan(fovRad / 2),
    d = 1 / (near - far);
  return new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) * d, -1, 0, 0, 2 * far * near * d, 0]);
}

export function lookAt(eye, target, up) {
  const z = unit(minus(eye, target)),
    x = unit(cross(up, z)),
    y = cross(z, x);
  return new Float32Array([
    x[0],
    y[0],
    z[0],
    0,
    x[1],
    y[1],
    z[1],
    0,
    x[2],
    y[2],
    z[2],
    0,
    -dot(x, eye),
    -dot(y, eye),
    -dot(z, eye),
    1,
  ]);
}

export function pose(p, q, scale = 1) {
  const [x, y, z] = rotation(q).map((column) => column.map((v) => v * scale));
  return new Float32Array([...x, 0, ...y, 0, ...z, 0, ...p, 1]);
}

// The axes of the rotated frame, as three columns.
export function rotation([w, x, y, z]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
    [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
    [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
  ];
}

// Roll, pitch (nose up positive) and heading (clockwise from north) [rad] of a body with x forward, y left, z up.
export function attitude(q) {
  const [x, y, z] = rotation(q);
  return {
    roll: Math.atan2(y[2], z[2]),
    pitch: Math.asin(Math.max(-1, Math.min(1, x[2]))),
    heading: Math.atan2(x[0], x[1]),
  };
}

export const IDENTITY = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
export function minus(a, b) {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}
export function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
export function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}
export function unit(a) {
  const n = Math.hypot(...a) || 1;
  return [a[0] / n, a[1] / n, a[2] / n];
}
