// Strip charts: a few lines over time, on a canvas.

export const COLOURS = ["--trail", "--other", "--good", "--plan", "--warn", "--bad", "--quiet", "--ink"];

export function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

export function sized(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
  const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  return ratio;
}

export class Chart {
  // `range`: [low, high] that is always visible. `limit`: number of points, beyond which every second one is dropped.
  constructor(canvas, { range = [0, 1], limit = 1200 } = {}) {
    this.canvas = canvas;
    this.range = range;
    this.limit = limit;
    this.clear();
  }

  clear() {
    this.t = [];
    this.rows = [];
    this.other = null;
    this.cursor = null;
  }

  add(t, values) {
    const last = this.t[this.t.length - 1];
    if (last !== undefined && t <= last) return;
    this.t.push(t);
    this.rows.push(values);
    if (this.t.length > this.limit) {
      this.t = this.t.filter((_, k) => k % 2 === 0);
      this.rows = this.rows.filter((_, k) => k % 2 === 0);
    }
  }

  set(t, rows) {
    this.t = t;
    this.rows = rows;
  }

  draw() {
    const ratio = sized(this.canvas);
    const g = this.canvas.getContext("2d");
    const { width, height } = this.canvas;
    g.clearRect(0, 0, width, height);
    const left = 34 * ratio,
      bottom = 15 * ratio,
      top = 4 * ratio,
      right = 4 * ratio;
    let [low, high] = this.range;
    const sets = [{ t: this.t, rows: this.rows, dash: [] }];
    if (this.other) sets.push({ ...this.other, dash: [4 * ratio, 3 * ratio] });
    for (const { rows } of sets)
      for (const row of rows)
        for (const v of row) {
          if (v < low) low = v;
          if (v > high) high = v;
        }
    let begin = Infinity,
      end = -Infinity;
    for (const { t } of sets)
      if (t.length) {
        begin = Math.min(begin, t[0]);
        end = Math.max(end, t[t.length - 1]);
      }
    if (!(end > begin)) {
      begin = 0;
      end = Math.max(1, end > 0 ? end : 1);
    }
    const x = (t) => left + ((t - begin) / (end - begin)) * (width - left - right);
    const y = (v) => height - bottom - ((v - low) / (high - low || 1)) * (height - bottom - top);
    g.font = `${10 * ratio}px system-ui, sans-serif`;
    g.fillStyle = css("--quiet");
    g.strokeStyle = css("--line");
    g.lineWidth = ratio;
    g.textAlign = "right";
    g.textBaseline = "middle";
    for (let k = 0; k <= 2; k++) {
      const v = low + (k / 2) * (high - low),
        lineY = y(v);
      g.beginPath();
      g.moveTo(left, lineY);
      g.lineTo(width - right, lineY);
      g.stroke();
      g.fillText(
        (Math.abs(high - low) < 5 ? v.toFixed(1) : v.toFixed(0)).replace(/^-(0(\.0)?)$/, "$1"),
        left - 4 * ratio,
        Math.min(Math.max(lineY, 6 * ratio), height - bottom),
      );
    }
    g.textBaseline = "bottom";
    g.textAlign = "left";
    g.fillText(`${begin.toFixed(0)} s`, left, height);
    g.textAlign = "right";
    g.fillText(`${end.toFixed(0)} s`, width - right, height);
    sets.forEach(({ t, rows, dash }, index) => {
      const columns = rows.length ? rows[rows.length - 1].length : 0;
      g.setLineDash(dash);
      g.lineWidth = 1.5 * ratio;
      for (let c = 0; c < columns; c++) {
        g.strokeStyle = css(index ? "--other" : COLOURS[c % COLOURS.length]);
        g.beginPath();
        let started = false;
        for (let k = 0; k < t.length; k++) {
          const v = rows[k][c];
          if (v === undefined || v === null) continue;
          if (started) g.lineTo(x(t[k]), y(v));
          else g.moveTo(x(t[k]), y(v));
          started = true;
        }
        g.stroke();
      }
      g.setLineDash([]);
    });
    if (this.cursor !== null) {
      g.strokeStyle = css("--ink");
      g.lineWidth = ratio;
      g.beginPath();
      g.moveTo(x(this.cursor), top);
      g.lineTo(x(this.cursor), height - bottom);
      g.stroke();
    }
  }
}
