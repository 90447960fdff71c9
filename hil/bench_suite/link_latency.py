"""A slow companion in simulated time against the same one in real time: does it fly the same path?

The waypoints client, kept busy for a given time over every answer, flies a short mission twice: in real time, and in
latency_true lockstep, where what the answers took is charged in simulated time. Error: the greatest distance between
the two vehicles at the same simulated instant; of real time, to a second flight in real time, which says how far the
comparison can be trusted: a hiccup of the machine shifts which frames the client takes. Time: wall clock per simulated
second. Then the flight in simulated time again from its trace: it must be the same, bit for bit.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.bench import run_bench
from hil.bench_suite.result import Check, Row
from hil.companion.trace_name import TRACE_NAME
from hil.config import load_bench
from hil.recorder.reading import Recording
from hil.signals.errors import HilError

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


def latency_rows(say: Callable[[str], None]) -> tuple[list[Row], list[Check]]:
    """Raises HilError if a flight does not PASS."""
    rows: list[Row] = []
    checks: list[Check] = []
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "hop.waypoints").write_text(_HOP)
        (place / "bench.yaml").write_text(_BENCH)
        for busy_s in BUSY_S:
            ms = f"{1e3 * busy_s:g} ms"
            say(f"a companion that takes {ms}, in real time and in simulated time")
            busy = f"companion.settings.busy_s={busy_s}"
            live, live_s, _ = _fly(place, "real", busy, "companion.time=realtime", "pace=1")
            second, _, _ = _fly(place, "second", busy, "companion.time=realtime", "pace=1")
            charged, charged_s, digest = _fly(place, "true", busy, "companion.time=latency_true")
            trace = f"companion.trace={place / 'true' / TRACE_NAME}"
            _, _, again = _fly(place, "again", busy, "companion.time=latency_true", trace)
            apart_m = _apart_m(live, charged)
            case = f"companion that takes {ms}"
            rows.append(Row(case, "latency_true", apart_m, "m from the flight in real time", charged_s))
            rows.append(Row(case, "realtime", _apart_m(live, second), "m from a second flight", live_s))
            checks.append(Check(f"{case}: latency_true off real time", apart_m, "<=", _LIMIT_M, "m"))
            checks.append(Check(f"{case}: digests from its trace that differ", float(digest != again), "<=", 0.0, "1"))
    return rows, checks


def _apart_m(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """The one that is over first has come to rest."""
    n = max(len(a), len(b))
    a, b = (np.vstack([p, np.repeat(p[-1:], n - len(p), axis=0)]) for p in (a, b))
    return float(np.linalg.norm(a - b, axis=1).max())


def _fly(place: Path, name: str, *settings: str) -> tuple[NDArray[np.float64], float, str]:
    """Positions tick by tick [m, W], wall seconds per simulated second, digest."""
    result = run_bench(load_bench(place / "bench.yaml", settings=settings), place / name, quiet=True)
    run = result.run
    if run["status"] != "PASS":
        raise HilError(f"{name}: {run['error']['message'] if run['error'] else 'the flight missed its limits'}")
    positions = [
        [values[f"pose.position.{axis}"] for axis in "xyz"]
        for values in (m.decode() for m in Recording(place / name / "run.mcap").messages() if m.topic == "/truth/pose")
    ]
    return np.array(positions), run["wall_s"] / run["sim_s"], run["digest"]
