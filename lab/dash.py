"""`hil bench dash`: cost of an open dashboard page for the run, its effect on the run, and the server's memory.

The same flight is run alone, with a page without panes, with two panes of the run's own pictures, and with two panes
that the server renders. The run is in this process; the server and the page have their own processes, as in
`hil run --dash`. The page is only a socket, so the cost of a browser is not included; it requests the next update as
soon as it has received one.

In the table, the error is the share of watched flights whose digest differs from that of the flight alone. The cost is
the processor time of the run's own thread for requests and updates, at the rate of a run that nothing else slows down:
pages ask in real time, so a flight on a busy machine answers more of them. The least of several flights counts. Updates
are those a second of the processor time of run and server.

Afterwards many updates are sent through the real server as fast as possible, and its memory is compared.
"""

from __future__ import annotations

import json
import multiprocessing
import select
import socket
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.timing import FlightCost, processor_s, resident_mib
from hil.apps.dash.command import server_process
from hil.apps.dash.part import DashboardPart
from hil.apps.dash.server.serve import open_port
from hil.config import Bench, load_bench
from hil.run.bench_run import run_bench
from hil.run.feed.live_run import UPDATE_NS, LiveRun
from hil.run.feed.messages import Unpacker, packed
from hil.run.feed.payloads import array_payload
from hil.run.part import Part
from signals.errors import HilError

TITLE = "Dashboard: cost of an open page for the run, and the server's memory"
_PANES: dict[str, tuple[str, ...]] = {
    "page without panes": (),
    "two panes of the run's pictures": ("front/rgb", "front/depth"),
    "two panes rendered by the server": ("view/camera/rgb", "view/lidar/points"),
}
_SETTINGS = [
    "scene=city_park",
    "autopilot.transport=loopback",
    "mission=rigs/missions/rectangle.plan",
    "record={mcap: true, tlog: false, report: false}",
    "sensors.front={kind: camera, resolution: [320, 240], fov_deg: 90, rate_hz: 10, channels: [rgb, depth]}",
]
_WAIT_S = 60.0  # on a busy machine a server takes long to start
_PICTURE_EVERY = 5  # updates


def measure(*, quick: bool, status: ShowStatus) -> BenchmarkResult:
    """Fly with and without pages, then send many updates. Raises HilError if a flight fails or the server ends."""
    result = BenchmarkResult(time_label="cost, share of the run's time")
    rounds, updates = (1, 2000) if quick else (3, 30_000)
    rates: dict[str, list[float]] = {}
    costs: dict[str, list[float]] = {}
    digests: dict[str, list[str]] = {}
    bench = load_bench(settings=_SETTINGS)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        status("alone")
        digest_alone = _fly(bench, folder / "alone")["digest"]
        for k in range(rounds):
            for method, panes in _PANES.items():
                status(f"{method}, flight {k + 1} of {rounds}")
                run, share, rate = _fly_watched(bench, folder, panes)
                rates.setdefault(method, []).append(rate)
                costs.setdefault(method, []).append(share)
                digests.setdefault(method, []).append(run["digest"])
        memory_mib, update_s = _measure_memory(folder, updates, status)
    for method, method_digests in digests.items():
        differing = float(np.mean([digest != digest_alone for digest in method_digests]))
        details = {"updates_per_processor_s": max(rates[method])}
        result.rows.append(
            Row("flight in city_park", method, differing, "digests that differ", min(costs[method]), details)
        )
    growth = memory_mib[1] - memory_mib[0]
    memory_details = {"updates": updates, "memory_mib": memory_mib}
    result.rows.append(
        Row("many updates", "the page's server", max(growth, 0.0), "MiB grown", update_s, memory_details)
    )
    two_panes = [method for method in _PANES if method.startswith("two")]
    different = {digest_alone}.union(*digests.values())
    result.checks += [
        Check(
            "updates with two panes a second of processor time",
            min(max(rates[m]) for m in two_panes),
            ">=",
            20.0,
            "1/s",
            "speed",
        ),
        Check(
            "cost of two panes: requests and updates in the run's thread",
            100.0 * max(min(costs[m]) for m in two_panes),
            "<=",
            5.0,
            "%",
            "speed",
        ),
        Check("different digests, watched and not", len(different), "<=", 1, "digests"),
        Check(f"growth of the server over {updates} updates", growth, "<=", 4.0, "MiB"),
    ]
    if quick:
        result.left_out.append("28,000 of 30,000 updates through the server; two of three flights with each page")
    return result


def _fly(bench: Bench, out: Path, *more: Part) -> dict[str, Any]:
    return run_bench(bench, out, quiet=True, more=more).flown()


def _fly_watched(bench: Bench, folder: Path, panes: Sequence[str]) -> tuple[dict[str, Any], float, float]:
    """Fly with an open page; return run.json, the share of requests and updates, and updates a processor second."""
    cost = FlightCost()
    with _server_and_page(folder, panes) as (connection, pid, page):
        live = LiveRun(connection)
        began_s = processor_s(pid)
        run = _fly(bench, folder / "watched", DashboardPart(live), cost)
        server_s = processor_s(pid) - began_s
        live.close()
    updates = page.result()
    if updates == 0:
        raise HilError(f"{run['sim_s']:.0f} s of flight were over before the page got an update")
    return run, live.service_ns / updates / UPDATE_NS, updates / (cost.process_s + server_s)


def _measure_memory(folder: Path, updates: int, status: ShowStatus) -> tuple[tuple[float, float], float]:
    """Return the server's memory [MiB] after a quarter of the updates and after all, and seconds per update."""
    panes = ("front/depth", "lidar/points")
    memory_mib: list[float] = []
    with _server_and_page(folder, panes) as (connection, pid, _):
        unpacker = Unpacker()
        connection.settimeout(_WAIT_S)
        connection.sendall(packed({"kind": "begin", "sensors": {}, "home": [0.0, 0.0, 0.0], "path": []}))
        sent, began_s = 0, time.monotonic()
        while sent < updates:
            data = connection.recv(1 << 16)
            if not data:
                raise HilError(f"the dashboard's server ended after {sent} updates")
            for _ in unpacker.feed(data):  # each is a request for an update
                sent += 1
                connection.sendall(packed(_state(sent, panes)))
                if sent in (updates // 4, updates):
                    memory_mib.append(resident_mib(pid))
                    status(f"{sent} of {updates} updates, {memory_mib[-1]:.0f} MiB")
        update_s = (time.monotonic() - began_s) / sent
    return (memory_mib[0], memory_mib[1]), update_s


def _state(k: int, panes: Sequence[str]) -> dict[str, Any]:
    """Return update number `k`, with new entries for everything that the server stores: trail, events and pictures."""
    p_WB = (20.0 * np.cos(1e-3 * k), 20.0 * np.sin(1e-3 * k), 5.0)
    state: dict[str, Any] = {"kind": "state", "tick": k, "t_ns": k * 50_000_000, "phase": "flying"}
    state |= {"p": p_WB, "q": (1.0, 0.0, 0.0, 0.0), "v": (0.1, 0.2, 0.0), "controls": (0.5,) * 4}
    state |= {"trail": [0.05 * k, *p_WB], "events": [(k, "status", f"event {k}")], "slow": {"links": []}}
    if k % _PICTURE_EVERY == 0:
        pose = {"t_ns": k, "p": p_WB, "q": (1.0, 0.0, 0.0, 0.0)}
        depth = array_payload(np.full((240, 320), 1.0 + k % 90, np.float32))
        cloud = {"points": np.full((500, 3), k % 7, np.float32).tobytes()}
        state["frames"] = {panes[0]: pose | depth, panes[1]: pose | cloud}
    return state


@contextmanager
def _server_and_page(folder: Path, panes: Sequence[str]) -> Iterator[tuple[socket.socket, int, Future[int]]]:
    """Start a server and a page; yield the run's side of the connection, the server's process id, and the page.

    The page waits for its first update. It ends when the server ends, after the context.
    """
    connection, server_side = socket.socketpair()
    with server_side, open_port("127.0.0.1", 0, "--port") as listening:
        host = f"127.0.0.1:{listening.getsockname()[1]}"
        server = server_process(listening, server_side, config=None, runs=folder, token=None)
    with connection, ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        try:
            page = pool.submit(follow, host, tuple(panes))
            if not select.select([connection], [], [], _WAIT_S)[0]:
                raise HilError(f"no page has connected to the dashboard's server within {_WAIT_S:g} s")
            yield connection, server.pid, page
        finally:
            server.kill()
            server.wait()


def follow(host: str, panes: Sequence[str]) -> int:
    """Act as a page: request and receive updates until the server ends; return the number of updates."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    received = 0
    request = json.dumps({"kind": "next"})
    with connect(f"ws://{host}/live", max_size=None, compression=None, proxy=None) as page:
        try:
            page.send(json.dumps({"kind": "streams", "streams": panes}))
            while True:
                page.send(request)
                page.recv()
                received += 1
        except ConnectionClosed:
            return received
