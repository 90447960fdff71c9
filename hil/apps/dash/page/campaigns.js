// Campaigns in the folder beside the past runs: counts, which change while a campaign goes on, and the report of each.

import { json } from "./runs.js";
import { cell } from "./panes/tables.js";

const PERIOD_MS = 2000;
const SILENT_S = 60; // a campaign that goes on is written every two seconds; older than this, the row says so

export class Campaigns {
  constructor(card, list) {
    Object.assign(this, { card, list, timer: null });
  }

  // Show the list, and again every two seconds while a campaign goes on and `isShown` returns true.
  async load(isShown) {
    clearTimeout(this.timer);
    const campaigns = (await json("/api/campaigns")) ?? [];
    this.card.hidden = !campaigns.length;
    const head = document.createElement("tr");
    for (const text of ["campaign", "state"]) cell(head, text, { tag: "th" });
    for (const text of ["PASS", "FAIL", "ERROR", "FLAKE", "pass rate, 95 %"])
      cell(head, text, { tag: "th", kind: "num" });
    cell(head, "", { tag: "th" });
    this.list.replaceChildren(head, ...campaigns.map(rowOf));
    if (campaigns.some((campaign) => campaign.doing)) {
      this.timer = setTimeout(() => {
        if (isShown()) this.load(isShown);
      }, PERIOD_MS);
    }
  }
}

function rowOf(campaign) {
  const row = document.createElement("tr");
  row.dataset.campaign = campaign.name;
  cell(row, campaign.name, { kind: "mono" });
  if (campaign.broken) {
    cell(row, "broken", { kind: "bad", title: campaign.broken });
    return row;
  }
  cell(row, stateOf(campaign));
  for (const [key, kind] of [
    ["pass", "good"],
    ["fail", "warned"],
    ["error", "bad"],
    ["flake", "bad"],
  ]) {
    cell(row, campaign[key].toLocaleString("en"), { kind: campaign[key] ? `num ${kind}` : "num" });
  }
  const [low, rate, high] = campaign.pass_rate.map((value) => `${(100 * value).toFixed(1)} %`);
  cell(row, campaign.pass + campaign.fail ? `${rate} (${low} to ${high})` : "", { kind: "num" });
  const last = cell(row, "");
  if (campaign.report) {
    const link = document.createElement("a");
    link.href = `/campaigns/${encodeURIComponent(campaign.name)}/report.html`;
    link.target = "_blank";
    link.rel = "noopener";
    link.textContent = campaign.doing ? "Earlier report" : "Report";
    last.append(link);
  }
  return row;
}

function stateOf({ doing, complete, stopped, age_s: age }) {
  if (doing) {
    const silent =
      age > SILENT_S
        ? `; not updated for ${age > 7200 ? `${(age / 3600).toFixed(0)} h` : `${(age / 60).toFixed(0)} min`}`
        : "";
    return `${doing.phase}: ${doing.done.toLocaleString("en")} of ${doing.total.toLocaleString("en")}${silent}`;
  }
  if (complete) return "complete";
  return stopped ? `stopped: ${stopped}` : "interrupted";
}
