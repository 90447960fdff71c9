"""`hil bench vehicles`: cost of further vehicles in one run, with the differences between their streams.

`rigs/swarm.yaml` is flown with 1, 2, 5, 10 and 20 mocks, in this process and over pseudo-terminals. Before each of
these runs one vehicle is flown alone; the check compares the vehicle seconds of the two per second of this process's
processor time. The error is the number of vehicles whose digest differs from their digest in the run with the most
vehicles over the other transport: the streams of a vehicle must depend neither on the other vehicles nor on the
transport. `peak_memory_so_far_mb` is the greatest memory of this process since the benchmark began: it shows what
further vehicles take where it grows from a row to the next, in the order of the flights.
"""

from __future__ import annotations

import resource
import tempfile
from pathlib import Path
from typing import Any

import rigs
from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.timing import FlightCost
from hil.config import load_bench
from hil.run.bench_run import run_bench
from signals.errors import HilError

TITLE = "Several vehicles: time per vehicle second"
_BENCH = Path(rigs.__file__).resolve().parent / "swarm.yaml"
_TRANSPORTS = {"in memory": "loopback", "pty": "pty"}
_MIN_RATIO = 0.9


def measure(*, quick: bool, status: ShowStatus) -> BenchmarkResult:
    """Fly swarms of several sizes. Raises HilError if a flight ends as ERROR."""
    result = BenchmarkResult(time_label="processor seconds per vehicle second")
    sizes = (2, 5) if quick else (2, 5, 10, 20)
    duration_s = 12 if quick else 40
    runs: dict[tuple[str, int], dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, transport in _TRANSPORTS.items():
            for size in sizes:
                status(f"{size} vehicles, {name}")
                alone = _fly(Path(folder), 1, transport, duration_s)
                runs[name, size] = run = _fly(Path(folder), size, transport, duration_s)
                runs.setdefault((name, 1), alone)
                ratio = run["vehicle_s_per_processor_s"] / alone["vehicle_s_per_processor_s"]
                label = f"{size} vehicles, {name}: vehicle seconds per processor second over those of one"
                result.checks.append(Check(label, ratio, ">=", _MIN_RATIO, "", "speed"))
    differing = 0
    for (name, size), run in sorted(runs.items(), key=lambda item: (item[0][0], item[0][1])):
        other = next(transport for transport in _TRANSPORTS if transport != name)
        largest = runs[other, max(sizes)]["vehicles"]
        errors = sum(vehicle["digest"] != largest[drone]["digest"] for drone, vehicle in run["vehicles"].items())
        differing += errors
        details = {key: run[key] for key in ("vehicle_s_per_s", "peak_memory_so_far_mb")}
        time_s = 1.0 / run["vehicle_s_per_processor_s"]
        result.rows.append(Row(f"{size} vehicles", name, float(errors), "digests", time_s, details))
    result.checks.append(Check("vehicles whose streams depend on the others", float(differing), "<=", 0.0, ""))
    return result


def _fly(folder: Path, count: int, transport: str, duration_s: float) -> dict[str, Any]:
    settings = [
        f"count={count}",
        f"autopilot.transport={transport}",
        f"duration_s={duration_s}",
        "record.report=false",
        "group.min_distance_m=null",
        "formation.max_error_m=null",
        "formation.shape=line",  # a place does not depend on the number of vehicles
    ]
    cost = FlightCost()
    out = folder / f"{transport}-{count}"
    outcome = run_bench(load_bench(_BENCH, settings=settings), out, quiet=True, more=[cost])
    if outcome.status == "ERROR":
        raise HilError(f"{count} vehicles, {transport}: {outcome.run['error']['message']}")
    peak_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    vehicle_s = outcome.run["vehicle_s_per_s"] * outcome.run["wall_s"]
    more = {"vehicle_s_per_processor_s": vehicle_s / cost.process_s, "peak_memory_so_far_mb": peak_kib / 1024}
    return outcome.run | more
