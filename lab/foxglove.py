"""`hil bench foxglove`: cost of a connected Foxglove client for the run, and its effect on the run.

A flight is made in turns alone and with a client in a process of its own, which subscribes to two compressed cameras
and a LiDAR. All three have new frames for every update. In the table, the error is the share of watched flights whose
digest differs from that of the flight alone; the time is the processor time of the run's thread, which flies, of which
the least of several flights counts. Wall times and the processor time of the whole process, with the threads that
encode and send, are in the JSON file.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import socket
import struct
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.timing import FlightCost
from hil.config import load_bench
from hil.run.bench_run import run_bench

TITLE = "Foxglove: cost of a connected client for the run"
_TOPICS = ("/front/rgb/compressed", "/down/rgb/compressed", "/lidar")
_CAMERA = "kind: camera, resolution: [320, 240], fov_deg: 90, rate_hz: 25, channels: [rgb]"
_SETTINGS = [
    "scene=city_park",
    "autopilot.transport=loopback",
    "mission=rigs/missions/rectangle.plan",
    "crash=null",
    "record={mcap: true, tlog: false, report: false}",
    f"sensors.front={{{_CAMERA}}}",
    f"sensors.down={{{_CAMERA}, mount_rpy_deg: [0, 90, 0]}}",
    "sensors.lidar={preset: vlp16, rate_hz: 20}",
]
_CONNECT_S = 60.0
_MESSAGE = struct.Struct("<BI")


def missing() -> str:
    """Return why this machine cannot run the benchmark, "" if it can."""
    return "" if find_spec("foxglove") else "needs the package foxglove-sdk: pip install 'hil-bench[foxglove]'"


def measure(*, quick: bool, status: ShowStatus) -> BenchmarkResult:
    """Fly with and without a client in turns. Raises HilError if a flight fails."""
    result = BenchmarkResult(time_label="processor time of the flight [s]")
    rounds, seconds = (2, 6) if quick else (5, 30)
    walls: dict[bool, list[float]] = {False: [], True: []}
    costs: dict[bool, list[FlightCost]] = {False: [], True: []}
    digests: dict[bool, set[str]] = {False: set(), True: set()}
    rates: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        for k in range(rounds):
            for watched in (False, True):
                status(f"{'with a client' if watched else 'alone'}, flight {k + 1} of {rounds}")
                costs[watched].append(FlightCost())
                run, counts = _fly(Path(name), costs[watched][-1], watched=watched, seconds=seconds)
                walls[watched].append(run["wall_s"])
                digests[watched].add(run["digest"])
                if watched:
                    rates.append(min(counts) / costs[True][-1].process_s)
    alone_s, watched_s = (min(cost.thread_s for cost in costs[watched]) for watched in (False, True))
    cpu_s = {watched: [(cost.thread_s, cost.process_s) for cost in costs[watched]] for watched in costs}
    differing = len(digests[True] - digests[False]) / rounds
    result.rows += [
        Row(
            "flight in city_park",
            "alone",
            0.0,
            "digests that differ",
            alone_s,
            {"wall_s": walls[False], "cpu_s": cpu_s[False]},
        ),
        Row(
            "flight in city_park",
            "two cameras and a LiDAR to a client",
            differing,
            "digests that differ",
            watched_s,
            {
                "wall_s": walls[True],
                "cpu_s": [(cost.thread_s, cost.process_s) for cost in costs[True]],
                "updates_per_s": rates,
            },
        ),
    ]
    result.checks += [
        Check("updates a second of processor time", max(rates), ">=", 18.0, "1/s", "speed"),
        Check(
            "cost of the client, of the flight's processor time",
            100.0 * (watched_s / alone_s - 1.0),
            "<=",
            5.0,
            "%",
            "speed",
        ),
        Check("different digests, watched and not", len(digests[False] | digests[True]), "<=", 1, "digests"),
    ]
    if quick:
        result.left_out.append("24 of 30 s of the flight, three of five flights")
    return result


def _fly(folder: Path, cost: FlightCost, *, watched: bool, seconds: int) -> tuple[dict[str, Any], Sequence[int]]:
    """Fly; return run.json and the messages that the client got of each topic."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    settings = [*_SETTINGS, f"duration_s={seconds}"]
    if not watched:
        return run_bench(load_bench(settings=settings), folder / "alone", quiet=True, more=[cost]).flown(), ()
    live = [f"foxglove.port={port}", "foxglove.paused=true"]
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        client = pool.submit(follow, port)
        run = run_bench(load_bench(settings=[*settings, *live]), folder / "watched", quiet=True, more=[cost]).flown()
        return run, client.result()


def follow(port: int) -> list[int]:
    """Act as a client: resume the run, receive to its end, and return the number of messages of each topic."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    os.nice(5)  # a viewer has a machine, or at least a processor, of its own
    counts = dict.fromkeys(range(len(_TOPICS)), 0)
    url, protocols = f"ws://127.0.0.1:{port}", [Subprotocol("foxglove.sdk.v1")]
    end_s = time.monotonic() + _CONNECT_S
    while True:
        try:
            connection = connect(url, subprotocols=protocols, max_size=None, compression=None, proxy=None)
            with connection as server:
                for message in server:
                    if isinstance(message, str):
                        _answer(server, json.loads(message))
                    else:
                        kind, number = _MESSAGE.unpack_from(message)
                        if kind == 1:
                            counts[number] += 1
        except ConnectionClosed:
            pass
        except OSError:
            if time.monotonic() < end_s:
                time.sleep(0.05)
                continue
        return list(counts.values())


def _answer(server: Any, message: dict[str, Any]) -> None:
    """Subscribe as soon as the topics are known, then let the run begin."""
    if message["op"] != "advertise":
        return
    wanted = [
        {"id": _TOPICS.index(channel["topic"]), "channelId": channel["id"]}
        for channel in message["channels"]
        if channel["topic"] in _TOPICS
    ]
    if wanted:
        server.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        time.sleep(0.2)
        parameters = [{"name": "paused", "value": False}]
        server.send(json.dumps({"op": "setParameters", "parameters": parameters}))
