// Manual control by keys, a gamepad of this browser, the dead-man pad or the two sticks on the page. A finger on a stick
// holds the dead-man switch, too. Sticks are sent only while the switch is held; a page that loses the focus, is hidden
// or closed releases it.

import { css } from "./panes/charts.js";

const PERIOD_MS = 50;
const KEYS = {
  KeyW: ["throttle", 1],
  KeyS: ["throttle", -1],
  KeyA: ["yaw", -1],
  KeyD: ["yaw", 1],
  ArrowUp: ["pitch", 1],
  ArrowDown: ["pitch", -1],
  ArrowLeft: ["roll", -1],
  ArrowRight: ["roll", 1],
};
const DEAD_ZONE = 0.08,
  KEY_DEFLECTION = 0.5,
  REQUEST_MS = 300,
  END_PX = 12; // from full deflection to the rim of a stick
const L1 = 4; // index of the button

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
    document.addEventListener("visibilitychange", () => {
      if (document.hidden) this.release();
    });
    pad.addEventListener("pointerdown", (event) => {
      pad.setPointerCapture(event.pointerId);
      this.finger = true;
      this.tick();
    });
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"])
      pad.addEventListener(name, () => {
        this.finger = false;
        this.tick();
      });
    this.drags = new Map(); // canvas -> x, y of its finger, -1..1
    for (const canvas of [left, right]) this.listen(canvas);
    setInterval(() => this.tick(), PERIOD_MS);
    this.draw([0, 0, 0, 0]);
  }

  // Let a finger move a stick. It returns to the middle when the finger leaves.
  listen(canvas) {
    const move = (event) => {
      const reach = canvas.clientWidth / 2 - END_PX;
      const place = [event.offsetX - canvas.clientWidth / 2, canvas.clientHeight / 2 - event.offsetY];
      this.drags.set(
        canvas,
        place.map((v) => withDeadZone(Math.max(-1, Math.min(1, v / reach)))),
      );
      this.tick();
    };
    canvas.addEventListener("pointerdown", (event) => {
      if (!this.mayFly()) return;
      canvas.setPointerCapture(event.pointerId);
      move(event);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.drags.has(canvas)) move(event);
    });
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"])
      canvas.addEventListener(name, () => {
        if (this.drags.delete(canvas)) this.tick();
      });
  }

  key(event, down) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const field = event.target.closest?.("select, input:not([type=checkbox]):not([type=range])");
    if (field || !(event.code === "Space" || event.code in KEYS || event.code.startsWith("Shift"))) return;
    if (!this.mayFly() && !this.held) return;
    if (!event.code.startsWith("Shift")) event.preventDefault(); // the space bar neither scrolls nor presses a button
    if (down) this.down.add(event.code);
    else this.down.delete(event.code);
    if (!event.repeat) this.tick();
  }

  release() {
    this.down.clear();
    this.drags.clear();
    this.finger = false;
    this.tick();
  }

  bind(box) {
    for (const button of box.querySelectorAll("[data-request]"))
      button.onclick = () => this.request(button.dataset.request);
  }

  // Send a request for a button of the page. The switch counts as held meanwhile.
  request(what) {
    this.requested = what;
    this.requestUntil = performance.now() + REQUEST_MS;
    this.tick();
  }

  tick() {
    const requesting = performance.now() < this.requestUntil;
    const gamepad = [...(navigator.getGamepads?.() ?? [])].find(
      (pad) => pad && pad.connected && pad.mapping === "standard",
    );
    const byPad = Boolean(gamepad && document.hasFocus() && gamepad.buttons[L1]?.pressed);
    const held = this.mayFly() && (this.down.has("Space") || this.finger || this.drags.size > 0 || byPad);
    const axes = byPad ? padAxes(gamepad) : this.drags.size ? this.dragAxes() : this.keyAxes();
    const began = held && !this.held;
    if (began) {
      this.onTake();
      this.modeRequestAt = performance.now();
    }
    const sinceModeRequest = performance.now() - (this.modeRequestAt ?? -Infinity);
    const wasActive = this.active;
    this.active = held || requesting;
    if (this.active) {
      const message = { kind: "sticks", held: true, axes: held ? axes : [0, 0, 0, 0] };
      if (requesting) message.ask = this.requested;
      else if (held && sinceModeRequest < REQUEST_MS) message.ask = this.mode();
      this.send(message);
    } else if (wasActive) this.send({ kind: "sticks", held: false });
    if (held !== this.held) {
      this.held = held;
      this.pad.setAttribute("aria-pressed", String(held));
      this.pad.textContent = held ? "flying by hand: release to stop" : "hold this, or the space bar, to fly";
    }
    this.draw(held ? axes : [0, 0, 0, 0]);
  }

  keyAxes() {
    const deflection = this.down.has("ShiftLeft") || this.down.has("ShiftRight") ? 1 : KEY_DEFLECTION;
    const out = { pitch: 0, roll: 0, throttle: 0, yaw: 0 };
    for (const code of this.down) if (code in KEYS) out[KEYS[code][0]] += KEYS[code][1] * deflection;
    return [out.pitch, out.roll, out.throttle, out.yaw];
  }

  dragAxes() {
    const [yaw, throttle] = this.drags.get(this.left) ?? [0, 0],
      [roll, pitch] = this.drags.get(this.right) ?? [0, 0];
    return [pitch, roll, throttle, yaw];
  }

  draw([pitch, roll, throttle, yaw]) {
    const state = [pitch, roll, throttle, yaw, this.held, css("--ink")].join();
    if (state === this.drawnState) return;
    this.drawnState = state;
    for (const [canvas, x, y] of [
      [this.left, yaw, throttle],
      [this.right, roll, pitch],
    ]) {
      const g = canvas.getContext("2d"),
        n = canvas.width;
      g.clearRect(0, 0, n, n);
      g.strokeStyle = css("--line");
      g.lineWidth = 3;
      g.strokeRect(1, 1, n - 2, n - 2);
      g.beginPath();
      g.moveTo(n / 2, 4);
      g.lineTo(n / 2, n - 4);
      g.moveTo(4, n / 2);
      g.lineTo(n - 4, n / 2);
      g.stroke();
      g.fillStyle = css(this.held ? "--good" : "--quiet");
      g.beginPath();
      g.arc(n / 2 + x * (n / 2 - 2 * END_PX), n / 2 - y * (n / 2 - 2 * END_PX), 16, 0, 7);
      g.fill();
    }
  }
}

function withDeadZone(v) {
  return Math.abs(v) < DEAD_ZONE ? 0 : (v - Math.sign(v) * DEAD_ZONE) / (1 - DEAD_ZONE);
}

function padAxes(gamepad) {
  const [leftX, leftY, rightX, rightY] = gamepad.axes.map(withDeadZone);
  return [-rightY, rightX, -leftY, leftX];
}
