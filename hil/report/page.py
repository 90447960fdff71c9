"""The report page of a run: one HTML file that needs nothing else, with its pictures beside it as PNGs."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from hil.companion.timing_file import FrameTimes
from hil.recorder.recorder import Event
from hil.recorder.track import TrackArrays
from hil.signals.classes import Classes
from hil.signals.errors import RecordingError
from hil.signals.samples import FrameSample, RadarSample, Vec3
from hil.signals.time import NS_PER_S
from sim.radar.chirp import Chirp

PAGE_NAME = "report.html"
FLIGHT_NAME = "flight.png"
_EVENTS_SHOWN = 300
_LARGEST_PICTURE_BYTES = 8 << 20
_HARMFUL_MS = 20.0  # samples this late were seen to hurt PX4's estimator: firmware_bridge.links.realtime_health
HEAD = ("client", "frames", "dropped", "t1 [ms]", "engine to SUT", "SUT to CUT", "t2 [ms]", "t3 [ms]")
_TIMES = ("t1_ms", "render_ms", "link_ms", "t2_ms", "t3_ms")


@dataclass(frozen=True)
class Timing:
    """Wall-clock figures of a run. `..._bins_ns`: (middle [ns], count); `phase_us`: mean per tick by phase."""

    rtt_bins_ns: Sequence[tuple[float, int]] = ()
    phase_us: Mapping[str, float] = field(default_factory=dict)
    lateness_bins_ns: Sequence[tuple[float, int]] = ()  # of the samples, free-running autopilots only
    age_bins_ns: Sequence[tuple[float, int]] = ()  # of the motor commands, likewise


def write_report(
    out_dir: Path,
    run: Mapping[str, Any],
    track: TrackArrays,
    plan: Sequence[Vec3],
    *,
    events: Sequence[Event] = (),
    timing: Timing | None = None,
    title: str = "",
    frames: Mapping[str, FrameSample] | None = None,
    classes: Classes = Classes(),  # noqa: B008 (immutable)
    chirps: Mapping[str, Chirp] | None = None,
    companion_timing: Mapping[str, FrameTimes] | None = None,
) -> Path:
    """Write `report.html`, `flight.png`, `motion.png` and `timing.png` into `out_dir`; returns the page's path.

    `frames`: one of each camera, LiDAR and radar, which become `frame_NAME.png`; `chirps`: of each radar;
    `companion_timing`: by client, which becomes `companion.png`.

    `run` is what run.json holds, `plan` the waypoints in the world frame [m] in flying order. Works for runs that
    ended before they began (no rows in `track`). Raises RecordingError where a file cannot be written.
    """
    timing = timing or Timing()
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
        pictures = _draw(out_dir, run, track, plan, timing, title)
        pictures += [("Found in the search, and who was there", p) for p in sorted(out_dir.glob("search.png"))]
        pictures += [(f"What {p.parent.name.removeprefix('companion_')} left", p) for p in _left_by_clients(out_dir)]
        pictures += _draw_companion(out_dir, companion_timing or {})
        pictures += _draw_frames(out_dir, frames or {}, classes, chirps or {})
        page = out_dir / PAGE_NAME
        page.write_text(_page(run, events, pictures, title), encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{out_dir}: the report cannot be written ({error.strerror or error})") from error
    return page


def _draw(
    out_dir: Path,
    run: Mapping[str, Any],
    track: TrackArrays,
    plan: Sequence[Vec3],
    timing: Timing,
    title: str,
) -> list[tuple[str, Path]]:
    from hil.report import figures  # half a second of matplotlib, paid after the flight

    pictures: list[tuple[str, Path]] = []
    with figures.style():
        if len(track.t_s):
            path = out_dir / FLIGHT_NAME
            figures.save(figures.flight_figure(track, plan, title or headline(run)), path)
            pictures.append(("Flown path against plan, altitude, attitude and motor commands", path))
            path = out_dir / "motion.png"
            figures.save(figures.motion_figure(track), path)
            pictures.append(("Speed and rotor speeds", path))
        if timing.rtt_bins_ns or timing.phase_us:
            path = out_dir / "timing.png"
            figures.save(figures.timing_figure(timing.rtt_bins_ns, timing.phase_us), path)
            pictures.append(("Round trips and wall time by phase", path))
        if timing.lateness_bins_ns:
            path = out_dir / "realtime.png"
            figures.save(figures.realtime_figure(timing.lateness_bins_ns, timing.age_bins_ns, _HARMFUL_MS), path)
            pictures.append(("Punctuality of samples and motor commands", path))
    return pictures


def _left_by_clients(out_dir: Path) -> list[Path]:
    """Pictures that started clients want to be shown: companion_NAME/report*.png, small enough for a page."""
    found = sorted(out_dir.glob("companion_*/report*.png"))
    return [path for path in found if path.stat().st_size <= _LARGEST_PICTURE_BYTES]


def _draw_companion(out_dir: Path, timing: Mapping[str, FrameTimes]) -> list[tuple[str, Path]]:
    if not timing:
        return []
    from hil.report import figures

    path = out_dir / "companion.png"
    with figures.style():
        figures.save(figures.companion_figure(timing), path)
    return [("Times of every frame to the companions and back", path)]


def _draw_frames(
    out_dir: Path, frames: Mapping[str, FrameSample], classes: Classes, chirps: Mapping[str, Chirp]
) -> list[tuple[str, Path]]:
    if not frames:
        return []
    from hil.report import figures, frame_pictures, radar_pictures

    pictures = []
    with figures.style():
        for name, sample in frames.items():
            path = out_dir / f"frame_{name}.png"
            if isinstance(sample, RadarSample):
                title = frame_pictures.frame_title(name, sample)
                figure = radar_pictures.radar_figure(title, sample.channels, chirps[name])
                pictures.append((f"What {name} saw in its fullest frame", path))
            else:
                figure = frame_pictures.frame_figure(name, sample, classes)
                pictures.append((f"What {name} saw in mid-flight", path))
            figures.save(figure, path)
    return pictures


def headline(run: Mapping[str, Any]) -> str:
    """One line: what was flown and how fast."""
    text = f"{run.get('scene', 'scene')} on rig {run.get('rig', '?')}, seed {run.get('seed', '?')}"
    if run.get("sim_s") is not None and run.get("wall_s") is not None:
        text += f": {run['sim_s']:.1f} s of flight in {run['wall_s']:.1f} s"
        if run.get("realtime_factor") is not None:
            text += f" ({run['realtime_factor']:.0f}\N{MULTIPLICATION SIGN} real time)"
    return text


def _page(run: Mapping[str, Any], events: Sequence[Event], pictures: list[tuple[str, Path]], title: str) -> str:
    status = str(run.get("status", "ERROR"))
    error = run.get("error")
    message = f"<p class='error'><b>{escape(error['type'])}</b> {escape(error['message'])}</p>" if error else ""
    figures = "".join(
        f"<figure><img alt='{escape(alt)}' src='data:image/png;base64,"
        f"{base64.b64encode(path.read_bytes()).decode()}'></figure>"
        for alt, path in pictures
    )
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{escape(status)} {escape(str(run.get("rig", "")))} {escape(str(run.get("scene", "")))}</title>
<style>{_CSS}</style></head><body>
<header class="{escape(status.lower())}"><b>{escape(status)}</b> {escape(title or headline(run))}</header>
{message}
{figures}
<div class="columns"><section><h2>Figures</h2>{_table(_headline_rows(run))}</section>
<section><h2>Verdict</h2>{_verdict(run)}<h2>Sensors</h2>{_sensors(run)}
<h2>Not computed</h2>{_skipped(run)}</section></div>
{_companion(run)}
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
        ("Mission completed", _text(mission.get("completed"))),
        ("Waypoints reached", f"{_text(mission.get('reached'))} of {_text(mission.get('waypoints'))}"),
        ("Simulated time", _text(run.get("sim_s"), "s")),
        ("Wall time", _text(run.get("wall_s"), "s")),
        ("Times real time", _text(run.get("realtime_factor"))),
        ("Deterministic", _text(run.get("deterministic"))),
        ("Seed", _text(run.get("seed"))),
        ("Autopilot", _text(autopilot.get("kind"))),
        ("Steps, of which late", f"{_text(autopilot.get('steps'))}, {_text(autopilot.get('late'))}"),
        ("Round trip p50", _text(rtt.get("p50"), "\N{MICRO SIGN}s")),
        ("Round trip p99", _text(rtt.get("p99"), "\N{MICRO SIGN}s")),
        ("Round trip max", _text(rtt.get("max"), "\N{MICRO SIGN}s")),
        *_realtime_rows(autopilot.get("realtime") or {}),
    ]


def _realtime_rows(realtime: Mapping[str, Any]) -> list[tuple[str, str]]:
    """How punctually a free-running autopilot was served."""
    if not realtime:
        return []
    late, age = realtime["send_lateness_us"], realtime["actuator_age_us"]
    return [
        ("Samples late p50, p99.9, max", f"{late['p50']:.0f}, {late['p999']:.0f}, {late['max']:.0f} \N{MICRO SIGN}s"),
        ("Motor commands' age p50, p99", f"{age['p50']:.0f}, {age['p99']:.0f} \N{MICRO SIGN}s"),
        ("Samples not sent, gaps in commands", f"{realtime['dropped']}, {realtime['actuator_gaps']}"),
        ("Board's clock drifts by", _text(realtime["clock_drift_ppm"], "ppm")),
        ("Sending thread", realtime["scheduling"]),
    ]


def _verdict(run: Mapping[str, Any]) -> str:
    """Every measurement beside its limit, and the reasons of a FAIL."""
    verdict = run.get("verdict") or {}
    rows = [
        (
            ("\N{CHECK MARK} " if r["ok"] else "\N{BALLOT X} ") + r["name"].rsplit("_", 1)[0].replace("_", " "),
            _text(r["value"], r["unit"]),
            "not judged" if r["limit"] is None else _text(float(r["limit"]), r["unit"]),
        )
        for r in verdict.get("rows") or []
    ]
    reasons = "".join(f"<p class='error'>{escape(reason)}</p>" for reason in verdict.get("reasons") or [])
    return reasons + (_table(rows, ("measured", "value", "limit")) if rows else "<p>Nothing was judged.</p>")


def _text(value: Any, unit: str = "") -> str:
    if value is None:
        return "not measured"
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return f"{text} {unit}".rstrip()


def _table(rows: Sequence[Sequence[str]], head: Sequence[str] = ()) -> str:
    def row(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    return f"<table>{row(head, 'th') if head else ''}{''.join(row(cells, 'td') for cells in rows)}</table>"


def _sensors(run: Mapping[str, Any]) -> str:
    sensors = run.get("sensors") or {}
    rows = [
        (
            name,
            _text(s.get("samples")),
            _text(s.get("skipped")),
            _text((s.get("ms") or {}).get("p50")),
            _text((s.get("ms") or {}).get("p99")),
        )
        for name, s in sensors.items()
    ]
    if not rows:
        return "<p>No sensor was sampled.</p>"
    return _table(rows, ("sensor", "samples", "skipped", "p50 [ms]", "p99 [ms]"))


def _companion(run: Mapping[str, Any]) -> str:
    """Of every client: frames, and how long they took; nothing where there was no link."""
    companion = run.get("companion")
    if not companion:
        return ""
    refused = "".join(f"<p class='error'>{escape(text)}</p>" for text in companion["refused"])
    rows = companion_rows(companion)
    return (
        f"<section><h2>Companions</h2><p>{escape(companion_line(companion))}. "
        "Wall time as p50 / p99 / max; t1: engine to CUT, t2: the CUT, t3: CUT to the autopilot.</p>"
        f"{_table(rows, HEAD) if rows else '<p>Nobody came.</p>'}{refused}</section>"
    )


def _skipped(run: Mapping[str, Any]) -> str:
    keys = ("what", "why", "saved")
    rows = [[_text(item.get(key, "")) for key in keys] for item in run.get("skipped") or []]
    return _table(rows, keys) if rows else "<p>Nothing was left out.</p>"


def _events(events: Sequence[Event]) -> str:
    if not events:
        return "<p>None.</p>"
    rows = [(f"{e.t_ns / NS_PER_S:.3f}", e.kind, e.text) for e in events[:_EVENTS_SHOWN]]
    more = len(events) - len(rows)
    note = f"<p>and {more} more, in run.mcap</p>" if more > 0 else ""
    return _table(rows, ("t [s]", "kind", "text")) + note


_CSS = """
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


def companion_rows(companion: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """One row per client under `HEAD`; times as p50 / p99 / max. `companion` is that of run.json."""
    return [
        (
            name + (" (in control)" if client.get("control") else ""),
            str(client.get("frames", 0)),
            str(client.get("dropped", 0)),
            *(_three(client.get(key)) for key in _TIMES),
        )
        for name, client in companion["clients"].items()
    ]


def companion_line(companion: Mapping[str, Any]) -> str:
    """How the clients were connected, in a line."""
    words = f"{companion['frames']} frames at {companion['rate_hz']:g} Hz, {companion['time']}"
    return f"{words}, {companion['arrangement'].replace('_', ' ')}"


def console_rows(companion: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Label and text, for the summary at the end of a run."""
    rows = [("companions", companion_line(companion))]
    for name, client in companion["clients"].items():
        rows.append((f"  {name}", f"{client.get('frames', 0)} frames, {client.get('dropped', 0)} dropped"))
        times = [(key[:2], client.get(key) or {}) for key in ("t1_ms", "t2_ms", "t3_ms")]
        texts = [f"{key} {ms['p50']:.2f} (p99 {ms['p99']:.2f})" for key, ms in times if ms.get("p50") is not None]
        if texts:
            rows.append(("", ", ".join(texts) + " ms"))
    return rows


def _three(times_ms: Mapping[str, float | None] | None) -> str:
    if not times_ms or times_ms["p50"] is None:
        return "\N{EN DASH}"
    return " / ".join(f"{times_ms[key]:.2f}" for key in ("p50", "p99", "max"))
