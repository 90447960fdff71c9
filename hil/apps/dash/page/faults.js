// Card "Wind and faults": each button sends one message.

import { options } from "./panes/tables.js";

const COMPASS = ["east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east"];
// Faults of a link: [kind, text, unit of the amount, default amount].
const AUTOPILOT_FAULTS = [
  ["drop gps", "lose GPS messages", "%", 50],
  ["drop", "lose messages", "%", 10],
  ["corrupt", "damage messages", "%", 10],
  ["duplicate", "double messages", "%", 10],
  ["delay", "delay (wall clock)", "ms", 20],
  ["stall", "hold back messages", "", 0],
  ["unplug", "unplug", "", 0],
];
const COMPANION_FAULTS = [
  ["drop", "lose frames", "%", 20],
  ["delay", "delay answers", "ms", 200],
  ["unplug", "unplug", "", 0],
];

export class Faults {
  constructor(send) {
    this.send = send;
    this.links = [];
    for (const id of ["wind-speed", "wind-dir"]) {
      $(id).oninput = () => this.chosenWind();
      $(id).onchange = () => send({ kind: "wind", velocity_W_mps: this.chosenWind() });
    }
    for (const button of document.querySelectorAll("[data-gust]"))
      button.onclick = () => {
        const speed = Number(button.dataset.gust),
          rad = (Number($("wind-dir").value) * Math.PI) / 180;
        this.inject({
          velocity_W_mps: [speed * Math.cos(rad), speed * Math.sin(rad), 0],
          rise_s: 0.5,
          hold_s: 2,
          fall_s: 0.5,
        });
      };
    $("inject-rotor").onclick = () => {
      const kind = $("fault-rotor-kind").value,
        fault = { kind, rotor: Number($("fault-rotor").value) };
      if (kind === "efficiency") fault.factor = 0.7;
      this.inject(fault);
    };
    $("inject-sensor").onclick = () =>
      this.inject({
        kind: $("fault-sensor-kind").value,
        sensor: $("fault-sensor").value,
        for_s: Number($("fault-for").value) || 5,
      });
    $("fault-link").onchange = () => this.showKinds();
    $("fault-link-kind").onchange = () => this.showAmount();
    $("inject-link").onclick = () => this.breakLink();
  }

  inject(fault) {
    this.send({ kind: "inject", fault });
  }

  // Fill the lists with the rotors, sensors and links of this run. `wire`: whether the link to the autopilot can have
  // faults.
  offer({ rotors, sensors, companions, wire }) {
    options(
      $("fault-rotor"),
      Array.from({ length: rotors ?? 4 }, (_, k) => String(k)),
    );
    options($("fault-sensor"), Object.keys(sensors ?? {}));
    const links = [...(wire === false ? [] : ["autopilot"]), ...(companions ?? [])];
    if (links.join() !== this.links.join()) {
      this.links = links;
      options($("fault-link"), links);
      this.showKinds();
    }
  }

  // Show the wind that this page or another one has set.
  show(velocity_W) {
    if (!velocity_W || ["wind-speed", "wind-dir"].includes(document.activeElement?.id)) return;
    const speed = Math.hypot(velocity_W[0], velocity_W[1]);
    if (Math.abs(speed - Number($("wind-speed").value)) < 0.26) return;
    $("wind-speed").value = speed;
    if (speed > 0) $("wind-dir").value = ((Math.atan2(velocity_W[1], velocity_W[0]) * 180) / Math.PI + 360) % 360;
    this.chosenWind();
  }

  // Show the chosen wind in words, and return it [m/s, in W].
  chosenWind() {
    const speed = Number($("wind-speed").value),
      deg = Number($("wind-dir").value),
      rad = (deg * Math.PI) / 180;
    $("wind-text").textContent = `${speed} m/s`;
    $("wind-dir-text").textContent = `${COMPASS[Math.round(deg / 45) % 8]}`;
    return [speed * Math.cos(rad), speed * Math.sin(rad), 0].map((v) => Math.round(v * 1000) / 1000);
  }

  kindTable() {
    return $("fault-link").value === "autopilot" ? AUTOPILOT_FAULTS : COMPANION_FAULTS;
  }

  showKinds() {
    $("fault-link-kind").replaceChildren(...this.kindTable().map(([kind, words]) => new Option(words, kind)));
    this.showAmount();
  }

  showAmount() {
    const [, , unit, defaultAmount] = this.kindTable().find(([kind]) => kind === $("fault-link-kind").value) ?? [
      "",
      "",
      "",
      0,
    ];
    $("fault-link-unit").textContent = unit || "–";
    $("fault-link-much").disabled = !unit;
    $("fault-link-much").value = defaultAmount;
    $("fault-link-much").max = unit === "%" ? 100 : 10000;
  }

  breakLink() {
    const [kind, messageType] = $("fault-link-kind").value.split(" "),
      amount = Number($("fault-link-much").value) || 0;
    const fault = { kind, link: $("fault-link").value, for_s: Number($("fault-link-for").value) || 5 };
    const isDelay = kind === "delay";
    if (isDelay) fault.delay_s = amount / 1000;
    if (["drop", "corrupt", "duplicate"].includes(kind)) fault.rate = amount / 100;
    if (isDelay && fault.link === "autopilot") fault.rate = 1;
    if (messageType) fault.messages = ["HIL_GPS"];
    this.inject(fault);
  }
}

function $(id) {
  return document.getElementById(id);
}
