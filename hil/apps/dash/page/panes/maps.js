// Maps that companions publish: a top view in a pane, and walls, plan and particles in the 3-D view.

import { css } from "./charts.js";

const FREE = 1,
  NEAR_OBSTACLE = 2,
  OCCUPIED = 3;
const MAX_WIDTH_PX = 560;

// `frame.data`: one byte per cell, row 0 in the south. `flown`: [t, x, y, z] of the true path.
export function drawMap(canvas, frame, flown) {
  const size = frame.map ? [frame.map.columns * frame.map.cell_m, frame.map.rows * frame.map.cell_m] : [40, 40];
  const corner = frame.map ? frame.map.origin : [frame.p[0] - 20, frame.p[1] - 20];
  const scale = Math.min(MAX_WIDTH_PX / size[0], (0.75 * MAX_WIDTH_PX) / size[1]);
  const width = Math.max(120, Math.round(size[0] * scale)),
    height = Math.max(90, Math.round(size[1] * scale));
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const g = canvas.getContext("2d");
  g.fillStyle = css("--unknown");
  g.fillRect(0, 0, width, height);
  g.imageSmoothingEnabled = false;
  if (frame.map) g.drawImage(pictureOf(frame.map, new Uint8Array(frame.data)), 0, 0, size[0] * scale, size[1] * scale);
  const toCanvas = ([x, y]) => [(x - corner[0]) * scale, size[1] * scale - (y - corner[1]) * scale];
  const line = (points, colour, width) => {
    if (points.length < 2) return;
    g.strokeStyle = css(colour);
    g.lineWidth = width;
    g.lineJoin = "round";
    g.beginPath();
    points.forEach((point, k) => (k ? g.lineTo(...toCanvas(point)) : g.moveTo(...toCanvas(point))));
    g.stroke();
  };
  line(
    flown.filter((point) => point[0] * 1e9 <= frame.t_ns).map(([, x, y]) => [x, y]),
    "--trail",
    2,
  );
  line(frame.plan, "--plan", 3);
  g.fillStyle = css("--warn");
  for (const point of frame.particles) {
    const [x, y] = toCanvas(point);
    g.fillRect(x - 1.5, y - 1.5, 3, 3);
  }
  if (frame.goal) cross(g, toCanvas(frame.goal));
  arrow(g, toCanvas(frame.p), frame.yaw);
  ruler(g, scale, height);
}

function pictureOf({ rows, columns }, cells) {
  const made = new OffscreenCanvas(columns, rows),
    g = made.getContext("2d"),
    picture = g.createImageData(columns, rows);
  const colours = ["--unknown", "--free", "--near", "--wall"].map((name) => {
    const text = css(name);
    return [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16));
  });
  for (let row = 0; row < rows; row++)
    for (let column = 0; column < columns; column++) {
      const byte = 4 * ((rows - 1 - row) * columns + column),
        colour = colours[cells[row * columns + column]];
      picture.data[byte] = colour[0];
      picture.data[byte + 1] = colour[1];
      picture.data[byte + 2] = colour[2];
      picture.data[byte + 3] = 255;
    }
  g.putImageData(picture, 0, 0);
  return made;
}

function cross(g, [x, y]) {
  g.strokeStyle = css("--bad");
  g.lineWidth = 3;
  g.beginPath();
  g.moveTo(x - 7, y - 7);
  g.lineTo(x + 7, y + 7);
  g.moveTo(x - 7, y + 7);
  g.lineTo(x + 7, y - 7);
  g.stroke();
}

function arrow(g, [x, y], yaw) {
  g.save();
  g.translate(x, y);
  g.rotate(-yaw);
  g.fillStyle = css("--trail");
  g.strokeStyle = css("--card");
  g.lineWidth = 1.5;
  g.beginPath();
  g.moveTo(12, 0);
  g.lineTo(-8, 7);
  g.lineTo(-4, 0);
  g.lineTo(-8, -7);
  g.closePath();
  g.fill();
  g.stroke();
  g.restore();
}

function ruler(g, scale, height) {
  const length_m = [1, 2, 5, 10, 20, 50, 100].find((m) => m * scale > 50) ?? 200;
  g.fillStyle = css("--ink");
  g.fillRect(8, height - 10, length_m * scale, 3);
  g.font = "13px system-ui, sans-serif";
  g.textBaseline = "bottom";
  g.textAlign = "left";
  g.fillText(`${length_m} m`, 8, height - 13);
}

// Draw a map in the 3-D view, at the height of the flight; `frame` null removes it.
export function overlayMap(view, stream, frame) {
  if (!view.gl) return;
  const up = frame?.p[2] ?? 0;
  const flat = (points) => Float32Array.from((points ?? []).flatMap(([x, y]) => [x, y, up]));
  view.setLine(`walls ${stream}`, frame?.map ? walls(frame, up) : [], {
    colour: "--other",
    mode: view.gl.POINTS,
    size: 3,
    alpha: 0.8,
  });
  view.setLine(`plan ${stream}`, flat(frame?.plan), { colour: "--plan" });
  view.setLine(`plan corners ${stream}`, flat(frame?.plan), { colour: "--plan", mode: view.gl.POINTS, size: 5 });
  view.setLine(`particles ${stream}`, flat(frame?.particles), { colour: "--warn", mode: view.gl.POINTS, size: 3 });
}

function walls({ map, data }, up) {
  const cells = new Uint8Array(data),
    points = [];
  for (let k = 0; k < cells.length; k++)
    if (cells[k] === OCCUPIED) {
      points.push(
        map.origin[0] + ((k % map.columns) + 0.5) * map.cell_m,
        map.origin[1] + (Math.floor(k / map.columns) + 0.5) * map.cell_m,
        up,
      );
    }
  return new Float32Array(points);
}

// Caption of a map: known area and number of particles.
export function captionOf(frame) {
  if (!frame.map) return "no map yet";
  const cells = new Uint8Array(frame.data);
  let known = 0;
  for (const cell of cells) known += cell === FREE || cell === NEAR_OBSTACLE || cell === OCCUPIED;
  return `${Math.round(known * frame.map.cell_m ** 2)} m² known, ${frame.particles.length} particles`;
}
