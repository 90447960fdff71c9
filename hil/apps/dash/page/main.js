// Entry point of the page: shows the updates from the socket and sends the user's commands.

import { Faults } from "./faults.js";
import { Chart } from "./panes/charts.js";
import { drawHorizon } from "./panes/horizon.js";
import { LiveSocket, parse } from "./socket.js";
import { overlayMap } from "./panes/maps.js";
import { attitude } from "./panes/matrices.js";
import { Missions } from "./missions.js";
import { Panes } from "./panes/panes.js";
import { Replay } from "./replay.js";
import { answered } from "./requests.js";
import { Campaigns } from "./campaigns.js";
import { Choices } from "./choices.js";
import { Runs, json } from "./runs.js";
import { Sticks } from "./sticks.js";
import { base, bytes, number, options, reachedOf, sensorRows, table } from "./panes/tables.js";
import { View3d } from "./panes/view3d.js";

const $ = (id) => document.getElementById(id);
const LOG_LINES = 200,
  NS = 1e9,
  OTHER_STEP_M = 0.2;
const LINK_ROWS = [
  ["messages sent", (l) => l.steps],
  ["late", (l) => l.late ?? "–"],
  ["lost, damaged", (l) => `${l.lost}, ${l.bad}`],
  ["round trip, median", (l) => `${number(l.rtt_p50_us, 0)} µs`],
  ["round trip, worst 1 %", (l) => `${number(l.rtt_p99_us, 0)} µs`],
  ["out, in", (l) => `${bytes(l.tx_bytes ?? 0)}, ${bytes(l.rx_bytes ?? 0)}`],
];
const charts = {
  altitude: new Chart($("c-altitude"), { range: [0, 5] }),
  speed: new Chart($("c-speed"), { range: [0, 2] }),
  motors: new Chart($("c-motors"), { range: [0, 1] }),
};
const view = new View3d($("view"), $("view-note"), $("texts"));
let replay = null,
  running = false,
  stopping = false,
  about = {},
  state = {},
  slow = {},
  run = -1,
  sceneOf = null;
let shownVehicle; // in a run of several
let trail = [],
  fresh = false; // [t, x, y, z] of the flight so far; fresh: true until the charts show it
const otherTrails = new Map(); // flown by the vehicles that are not shown: name -> x, y, z, x, ...
let drawn = null; // newest drawings of the scripts that fly (hil airsim)
let maps = []; // streams of the companions that publish a map

// -- updates -------------------------------------------------------------------------------------------------------

const live = new LiveSocket(update, () => setStatus("no connection", "bad"));

function update(head, frames) {
  running = head.going;
  if (head.about) begin(head);
  state = head.state;
  if (head.slow) {
    slow = head.slow;
    trail = slow.trail ?? [];
    if (fresh && trail.length) {
      fresh = false;
      if (!replay?.on) fillCharts();
    }
  }
  // Between two trails from the run, updates extend the trail.
  if (state.p && !(state.t_ns / NS <= trail.at(-1)?.[0])) trail.push([state.t_ns / NS, ...state.p]);
  const error = head.result?.error;
  showMessage("run", head.message || (error && error.type !== "Interrupted" ? `${error.type}: ${error.message}` : ""));
  if (!running) stopping = false;
  buttons();
  drawn = frames.find((frame) => frame.as === "drawings") ?? drawn;
  if (replay?.on) return;
  for (const event of head.events) log(event);
  showSlow();
  if (state.p) showState();
  showStatus(head.result);
  showAfter(head.result);
  panes.boxes = state.boxes ?? {};
  for (const frame of frames)
    if (frame === drawn) view.setDrawings(frame.data, frame.texts);
    else panes.show(frame);
}

// Fill the charts of altitude and speed from the trail, for a page that is opened during a flight.
function fillCharts() {
  charts.altitude.clear();
  charts.speed.clear();
  trail.forEach((point, k) => {
    const [t0, ...p0] = trail[Math.max(0, k - 1)],
      [t, ...p] = point,
      dt = t - t0 || 1;
    charts.altitude.add(t, [p[2]]);
    charts.speed.add(t, [Math.hypot(p[0] - p0[0], p[1] - p0[1]) / dt, (p[2] - p0[2]) / dt]);
  });
}

function begin(head) {
  about = head.about;
  if (head.run === run && about.vehicle === shownVehicle) {
    if (!replay.on) $("log").replaceChildren(); // a new connection: all events come again
    return;
  }
  run = head.run;
  shownVehicle = about.vehicle;
  drawn = null;
  fresh = true;
  trail = [];
  if (!replay.on) showRun();
}

function showRun() {
  $("vehicle").onchange = () => {
    live.vehicle = $("vehicle").value;
    live.watch(live.streams);
  };
  for (const chart of Object.values(charts)) chart.clear();
  $("log").replaceChildren();
  showWorld(about);
}

function showWorld(description) {
  if (description.rotor_positions) view.setVehicle(description.rotor_positions);
  const plan = description.path?.length ? [description.home, ...description.path] : [];
  view.setLine("plan", plan.flat(), { colour: "--plan" });
  view.setLine("corners", (description.path ?? []).flat(), { colour: "--plan", mode: view.gl?.POINTS, size: 6 });
  view.setLine("trail", [], { colour: "--trail" });
  if (!missions.bar.box.hidden) missions.open(false);
  view.setDrawings(drawn?.data ?? new ArrayBuffer(0), drawn?.texts ?? []);
  document.body.classList.toggle("watches", description.watches === true);
  offerVehicles(Object.keys(description.vehicles ?? {}), description.vehicle);
  for (const [name, other] of Object.entries(description.vehicles ?? {})) view.setVehicle(other.rotor_positions, name);
  if (description.home && !replay.on) view.setPose(description.home, [1, 0, 0, 0]);
  maps = [];
  offerPanes();
  faults.offer(description);
  loadScene(description.out ?? "");
}

// Fill the list of vehicles, which a run of one does not show, and remove what the 3-D view has of others.
function offerVehicles(names, name) {
  $("vehicle").hidden = !names.length;
  if (names.length) options($("vehicle"), names);
  $("vehicle").value = name ?? "";
  for (const other of otherTrails.keys()) view.setLine(`trail of ${other}`, [], { colour: "--other" });
  otherTrails.clear();
  view.setOthers({});
  $("legend-other").innerHTML = names.length ? "<i class='k-other'></i>other vehicles" : "";
}

// Show the other vehicles at their places, name -> [p, q] or null, and extend their trails.
function showOthers(places) {
  const others = Object.fromEntries(
    Object.entries(places ?? {}).filter(([name, place]) => place && name !== shownVehicle),
  );
  view.setOthers(others);
  for (const [name, [p]] of Object.entries(others)) {
    const flown = otherTrails.get(name) ?? [];
    if (flown.length && Math.hypot(...p.map((v, axis) => v - flown.at(axis - 3))) < OTHER_STEP_M) continue;
    flown.push(...p);
    otherTrails.set(name, flown);
    view.setLine(`trail of ${name}`, flown, { colour: "--other" });
  }
}

function offerPanes() {
  const sensors = about.sensors === undefined ? null : Object.values(about.sensors);
  const streams = (sensors ?? []).flatMap((sensor) => sensor.streams);
  if (!replay.on) panes.offer([...streams, ...maps], about.previews, sensors?.map((sensor) => sensor.kind) ?? null);
}

async function loadScene(folder) {
  if (sceneOf === folder) return;
  sceneOf = folder;
  const answer = await answered("/api/scene", (reason) => {
    $("view-note").textContent = `the scene did not come (${reason}); asking again`;
  });
  if (sceneOf !== folder) return; // another run has begun meanwhile
  if (view.gl) $("view-note").textContent = answer.ok ? "" : await answer.text();
  if (answer.ok) view.setScene(await answer.arrayBuffer());
}

function showState() {
  view.setActors(state.actors);
  showOthers(state.places);
  view.setPose(state.p, state.q);
  view.setLine(
    "trail",
    trail.flatMap((point) => point.slice(1)),
    { colour: "--trail" },
  );
  faults.show(state.by_hand);
  const t = state.t_ns / NS;
  charts.altitude.add(t, [state.p[2]]);
  charts.speed.add(t, [Math.hypot(state.v[0], state.v[1]), state.v[2]]);
  charts.motors.add(t, state.controls);
  for (const chart of Object.values(charts)) chart.draw();
  showVehicle(state, t);
}

function showVehicle(s, t) {
  const angles = attitude(s.q);
  drawHorizon($("horizon"), angles);
  $("clock").textContent = `${t.toFixed(2)} s`;
  const rows = [
    ["altitude", `${number(s.p[2])} m`],
    ["east", `${number(s.p[0])} m`],
    ["north", `${number(s.p[1])} m`],
    ["ground speed", `${number(Math.hypot(s.v[0], s.v[1]))} m/s`],
    ["climb", `${number(s.v[2])} m/s`],
    ["roll", `${number(angles.roll * 57.29578, 1)}°`],
    ["pitch", `${number(angles.pitch * 57.29578, 1)}°`],
  ];
  if (s.w) rows.push(["angular speed", `${number(57.29578 * Math.hypot(...s.w), 0)}°/s`]);
  if (s.contact) rows.push(["contact", "yes"]);
  if (s.wind) rows.push(["wind", `${number(Math.hypot(...s.wind), 1)} m/s`]);
  if (s.armed !== undefined) rows.push(["motors", s.armed ? "armed" : "disarmed"]);
  if (s.mode !== undefined) rows.push(["mode bits", `0x${s.mode.toString(16).padStart(2, "0")}`]);
  if (s.battery)
    rows.push([
      "battery",
      `${number(100 * s.battery[0], 0)} %, ${number(s.battery[1], 1)} V, ${number(s.battery[2], 1)} A`,
    ]);
  const list = $("numbers");
  list.replaceChildren(
    ...rows.flatMap(([name, value]) => {
      const dt = document.createElement("dt"),
        dd = document.createElement("dd");
      dt.textContent = name;
      dd.textContent = value;
      return [dt, dd];
    }),
  );
  const motors = $("motors");
  while (motors.children.length > s.controls.length) motors.lastChild.remove();
  s.controls.forEach((u, k) => {
    let motor = motors.children[k];
    if (!motor) {
      motor = document.createElement("div");
      motor.append(document.createElement("span"), document.createElement("meter"));
      motors.append(motor);
    }
    motor.firstChild.textContent = `${k}: ${number(100 * u, 0)} %`;
    const speed = s.rotors?.[k];
    motor.title =
      `command of motor ${k}` + (speed === undefined ? "" : `; it turns at ${number(speed * 9.549297, 0)} rpm`);
    motor.lastChild.value = u;
  });
}

// Reports of the companions, one row each.
function clientRows(reports) {
  return Object.entries(reports).flatMap(([client, report]) =>
    Object.entries(report)
      .filter(([, value]) => value !== "")
      .map(([name, value]) => [`${client}: ${name.replaceAll("_", " ")}`, value]),
  );
}

let slowShown = null;
function showSlow() {
  if (slow.battery) state.battery = slow.battery;
  if (slow.maps && slow.maps.join() !== maps.join()) {
    maps = slow.maps;
    offerPanes();
  }
  if (slow.links) faults.offer({ ...about, companions: slow.companions });
  state.byHand = slow.flying_by_hand === true; // includes the gamepad at the bench's own machine
  if (slow === slowShown) return;
  slowShown = slow;
  table($("reports"), [], clientRows(slow.told ?? {}));
  if (slow.links) {
    table(
      $("links"),
      ["", ...slow.links.map((l) => l.name)],
      LINK_ROWS.map(([name, value]) => [name, ...slow.links.map(value)]),
    );
  }
  table($("sensors"), [], sensorRows(slow.sensors));
  const notes = [];
  if (slow.own_us !== undefined) notes.push(`time per tick in the bench itself: ${number(slow.own_us, 0)} µs`);
  if (slow.late_ticks) notes.push(`${slow.late_ticks} ticks began late`);
  if (slow.router)
    notes.push(
      "router: " +
        Object.entries(slow.router)
          .filter(([, count]) => count)
          .map(([name, count]) => `${name.replaceAll("_", " ")} ${number(count)}`)
          .join(", "),
    );
  $("pace-note").textContent = notes.join("; ");
  if (slow.skipped)
    table(
      $("skipped"),
      ["what", "why", "saved"],
      slow.skipped.map((s) => [s.what, s.why, s.saved]),
    );
}

function showStatus(result) {
  $("mission").textContent =
    about.rig === undefined ? "no run yet: press Start" : [state.phase, reachedOf(state)].filter(Boolean).join(", ");
  $("progress").value = result?.status === "PASS" ? 1 : state.waypoints ? state.reached / state.waypoints : 0;
  const runName = about.rig === undefined ? "" : `${base(about.rig)}, ${about.scene}, seed ${about.seed}`;
  if (running) {
    const now = stopping ? "stopping" : state.paused ? `paused at tick ${state.tick}` : (state.phase ?? "starting");
    setStatus(now, state.paused || stopping ? "warn" : "live");
    const speed = state.paused ? "" : `, ${number(state.speed, 1)} x real time`;
    $("headline").textContent = runName + speed + (state.altered ? ", altered by hand" : "");
  } else if (result) {
    setStatus(result.status, { PASS: "good", FAIL: "warn", ERROR: "bad" }[result.status]);
    $("headline").textContent =
      `${runName}, digest ${result.digest.slice(0, 12)}${result.deterministic ? "" : " (not deterministic)"}`;
    $("headline").title = result.digest;
  } else {
    setStatus("no run", "");
    if (about.rig === undefined)
      $("headline").textContent = "ready: press Start. The panes show the scene from 2 m above the take-off place";
  }
  const chip = $("deadman"),
    held = running && (state.held || state.byHand);
  chip.textContent = held ? "flying by hand" : "sticks released";
  chip.className = `chip ${held ? "good" : ""}`;
}

// Offer the folder of the run that has ended.
function showAfter(result) {
  const name = base(about.out),
    over = !running && result !== null && result !== undefined && name !== "";
  $("after").hidden = !over;
  if (!over) return;
  $("after-report").href = `/runs/${encodeURIComponent(name)}/report.html`;
  $("after-download").href = `/api/runs/${encodeURIComponent(name)}/download`;
}

function setStatus(text, kind) {
  $("status").textContent = text;
  $("status").className = `chip ${kind}`;
}
const said = {}; // what each part of the page has to say, until it takes that back

function showMessage(part, its) {
  said[part] = its;
  const text = Object.values(said).filter(Boolean).join("\n");
  if ($("message").textContent === text) return;
  $("message").hidden = !text;
  $("message").textContent = text;
}

function log([t_ns, kind, text]) {
  const line = document.createElement("li"),
    list = $("log");
  line.textContent = `${(t_ns / NS).toFixed(2).padStart(7)}  ${kind}: ${text}`;
  if (kind === "error" || kind === "refused") line.className = "bad";
  if (kind === "warning" || kind === "fault" || kind === "by_hand") line.className = "warned";
  list.prepend(line);
  while (list.children.length > LOG_LINES) list.lastChild.remove();
}

function buttons() {
  const paused = state.paused === true;
  $("start").disabled = $("start-top").disabled = running;
  $("pause").disabled = !running || paused || about.lockstep === false;
  $("step").disabled = !running || about.lockstep === false;
  $("resume").disabled = !running || !paused;
  $("stop").disabled = !running;
  $("reset").disabled = run < 1;
  for (const control of document.querySelectorAll(
    "[data-request], [data-gust], #inject-rotor, #inject-sensor, #inject-link, #wind-speed, #wind-dir",
  ))
    control.disabled = !running;
}

// -- commands ------------------------------------------------------------------------------------------------------

const panes = new Panes({
  chips: $("pane-chips"),
  box: $("panes"),
  onChange: (streams) => {
    if (!replay?.on) live.watch(streams);
    else showMoment(Number($("replay-time").value));
  },
  onCloud: (stream, cloud) =>
    view.setLine(`cloud ${stream}`, cloud?.points ?? [], {
      colour: "--warn",
      mode: view.gl?.POINTS,
      size: 2,
      at: cloud?.at ?? null,
    }),
  onMap: (stream, frame) => overlayMap(view, stream, frame),
  flown: () => (replay?.on ? replay.flown : trail),
});
const faults = new Faults((message) => live.send(message));

for (const kind of ["pause", "step", "resume", "stop", "reset"]) $(kind).onclick = () => live.send({ kind });
$("stop").addEventListener("click", () => {
  stopping = true;
});
$("start-form").onsubmit = (event) => {
  event.preventDefault();
  if (replay.on) $("replay-close").click();
  showMessage("mission", "");
  const message = { kind: "start", paused: $("f-paused").checked, gamepad: $("f-gamepad").checked };
  for (const name of ["bench", "rig", "scene", "mission"])
    if ($(`f-${name}`).value) message[name] = $(`f-${name}`).value;
  if ($("f-seed").value !== "") message.seed = Number($("f-seed").value);
  if ($("f-pace").value !== "") message.pace = Number($("f-pace").value);
  live.send(message);
};
$("f-pace").onchange = () => {
  if (running) live.send({ kind: "pace", pace: $("f-pace").value === "" ? null : Number($("f-pace").value) });
};

const choices = new Choices(
  (name) => $(`f-${name}`),
  (text) => showMessage("lists", text),
);

const missions = new Missions({
  view,
  follow: $("v-follow"),
  file: $("mission-file"),
  draw: $("mission-draw"),
  bar: {
    box: $("draw-bar"),
    text: $("draw-text"),
    height: $("draw-height"),
    speed: $("draw-speed"),
    home: $("draw-home"),
    undo: $("draw-undo"),
    clear: $("draw-clear"),
    close: $("draw-close"),
    use: $("draw-use"),
  },
  home: () => about.home ?? [0, 0, 0],
  message: (text) => showMessage("mission", text),
  onMission: async (path) => {
    await choices.offer();
    $("f-mission").value = path;
  },
});

new Sticks({
  pad: $("hold"),
  left: $("stick-left"),
  right: $("stick-right"),
  send: (message) => live.send(message),
  mode: () => $("take-mode").value,
  mayFly: () => running && !replay.on && !$("live").hidden,
  onTake: () => {
    // A pilot can only fly in real time.
    if (about.lockstep !== false && state.pace !== 1) {
      live.send({ kind: "pace", pace: 1 });
      $("f-pace").value = "1";
    }
  },
}).bind($("requests"));

$("v-follow").onclick = () => {
  view.follow = !view.follow;
  $("v-follow").setAttribute("aria-pressed", String(view.follow));
  if (view.follow && view.vehicle) view.setPose(view.vehicle.p, view.vehicle.q);
};
$("v-top").onclick = () => view.look(-Math.PI / 2, 1.55, Math.max(view.distance, 40));
$("v-behind").onclick = () => {
  const heading = view.vehicle ? attitude(view.vehicle.q).heading : 0;
  view.look(-Math.PI / 2 - heading, 0.3, 8);
};

// -- past runs -----------------------------------------------------------------------------------------------------

replay = new Replay({
  bar: $("replay-bar"),
  slider: $("replay-time"),
  text: $("replay-text"),
  play: $("replay-play"),
  close: $("replay-close"),
  show: showReplay,
  onClose: () => {
    view.setLine("other", [], { colour: "--other" });
    $("legend-other").replaceChildren();
    $("clock").textContent = $("headline").textContent = "";
    $("sensors-card").hidden = false;
    showRun();
  },
});
const runs = new Runs({ list: $("runs-table"), detail: $("run-detail"), compare: $("compare"), onReplay: openReplay });
const campaigns = new Campaigns($("campaigns"), $("campaigns-table"));
function loadRuns() {
  runs.load();
  campaigns.load(() => !$("runs").hidden);
}
$("runs-refresh").onclick = loadRuns;

async function openReplay(name, summary, other = null, vehicle = "") {
  const opened = await replay.open(name, summary, other, vehicle);
  showMessage("replay", opened ? "" : `${name}: its recording has no flight`);
  if (!opened) return;
  const { track, second } = replay,
    ofRun = summary;
  if (track.vehicle) summary = (await json(`/api/runs/${name}/summary?vehicle=${track.vehicle}`)) ?? summary;
  offerVehicles(track.vehicles, track.vehicle);
  $("vehicle").onchange = () => openReplay(name, ofRun, other, $("vehicle").value);
  select("live");
  setStatus(`replay: ${ofRun.status}`, { PASS: "good", FAIL: "warn", ERROR: "bad" }[ofRun.status]);
  $("headline").textContent = `${name}, digest ${ofRun.digest.slice(0, 12)}`;
  $("mission").textContent = reachedOf(summary.mission);
  $("sensors-card").hidden = true;
  table(
    $("reports"),
    [],
    clientRows(
      Object.fromEntries(
        Object.entries(summary.companion?.clients ?? {}).map(([name, client]) => [name, client.report ?? {}]),
      ),
    ),
  );
  $("progress").value = summary.mission.waypoints ? summary.mission.reached / summary.mission.waypoints : 0;
  table(
    $("links"),
    ["link", "steps", "late", "round trip p50, p99"],
    [
      [
        summary.autopilot.kind,
        summary.autopilot.steps,
        summary.autopilot.late,
        `${number(summary.autopilot.rtt_us.p50, 0)}, ${number(summary.autopilot.rtt_us.p99, 0)} µs`,
      ],
    ],
  );
  table(
    $("skipped"),
    ["what", "why", "saved"],
    summary.skipped.map((s) => [s.what, s.why, s.saved]),
  );
  slowShown = null;
  $("log").replaceChildren();
  for (const event of track.events) log(event);
  view.setLine("plan", track.path.length ? [...track.p[0], ...track.path.flat()] : [], { colour: "--plan" });
  view.setLine("corners", track.path.flat(), { colour: "--plan", mode: view.gl?.POINTS, size: 6 });
  view.setDrawings(new ArrayBuffer(0), []);
  view.setLine("other", second ? second.p.flat() : [], { colour: "--other" });
  if (second && !track.vehicles.length) $("legend-other").innerHTML = "<i class='k-other'></i>second run";
  const rotors = Math.max(
    1,
    track.controls.reduce((count, row) => Math.max(count, row.findLastIndex((u) => u > 0) + 1), 4),
  );
  replay.rotors = rotors;
  const set = (chart, value) => {
    chart.clear();
    chart.set(
      track.t,
      track.t.map((_, k) => value(track, k)),
    );
    if (second) chart.other = { t: second.t, rows: second.t.map((_, k) => value(second, k).slice(0, 1)) };
  };
  set(charts.altitude, (t, k) => [t.p[k][2]]);
  set(charts.speed, (t, k) => [Math.hypot(t.v[k][0], t.v[k][1]), t.v[k][2]]);
  set(charts.motors, (t, k) => t.controls[k].slice(0, rotors));
  panes.offer(track.streams, []);
  if (!track.streams.length) $("pane-chips").textContent = "this run recorded no pictures, sweeps or detections";
  replay.begin();
  const scene = await fetch(`/api/runs/${encodeURIComponent(name)}/scene`);
  if (scene.ok && replay.on) {
    view.setScene(await scene.arrayBuffer());
    sceneOf = null;
    showMoment(Number($("replay-time").value));
  }
}

function showReplay(k, t) {
  const { track, rotors } = replay;
  const shown = { p: track.p[k], q: track.q[k], v: track.v[k], controls: track.controls[k].slice(0, rotors) };
  view.setPose(shown.p, shown.q);
  const at = (poses) => Math.min(k, poses.length - 1),
    others = Object.entries(track.others).filter(([, other]) => other.p.length);
  for (const [name, other] of others) {
    otherTrails.set(name, []);
    view.setLine(`trail of ${name}`, other.p.slice(0, k + 1).flat(), { colour: "--other" });
  }
  view.setOthers(
    Object.fromEntries(others.map(([name, other]) => [name, [other.p[at(other.p)], other.q[at(other.q)]]])),
  );
  view.setLine("trail", track.p.slice(0, k + 1).flat(), { colour: "--trail" });
  for (const chart of Object.values(charts)) {
    chart.cursor = t;
    chart.draw();
  }
  showVehicle(shown, t);
  showMoment(t);
}

// Request one moment at a time. Afterwards, request the one at the slider if it has moved meanwhile.
let momentWanted = null,
  momentBusy = false;
async function showMoment(t) {
  momentWanted = t;
  if (momentBusy) return;
  momentBusy = true;
  try {
    while (momentWanted !== null && replay.on) {
      const moment = momentWanted,
        streams = [...panes.open.keys()];
      momentWanted = null;
      const answer = await fetch(
        `/api/runs/${replay.name}/moment?t_ns=${Math.round(moment * NS)}&streams=${encodeURIComponent(streams.join())}&vehicle=${replay.track.vehicle}`,
      );
      if (!answer.ok || !replay.on) continue;
      const { head, frames } = parse(await answer.arrayBuffer());
      view.setActors(head.actors);
      panes.boxes = head.boxes;
      for (const frame of frames) await panes.show(frame);
      for (const stream of streams) if (!frames.some((frame) => frame.stream === stream)) panes.showNone(stream);
      view.touch();
    }
  } finally {
    momentBusy = false;
  }
}

// -- tabs, theme, start --------------------------------------------------------------------------------------------

function select(name) {
  for (const tab of ["live", "runs"]) {
    $(tab).hidden = tab !== name;
    $(`tab-${tab}`).setAttribute("aria-selected", String(tab === name));
  }
  if (name === "runs") loadRuns();
  live.watch(name === "live" && !replay.on ? [...panes.open.keys()] : []);
  view.touch();
}
$("tab-live").onclick = () => select("live");
$("tab-runs").onclick = () => select("runs");

function theme(name) {
  document.documentElement.dataset.theme = name;
  view.touch();
  panes.redraw();
  for (const chart of Object.values(charts)) chart.draw();
}
const savedTheme = localStorage.getItem("theme");
theme(savedTheme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
$("theme").onclick = () => {
  const next = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  localStorage.setItem("theme", next);
  theme(next);
};

async function start() {
  buttons();
  view.setVehicle([
    [0.17, 0.17, 0.02],
    [-0.17, 0.17, 0.02],
    [-0.17, -0.17, 0.02],
    [0.17, -0.17, 0.02],
  ]);
  options($("fault-rotor"), ["0", "1", "2", "3"]);
  $("f-bench").onchange = async () => {
    for (const name of ["rig", "scene", "mission"]) $(`f-${name}`).value = ""; // the bench's own
    $("f-seed").value = "";
    await choices.offer();
  };
  await choices.offer();
  document.documentElement.dataset.ready = "yes";
}
start();
