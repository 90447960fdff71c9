"""`hil bench lockstep`: cost of a step of the closed loop, phase by phase, with the errors of the flight.

The same mission and seed are flown in three configurations: over a pseudo-terminal with all recordings (the default),
the same without recordings, and with the mock in this process (no serial connection). The lower bound is a bare round
trip of messages of the same size through a pseudo-terminal to another process, measured between the flights. The checks
of speed take the processor time of the thread that flies; wall-clock times are in the rows.

The error of a flight is its greatest cross-track distance. The digests of all configurations must be equal.
"""

from __future__ import annotations

import os
import signal
import tempfile
import time
import tty
from pathlib import Path
from typing import Any

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.timing import FlightCost
from hil.config import load_bench
from hil.run.bench_run import run_bench
from signals.errors import HilError
from signals.latency import LatencyHistogram

TITLE = "Lockstep loop: flight error against wall time"
_SENT_BYTES, _ANSWERED_BYTES = 77, 48  # HIL_SENSOR and HIL_ACTUATOR_CONTROLS with four motors, MAVLink 2
_CONFIGURATIONS = {
    "pty, recorded": [],
    "pty, not recorded": ["record.mcap=false", "record.tlog=false"],
    "in memory, recorded": ["autopilot.transport=loopback"],
}


def bare_round_trips(count: int) -> tuple[LatencyHistogram, float]:
    """Measure `count` round trips through a pseudo-terminal to a process that answers each message with a fixed one.

    Return their wall-clock times, and the processor time of this thread for each [s].
    """
    bench_fd, echo_fd = os.openpty()
    tty.setraw(echo_fd)
    pid = os.fork()
    if pid == 0:
        answer = bytes(_ANSWERED_BYTES)
        try:
            while True:
                os.read(echo_fd, 4096)
                os.write(echo_fd, answer)
        finally:
            os._exit(0)
    histogram = LatencyHistogram()
    request = bytes(_SENT_BYTES)
    began_s = time.thread_time()
    try:
        for _ in range(count):
            began = time.perf_counter_ns()
            os.write(bench_fd, request)
            os.read(bench_fd, 4096)
            histogram.add(time.perf_counter_ns() - began)
        processor_s = time.thread_time() - began_s
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        os.close(bench_fd)
        os.close(echo_fd)
    return histogram, processor_s / count


def measure(*, quick: bool, status: ShowStatus) -> BenchmarkResult:
    """Fly the default mission in each configuration. Raises HilError if a flight is no PASS."""
    result = BenchmarkResult(time_label="wall seconds per simulated second")
    repeats = 1 if quick else 3
    runs: dict[str, list[dict[str, Any]]] = {name: [] for name in _CONFIGURATIONS}
    step_us: dict[str, list[float]] = {name: [] for name in _CONFIGURATIONS}  # processor time
    bare, bare_s = LatencyHistogram(), list[float]()
    with tempfile.TemporaryDirectory() as folder:
        for repeat in range(repeats):
            for name, settings in _CONFIGURATIONS.items():
                status(f"{name}, flight {repeat + 1} of {repeats}")
                bench = load_bench(settings=[*settings, "record.report=false"])
                cost = FlightCost()
                outcome = run_bench(bench, Path(folder) / f"{name}-{repeat}", quiet=True, more=[cost])
                if outcome.status != "PASS":  # the time of a flight that failed is no figure
                    error, reasons = outcome.run["error"], outcome.run["verdict"]["reasons"]
                    raise HilError(f"{name}: {error['message'] if error else reasons[0]}")
                runs[name].append(outcome.run)
                step_us[name].append(1e6 * cost.thread_s / (outcome.run["sim_s"] * bench.config.tick_hz))
                status("bare round trips")
                trips, trip_s = bare_round_trips(2000)
                bare_s.append(trip_s)
                for middle_ns, n in trips.bins():
                    for _ in range(n):
                        bare.add(int(middle_ns))
    bare_us = bare.quantile_ns(0.5) / 1000
    for name, flights in runs.items():
        # The fastest flight: other load on the machine can only slow flights down.
        fastest = max(flights, key=lambda run: run["realtime_factor"])
        timing = fastest["timing"]
        phases = {phase: stats["p50"] for phase, stats in timing["phase_us"].items()}
        result.rows.append(
            Row(
                "rectangle",
                name,
                fastest["mission"]["max_cross_track_m"],
                "m",
                fastest["wall_s"] / fastest["sim_s"],
                {
                    "realtime_factor": fastest["realtime_factor"],
                    "step_us_p50": timing["step_us"]["p50"],
                    "own_us_p50": timing["own_us"]["p50"],
                    "phase_us_p50": phases,
                    "bare_round_trip_us_p50": bare_us,
                    "processor_us": min(step_us[name]),
                    "final_error_m": fastest["mission"]["final_error_m"],
                    "digest": fastest["digest"],
                },
            )
        )
    default = max(runs["pty, recorded"], key=lambda run: run["realtime_factor"])
    excess_us = min(step_us["pty, recorded"]) - 1e6 * min(bare_s)
    digests = {run["digest"] for flights in runs.values() for run in flights}
    mission = default["mission"]
    result.checks += [
        Check("step over the pty above a bare round trip, processor time", excess_us, "<=", 100.0, "us", "speed"),
        Check(
            "processor time per step of the bench, median",
            default["timing"]["own_us"]["p50"],
            "<=",
            150.0,
            "us",
            "speed",
        ),
        Check("different digests over all flights", len(digests), "<=", 1, "digests"),
        Check("max cross-track error", mission["max_cross_track_m"], "<=", 1.0, "m"),
        Check("final error", mission["final_error_m"], "<=", 0.7, "m"),
        Check("altitude error", mission["altitude_error_m"], "<=", 0.5, "m"),
    ]
    return result
