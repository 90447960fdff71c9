"""`hil bench link`: send lateness in real time, cost of messages, companion links, and flights of real firmware.

Pacing     writes of HIL_SENSOR's size at 250 Hz by the real-time process into a pseudo-terminal with a reader.
           Error: lateness, 99.9th percentile. Time: CPU seconds per second.
HITL       a whole flight of the free-running mock Pixhawk over a pseudo-terminal. Error: greatest cross-track distance.
Messages   HIL_SENSOR encoded and HIL_ACTUATOR_CONTROLS decoded, against pymavlink in the same process. Error: bytes or
           fields that differ from pymavlink's.
Companion  frames of a megabyte to a client under test, in flights (companion.py) and between two hosts, compared with a
           bare socket (transfer.py); slow clients in simulated time, compared with real time (latency.py).
Firmware   the default mission (rectangle.plan) on PX4 SITL and ArduCopter SITL, if the environment variables PX4_BINARY
           and ARDUCOPTER_BINARY are set.
"""

from __future__ import annotations

import os
import struct
import tempfile
import threading
import time
import tty
from pathlib import Path
from typing import Any

from firmware_bridge.codecs.hil import HIL_ACTUATOR_CONTROLS, HIL_SENSOR, actuator_frame, hil_sensor_payload
from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.links.realtime.deadline_schedule import DeadlineSchedule
from firmware_bridge.links.realtime.processor import RealtimeProducer
from firmware_bridge.links.realtime.sender import RealtimeSender, SendStats
from hil.apps.bench_suite.link.companion import measure_flights
from hil.apps.bench_suite.link.latency import latency_rows
from hil.apps.bench_suite.link.transfer import measure_transfers
from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.config import load_bench
from hil.run.bench_run import run_bench
from signals.errors import HilError
from signals.latency import LatencyHistogram
from signals.samples import BaroSample, ImuSample, MagSample
from signals.time import NS_PER_MS

TITLE = "Links: lateness, message errors and flight errors against time"
_PERIOD_NS = 4 * NS_PER_MS
_FRAME = bytes(77)
_WORK_NS = 100_000  # computing time of a tick before its samples are sent
_MESSAGES = 20_000
_LATENESS_LIMIT_MS = 2.0  # p99.9, on an idle machine
_FIRMWARE = {"px4_sitl": "PX4_BINARY", "ardupilot_sitl": "ARDUCOPTER_BINARY"}
_MIN_REALTIME_FACTOR = {"px4_sitl": 25.0, "ardupilot_sitl": 20.0}


def measure(*, quick: bool, status: ShowStatus, errors_only: bool = False) -> BenchmarkResult:
    """Run all parts of the benchmark; `errors_only`: few samples and no flight in real time.

    Raises HilError if a flight ends as ERROR.
    """
    result = BenchmarkResult(time_label="time per item [s] (pacing: CPU time per second)")
    _measure_pacing(result, seconds=0.2 if errors_only else 10 if quick else 60, status=status)
    status("messages")
    _measure_messages(result)
    with tempfile.TemporaryDirectory() as folder:
        measure_flights(result, Path(folder) / "companion", status, seconds=1.5 if quick else 10.0)
        measure_transfers(result, Path(folder), status, seconds=0.35 if quick else 3.0)
        if quick:
            result.left_out.append("companion: slow clients in simulated time, compared with real time")
            result.left_out.append("a whole flight in HITL, and flights of real firmware")
        else:
            rows, checks = latency_rows(status)
            result.rows += rows
            result.checks += checks
            if not errors_only:
                _fly_hitl(result, Path(folder), status)
            for rig, variable in _FIRMWARE.items():
                if variable in os.environ:
                    _fly_firmware(result, rig, os.environ[variable], Path(folder), status)
                else:
                    result.left_out.append(f"{rig}: the environment variable {variable} is not set")
    return result


def _measure_pacing(result: BenchmarkResult, *, seconds: float, status: ShowStatus) -> None:
    status(f"pacing, {seconds:g} s")
    lateness, cpu_s, scheduling = _pace(seconds)
    p999_ms = lateness.quantile_ns(0.999) / NS_PER_MS
    figures = {q: lateness.quantile_ns(v) / 1000 for q, v in (("p50_us", 0.5), ("p99_us", 0.99), ("p999_us", 0.999))}
    details = {**figures, "max_us": lateness.max_ns / 1000, "scheduling": scheduling}
    result.rows.append(Row("samples at 250 Hz", "own process", p999_ms, "ms late (p99.9)", cpu_s / seconds, details))
    result.checks.append(Check("send lateness, p99.9", p999_ms, "<=", _LATENESS_LIMIT_MS, "ms", "speed"))


def _pace(seconds: float) -> tuple[LatencyHistogram, float, str]:
    """Prepare and send one frame per period; return lateness, CPU seconds of this process, and its scheduling."""
    board_fd, bench_fd = os.openpty()
    tty.setraw(bench_fd)
    stop = threading.Event()

    def drain() -> None:
        while not stop.is_set():
            try:
                os.read(board_fd, 65536)
            except OSError:
                return

    threading.Thread(target=drain, daemon=True).start()
    sent = SendStats()
    sender = RealtimeSender(bench_fd, sent, period_ns=_PERIOD_NS, stale_ns=20 * NS_PER_MS)
    schedule = DeadlineSchedule(period_ns=_PERIOD_NS, lead_ns=1_500_000)
    began = time.process_time()
    try:
        with RealtimeProducer():
            for tick in range(int(seconds * 1e9) // _PERIOD_NS):
                deadline_ns = schedule.wait_until_due(tick)
                busy_until = time.monotonic_ns() + _WORK_NS
                while time.monotonic_ns() < busy_until:
                    pass
                sender.push(deadline_ns, _FRAME)
        cpu_s = time.process_time() - began
        time.sleep(0.05)
        sender.stop()
    finally:
        stop.set()
        os.write(bench_fd, b"\0")  # wakes the reader
        os.close(bench_fd)
        os.close(board_fd)
    return sent.lateness, cpu_s, sent.scheduling


def _measure_messages(result: BenchmarkResult) -> None:
    from pymavlink.dialects.v20 import common

    imu = ImuSample(0, 0, 0, (0.1, -0.2, 9.81), (0.01, 0.02, -0.03), 25.0)
    mag, baro = MagSample(0, 0, 0, (2e-5, 1e-6, -4e-5)), BaroSample(0, 0, 0, 95_600.0, 488.0, 20.0)
    encoder = FrameEncoder(1, 1)
    bench_frames = [b""] * _MESSAGES
    began = time.perf_counter()
    for k in range(_MESSAGES):
        bench_frames[k] = encoder.frame(HIL_SENSOR, hil_sensor_payload(k * _PERIOD_NS, imu, mag, baro))
    bench_s = (time.perf_counter() - began) / _MESSAGES
    mav = common.MAVLink(None, srcSystem=1, srcComponent=1)
    pymavlink_frames = [b""] * _MESSAGES
    accel, gyro = (0.1, 0.2, -9.81), (0.01, -0.02, 0.03)
    began = time.perf_counter()
    for k in range(_MESSAGES):
        message = common.MAVLink_hil_sensor_message(
            k * _PERIOD_NS // 1000,
            *accel,
            *gyro,
            2e-5 * 1e4,
            -1e-6 * 1e4,
            4e-5 * 1e4,
            95_600.0 * 1e-2,
            0.0,
            488.0,
            20.0,
            0x1BFF,
            0,
        )
        pymavlink_frames[k] = bytes(message.pack(mav))
        mav.seq = (mav.seq + 1) % 256
    pymavlink_s = (time.perf_counter() - began) / _MESSAGES
    pairs = zip(bench_frames, pymavlink_frames, strict=True)
    differing = sum(a != b for pair in pairs for a, b in zip(*pair, strict=True))
    result.rows.append(Row("HIL_SENSOR encoded", "bench", float(differing), "bytes", bench_s))
    result.rows.append(Row("HIL_SENSOR encoded", "pymavlink", 0.0, "bytes", pymavlink_s))
    result.checks.append(Check("encoded bytes that differ from pymavlink's", float(differing), "<=", 0.0, "bytes"))

    payload = struct.pack("<QQ16fB", 4000, 1, *(i / 16 for i in range(16)), 129)
    stream = b"".join(encoder.frame(HIL_ACTUATOR_CONTROLS, payload) for _ in range(_MESSAGES))
    began = time.perf_counter()
    frames = FrameParser().feed(stream)
    bench_decoded = [actuator_frame(0, frame) for frame in frames]
    bench_s = (time.perf_counter() - began) / _MESSAGES
    parser = common.MAVLink(None)
    began = time.perf_counter()
    pymavlink_decoded = parser.parse_buffer(stream)
    pymavlink_s = (time.perf_counter() - began) / _MESSAGES
    pairs_decoded = zip(bench_decoded, pymavlink_decoded or [], strict=True)
    differing = sum(tuple(message.controls) != frame.controls for frame, message in pairs_decoded)
    result.rows.append(Row("HIL_ACTUATOR_CONTROLS decoded", "bench", float(differing), "fields", bench_s))
    result.rows.append(Row("HIL_ACTUATOR_CONTROLS decoded", "pymavlink", 0.0, "fields", pymavlink_s))
    result.checks.append(Check("decoded fields that differ from pymavlink's", float(differing), "<=", 0.0, "fields"))


def _fly(rig: str, settings: list[str], folder: Path) -> dict[str, Any]:
    bench = load_bench(rig=rig, settings=[*settings, "record.report=false"])
    outcome = run_bench(bench, folder / rig, quiet=True)
    if outcome.status == "ERROR":
        raise HilError(f"{rig}: {outcome.run['error']['message']}")
    return outcome.run


def _fly_hitl(result: BenchmarkResult, folder: Path, status: ShowStatus) -> None:
    status("a flight in HITL, in real time")
    run = _fly("mock_hitl", [], folder)
    realtime = run["autopilot"]["realtime"]
    late_ms = realtime["send_lateness_us"]["p999"] / 1000
    row = Row(
        "HITL flight", "mock_hitl", run["mission"]["max_cross_track_m"], "m", run["wall_s"] / run["sim_s"], realtime
    )
    result.rows.append(row)
    result.checks += [
        Check("HITL flight: send lateness, p99.9", late_ms, "<=", _LATENESS_LIMIT_MS, "ms", "speed"),
        Check("HITL flight: warnings about its timing", len(realtime["findings"]), "<=", 0, "warnings", "speed"),
        Check("HITL flight: max cross-track error", run["mission"]["max_cross_track_m"], "<=", 1.5, "m", "speed"),
    ]


def _fly_firmware(result: BenchmarkResult, rig: str, binary: str, folder: Path, status: ShowStatus) -> None:
    status(f"the default mission on {rig}")
    settings = [f"autopilot.binary={binary}"] + (["tick_hz=400"] if rig == "ardupilot_sitl" else [])
    run = _fly(rig, settings, folder)
    cross_m, factor = run["mission"]["max_cross_track_m"], run["realtime_factor"]
    details = {"realtime_factor": factor, "own_us_p50": run["timing"]["own_us"]["p50"]}
    result.rows.append(Row("rectangle", rig, cross_m, "m", run["wall_s"] / run["sim_s"], details))
    result.checks += [
        Check(f"{rig}: real-time factor", factor, ">=", _MIN_REALTIME_FACTOR[rig], "x", "speed"),
        Check(f"{rig}: max cross-track error", cross_m, "<=", 1.5, "m"),
    ]
    if rig == "px4_sitl":
        result.checks.append(
            Check(
                f"{rig}: processor time per tick of the bench, median",
                details["own_us_p50"],
                "<=",
                80.0,
                "us",
                "speed",
            )
        )
        status("the default mission on px4_sitl, on processors of its own")
        run = _fly(rig, [*settings, "autopilot.share_processor=false"], folder)
        turnaround_us = run["timing"]["turnaround_us"]["p50"]
        details = {"realtime_factor": run["realtime_factor"], "turnaround_us_p50": turnaround_us}
        cross_m, label = run["mission"]["max_cross_track_m"], f"{rig}, own processors"
        result.rows.append(Row("rectangle", label, cross_m, "m", run["wall_s"] / run["sim_s"], details))
        result.checks.append(
            Check(f"{label}: from reply to next send, median", turnaround_us, "<=", 25.0, "us", "speed")
        )
