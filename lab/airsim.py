"""`hil bench airsim`: times of the server of AirSim's API, with calls that fail and runs that differ as its error.

The server has a process of its own, and the client is a few lines of MessagePack-RPC in this one. Where the package
`cosysairsim` is installed, its client takes the pictures too. Beside each time stands the server's processor time,
which load on the machine affects less.

    ping        round trips while a take-off is pending, with either clock
    pictures    one raw scene picture of 256 x 144; colour, depth and segmentation of 320 x 240, in `calls`
    resets      many in a row, each from a flight, with the growth of memory and open files
    episode     steps of 0.1 s as a gym environment makes them: move, picture, state, collision; twice, in `calls`
"""

from __future__ import annotations

import importlib
import importlib.util
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from lab.airsim_server import BenchClient, BenchServer
from signals.errors import HilError

TITLE = "Server of AirSim's API: time of its calls"
_NO_LIMIT_S = 3e38
_AHEAD = {"is_rate": True, "yaw_or_rate": 0.0}
_SCENE, _DEPTH_PLANAR, _DEPTH_PERSPECTIVE, _SEGMENTATION = 0, 1, 2, 5
_STEP_S = 0.1
_SETTINGS: dict[str, Any] = {"SettingsVersion": 1.2, "SimMode": "Multirotor"}
_CAPTURE = [{"ImageType": kind, "Width": 320, "Height": 240} for kind in (_SCENE, _DEPTH_PLANAR, _SEGMENTATION)]
_WIDE = {**_SETTINGS, "CameraDefaults": {"CaptureSettings": _CAPTURE}}


def measure(*, quick: bool, status: ShowStatus) -> BenchmarkResult:
    """Measure a server with either clock. Raises HilError if one does not start, or refuses a call."""
    result = BenchmarkResult()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for clock in ("wall", "calls"):
            status(f"ping, clock {clock}")
            with BenchServer(folder / f"ping_{clock}", _SETTINGS, clock) as server:
                _measure_ping(result, server, clock)
                if clock == "calls":
                    status("one picture")
                    requests = [_request("0", _SCENE)]
                    _measure_pictures(result, server, requests, "scene 256 x 144, raw", 100 if quick else 1000)
        with BenchServer(folder / "pictures", _WIDE, "calls") as server:
            status("colour, depth and segmentation")
            requests = [_request("0", _SCENE), _request("0", _DEPTH_PLANAR, floats=True), _request("0", _SEGMENTATION)]
            _measure_pictures(
                result, server, requests, "colour, depth and segmentation 320 x 240", 100 if quick else 1000
            )
            status("the client of cosysairsim")
            _measure_cosys(result, server, 100 if quick else 1000)
        status("resets")
        with BenchServer(folder / "resets", _SETTINGS, "calls") as server:
            _measure_resets(result, server, 1000)
        _measure_episode(result, folder, 1000, status)
    if quick:
        result.left_out.append("900 of 1,000 pictures of each kind")
    return result


def _ready(client: BenchClient) -> None:
    client.call("enableApiControl", True, "")
    client.call("armDisarm", True, "")


def _request(camera: str, kind: int, *, floats: bool = False) -> dict[str, Any]:
    return {"camera_name": camera, "image_type": kind, "pixels_as_float": floats, "compress": False}


def _measure_ping(result: BenchmarkResult, server: BenchServer, clock: str) -> None:
    """Ping from a second client while the first one waits for a take-off."""
    pilot, client = server.client(), server.client()
    round_trips_s: list[float] = []
    processor_s: list[float] = []  # of the server during each: with `calls` it simulates all the time
    while len(round_trips_s) < 500:
        pilot.call("reset")
        _ready(pilot)
        move = pilot.send("takeoff", 20.0, "")
        # With `calls` a take-off of some simulated seconds is over soon, so it is repeated.
        for _ in range(50):
            began_s, began_processor_s = time.perf_counter(), server.processor_s()
            client.call("ping")
            processor_s.append(server.processor_s() - began_processor_s)
            round_trips_s.append(time.perf_counter() - began_s)
        pilot.call("cancelLastTask", "")
        pilot.join(move)
    median_s, p95_s = float(np.median(round_trips_s)), float(np.quantile(round_trips_s, 0.95))
    server_s = float(np.median(processor_s))
    details = {"p95_s": p95_s, "server_processor_s": server_s, "calls": len(round_trips_s)}
    result.rows.append(Row("ping, take-off pending", f"clock {clock}", 0.0, "failed calls", median_s, details))
    what = f"ping, clock {clock}: processor time of the server"
    result.checks.append(Check(what, 1e3 * server_s, "<=", 1.0, "ms", "speed"))


def _measure_pictures(
    result: BenchmarkResult, server: BenchServer, requests: list[dict[str, Any]], case: str, count: int
) -> None:
    """Take the same pictures many times in a world that stands still: all must be the same."""
    client = server.client()
    take: Callable[[], Any] = lambda: client.call("simGetImages", requests, "")  # noqa: E731
    first = [(each["image_data_uint8"], each["image_data_float"]) for each in take()]
    differing = 0
    began_s, processor_s = time.perf_counter(), server.processor_s()
    taken = [take() for _ in range(count)]
    wall_s = (time.perf_counter() - began_s) / count
    server_s = (server.processor_s() - processor_s) / count
    for pictures in taken:
        differing += [(each["image_data_uint8"], each["image_data_float"]) for each in pictures] != first
    details = {"server_processor_s": server_s, "per_second": 1.0 / wall_s}
    result.rows.append(Row(case, "own client", differing / count, "pictures that differ", wall_s, details))
    result.checks.append(Check(f"{case}: pictures that differ", differing, "<=", 0, "pictures"))
    if len(requests) == 1:
        result.checks.append(Check(f"{case}: processor time of the server", 1e3 * server_s, "<=", 3.0, "ms", "speed"))
    else:
        result.checks.append(
            Check(f"{case}: a second, by the server's time", 1.0 / server_s, ">=", 60.0, "1/s", "speed")
        )


def _measure_cosys(result: BenchmarkResult, server: BenchServer, count: int) -> None:
    """Take pictures with the client of Cosys-AirSim, if there is one in this Python."""
    case = "colour, depth and segmentation 320 x 240"
    if importlib.util.find_spec("cosysairsim") is None:
        result.left_out.append("pictures with cosysairsim's own client, which is not installed in this Python")
        return
    cosys = importlib.import_module("cosysairsim")
    client = cosys.MultirotorClient(port=server.port)
    kinds = cosys.ImageType
    requests = [
        cosys.ImageRequest("0", kinds.Scene, False, False),
        cosys.ImageRequest("0", kinds.DepthPlanar, True, False),
        cosys.ImageRequest("0", kinds.Segmentation, False, False),
    ]
    client.simGetImages(requests)
    began_s, processor_s = time.perf_counter(), server.processor_s() + time.process_time()
    sizes = {len(client.simGetImages(requests)[0].image_data_uint8) for _ in range(count)}
    wall_s = (time.perf_counter() - began_s) / count
    both_s = (server.processor_s() + time.process_time() - processor_s) / count
    details = {"processor_s": both_s, "per_second": 1.0 / wall_s}
    failed = 0.0 if sizes == {320 * 240 * 3} else 1.0
    result.rows.append(Row(case, "cosysairsim", failed, "pictures of a wrong size", wall_s, details))
    result.checks.append(
        Check(f"{case}, cosysairsim: a second of processor time", 1.0 / both_s, ">=", 60.0, "1/s", "speed")
    )


def _measure_resets(result: BenchmarkResult, server: BenchServer, count: int) -> None:
    """Fly a little and reset, many times."""
    client = server.client()
    start = client.call("simGetVehiclePose", "")["position"]
    failures = 0
    before: tuple[float, float] = (float("nan"), float("nan"))
    spent_s = 0.0
    for k in range(count):
        if k == count // 10:  # the first ones fill caches
            before = server.resident_mib(), server.open_files()
        try:
            _ready(client)
            client.call("moveByVelocity", 1.0, 0.5, -2.0, 0.2, 0, _AHEAD, "")
            began_s = time.perf_counter()
            client.call("reset")
            spent_s += time.perf_counter() - began_s
            if client.call("simGetVehiclePose", "")["position"] != start:
                failures += 1
        except HilError:
            failures += 1
    grown_mib, grown_files = server.resident_mib() - before[0], server.open_files() - before[1]
    details = {"resets": count, "grown_mib": grown_mib, "grown_files": grown_files}
    result.rows.append(Row(f"{count} resets in flight", "clock calls", failures, "failures", spent_s / count, details))
    result.checks += [
        Check(f"failures of {count} resets", failures, "<=", 0, "resets"),
        Check(f"growth over {count} resets", grown_mib, "<=", 2.0, "MiB"),
        Check(f"open files more after {count} resets", grown_files, "<=", 0, "files"),
    ]


def _measure_episode(result: BenchmarkResult, folder: Path, steps: int, status: ShowStatus) -> None:
    """Fly an episode in two servers: their digests must be the same."""
    digests: list[str] = []
    times_s: list[float] = []
    processor_s: list[float] = []
    for k in range(2):
        status(f"episode {k + 1} of 2")
        with BenchServer(folder / f"episode_{k}", _SETTINGS, "calls") as server:
            client = server.client()
            _ready(client)
            client.call("moveToPosition", 0.0, 0.0, -20.0, 10.0, _NO_LIMIT_S, 0, _AHEAD, -1.0, 1.0, "")
            began_s, began_processor_s = time.perf_counter(), server.processor_s()
            _fly_episode(client, steps)
            times_s.append(time.perf_counter() - began_s)
            processor_s.append(server.processor_s() - began_processor_s)
            digests.append(server.finish()["digest"])
    differing = float(digests[0] != digests[1])
    details = {"server_processor_s": min(processor_s), "steps": steps}
    case = f"gym episode of {steps} steps"
    result.rows.append(Row(case, "clock calls", differing, "digests that differ", min(times_s), details))
    result.checks.append(Check(f"{case}: processor time of the server", min(processor_s), "<=", 10.0, "s", "speed"))
    result.checks.append(Check(f"{case}: different digests", len(set(digests)), "<=", 1, "digests"))


def _fly_episode(client: BenchClient, steps: int) -> None:
    """Act at random, as a gym environment does before its policy has learned something."""
    picture = [_request("3", _DEPTH_PERSPECTIVE, floats=True)]
    actions = np.random.default_rng(0).integers(0, 6, steps)
    for action in actions:
        speed = client.call("getMultirotorState", "")["kinematics_estimated"]["linear_velocity"]
        v = [speed["x_val"], speed["y_val"], speed["z_val"]]
        v[action % 3] += 0.25 if action < 3 else -0.25
        client.call("moveByVelocity", *v, _STEP_S, 0, _AHEAD, "")
        client.call("simGetImages", picture, "")
        client.call("getMultirotorState", "")
        client.call("simGetCollisionInfo", "")
