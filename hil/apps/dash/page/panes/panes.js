// Panes with sensor pictures, sweeps, detections and maps. Only streams of open panes are requested and computed.

import { css, sized } from "./charts.js";
import { drawMap, captionOf } from "./maps.js";

const PREVIEWS = {
  "view/camera/rgb": "camera",
  "view/camera/depth": "depth",
  "view/camera/segmentation": "classes",
  "view/lidar/points": "LiDAR",
  "view/radar/range_doppler": "radar map",
  "view/radar/points": "radar detections",
};
const CLOUD_RANGE_M = 40,
  DETECTION_RANGE_M = 20,
  MAP = /^companion\/(.+)\/map$/;

export class Panes {
  // `flown`: the path flown so far, for maps.
  constructor({ chips, box, onChange, onCloud, onMap, flown }) {
    Object.assign(this, { chips, box, onChange, onCloud, onMap, flown });
    this.open = new Map();
    this.last = new Map(); // newest frame, by stream
    this.all = [];
    this.boxes = {}; // newest detections of a companion, by stream
    this.wanted = new Set(["view/camera/rgb", "view/lidar/points", "view/radar/range_doppler"]);
    this.missing = new Set();
    this.offer([]);
  }

  // `run`: streams of the run itself, live or recorded. `kinds`: kinds of its sensors; null: not known.
  offer(run, previews = Object.keys(PREVIEWS), kinds = null) {
    this.missing = new Set(kinds === null ? [] : ["camera", "lidar", "radar"].filter((kind) => !kinds.includes(kind)));
    for (const [stream, pane] of this.open) nameOf(pane).textContent = this.captionOf(stream);
    const all = [...previews, ...run];
    if (all.join() === this.all.join() && all.length) return;
    // A new map is opened without a click.
    for (const stream of all) if (MAP.test(stream) && !this.all.includes(stream)) this.wanted.add(stream);
    this.all = all;
    this.chips.replaceChildren();
    for (const stream of this.all) {
      const chip = document.createElement("button");
      chip.textContent = titleOf(stream);
      chip.title = PREVIEWS[stream]
        ? "a preview computed for this page, without sensor errors"
        : MAP.test(stream)
          ? "map that the companion publishes"
          : "the run's own sensor";
      chip.dataset.stream = stream;
      chip.setAttribute("aria-pressed", String(this.wanted.has(stream)));
      chip.onclick = () => {
        if (!this.wanted.delete(stream)) this.wanted.add(stream);
        this.arrange();
      };
      this.chips.append(chip);
    }
    this.arrange();
  }

  arrange() {
    const open = this.all.filter((stream) => this.wanted.has(stream));
    for (const chip of this.chips.children)
      chip.setAttribute("aria-pressed", String(this.wanted.has(chip.dataset.stream)));
    for (const [stream, pane] of this.open)
      if (!open.includes(stream)) {
        pane.remove();
        this.open.delete(stream);
        this.last.delete(stream);
        if (stream.endsWith("/points")) this.onCloud(stream, null);
        if (MAP.test(stream)) this.onMap(stream, null);
      }
    for (const stream of open)
      if (!this.open.has(stream)) {
        const pane = document.createElement("div");
        pane.className = "pane";
        pane.dataset.stream = stream;
        const canvas = document.createElement("canvas"),
          caption = document.createElement("p");
        canvas.width = 320;
        canvas.height = 240;
        caption.innerHTML = "<span></span><span class='quiet'>waiting</span>";
        caption.firstChild.textContent = this.captionOf(stream);
        pane.append(canvas, caption);
        this.box.append(pane);
        this.open.set(stream, pane);
      }
    this.onChange(open);
  }

  // A preview of a kind of sensor that the run does not have says so.
  captionOf(stream) {
    const kind = stream.startsWith("view/") ? stream.split("/")[1] : "";
    const name = { camera: "camera", lidar: "LiDAR", radar: "radar" }[kind];
    return this.missing.has(kind) ? `${titleOf(stream)}: a preview, this run has no ${name}` : titleOf(stream);
  }

  // Draw again in the colours of another theme.
  redraw() {
    for (const frame of this.last.values()) if (!frame.as.startsWith("image/")) this.show(frame);
  }

  async show(frame) {
    const pane = this.open.get(frame.stream);
    if (!pane) return;
    this.last.set(frame.stream, frame);
    const canvas = pane.firstChild,
      note = pane.lastChild.lastChild;
    note.textContent = `${(frame.t_ns / 1e9).toFixed(2)} s`;
    pane.dataset.frames = String(Number(pane.dataset.frames ?? 0) + 1);
    if (frame.as.startsWith("image/")) {
      await showPicture(canvas, new Blob([frame.data], { type: frame.as }));
      drawBoxes(canvas, this.boxes[frame.stream]?.boxes ?? []);
    } else if (frame.as === "points") {
      const points = new Float32Array(frame.data);
      drawCloud(canvas, points);
      this.onCloud(frame.stream, { points, at: [frame.p, frame.q] });
      note.textContent += `, ${points.length / 3} points`;
    } else if (frame.as === "records") {
      drawDetections(canvas, frame.records);
      note.textContent += `, ${frame.records.length} found`;
    } else if (frame.as === "map") {
      drawMap(canvas, frame, this.flown());
      this.onMap(frame.stream, frame);
      note.textContent += `, ${captionOf(frame)}`;
    }
  }

  // In a replay: no frame of this stream was recorded shortly before the moment.
  showNone(stream) {
    const pane = this.open.get(stream);
    if (pane) pane.lastChild.lastChild.textContent = "no frame at this time";
  }
}

function nameOf(pane) {
  return pane.lastChild.firstChild;
}

function titleOf(stream) {
  return PREVIEWS[stream] ?? stream.replace(MAP, "map of $1");
}

async function showPicture(canvas, blob) {
  const picture = await createImageBitmap(blob);
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    canvas.width = picture.width;
    canvas.height = picture.height;
  }
  canvas.getContext("2d").drawImage(picture, 0, 0);
  picture.close();
}

function drawBoxes(canvas, boxes) {
  const g = canvas.getContext("2d"),
    { width, height } = canvas;
  g.lineWidth = 1.5;
  g.font = "10px system-ui, sans-serif";
  for (const [x0, y0, x1, y1, words] of boxes) {
    g.strokeStyle = "#ffd400";
    g.strokeRect(x0 * width, y0 * height, (x1 - x0) * width, (y1 - y0) * height);
    const textWidth = g.measureText(words).width,
      x = Math.max(0, Math.min(x0 * width, width - textWidth)),
      y = Math.max(10, y0 * height - 2);
    g.fillStyle = "#000a";
    g.fillRect(x, y - 9, textWidth + 2, 11);
    g.fillStyle = "#fff";
    g.fillText(words, x + 1, y);
  }
}

function polarGrid(canvas, range_m) {
  const ratio = sized(canvas),
    g = canvas.getContext("2d"),
    { width, height } = canvas;
  g.clearRect(0, 0, width, height);
  const scale = Math.min(width, height) / (2 * range_m),
    x = (left) => width / 2 - left * scale,
    y = (ahead) => height / 2 - ahead * scale;
  g.strokeStyle = css("--line");
  g.fillStyle = css("--quiet");
  g.lineWidth = ratio;
  g.font = `${10 * ratio}px system-ui, sans-serif`;
  for (let r = range_m / 4; r <= range_m; r += range_m / 4) {
    g.beginPath();
    g.arc(width / 2, height / 2, r * scale, 0, 7);
    g.stroke();
    g.fillText(`${r.toFixed(0)} m`, width / 2 + 3 * ratio, height / 2 - r * scale + 11 * ratio);
  }
  g.fillStyle = css("--bad");
  g.beginPath();
  g.moveTo(width / 2, height / 2 - 7 * ratio);
  g.lineTo(width / 2 - 5 * ratio, height / 2 + 5 * ratio);
  g.lineTo(width / 2 + 5 * ratio, height / 2 + 5 * ratio);
  g.fill();
  return { g, x, y, ratio };
}

// Top view of a point cloud, forward is up. The colour is the height, from blue (low) to red (high).
function drawCloud(canvas, points) {
  const { g, x, y, ratio } = polarGrid(canvas, CLOUD_RANGE_M);
  for (let k = 0; k + 2 < points.length; k += 3) {
    const height = Math.max(0, Math.min(1, (points[k + 2] + 6) / 12));
    g.fillStyle = `hsl(${220 - 220 * height} 75% 50%)`;
    g.fillRect(x(points[k + 1]), y(points[k]), 1.6 * ratio, 1.6 * ratio);
  }
}

function drawDetections(canvas, records) {
  const { g, x, y, ratio } = polarGrid(canvas, DETECTION_RANGE_M);
  for (const record of records) {
    const ahead = record.x_R ?? record.p_R?.[0] ?? 0,
      left = record.y_R ?? record.p_R?.[1] ?? 0,
      speed = record.speed_mps ?? 0;
    g.fillStyle = Math.abs(speed) < 0.2 ? css("--trail") : css("--bad");
    g.beginPath();
    g.arc(x(left), y(ahead), 4 * ratio, 0, 7);
    g.fill();
    g.fillStyle = css("--ink");
    g.fillText(`${speed.toFixed(1)} m/s`, x(left) + 6 * ratio, y(ahead));
  }
}
