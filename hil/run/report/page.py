"""The report page of a run: one self-contained HTML file. Its pictures are also PNG files in the run's folder."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from hil.run.recorder.recorder import Event
from hil.run.report.html import table, text
from hil.run_files import PAGE_NAME
from signals.time import NS_PER_S

_EVENTS_SHOWN = 300


class Report(NamedTuple):
    """Contribution of a part to the report page."""

    pictures: Sequence[tuple[str, Path]] = ()  # caption, PNG file
    sections: Sequence[tuple[str, str]] = ()  # heading, HTML


def write_page(out_dir: Path, run: Mapping[str, Any], events: Sequence[Event], report: Report, title: str = "") -> Path:
    """Write `report.html` into `out_dir` and return its path. Also works for a run that failed before tick 0.

    `run` is the content of run.json, `report` the contributions of the parts. Raises OSError.
    """
    page = out_dir / PAGE_NAME
    page.write_text(_page(run, events, report, title), encoding="utf-8")
    return page


def amend_page(out_dir: Path, run: Mapping[str, Any]) -> None:
    """Have a written page say the status and the reasons of `run`, found only after the page was written.

    Does nothing where there is no page. Raises OSError.
    """
    page = out_dir / PAGE_NAME
    if not page.is_file():
        return
    status, html = escape(str(run["status"])), page.read_text(encoding="utf-8")
    html = re.sub(r"<title>\w+", f"<title>{status}", html, count=1)
    header = f'<header class="{status.lower()}"><b>{status}</b>'
    html = re.sub(r'<header class="\w+"><b>\w+</b>', header, html, count=1)
    page.write_text(html.replace("</header>", f"</header>\n{_reasons(run)}", 1), encoding="utf-8")


def headline(run: Mapping[str, Any]) -> str:
    """Return scene, rig, seed and duration of the run in one line."""
    line = f"{run.get('scene', 'scene')} on rig {run.get('rig', '?')}, seed {run.get('seed', '?')}"
    if run.get("sim_s") is not None and run.get("wall_s") is not None:
        line += f": {run['sim_s']:.1f} s of flight in {run['wall_s']:.1f} s"
        if run.get("realtime_factor") is not None:
            line += f" ({run['realtime_factor']:.0f}\N{MULTIPLICATION SIGN} real time)"
    return line


def _page(run: Mapping[str, Any], events: Sequence[Event], report: Report, title: str) -> str:
    status = str(run.get("status", "ERROR"))
    error = run.get("error")
    message = f"<p class='error'><b>{escape(error['type'])}</b> {escape(error['message'])}</p>" if error else ""
    figures = "".join(
        f"<figure><img alt='{escape(alt)}' src='data:image/png;base64,"
        f"{base64.b64encode(path.read_bytes()).decode()}'></figure>"
        for alt, path in report.pictures
    )
    sections = "".join(f"<section><h2>{escape(heading)}</h2>{html}</section>" for heading, html in report.sections)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{escape(status)} {escape(str(run.get("rig", "")))} {escape(str(run.get("scene", "")))}</title>
<style>{CSS}</style></head><body>
<header class="{escape(status.lower())}"><b>{escape(status)}</b> {escape(title or headline(run))}</header>
{message}
{figures}
<div class="columns"><section><h2>Summary</h2>{table(_headline_rows(run))}</section>
<section><h2>Verdict</h2>{_verdict(run)}<h2>Sensors</h2>{_sensors(run)}
<h2>Not computed</h2>{_skipped(run)}</section></div>
{_warnings(run)}{sections}
<section><h2>Events</h2>{_events(events)}</section>
<footer>digest <code>{escape(str(run.get("digest", "")))}</code><br>
The recording run.mcap opens in Foxglove and with ros2 bag, flight.tlog in QGroundControl.</footer>
</body></html>
"""


def _headline_rows(run: Mapping[str, Any]) -> list[tuple[str, str]]:
    mission = run.get("mission") or {}
    autopilot = run.get("autopilot") or {}
    rtt = autopilot.get("rtt_us") or {}
    return [
        ("Mission completed", text(mission.get("completed"))),
        ("Waypoints reached", f"{text(mission.get('reached'))} of {text(mission.get('waypoints'))}"),
        ("Simulated time", text(run.get("sim_s"), "s")),
        ("Wall time", text(run.get("wall_s"), "s")),
        ("Real-time factor", text(run.get("realtime_factor"))),
        ("Deterministic", text(run.get("deterministic"))),
        ("Seed", text(run.get("seed"))),
        ("Autopilot", text(autopilot.get("kind"))),
        ("Steps, of which late", f"{text(autopilot.get('steps'))}, {text(autopilot.get('late'))}"),
        ("Round trip p50", text(rtt.get("p50"), "\N{MICRO SIGN}s")),
        ("Round trip p99", text(rtt.get("p99"), "\N{MICRO SIGN}s")),
        ("Round trip max", text(rtt.get("max"), "\N{MICRO SIGN}s")),
        *_realtime_rows(autopilot.get("realtime") or {}),
    ]


def _realtime_rows(realtime: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return rows on the punctuality of samples and motor commands; none for an autopilot in lockstep."""
    if not realtime:
        return []
    late, age = realtime["send_lateness_us"], realtime["actuator_age_us"]
    return [
        ("Samples late p50, p99.9, max", f"{late['p50']:.0f}, {late['p999']:.0f}, {late['max']:.0f} \N{MICRO SIGN}s"),
        ("Motor commands' age p50, p99", f"{age['p50']:.0f}, {age['p99']:.0f} \N{MICRO SIGN}s"),
        ("Samples not sent, gaps in commands", f"{realtime['dropped']}, {realtime['actuator_gaps']}"),
        ("Board's clock drifts by", text(realtime["clock_drift_ppm"], "ppm")),
        ("Sending thread", realtime["scheduling"]),
    ]


_MARKS = {True: "\N{CHECK MARK} ", False: "\N{BALLOT X} ", None: ""}  # None: not measured, so not judged


def _limit(row: Mapping[str, Any]) -> str:
    """Return the limit of a measurement; a part may fail a measurement that has none."""
    if row["limit"] is None:
        return "" if row["ok"] is False else "not judged"
    return text(float(row["limit"]), row["unit"])


def _verdict(run: Mapping[str, Any]) -> str:
    """Return the reasons of a FAIL, and a table of every measurement beside its limit."""
    verdict = run.get("verdict") or {}
    rows = [
        (
            _MARKS[r["ok"]] + r["name"].rsplit("_", 1)[0].replace("_", " "),
            text(r["value"], r["unit"]),
            _limit(r),
        )
        for r in verdict.get("rows") or []
    ]
    return _reasons(run) + (table(rows, ("measured", "value", "limit")) if rows else "<p>Nothing was judged.</p>")


def _reasons(run: Mapping[str, Any]) -> str:
    reasons = (run.get("verdict") or {}).get("reasons") or []
    return "".join(f"<p class='error'>{escape(reason)}</p>" for reason in reasons)


def _warnings(run: Mapping[str, Any]) -> str:
    """Return a section with the warnings of the run; empty if there are none."""
    warnings = run.get("warnings") or []
    if not warnings:
        return ""
    rows = [(f"{w['t_s']:.3f}", w.get("vehicle", ""), w["level"], w["text"]) for w in warnings[:_EVENTS_SHOWN]]
    return f"<section><h2>Warnings</h2>{table(rows, ('t [s]', 'vehicle', 'level', 'text'))}</section>\n"


def _sensors(run: Mapping[str, Any]) -> str:
    sensors = run.get("sensors") or {}
    rows = [
        (
            name,
            text(s.get("samples")),
            text(s.get("skipped")),
            text((s.get("ms") or {}).get("p50")),
            text((s.get("ms") or {}).get("p99")),
        )
        for name, s in sensors.items()
    ]
    if not rows:
        return "<p>No sensor was sampled.</p>"
    return table(rows, ("sensor", "samples", "skipped", "p50 [ms]", "p99 [ms]"))


def _skipped(run: Mapping[str, Any]) -> str:
    keys = ("what", "why", "saved")
    rows = [[text(item.get(key, "")) for key in keys] for item in run.get("skipped") or []]
    return table(rows, keys) if rows else "<p>Nothing was left out.</p>"


def _events(events: Sequence[Event]) -> str:
    if not events:
        return "<p>None.</p>"
    by_time = sorted(events, key=lambda event: event.t_ns)  # texts of the autopilot are recorded last
    rows = [(f"{e.t_ns / NS_PER_S:.3f}", e.kind, e.text) for e in by_time[:_EVENTS_SHOWN]]
    more = len(events) - len(rows)
    note = f"<p>and {more} more, in run.mcap</p>" if more > 0 else ""
    return table(rows, ("t [s]", "kind", "text")) + note


CSS = """
:root{color-scheme:light dark;--ink:#20262e;--soft:#5b636e;--line:#dfe3e8;--back:#fff;--card:#f6f7f9}
@media(prefers-color-scheme:dark){:root{--ink:#e6e9ed;--soft:#9aa3ae;--line:#343b44;--back:#15191e;--card:#1d2228}}
*{box-sizing:border-box}
body{font:15px/1.45 system-ui,sans-serif;color:var(--ink);background:var(--back);max-width:1200px;margin:0 auto;
padding:1.2rem}
header{padding:.8rem 1.1rem;border-radius:8px;color:#fff;font-size:1.05rem}
header b{margin-right:.8rem}
.pass{background:#00734f}.fail{background:#b34700}.error{background:#a4161a}
p.error{background:none;border-left:4px solid #a4161a;padding:.3rem .9rem;white-space:pre-wrap}
figure{margin:1rem 0;padding:.5rem;background:#fff;border:1px solid var(--line);border-radius:8px}
img{display:block;width:100%;height:auto}
h2{font-size:1.02rem;margin:1.1rem 0 .4rem}
.columns{display:grid;grid-template-columns:repeat(auto-fit,minmax(330px,1fr));gap:0 2rem}
section{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
td,th{text-align:left;padding:.25rem .6rem .25rem 0;border-bottom:1px solid var(--line);vertical-align:top}
th{color:var(--soft);font-weight:600}
footer{margin-top:1.5rem;color:var(--soft);font-size:.85rem;overflow-wrap:anywhere}
"""
