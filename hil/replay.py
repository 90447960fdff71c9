"""Compare two recordings of the same run, and name the first thing that differs.

A lockstep run is a pure function of its configuration. `replay` runs a recorded configuration again and compares
what came out, message by message: the first tick and port at which the two part is where the cause is, because
within a tick messages are compared in the order in which they come about (truth, sensors, sent, received,
actuators).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

from mcap.records import Chunk
from rich.console import Console

from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.mavlink_frame import FrameParser
from firmware_bridge.codecs.messages import NAME, unpack
from hil.companion.trace_name import TRACE_NAME
from hil.recorder.reading import RecordedMessage, Recording, causal_order
from hil.recorder.recorder import MCAP_NAME
from hil.signals.errors import RecordingError
from hil.signals.time import NS_PER_S

CONFIG_NAME = "bench.yaml"
_IGNORED = ("/events",)  # notes for people: they may name paths or wall-clock times
_MAVLINK = "hil_msgs/MavlinkFrame"
_BYTES_SHOWN = 64  # of a field that is bytes; of longer ones only the first difference


@dataclass(frozen=True)
class Difference:
    """The first place at which two recordings part. `recorded`, `fresh` are the values, None where there is none."""

    tick: int
    t_ns: int
    port: str
    field: str
    recorded: Any
    fresh: Any

    def __str__(self) -> str:
        where = f"first difference at tick {self.tick} (t = {self.t_ns / NS_PER_S:.3f} s), port {self.port}: "
        if self.recorded is None and self.fresh is None:
            return where + self.field
        if self.recorded is None:
            return where + f"{self.field} only in the fresh run"
        if self.fresh is None:
            return where + f"{self.field} only in the recorded run"
        return where + f"{self.field} {self.recorded!r} != {self.fresh!r}"


@dataclass(frozen=True)
class ReplayResult:
    """What `replay` found. `digests` are those in the two recordings, None where a run was cut off."""

    identical: bool
    difference: Difference | None
    ticks: int
    digests: tuple[str | None, str | None]

    def __str__(self) -> str:
        if self.difference:
            return str(self.difference)
        return f"identical over {self.ticks} ticks, digest {self.digests[1] or 'not in the recording'}"


def compare(recorded: Path, fresh: Path) -> Difference | None:
    """First difference between two `run.mcap` files; None where every message is the same, bit for bit.

    A recording that was cut off is compared up to its end. Raises RecordingError where a file cannot be read.
    """
    a, b = Recording(recorded).scan(), Recording(fresh).scan()
    difference = first_difference(_pairs(a, b), tick_ns=_tick_ns(a, b))
    if difference and _only_one(difference):
        # One run has more than the other. That is a difference only if the shorter one was not cut off.
        shorter = a if difference.recorded is None else b
        if not shorter.scan().complete and difference.t_ns > shorter.last_ns:
            return None
    return difference


def first_difference(
    pairs: Iterator[tuple[RecordedMessage | None, RecordedMessage | None]], *, tick_ns: int
) -> Difference | None:
    """First pair that is not equal. The streaming form: the pairs may come from runs still under way."""
    for a, b in pairs:
        if a == b:
            continue
        if a is None or b is None or (a.log_time_ns, a.topic) != (b.log_time_ns, b.topic):
            # One side lacks a message that the other has: the earlier of the two is the one with no partner.
            first_is_a = b is None or (a is not None and causal_order(a) < causal_order(b))
            extra = a if first_is_a else b
            assert extra is not None
            text = f"message {extra.sequence}"
            return Difference(
                extra.log_time_ns // tick_ns,
                extra.log_time_ns,
                extra.topic,
                text,
                "present" if first_is_a else None,
                None if first_is_a else "present",
            )
        name, left, right = _differing_field(a, b)
        return Difference(a.log_time_ns // tick_ns, a.log_time_ns, a.topic, name, left, right)
    return None


def replay(run_dir: Path, run: Callable[[Path, Path], Any], *, out_dir: Path | None = None) -> ReplayResult:
    """Run `run_dir/bench.yaml` again with `run(config, out_dir)` and compare.

    `out_dir` defaults to `run_dir/replay`. Raises RecordingError where the run cannot be compared: no recording, no
    configuration, or one that ran on free-running hardware.
    """
    config, recorded = run_dir / CONFIG_NAME, run_dir / MCAP_NAME
    for path, what in ((recorded, "a recording (record.mcap)"), (config, "its resolved configuration")):
        if not path.is_file():
            raise RecordingError(f"{run_dir}: cannot be replayed, it lacks {what}: {path.name}")
    _refuse_free_running(run_dir)
    out = out_dir or run_dir / "replay"
    if out.resolve() == run_dir.resolve():
        raise RecordingError(f"{out}: is the run to be compared with; the fresh run needs a folder of its own")
    Recording(recorded).scan()  # a file that cannot be read is noticed before the flight, not after it
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{out}: cannot be used as the folder of a run ({error.strerror or error})") from error
    run(config, out)
    fresh = out / MCAP_NAME
    if not fresh.is_file():
        raise RecordingError(f"{out}: the fresh run left no {MCAP_NAME}; is record.mcap on in {config}?")
    difference = compare(recorded, fresh)
    a, b = Recording(recorded).scan(), Recording(fresh).scan()
    ticks = min(a.last_ns, b.last_ns) // _tick_ns(a, b) + 1
    return ReplayResult(difference is None, difference, ticks, (_digest(a), _digest(b)))


def _refuse_free_running(run_dir: Path) -> None:
    """A physical autopilot keeps its own time: no two runs are alike, and comparing them would say nothing."""
    try:
        run = json.loads((run_dir / "run.json").read_text())
    except (OSError, ValueError):
        return  # a killed run has none; the comparison will tell
    if not isinstance(run, dict):
        return
    error = run.get("error")
    killed = isinstance(error, dict) and error.get("type") == "Killed"
    if run.get("deterministic") is False and not killed and not (run_dir / TRACE_NAME).is_file():
        raise RecordingError(
            f"{run_dir}: was recorded on a free-running rig ({run.get('rig')}), which never repeats bit for bit; "
            "replay wants a lockstep rig such as mock"
        )


def _digest(recording: Recording) -> str | None:
    return recording.metadata.get("hil_result", {}).get("digest")


def _tick_ns(a: Recording, b: Recording) -> int:
    ticks = []
    for recording in (a, b):
        text = recording.metadata.get("hil_run", {}).get("tick_ns", "")
        if not text.isdigit() or int(text) == 0:
            raise RecordingError(f"{recording.path}: names no tick, so it is not a recording of this bench")
        ticks.append(int(text))
    if ticks[0] != ticks[1]:
        raise RecordingError(f"{a.path} ticks every {ticks[0]} ns and {b.path} every {ticks[1]} ns")
    return ticks[0]


def _only_one(difference: Difference) -> bool:
    return difference.recorded is None or difference.fresh is None


def _pairs(a: Recording, b: Recording) -> Iterator[tuple[RecordedMessage | None, RecordedMessage | None]]:
    """Pairs of messages, chunk by chunk. Chunks that are equal as bytes cost no decoding."""
    chunks_a, chunks_b = a.chunks(), b.chunks()
    for left, right in zip_longest(chunks_a, chunks_b):
        if left is not None and left == right:
            a.learn(left)
            b.learn(right)
            continue
        yield from zip_longest(_rest(a, left, chunks_a), _rest(b, right, chunks_b))
        return


def _rest(recording: Recording, chunk: Chunk | None, chunks: Iterator[Chunk]) -> Iterator[RecordedMessage]:
    while chunk is not None:
        for message in recording.messages_of(chunk):
            if message.topic not in _IGNORED:
                yield message
        chunk = next(chunks, None)


def _differing_field(a: RecordedMessage, b: RecordedMessage) -> tuple[str, Any, Any]:
    """Name and the two values of the first field in which two messages of one port differ."""
    if a.type_name == b.type_name and a.data != b.data:
        left, right = a.decode(), b.decode()
        if a.type_name == _MAVLINK:
            named = _differing_mavlink(left["data"], right["data"])
            if named:
                return named
        for name in [*left, *(n for n in right if n not in left)]:
            x, y = left.get(name, "absent"), right.get(name, "absent")
            if _unequal(x, y):
                if isinstance(x, bytes | tuple) and isinstance(y, bytes | tuple) and max(len(x), len(y)) > _BYTES_SHOWN:
                    return _differing_element(name, x, y)
                return name, x, y
        return "bytes", a.data.hex(), b.data.hex()  # -0.0 against 0.0, or two NaNs: equal values, other bits
    for name in ("type_name", "sequence", "publish_time_ns"):
        if getattr(a, name) != getattr(b, name):
            return name, getattr(a, name), getattr(b, name)
    raise AssertionError("called with equal messages")


def _differing_element(name: str, x: Sequence[Any], y: Sequence[Any]) -> tuple[str, Any, Any]:
    """The first element in which two pictures, point clouds or radar frames differ: nobody reads a million of them."""
    if len(x) != len(y):
        return f"length of {name}", len(x), len(y)
    at = next(i for i, (a, b) in enumerate(zip(x, y, strict=True)) if a != b)
    return f"{name}[{at}]", x[at], y[at]


def _differing_mavlink(a: bytes, b: bytes) -> tuple[str, Any, Any] | None:
    """The field of the MAVLink message in which two frames differ; None where either is no whole frame."""
    frames_a, frames_b = FrameParser().feed(a), FrameParser().feed(b)
    if len(frames_a) != 1 or len(frames_b) != 1:
        return None
    left, right = frames_a[0], frames_b[0]
    name = NAME.get(left.msgid, f"message {left.msgid}")
    if left.msgid != right.msgid:
        return "message", name, NAME.get(right.msgid, f"message {right.msgid}")
    for header in ("sysid", "compid", "seq"):
        if getattr(left, header) != getattr(right, header):
            return f"{name} {header}", getattr(left, header), getattr(right, header)
    try:
        values_a, values_b = unpack(left), unpack(right)
    except CodecError:
        return None
    for field, x, y in zip(values_a._fields, values_a, values_b, strict=True):
        if isinstance(x, tuple):
            for i, (u, v) in enumerate(zip(x, y, strict=True)):
                if _unequal(u, v):
                    return f"{name}.{field}[{i}]", u, v
        elif _unequal(x, y):
            return f"{name}.{field}", x, y
    return None


def _unequal(x: Any, y: Any) -> bool:
    return x != y and not (x != x and y != y)  # here NaN equals NaN


def fly_and_compare(run_dir: Path, out: Path | None, errors: Console) -> ReplayResult:
    """Fly the recorded configuration of a run again and compare. Raises HilError."""
    from hil.bench import run_bench
    from hil.config import load_bench

    def again(config: Path, folder: Path) -> None:
        # Companions are not asked again: what they answered is in the trace.
        trace = run_dir / TRACE_NAME
        settings = [f"companion.trace={trace.resolve()}"] if trace.is_file() else []
        fresh = run_bench(load_bench(config, settings=settings), folder)
        if fresh.status == "ERROR":
            errors.print(f"the fresh run ended as an error: {fresh.run['error']['message']}", markup=False)

    return replay(run_dir, again, out_dir=out)
