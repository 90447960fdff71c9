// Artificial horizon: roll, pitch and heading.

import { css } from "./charts.js";

export function drawHorizon(canvas, { roll, pitch, heading }) {
  const g = canvas.getContext("2d"),
    n = canvas.width,
    r = n / 2 - 2,
    scale = r / 0.7,
    u = n / 150;
  g.save();
  g.clearRect(0, 0, n, n);
  g.translate(n / 2, n / 2);
  g.beginPath();
  g.arc(0, 0, r, 0, 7);
  g.clip();
  g.save();
  g.rotate(-roll);
  g.translate(0, pitch * scale);
  g.fillStyle = "#3f86c9";
  g.fillRect(-n, -4 * n, 2 * n, 4 * n);
  g.fillStyle = "#8a6340";
  g.fillRect(-n, 0, 2 * n, 4 * n);
  g.strokeStyle = "#fff";
  g.fillStyle = "#fff";
  g.lineWidth = 1.5 * u;
  g.font = `${9 * u}px system-ui, sans-serif`;
  g.textAlign = "left";
  g.textBaseline = "middle";
  for (let deg = -40; deg <= 40; deg += 10) {
    const y = -((deg * Math.PI) / 180) * scale,
      half = deg === 0 ? n : 16 * u;
    g.beginPath();
    g.moveTo(-half, y);
    g.lineTo(half, y);
    g.stroke();
    if (deg) g.fillText(String(Math.abs(deg)), half + 4 * u, y);
  }
  g.restore();
  g.strokeStyle = "#ffd33d";
  g.lineWidth = 3 * u;
  g.beginPath();
  g.moveTo(-34 * u, 0);
  g.lineTo(-12 * u, 0);
  g.lineTo(0, 7 * u);
  g.lineTo(12 * u, 0);
  g.lineTo(34 * u, 0);
  g.stroke();
  const deg = ((heading * 180) / Math.PI + 360) % 360;
  g.fillStyle = "rgba(0,0,0,.55)";
  g.fillRect(-22 * u, r - 22 * u, 44 * u, 16 * u);
  g.fillStyle = "#fff";
  g.font = `${11 * u}px ui-monospace, monospace`;
  g.textAlign = "center";
  g.fillText(`${deg.toFixed(0).padStart(3, "0")}°`, 0, r - 13 * u);
  g.restore();
  g.strokeStyle = css("--line");
  g.lineWidth = 2;
  g.beginPath();
  g.arc(n / 2, n / 2, r, 0, 7);
  g.stroke();
}
