// Past runs: the list, the details of one, and a comparison of two.

import { Chart } from "./panes/charts.js";
import { base, cell, number, reachedOf, table } from "./panes/tables.js";

const VERDICT_CLASS = { PASS: "good", FAIL: "warned", ERROR: "bad", running: "live" };

export class Runs {
  constructor({ list, detail, compare, onReplay }) {
    Object.assign(this, { list, detail, compare, onReplay });
    this.selected = new Set();
    compare.onclick = () => this.compareTwo([...this.selected]);
  }

  async load() {
    const answer = await fetch("/api/runs");
    if (!answer.ok) return;
    const runs = await answer.json();
    const names = new Set(runs.map((run) => run.name));
    this.selected = new Set([...this.selected].filter((name) => names.has(name)));
    this.compare.disabled = this.selected.size !== 2;
    const head = document.createElement("tr");
    for (const text of ["", "run", "verdict", "rig", "scene", "mission", "seed", "simulated", "x real time", "digest"])
      cell(head, text, { tag: "th" });
    const rows = runs.map((run) => this.row(run));
    const body = document.createElement("tbody");
    body.append(...rows);
    if (!rows.length)
      cell(body.insertRow(), "there are no runs yet: start one on the tab Live", { kind: "quiet" }).colSpan = 10;
    const heads = document.createElement("thead");
    heads.append(head);
    this.list.replaceChildren(heads, body);
  }

  row(run) {
    const row = document.createElement("tr");
    row.dataset.run = run.name;
    const tick = document.createElement("input");
    tick.type = "checkbox";
    tick.checked = this.selected.has(run.name);
    tick.setAttribute("aria-label", `compare ${run.name}`);
    tick.onclick = (event) => event.stopPropagation();
    tick.onchange = () => {
      if (tick.checked) this.selected.add(run.name);
      else this.selected.delete(run.name);
      this.compare.disabled = this.selected.size !== 2;
    };
    cell(row, "").append(tick);
    cell(row, run.name, { kind: "mono" });
    const status = run.error ? `${run.status} (${run.error})` : run.status;
    cell(row, run.broken ? "broken" : status, {
      kind: run.broken ? "bad" : (VERDICT_CLASS[run.status] ?? ""),
      title: run.broken ?? "",
    });
    cell(row, base(run.rig));
    cell(row, run.scene);
    cell(row, base(run.mission));
    cell(row, String(run.seed ?? ""));
    cell(row, `${number(run.sim_s, 1)} s`, { kind: "num" });
    cell(row, number(run.realtime_factor, 1), { kind: "num" });
    const marks = (run.deterministic ? "" : " not deterministic") + (run.by_hand ? ", commands by hand" : "");
    cell(row, `${(run.digest ?? "").slice(0, 12)}${marks}`, { kind: "mono", title: run.digest });
    row.onclick = () => this.showOne(run);
    return row;
  }

  async showOne(run) {
    const answer = await fetch(`/api/runs/${run.name}/summary`);
    this.detail.hidden = false;
    if (!answer.ok) {
      this.detail.replaceChildren(heading(`${run.name}: broken`, "bad"), line(await answer.text(), "bad"));
      return;
    }
    const summary = await answer.json();
    const parts = [heading(`${run.name}: ${summary.status}`, VERDICT_CLASS[summary.status])];
    if (run.broken) parts.push(line(run.broken, "bad"));
    if (summary.error) parts.push(line(`${summary.error.type}: ${summary.error.message}`, "bad"));
    for (const reason of summary.verdict?.reasons ?? []) parts.push(line(reason, "warned"));
    parts.push(line(`digest ${summary.digest}${summary.deterministic ? "" : " (not deterministic)"}`, "mono digest"));
    const buttons = document.createElement("div");
    buttons.className = "row";
    if (run.recording) buttons.append(button("Replay", "replay", () => this.onReplay(run.name, summary)));
    if (run.report) {
      const report = document.createElement("a");
      report.href = `/runs/${run.name}/report.html`;
      report.target = "_blank";
      report.rel = "noopener";
      report.textContent = "Report with plots";
      buttons.append(report);
    }
    const download = document.createElement("a");
    download.href = `/api/runs/${encodeURIComponent(run.name)}/download`;
    download.download = `${run.name}.zip`;
    download.id = "download";
    download.textContent = "Download this run";
    buttons.append(download);
    parts.push(buttons);
    const rows = summary.verdict?.rows ?? [];
    parts.push(line(reachedOf(summary.mission)));
    parts.push(
      tableOf(
        ["measured", "value", "limit", "unit", ""],
        rows.map((r) => [
          measurementName(r.name),
          r.value ?? "–",
          r.limit ?? "not judged",
          r.unit,
          r.ok === false ? "missed" : "",
        ]),
      ),
    );
    if (summary.vehicles)
      parts.push(
        heading("Vehicles"),
        tableOf(
          ["vehicle", "verdict", "mission", "why"],
          Object.entries(summary.vehicles).map(([name, v]) => [
            name,
            v.status + (v.lost ? " (lost)" : ""),
            reachedOf(v.mission),
            v.error?.message ?? v.verdict.reasons.join("; "),
          ]),
        ),
      );
    if (summary.by_hand?.length)
      parts.push(
        heading("By hand"),
        tableOf(
          ["before tick", "what", "alters the run"],
          summary.by_hand.map((command) => [command.tick, command.what, command.alters ? "yes" : "no"]),
        ),
      );
    if (run.recording) {
      const plot = document.createElement("div");
      plot.className = "charts";
      parts.push(plot);
      this.plots(plot, [run.name]);
    }
    parts.push(
      heading("Not computed"),
      tableOf(
        ["what", "why", "saved"],
        (summary.skipped ?? []).map((s) => [s.what, s.why, s.saved]),
      ),
    );
    this.detail.replaceChildren(...parts);
    this.detail.scrollIntoView({ block: "nearest" });
  }

  async compareTwo(names) {
    const [a, b] = await Promise.all(names.map((name) => json(`/api/runs/${name}/summary`)));
    if (!a || !b) return;
    this.detail.hidden = false;
    const same = a.digest === b.digest;
    const rows = (a.verdict?.rows ?? []).map((r) => {
      const other = (b.verdict?.rows ?? []).find((row) => row.name === r.name);
      return [
        `${measurementName(r.name)} [${r.unit}]`,
        r.value ?? "–",
        other?.value ?? "–",
        typeof r.value === "number" && typeof other?.value === "number" ? other.value - r.value : "–",
      ];
    });
    const rowOf = (key) =>
      [key.replaceAll("_", " "), a[key] ?? "–", b[key] ?? "–", ""].map((v) => (typeof v === "number" ? v : String(v)));
    const plot = document.createElement("div");
    plot.className = "charts";
    const distance = line("", "quiet");
    const buttons = document.createElement("div");
    buttons.className = "row";
    buttons.append(button("Replay the first with the second", "replay", () => this.onReplay(names[0], a, names[1])));
    this.detail.replaceChildren(
      heading("Two runs"),
      line(same ? "identical: the same digest" : "different digests", same ? "good" : "warned"),
      distance,
      buttons,
      tableOf(
        ["", names[0], names[1], "difference"],
        [
          rowOf("status"),
          ["mission", reachedOf(a.mission), reachedOf(b.mission), ""],
          rowOf("rig"),
          rowOf("scene"),
          rowOf("seed"),
          rowOf("sim_s"),
          rowOf("realtime_factor"),
          ...rows,
          ["digest", a.digest.slice(0, 16), b.digest.slice(0, 16), ""],
        ],
      ),
      plot,
    );
    const tracks = await this.plots(plot, names);
    if (tracks.length === 2) distance.textContent = farthestText(...tracks);
    this.detail.scrollIntoView({ block: "nearest" });
  }

  async plots(box, names) {
    const tracks = (await Promise.all(names.map((name) => json(`/api/runs/${name}/track`)))).filter(Boolean);
    if (tracks.length !== names.length) return tracks;
    for (const [title, value] of [
      ["Altitude, m", (t, k) => [t.p[k][2]]],
      ["Speed, m/s", (t, k) => [Math.hypot(...t.v[k])]],
      ["Distance from the start, m", (t, k) => [Math.hypot(t.p[k][0] - t.p[0][0], t.p[k][1] - t.p[0][1])]],
    ]) {
      const card = document.createElement("div"),
        canvas = document.createElement("canvas"),
        head = document.createElement("h2");
      card.className = "card";
      head.textContent = title;
      card.append(head, canvas);
      box.append(card);
      const chart = new Chart(canvas);
      chart.set(
        tracks[0].t,
        tracks[0].t.map((_, k) => value(tracks[0], k)),
      );
      if (tracks[1]) chart.other = { t: tracks[1].t, rows: tracks[1].t.map((_, k) => value(tracks[1], k)) };
      chart.draw();
    }
    return tracks;
  }
}

// The greatest distance between two flights at equal times, in words.
function farthestText(a, b) {
  let maxDistance = 0,
    maxTime = 0,
    k = 0;
  for (let i = 0; i < a.t.length; i++) {
    while (k + 1 < b.t.length && b.t[k + 1] <= a.t[i]) k++;
    if (b.t.length <= k || a.t[i] > b.t[b.t.length - 1]) break;
    const d = Math.hypot(...a.p[i].map((v, axis) => v - b.p[k][axis]));
    if (d > maxDistance) {
      maxDistance = d;
      maxTime = a.t[i];
    }
  }
  return `farthest apart at equal times: ${maxDistance.toFixed(3)} m, at ${maxTime.toFixed(1)} s (within the spacing of the recorded points)`;
}

// The name of a measurement without its unit, which has its own column.
function measurementName(name) {
  return name.replace(/_(m|mps|deg|s|us|ms)$/, "").replaceAll("_", " ");
}
export async function json(url) {
  const answer = await fetch(url);
  return answer.ok ? answer.json() : null;
}
function heading(text, kind = "") {
  const made = document.createElement("h3");
  made.textContent = text;
  made.className = kind;
  return made;
}
function line(text, kind = "") {
  const made = document.createElement("p");
  made.textContent = text;
  made.className = kind;
  return made;
}
function button(text, id, act) {
  const made = document.createElement("button");
  made.textContent = text;
  made.id = id;
  made.onclick = act;
  return made;
}
function tableOf(heads, rows) {
  const box = document.createElement("div"),
    made = document.createElement("table");
  box.className = "scroll";
  table(made, heads, rows);
  box.append(made);
  return box;
}
