// Manual control: keys, a gamepad in this browser, or a finger on the pad. Sticks count only while the dead-man switch is
// held; a page that loses the focus, is hidden or closed releases it.

import { css } from "/page/panes/charts.js";

const PERIOD_MS = 50;
const KEYS = { KeyW: ["throttle", 1], KeyS: ["throttle", -1], KeyA: ["yaw", -1], KeyD: ["yaw", 1],
  ArrowUp: ["pitch", 1], ArrowDown: ["pitch", -1], ArrowLeft: ["roll", -1], ArrowRight: ["roll", 1] };
const DEAD_ZONE = 0.08, GENTLE = 0.5, REQUEST_MS = 300;
// An autopilot accepts a manual mode only after it has received stick positions.
const TAKE_AFTER_MS = 250;
const L1 = 4;

export class Sticks {
  constructor({ pad, left, right, send, mode, mayFly, onTake }) {
    Object.assign(this, { pad, left, right, send, mode, mayFly, onTake });
    this.down = new Set();
    this.finger = false;
    this.held = false;
    this.requested = null;
    this.requestUntil = 0;
    window.addEventListener("keydown", (event) => this.key(event, true));
    window.addEventListener("keyup", (event) => this.key(event, false));
    for (const name of ["blur", "pagehide"]) window.addEventListener(name, () => this.release());
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.release(); });
    pad.addEventListener("pointerdown", (event) => { pad.setPointerCapture(event.pointerId); this.finger = true; this.tick(); });
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"])
      pad.addEventListener(name, () => { this.finger = false; this.tick(); });
    setInterval(() => this.tick(), PERIOD_MS);
    this.draw([0, 0, 0, 0]);
  }

  key(event, down) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const field = event.target.closest?.("select, input:not([type=checkbox]):not([type=range])");
    if (field || !(event.code === "Space" || event.code in KEYS || event.code.startsWith("Shift"))) return;
    if (!this.mayFly() && !this.held) return;
    if (!event.code.startsWith("Shift")) event.preventDefault();  // the space bar neither scrolls nor presses a button
    if (down) this.down.add(event.code); else this.down.delete(event.code);
    if (!event.repeat) this.tick();
  }

  release() { this.down.clear(); this.finger = false; this.tick(); }

  bind(box) {
    for (const one of box.querySelectorAll("[data-request]")) one.onclick = () => this.request(one.dataset.request);
  }

  // A button of the page: the switch counts as held while the request is sent.
  request(what) { this.requested = what; this.requestUntil = performance.now() + REQUEST_MS; this.tick(); }

  tick() {
    const requesting = performance.now() < this.requestUntil;
    const gamepad = [...(navigator.getGamepads?.() ?? [])].find((one) => one && one.connected && one.mapping === "standard");
    const byPad = Boolean(gamepad && document.hasFocus() && gamepad.buttons[L1]?.pressed);
    const held = this.mayFly() && (this.down.has("Space") || this.finger || byPad);
    const axes = byPad ? padAxes(gamepad) : this.keyAxes();
    const began = held && !this.held;
    if (began) {
      this.onTake();
      this.takeAt = performance.now() + TAKE_AFTER_MS;
    }
    const since = performance.now() - (this.takeAt ?? Infinity);
    const wasActive = this.active;
    this.active = held || requesting;
    if (this.active) {
      const message = { kind: "sticks", held: true, axes: held ? axes : [0, 0, 0, 0] };
      if (requesting) message.ask = this.requested;
      else if (held && since >= 0 && since < REQUEST_MS) message.ask = this.mode();
      this.send(message);
    } else if (wasActive) this.send({ kind: "sticks", held: false });
    if (held !== this.held) {
      this.held = held;
      this.pad.setAttribute("aria-pressed", String(held));
      this.pad.textContent = held ? "flying by hand: release to stop" : "hold here, or the space bar, to fly";
    }
    this.draw(held ? axes : [0, 0, 0, 0]);
  }

  keyAxes() {
    const full = this.down.has("ShiftLeft") || this.down.has("ShiftRight") ? 1 : GENTLE;
    const out = { pitch: 0, roll: 0, throttle: 0, yaw: 0 };
    for (const code of this.down) if (code in KEYS) out[KEYS[code][0]] += KEYS[code][1] * full;
    return [out.pitch, out.roll, out.throttle, out.yaw];
  }

  draw([pitch, roll, throttle, yaw]) {
    const now = [pitch, roll, throttle, yaw, this.held, css("--ink")].join();
    if (now === this.drawn) return;
    this.drawn = now;
    for (const [canvas, x, y] of [[this.left, yaw, throttle], [this.right, roll, pitch]]) {
      const g = canvas.getContext("2d"), n = canvas.width;
      g.clearRect(0, 0, n, n);
      g.strokeStyle = css("--line"); g.lineWidth = 2;
      g.strokeRect(1, 1, n - 2, n - 2);
      g.beginPath(); g.moveTo(n / 2, 4); g.lineTo(n / 2, n - 4); g.moveTo(4, n / 2); g.lineTo(n - 4, n / 2); g.stroke();
      g.fillStyle = css(this.held ? "--good" : "--quiet");
      g.beginPath(); g.arc(n / 2 + x * (n / 2 - 10), n / 2 - y * (n / 2 - 10), 8, 0, 7); g.fill();
    }
  }
}

function padAxes(gamepad) {
  const dead = (v) => (Math.abs(v) < DEAD_ZONE ? 0 : (v - Math.sign(v) * DEAD_ZONE) / (1 - DEAD_ZONE));
  const [leftX, leftY, rightX, rightY] = gamepad.axes.map(dead);
  return [-rightY, rightX, -leftY, leftX];
}
