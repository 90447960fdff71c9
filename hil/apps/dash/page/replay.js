// Replay of a past run on the live page, at the time of a slider.

import { json } from "./runs.js";

export class Replay {
  constructor({ bar, slider, text, play, close, show, onClose }) {
    Object.assign(this, { bar, slider, text, play, show, onClose });
    this.track = null;
    this.timer = null;
    slider.oninput = () => this.showAt(Number(slider.value));
    play.onclick = () => (this.timer ? this.pause() : this.run());
    close.onclick = () => {
      this.pause();
      this.track = null;
      bar.hidden = true;
      onClose();
    };
  }

  // [t, x, y, z] of the whole flight.
  get flown() {
    return this.track.t.map((t, k) => [t, ...this.track.p[k]]);
  }

  get on() {
    return this.track !== null;
  }

  async open(name, summary, other = null, vehicle = "") {
    const [track, second] = await Promise.all(
      [name, other].map((run) => (run ? json(`/api/runs/${run}/track?vehicle=${vehicle}`) : null)),
    );
    if (!track || !track.t.length) return false;
    Object.assign(this, { name, summary, track, second });
    this.bar.hidden = false;
    this.slider.min = track.t[0];
    this.slider.max = track.t[track.t.length - 1];
    this.slider.value = track.t[0];
    return true;
  }

  begin() {
    this.showAt(this.track.t[0]);
  }

  showAt(t) {
    const { track } = this;
    let low = 0,
      high = track.t.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (track.t[middle] <= t) low = middle;
      else high = middle - 1;
    }
    this.text.textContent = `${t.toFixed(1)} of ${track.t[track.t.length - 1].toFixed(1)} s`;
    this.show(low, t);
  }

  run() {
    this.play.textContent = "Stop";
    let last = performance.now();
    if (Number(this.slider.value) >= Number(this.slider.max)) this.slider.value = this.slider.min;
    const step = (now) => {
      const t = Math.min(Number(this.slider.max), Number(this.slider.value) + (now - last) / 1000);
      last = now;
      this.slider.value = t;
      this.showAt(t);
      if (t >= Number(this.slider.max)) this.pause();
      else if (this.timer) this.timer = requestAnimationFrame(step);
    };
    this.timer = requestAnimationFrame(step);
  }

  pause() {
    cancelAnimationFrame(this.timer);
    this.timer = null;
    this.play.textContent = "Play";
  }
}
