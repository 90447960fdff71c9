"""`hil bench dash`: what an open page costs the run, whether it changes it, and whether the server grows.

The same flight alone, with a page and no panes, with two panes of the run's own pictures, and with two that the page's
server draws. The run is in this process; the server and a page that takes every update at once are in processes of
their own, as in `hil run --dash`. The page is only a socket that is read: a browser, and what it draws, is not in these
figures. The error of a watched flight is the share of flights whose digest is not that of the flight alone; its time is
the processor time of the run's own thread for looks and updates, as a share of the flight. Of several flights the best
counts: what else the machine did can only have added to the others.

Then many updates are put through the real server as fast as they go, and its memory is compared before and after.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import select
import socket
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from hil.bench import run_bench
from hil.bench_suite.result import BenchmarkResult, Check, Row
from hil.config import Bench, load_bench
from hil.dash_command import server_process
from hil.dashboard.live_run import LiveRun
from hil.dashboard.serve import open_port
from hil.dashboard.snapshot import array_body
from hil.dashboard.wire import Unpacker, packed
from hil.signals.errors import HilError

Say = Callable[[str], None]
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
_WAIT_S = 60.0  # a server beside other work takes its time to load
_WARM_S = 1.0  # of a flight: the server loads what it draws with, once in its life
_PICTURE_EVERY = 5  # updates


def measure(*, quick: bool, say: Say) -> BenchmarkResult:
    """Watched flights, then many updates. HilError if a flight fails or the server goes away."""
    result = BenchmarkResult(time_label="cost, share of the run's time")
    rounds, updates = (1, 2000) if quick else (3, 30_000)
    rates: dict[str, list[float]] = {}
    costs: dict[str, list[float]] = {}
    digests: dict[str, list[str]] = {}
    bench = load_bench(settings=_SETTINGS)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        say("alone")
        alone = _fly(bench, folder / "alone", None)["digest"]
        for k in range(rounds):
            for method, panes in _PANES.items():
                say(f"{method}, flight {k + 1} of {rounds}")
                run, live, rate = _watched(bench, folder, panes)
                rates.setdefault(method, []).append(rate)
                costs.setdefault(method, []).append(1e-9 * live.looks_ns / run["wall_s"])
                digests.setdefault(method, []).append(run["digest"])
        memory_mib, update_s = _memory(folder, updates, say)
    for method, seen in digests.items():
        differing = float(np.mean([digest != alone for digest in seen]))
        details = {"updates_per_s": max(rates[method])}
        result.rows.append(
            Row("flight in city_park", method, differing, "digests that differ", min(costs[method]), details)
        )
    growth = memory_mib[1] - memory_mib[0]
    many = {"updates": updates, "memory_mib": memory_mib}
    result.rows.append(Row("many updates", "the page's server", max(growth, 0.0), "MiB grown", update_s, many))
    two = [method for method in _PANES if method.startswith("two")]
    different = {alone}.union(*digests.values())
    result.checks += [
        Check("updates a second with two panes", min(max(rates[m]) for m in two), ">=", 20.0, "1/s"),
        Check(
            "cost of two panes: looks and updates in the run's thread",
            100.0 * max(min(costs[m]) for m in two),
            "<=",
            5.0,
            "%",
        ),
        Check("different digests, watched and not", len(different), "<=", 1, "digests"),
        Check(f"growth of the server over {updates} updates", growth, "<=", 4.0, "MiB"),
    ]
    if quick:
        result.left_out.append("30,000 updates through the server: 2000 only; each flight but once")
    return result


def _fly(bench: Bench, out: Path, live: LiveRun | None) -> dict[str, Any]:
    flown = run_bench(bench, out, quiet=True, live=live).run
    if flown["error"] is not None:
        raise HilError(f"the flight ended as ERROR: {flown['error']['message']}")
    return flown


def _watched(bench: Bench, folder: Path, panes: Sequence[str]) -> tuple[dict[str, Any], LiveRun, float]:
    """run.json of a flight with a page open, the run's end of it, and updates a second."""
    with _served(folder, panes) as (wire, _, page):
        live = LiveRun(wire)
        run = _fly(bench, folder / "watched", live)
        live.close()
    came_s = np.array(page.result())
    came_s = came_s[came_s > came_s[0] + _WARM_S]
    return run, live, (len(came_s) - 1) / float(np.ptp(came_s))


def _memory(folder: Path, updates: int, say: Say) -> tuple[tuple[float, float], float]:
    """The server's memory [MiB] after a quarter of the updates and after all; seconds an update."""
    panes = ("front/depth", "lidar/points")
    memory_mib: list[float] = []
    with _served(folder, panes) as (wire, pid, _):
        unpacker = Unpacker()
        wire.settimeout(_WAIT_S)
        wire.sendall(packed({"kind": "begin", "sensors": {}, "home": [0.0, 0.0, 0.0], "path": []}))
        made, began_s = 0, time.monotonic()
        while made < updates:
            data = wire.recv(1 << 16)
            if not data:
                raise HilError(f"the dashboard's server went away after {made} updates")
            for _ in unpacker.feed(data):  # each is a request for an update
                made += 1
                wire.sendall(packed(_state(made, panes)))
                if made in (updates // 4, updates):
                    memory_mib.append(_resident_mib(pid))
                    say(f"{made} of {updates} updates, {memory_mib[-1]:.0f} MiB")
        update_s = (time.monotonic() - began_s) / made
    return (memory_mib[0], memory_mib[1]), update_s


def _state(k: int, panes: Sequence[str]) -> dict[str, Any]:
    """An update long in what may grow: trail, events, pictures."""
    p_WB = (20.0 * np.cos(1e-3 * k), 20.0 * np.sin(1e-3 * k), 5.0)
    state: dict[str, Any] = {"kind": "state", "tick": k, "t_ns": k * 50_000_000, "phase": "flying"}
    state |= {"p": p_WB, "q": (1.0, 0.0, 0.0, 0.0), "v": (0.1, 0.2, 0.0), "controls": (0.5,) * 4}
    state |= {"trail": [0.05 * k, *p_WB], "events": [(k, "status", f"event {k}")], "slow": {"links": []}}
    if k % _PICTURE_EVERY == 0:
        place = {"t_ns": k, "p": p_WB, "q": (1.0, 0.0, 0.0, 0.0)}
        depth = array_body(np.full((240, 320), 1.0 + k % 90, np.float32))
        cloud = {"points": np.full((500, 3), k % 7, np.float32).tobytes()}
        state["frames"] = {panes[0]: place | depth, panes[1]: place | cloud}
    return state


@contextmanager
def _served(folder: Path, panes: Sequence[str]) -> Iterator[tuple[socket.socket, int, Future[list[float]]]]:
    """The run's end of a wire to a page that waits for its first update, the server's process id, and the page.

    The page ends when the server does, after this.
    """
    wire, theirs = socket.socketpair()
    with theirs, open_port("127.0.0.1", 0) as listening:
        host = f"127.0.0.1:{listening.getsockname()[1]}"
        server = server_process(listening, theirs, config=None, runs=folder, token=None)
    with wire, ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        try:
            page = pool.submit(follow, host, tuple(panes))
            if not select.select([wire], [], [], _WAIT_S)[0]:
                raise HilError(f"no page has come to the dashboard's server within {_WAIT_S:g} s")
            yield wire, server.pid, page
        finally:
            server.kill()
            server.wait()


def follow(host: str, panes: Sequence[str]) -> list[float]:
    """A page without a browser: takes every update as it comes until the server is gone; when each came [s]."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    came_s: list[float] = []
    asking = json.dumps({"kind": "next"})
    with connect(f"ws://{host}/live", max_size=None, compression=None, proxy=None) as page:
        try:
            page.send(json.dumps({"kind": "streams", "streams": panes}))
            while True:
                page.send(asking)
                page.recv()
                came_s.append(time.monotonic())
        except ConnectionClosed:
            return came_s


def _resident_mib(pid: int) -> float:
    """NaN where the system does not tell."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    except OSError:
        return float("nan")
