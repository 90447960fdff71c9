"""Latency benchmark: a slow companion in latency_true lockstep, compared with the same companion in real time.

The waypoints client, which computes for a given time per answer, flies a short mission in real time and in latency_true
lockstep, where its compute time is charged in simulated time. The error is the greatest distance between the two
vehicles at the same simulated time. The error of real time is the distance to a second flight in real time. It
limits the comparison, because load on the machine changes which frames the client receives. The time is wall-clock time
per simulated second. The lockstep flight is then repeated from its trace and must be identical.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.result import Check, Row, ShowStatus
from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.recorder.reading import Recording
from hil.run_files import BENCH_NAME, MCAP_NAME, TRACE_NAME
from signals.errors import HilError

BUSY_S = (0.005, 0.05, 0.2)
_LIMIT_M = 0.05
# Up, four metres north, down.
_HOP = """QGC WPL 110
0	1	0	16	0	0	0	0	47.39774200	8.54559400	488.0	1
1	0	3	22	0	0	0	0	47.39774200	8.54559400	3.0	1
2	0	3	16	0	0	0	0	47.39774200	8.54559400	3.0	1
3	0	3	16	0	0	0	0	47.39777800	8.54559400	3.0	1
4	0	3	21	0	0	0	0	47.39777800	8.54559400	0.0	1
"""
_BENCH = """mission: hop.waypoints
autopilot: {transport: loopback}
companion: {start: [waypoints], control: true, rate_hz: 25, port: 0}
record: {report: false, tlog: false}
duration_s: 60
"""


def latency_rows(status: ShowStatus) -> tuple[list[Row], list[Check]]:
    """Fly with each of `BUSY_S` and return rows and checks. Raises HilError if a flight does not PASS."""
    rows: list[Row] = []
    checks: list[Check] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "hop.waypoints").write_text(_HOP)
        (folder / BENCH_NAME).write_text(_BENCH)
        for busy_s in BUSY_S:
            ms = f"{1e3 * busy_s:g} ms"
            status(f"a companion that takes {ms}, in real time and in simulated time")
            busy_setting = f"companion.settings.busy_s={busy_s}"
            first, realtime_s, _ = _fly(folder, "real", busy_setting, "companion.time=realtime", "pace=1")
            second, _, _ = _fly(folder, "second", busy_setting, "companion.time=realtime", "pace=1")
            lockstep, lockstep_s, digest = _fly(folder, "true", busy_setting, "companion.time=latency_true")
            trace = f"companion.trace={folder / 'true' / TRACE_NAME}"
            _, _, repeated_digest = _fly(folder, "again", busy_setting, "companion.time=latency_true", trace)
            distance_m = _distance_m(first, lockstep)
            case = f"companion that takes {ms}"
            rows.append(Row(case, "latency_true", distance_m, "m from the flight in real time", lockstep_s))
            rows.append(Row(case, "realtime", _distance_m(first, second), "m from a second flight", realtime_s))
            checks.append(
                Check(f"{case}: distance of latency_true from real time", distance_m, "<=", _LIMIT_M, "m", "speed")
            )
            checks.append(
                Check(
                    f"{case}: digests that differ when repeated from the trace",
                    float(digest != repeated_digest),
                    "<=",
                    0.0,
                    "1",
                )
            )
    return rows, checks


def _distance_m(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return the greatest distance of two tracks (n, 3) at the same tick. The shorter track is extended at its end."""
    n = max(len(a), len(b))
    a, b = (np.vstack([p, np.repeat(p[-1:], n - len(p), axis=0)]) for p in (a, b))
    return float(np.linalg.norm(a - b, axis=1).max())


def _fly(folder: Path, name: str, *settings: str) -> tuple[NDArray[np.float64], float, str]:
    """Return the positions by tick in W [m], wall seconds per simulated second, and the digest."""
    result = run_bench(load_bench(folder / BENCH_NAME, settings=settings), folder / name, quiet=True)
    run = result.run
    if run["status"] != "PASS":
        raise HilError(f"{name}: {run['error']['message'] if run['error'] else 'the flight missed its limits'}")
    positions = [
        [values[f"pose.position.{axis}"] for axis in "xyz"]
        for values in (m.decode() for m in Recording(folder / name / MCAP_NAME).messages() if m.topic == "/truth/pose")
    ]
    return np.array(positions), run["wall_s"] / run["sim_s"], run["digest"]
