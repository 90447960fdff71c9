"""`hil bench dash`: what an open page costs the run, whether it changes it, and whether it grows.

The same flight in turns: with nobody looking, with a page and no panes, with a page that shows two pictures of the
run's own, and with one that shows two that its own server draws. The run is in this process; the server and a page that
takes every update at once are in processes of their own, as in `hil run --dash`. The error of a watched flight is
whether its digest is another one. Its cost, each the median over the turns:

    looks        of the run's own thread, in looks at the wire and in updates, as a share of the flight
    processor    more than the flight alone in the same turn, this process's own time
    wall clock   more than the flight alone in the same turn

Any process that is busy beside a flight costs it some of the caches and, on many machines, of the processor itself. One
more flight in each turn is beside a process that only counts, so that this can be told from the dashboard's own part.
Beside each cost by wall clock stands what was used beside the run: by the server, and by the page. The page is only a
socket which is read: a browser, and whatever it draws, is on somebody's desk.

The soak puts as many updates as so many hours bring at 20 a second through the real server, as fast as they go, and
looks at its memory.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hil.bench import fly
from hil.bench_suite.dash_server import ServedPages
from hil.bench_suite.dash_soak import Soaked, soak
from hil.bench_suite.result import BenchmarkResult, Check, Row, save_figure
from hil.config import Bench, load_bench, save_bench
from hil.dashboard.live_run import LiveRun
from hil.recorder.recorder import Recorder

Say = Callable[[str], None]
UPDATES_PER_S = 20.0
_ALONE, _BESIDE = "nobody looks", "nobody looks, beside a process that counts"
_COUNTING = "n = 0\nwhile True: n += 1"
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
_BEFORE_S = 5.0  # simulated, before the clock is looked at
_WARM_S = 3.0  # wall clock
_GROWTH_MIB = 4.0  # of the server, over the soak: what an allocator may do, and no update of which kept a byte
_HOURS = 8.0
# Of a processor. A whole one that only counts costs a run 11 to 23 % where two processors share one core: a fifth of it
# is what leaves the run its 95 %.
_SERVER_PERCENT = 20.0


@dataclass(frozen=True)
class _Flight:
    wall_s: float
    processor_s: float
    digest: str
    updates_per_s: float = 0.0
    looks_s: float = 0.0
    server: float = 0.0  # processor time beside the run, seconds a second: of the page's server
    page: float = 0.0  # and of what stands for a page


def measure(*, quick: bool, say: Say) -> BenchmarkResult:
    """Flights in turns, then the soak. HilError if a flight fails."""
    result = BenchmarkResult(time_label="cost, share of the run's time")
    turns, sim_s = (1, 30.0) if quick else (6, 60.0)
    flights: dict[str, list[_Flight]] = {name: [] for name in (_ALONE, _BESIDE, *_PANES)}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _fly(folder / "warm", 1.0, None)  # whatever is loaded once
        for turn in range(turns):
            # In another order each time: who comes first has the coldest caches.
            order = [*flights][turn % len(flights) :] + [*flights][: turn % len(flights)]
            for method in order:
                say(f"turn {turn + 1} of {turns}: {method}")
                with _counting() if method == _BESIDE else nullcontext():
                    flown = _fly(folder / f"{turn}", sim_s, _PANES.get(method))
                flights[method].append(flown)
                say(_told(flown))
        updates = 3000 if quick else round(_HOURS * 3600 * UPDATES_PER_S)
        soaked = soak(folder, updates, say)
    _judge(result, flights, soaked)
    if quick:
        result.left_out.append(f"{_HOURS:g} hours of updates: {soaked.updates} only; one turn of {sim_s:g} s")
    result.panels += [lambda ax: _draw_costs(ax, flights), lambda ax: _draw_memory(ax, soaked)]
    return result


def _fly(out: Path, sim_s: float, panes: Sequence[str] | None) -> _Flight:
    """`panes` None: nobody looks."""
    bench = load_bench(settings=[*_SETTINGS, f"duration_s={_BEFORE_S + sim_s + 1.0}"])
    if panes is None:
        return _Timed(bench, out, sim_s).fly()
    with ServedPages(out.parent, [panes]) as served:
        served.wait_for_page()
        live = LiveRun(served.wire)
        try:
            return _Timed(bench, out, sim_s, live, served).fly()
        finally:
            live.close()


class _Mark(NamedTuple):
    """Read at the beginning of what is timed, and at its end."""

    wall_s: float
    processor_s: float
    updates: int
    looks_ns: int
    server_s: float
    page_s: float


class _Timed:
    """A flight, timed from `_BEFORE_S` on for `sim_s` of simulated time."""

    def __init__(
        self, bench: Bench, out: Path, sim_s: float, live: LiveRun | None = None, served: ServedPages | None = None
    ) -> None:
        tick_hz = bench.config.tick_hz
        self._from, self._to = round(_BEFORE_S * tick_hz), round((_BEFORE_S + sim_s) * tick_hz)
        self._bench, self._out, self._live, self._served = bench, out, live, served
        self._tick = 0
        self._marks: list[_Mark] = []

    def fly(self) -> _Flight:
        out, tick_ns = self._out, self._bench.config.tick_ns
        out.mkdir(parents=True, exist_ok=True)
        save_bench(self._bench, out)
        recorder = Recorder(out, mcap=True, tlog=False, tick_ns=tick_ns, watch=self._live)
        try:
            fly(self._bench, out, recorder, self._over, self._live)
        finally:
            recorder.close("PASS")
        begin, end = self._marks
        wall_s = end.wall_s - begin.wall_s
        return _Flight(
            wall_s,
            end.processor_s - begin.processor_s,
            recorder.digest,
            (end.updates - begin.updates) / wall_s,
            (end.looks_ns - begin.looks_ns) * 1e-9,
            (end.server_s - begin.server_s) / wall_s,
            (end.page_s - begin.page_s) / wall_s,
        )

    def _over(self, _reached: Callable[[], int], _ended: bool) -> bool:
        self._tick += 1
        if self._tick == self._from and self._live is not None:
            until_s = time.monotonic() + _WARM_S
            while time.monotonic() < until_s:  # the server loads what it draws with, once in its life
                self._live.before_tick()
                time.sleep(0.005)
        if self._tick in (self._from, self._to):
            live, served = self._live, self._served
            beside = (0.0, 0.0) if served is None else served.processor_s
            counts = (0, 0) if live is None else (live.updates, live.looks_ns)
            self._marks.append(_Mark(time.perf_counter(), time.process_time(), *counts, *beside))
        return self._tick >= self._to


def _told(flown: _Flight) -> str:
    beside = f"; beside it: server {100.0 * flown.server:.1f} %, page {100.0 * flown.page:.1f} % of a core"
    return f"  {flown.wall_s:.2f} s, {flown.updates_per_s:.1f} updates/s" + (beside if flown.updates_per_s else "")


@contextmanager
def _counting() -> Iterator[None]:
    with subprocess.Popen([sys.executable, "-c", _COUNTING]) as process:
        try:
            yield
        finally:
            process.kill()


def _cost(flights: dict[str, list[_Flight]], method: str, of: Callable[[_Flight], float]) -> float:
    """Median over the turns of how much more it took than the flight alone in the same turn."""
    pairs = zip(flights[method], flights[_ALONE], strict=True)
    return float(np.median([of(seen) / of(alone) - 1.0 for seen, alone in pairs]))


def _median(flown: Sequence[_Flight], of: Callable[[_Flight], float]) -> float:
    return float(np.median([of(flight) for flight in flown]))


def _looks(flown: Sequence[_Flight]) -> float:
    return _median(flown, lambda flight: flight.looks_s / flight.wall_s)


def _judge(result: BenchmarkResult, flights: dict[str, list[_Flight]], soaked: Soaked) -> None:
    digests = {flight.digest for flown in flights.values() for flight in flown}
    alone = flights[_ALONE][0].digest
    for method, flown in flights.items():
        differing = sum(flight.digest != alone for flight in flown) / len(flown)
        wall = _cost(flights, method, lambda flight: flight.wall_s)
        own = _cost(flights, method, lambda flight: flight.processor_s)
        looks = _looks(flown)
        details = {
            "wall_cost": wall,
            "processor_cost": own,
            "looks": looks,
            "updates_per_s": _median(flown, lambda flight: flight.updates_per_s),
            "server": _median(flown, lambda flight: flight.server),
            "page": _median(flown, lambda flight: flight.page),
            "wall_s": [flight.wall_s for flight in flown],
            "processor_s": [flight.processor_s for flight in flown],
        }
        result.rows.append(
            Row("flight in city_park", method, differing, "digests that differ", max(looks, 1e-4), details)
        )
    spread = float(np.ptp([f.wall_s for f in flights[_ALONE]]) / np.median([f.wall_s for f in flights[_ALONE]]))
    details = {"updates": soaked.updates, "hours_at_20_per_s": soaked.updates / UPDATES_PER_S / 3600.0}
    details |= {"memory_bytes": list(soaked.memory_bytes), "wall_spread_alone": spread}
    per_update_s = soaked.seconds / soaked.updates
    growth_mib = soaked.growth_bytes / 2**20
    result.rows.append(Row("soak", "server, two pages", max(growth_mib, 0.0), "MiB grown", per_update_s, details))
    panes = [method for method in _PANES if method.startswith("two")]
    rate = min(_median(flights[method], lambda flight: flight.updates_per_s) for method in panes)
    server = max(_median(flights[method], lambda flight: flight.server) for method in panes)
    looks = max(_looks(flights[method]) for method in panes)
    beside = max(0.0, _cost(flights, _BESIDE, lambda flight: flight.processor_s))
    own = max(_cost(flights, method, lambda flight: flight.processor_s) for method in panes)
    wall = max(_cost(flights, method, lambda flight: flight.wall_s) for method in panes)
    result.checks += [
        Check("updates a second with two panes", rate, ">=", UPDATES_PER_S, "1/s"),
        Check("cost of two panes: looks and updates in the run's thread", 100.0 * looks, "<=", 5.0, "%"),
        Check("cost of two panes: processor time, less that of any neighbour", 100.0 * (own - beside), "<=", 5.0, "%"),
        Check("cost of two panes: wall clock, all of it", 100.0 * wall, "<=", 5.0, "%"),
        Check(
            "beside the run, by the page's server with two panes", 100.0 * server, "<=", _SERVER_PERCENT, "% of a core"
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


def _draw_costs(ax: Any, flights: dict[str, list[_Flight]]) -> None:
    """Every turn's, so that the machine's own noise is seen beside them."""
    kinds = {"processor time": lambda f: f.processor_s, "wall clock": lambda f: f.wall_s}
    shown = [_BESIDE, *_PANES]
    for row, method in enumerate(shown):
        for shift, (kind, of) in zip((-0.12, 0.12), kinds.items(), strict=True):
            pairs = zip(flights[method], flights[_ALONE], strict=True)
            costs = [100.0 * (of(seen) / of(alone) - 1.0) for seen, alone in pairs]
            colour = "#4477aa" if kind == "processor time" else "#cc8844"
            ax.plot(costs, [row + shift] * len(costs), "o", color=colour, alpha=0.6, label=kind if row == 0 else None)
            ax.plot([float(np.median(costs))], [row + shift], "|", color=colour, markersize=22, markeredgewidth=2.5)
    ax.axvline(5.0, color="#bb3333", linestyle="--", linewidth=1.0)
    ax.axvline(0.0, color="#888888", linewidth=0.8)
    ax.set_yticks(range(len(shown)), [method.replace(", beside", ",\nbeside") for method in shown])
    ax.invert_yaxis()
    ax.set_xlabel("more than the same flight alone [%]")
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
