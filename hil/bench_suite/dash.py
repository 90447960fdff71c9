"""`hil bench dash`: what an open page costs the run, whether it changes it, and whether it grows.

The same flight with a page and no panes, with one that shows two pictures of the run's own, and with one that shows two
that its own server draws. The run is in this process; the server and a page that takes every update at once are in
processes of their own, as in `hil run --dash`. The error of a watched flight is whether its digest is another one than
that of a flight that nobody looked at. Its cost, window by window against the same window alone (dash_windows.py):

    looks        of the run's own thread, in looks at the wire and in updates, as a share of the flight
    processor    more than alone, this process's own time
    wall clock   more than alone

Any process that is busy beside a flight costs it some of the caches and, on many machines, of the processor itself. So
the same windows are also flown beside a process that only counts, and with each cost stands what was used beside the
run: by the server, and by the page. The page is only a socket which is read: a browser, and whatever it draws, is on
somebody's desk.

The soak puts as many updates as so many hours bring at 20 a second through the real server, as fast as they go, and
looks at its memory.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hil.bench_suite.dash_soak import Soaked, soak
from hil.bench_suite.dash_windows import BEFORE_S, State, Windows, fly_alone, fly_windows
from hil.bench_suite.result import BenchmarkResult, Check, Row, save_figure
from hil.config import Bench, load_bench

Say = Callable[[str], None]
UPDATES_PER_S = 20.0
_PANES: dict[str, tuple[str, ...]] = {
    "a page, no panes": (),
    "two panes of the run's own": ("front/rgb", "front/depth"),
    "two panes of the page's own": ("view/camera/rgb", "view/lidar/points"),
}
_SETTINGS = [
    "scene=city_park",
    "autopilot.transport=loopback",
    "mission=rigs/missions/rectangle.plan",
    "record={mcap: true, tlog: false, report: false}",
    "sensors.front={kind: camera, resolution: [320, 240], fov_deg: 90, rate_hz: 10, channels: [rgb, depth]}",
]
_WINDOW_S = 2.0  # simulated; about 0.15 s of wall clock
_GROWTH_MIB = 4.0  # of the server, over the soak: what an allocator may do, and no update of which kept a byte
_HOURS = 8.0
_KINDS = (("processor time", "processor_s", "#4477aa"), ("wall clock", "wall_s", "#cc8844"))
# Of a processor. A whole one that only counts costs a run 11 to 23 % where two processors share one core: a fifth of it
# is what leaves the run its 95 %.
_SERVER_PERCENT = 20.0


def measure(*, quick: bool, say: Say) -> BenchmarkResult:
    """Flights in windows, then the soak. HilError if a flight fails."""
    result = BenchmarkResult(time_label="cost, share of the run's time")
    windows, rounds = (15, 1) if quick else (30, 2)
    flown: dict[str, list[Windows]] = {name: [] for name in _PANES}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fly_alone(_bench(1.0), folder / "warm")  # whatever is loaded once
        say("nobody looks")
        alone = fly_alone(_bench(BEFORE_S + windows * _WINDOW_S + 1.0), folder / "alone")
        for i in range(rounds):
            for method, panes in _PANES.items():
                say(f"round {i + 1} of {rounds}: {method}, {windows} windows three times")
                seen = fly_windows(_bench, folder / "watched", panes, windows=windows, window_s=_WINDOW_S)
                flown[method].append(seen)
                say(_told(seen))
        updates = 3000 if quick else round(_HOURS * 3600 * UPDATES_PER_S)
        soaked = soak(folder, updates, say)
    together = {
        method: Windows(np.concatenate([s.spent for s in seen], axis=1), tuple(d for s in seen for d in s.digests))
        for method, seen in flown.items()
    }
    _judge(result, together, alone, soaked)
    if quick:
        result.left_out.append(f"{_HOURS:g} hours of updates: {soaked.updates} only; {windows} windows")
    result.panels += [lambda ax: _draw_costs(ax, together), lambda ax: _draw_memory(ax, soaked)]
    return result


def _bench(duration_s: float) -> Bench:
    return load_bench(settings=[*_SETTINGS, f"duration_s={duration_s}"])


def _told(seen: Windows) -> str:
    wall, error = seen.cost(State.WATCHED, "wall_s")
    return (
        f"  wall clock {100.0 * wall:+.1f} +- {100.0 * error:.1f} %, {seen.share('updates'):.1f} updates/s; beside it: "
        f"server {100.0 * seen.share('server_s'):.1f} %, page {100.0 * seen.share('page_s'):.1f} % of a core"
    )


def _judge(result: BenchmarkResult, flown: dict[str, Windows], alone: str, soaked: Soaked) -> None:
    for method, seen in flown.items():
        differing = sum(digest != alone for digest in seen.digests) / len(seen.digests)
        looks = seen.share("looks_s")
        details: dict[str, Any] = {"looks": looks, "windows": seen.spent.shape[1]}
        for state, what in ((State.WATCHED, "cost"), (State.BESIDE, "cost_beside_counting")):
            for field in ("wall_s", "processor_s"):
                cost, error = seen.cost(state, field)
                details |= {f"{field[:-2]}_{what}": cost, f"{field[:-2]}_{what}_standard_error": error}
        details |= {f"{name}_per_s": seen.share(name) for name in ("updates", "server_s", "page_s")}
        result.rows.append(
            Row("flight in city_park", method, differing, "digests that differ", max(looks, 1e-4), details)
        )
    details = {"updates": soaked.updates, "hours_at_20_per_s": soaked.updates / UPDATES_PER_S / 3600.0}
    details |= {"memory_bytes": list(soaked.memory_bytes)}
    per_update_s = soaked.seconds / soaked.updates
    growth_mib = soaked.growth_bytes / 2**20
    result.rows.append(Row("soak", "server, two pages", max(growth_mib, 0.0), "MiB grown", per_update_s, details))
    panes = [seen for method, seen in flown.items() if method.startswith("two")]
    digests = {alone, *(digest for seen in flown.values() for digest in seen.digests)}
    costs = [seen.cost(State.WATCHED, "wall_s") for seen in panes]
    result.checks += [
        Check("updates a second with two panes", min(s.share("updates") for s in panes), ">=", UPDATES_PER_S, "1/s"),
        Check(
            "cost of two panes: looks and updates in the run's thread",
            100.0 * max(s.share("looks_s") for s in panes),
            "<=",
            5.0,
            "%",
        ),
        Check("cost of two panes: wall clock, all of it", 100.0 * max(c for c, _ in costs), "<=", 5.0, "%"),
        Check(
            "beside the run, by the page's server with two panes",
            100.0 * max(s.share("server_s") for s in panes),
            "<=",
            _SERVER_PERCENT,
            "% of a core",
        ),
        Check("different digests, watched and not", len(digests), "<=", 1, "digests"),
        Check("growth of the server over the soak", growth_mib, "<=", _GROWTH_MIB, "MiB"),
    ]


def plot(result: BenchmarkResult, title: str, path: Path) -> None:
    """Costs and memory. RecordingError if it cannot be written."""
    from matplotlib.figure import Figure  # slow to import, and only needed here

    figure = Figure(figsize=(11.0, 3.8), layout="constrained")
    for ax, draw in zip(figure.subplots(1, 2).flat, result.panels, strict=True):
        draw(ax)
    figure.suptitle(title)
    save_figure(figure, path)


def _draw_costs(ax: Any, flown: dict[str, Windows]) -> None:
    """Every window's, so that the machine's own noise is seen beside them."""
    shown = {method: (seen, State.WATCHED) for method, seen in flown.items()}
    shown["beside a process that counts"] = (list(flown.values())[-1], State.BESIDE)
    for row, (seen, state) in enumerate(shown.values()):
        for shift, (kind, field, colour) in zip((-0.12, 0.12), _KINDS, strict=True):
            more = 100.0 * np.expm1(seen.more(state, field))
            ax.plot(more, [row + shift] * len(more), "o", color=colour, alpha=0.25, label=kind if row == 0 else None)
            cost, error = (100.0 * value for value in seen.cost(state, field))
            ax.errorbar(cost, row + shift, xerr=2.0 * error, fmt="|", color=colour, markersize=20, markeredgewidth=2.5)
    ax.axvline(5.0, color="#bb3333", linestyle="--", linewidth=1.0)
    ax.axvline(0.0, color="#888888", linewidth=0.8)
    ax.set_xlim(-40.0, 60.0)
    ax.set_yticks(range(len(shown)), list(shown))
    ax.invert_yaxis()
    ax.set_xlabel("more than the same window alone [%]; bars: median, two standard errors")
    ax.legend(fontsize=8, frameon=False)
    ax.set_title("Cost for the run, all digests compared", loc="left", fontsize=10, fontweight="bold")


def _draw_memory(ax: Any, soaked: Soaked) -> None:
    share = np.linspace(0.25, 1.0, len(soaked.memory_bytes))
    hours = share * soaked.updates / UPDATES_PER_S / 3600.0
    ax.plot(hours, np.array(soaked.memory_bytes) / 2**20, ".-", color="#4477aa")
    ax.set_ylim(0, 1.15 * max(soaked.memory_bytes) / 2**20)
    ax.set_xlabel(f"hours' worth of updates at {UPDATES_PER_S:g} a second")
    ax.set_ylabel("server's memory [MiB]")
    ax.set_title(f"Soak: {soaked.updates} updates to two pages", loc="left", fontsize=10, fontweight="bold")
