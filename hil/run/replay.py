"""Run a recorded configuration again, and return the first difference of the two recordings.

A lockstep run is a pure function of its configuration. The two recordings are compared message by message, within a
tick in causal order (truth, sensors, sent, received, actuators), so the first tick and port that differ are the cause.
The digests are compared, too: they cover what is not recorded, and what a recording has lost.
"""

from __future__ import annotations

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
from hil.config import Bench
from hil.run.recorder.reading import RecordedMessage, Recording, causal_order
from hil.run.replayed_verdict import carry_verdict, read_run
from hil.run_files import BENCH_NAME, MCAP_NAME, TRACE_NAME
from signals.errors import ConfigError, RecordingError, file_errors
from signals.time import NS_PER_S

_IGNORED = "/events"  # end of a topic: notes for people: they may name paths or wall-clock times
_MAVLINK = "hil_msgs/MavlinkFrame"
_BYTES_SHOWN = 64  # longer fields of bytes are shown by their first difference


@dataclass(frozen=True)
class Difference:
    """The first difference of two recordings. `recorded`, `fresh`: the two values, None where one is missing."""

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
    """Result of a replay. `digests`: of the recorded run, None if it did not come to its end, and of the fresh one,
    None if its recording has none.

    `recorded_verdict`: that of a recorded run that did not pass, in words. The messages of a run may all be the same
    (no `difference`), and the digests not: then the runs are not identical.
    """

    identical: bool
    difference: Difference | None
    ticks: int
    digests: tuple[str | None, str | None]
    recorded_verdict: str = ""
    stopped: bool = False  # the recorded run ended as ERROR
    cut: bool = False  # the recording was cut off

    def __str__(self) -> str:
        recorded, fresh = self.digests
        end = ", up to where the run ended as ERROR" if self.stopped else ""
        end = ", up to where the recording was cut off" if self.cut else end
        text = f"identical over {self.ticks} ticks{end}, digest {fresh or 'not in the recording'}"
        if self.cut and recorded:
            text += ", that of the whole run"
        if not self.identical:
            text = (
                f"the recorded messages are the same over {self.ticks} ticks{end}, the digests are not: {recorded} != "
                f"{fresh}; what is not recorded differs, such as pictures, or run.json is of another run"
            )
        return "\n".join(part for part in (str(self.difference or text), self.recorded_verdict) if part)


def compare(recorded: Path, fresh: Path) -> Difference | None:
    """Return the first difference of two `run.mcap` files, None if every message is the same, bit for bit.

    A recording that was cut off is compared up to its end, and one of a run that ended as ERROR up to its last tick, of
    which it may lack the answers. Raises RecordingError if a file cannot be read.
    """
    a, b = Recording(recorded).scan(), Recording(fresh).scan()
    difference = _first_difference(_pairs(a, b), tick_ns=_tick_ns(a, b))
    if difference and _one_sided(difference):
        # One run has more messages. That is a difference only if the shorter recording was not cut off.
        shorter = a if difference.recorded is None else b
        if not shorter.scan().complete and difference.t_ns > shorter.end_ns(difference.port):
            return None
        if shorter is a and _stopped(a) and difference.t_ns >= shorter.last_ns:
            return None
    return difference


def _first_difference(
    pairs: Iterator[tuple[RecordedMessage | None, RecordedMessage | None]], *, tick_ns: int
) -> Difference | None:
    """Return the difference in the first pair of unequal messages, None if there is none.

    Consumes `pairs` one by one, so they may come from runs still under way.
    """
    for a, b in pairs:
        if a == b:
            continue
        if a is None or b is None or (a.log_time_ns, a.topic) != (b.log_time_ns, b.topic):
            # One recording lacks a message: the earlier of the two messages is the one without a counterpart.
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


def run_files(run_dir: Path, use: str, whole: str) -> tuple[Path, Path]:
    """Return the resolved configuration and the recording of a run.

    `use`: what cannot be done without them. `whole`: what to do with the folder of one vehicle: {run} and {vehicle} are
    filled in. Raises ConfigError if there is no such folder, RecordingError if it lacks one of the two.
    """
    if not run_dir.is_dir():
        fault = "is a file, not the folder of a run" if run_dir.exists() else "does not exist"
        hint = (
            f"name its folder, {run_dir.parent}"
            if run_dir.name == MCAP_NAME
            else "name the folder of a run, such as runs/latest"
        )
        raise ConfigError.at(str(run_dir), fault, hint)
    config, recorded = run_dir / BENCH_NAME, run_dir / MCAP_NAME
    is_vehicle = (run_dir.parent / MCAP_NAME).is_file()
    hint = whole.format(run=run_dir.parent, vehicle=run_dir.name) if is_vehicle else "was record.mcap off?"
    for path, remedy in ((recorded, hint), (config, "its resolved configuration")):
        if not path.is_file():
            raise RecordingError(f"{run_dir}: cannot be {use}: it has no {path.name} ({remedy})")
    return config, recorded


def replay(run_dir: Path, run: Callable[[Path, Path], Any], *, out_dir: Path | None = None) -> ReplayResult:
    """Run `run_dir/bench.yaml` again with `run(config, out_dir)` and compare.

    `out_dir` defaults to `run_dir/replay`. Raises ConfigError if there is no such folder, RecordingError if the
    run has no recording or no configuration, or was not repeatable, or the fresh recording was cut off.
    """
    config, recorded = run_files(run_dir, "replayed", whole="hil replay {run}")
    _refuse_not_repeatable(run_dir)
    out = out_dir or run_dir / "replay"
    if out.resolve() == run_dir.resolve():
        raise RecordingError(f"{out}: holds the recorded run; name another folder for the fresh run with --out")
    Recording(recorded).scan()  # reports an unreadable file before the flight instead of after it
    with file_errors(out, "cannot be used as a folder for results"):
        out.mkdir(parents=True, exist_ok=True)
    run(config, out)
    fresh = out / MCAP_NAME
    if not fresh.is_file():
        raise RecordingError(f"{out}: the fresh run left no {MCAP_NAME}; is record.mcap on in {config}?")
    a, b = Recording(recorded).scan(), Recording(fresh).scan()
    if not b.complete:
        raise RecordingError(
            f"{fresh}: is cut off, so the fresh run says nothing; replay into a folder with room (--out)"
        )
    difference = compare(recorded, fresh)
    ticks = min(a.whole_ns, b.whole_ns) // _tick_ns(a, b) + 1
    digests, digest = _whole_digests(run_dir, a), _digest(b)
    recorded_digest = next((one for one in digests if one != digest), next(iter(digests), None))
    identical = difference is None and recorded_digest in (None, digest)
    verdict = carry_verdict(run_dir, out, identical=identical)
    shown = (recorded_digest, digest)
    return ReplayResult(identical, difference, ticks, shown, verdict, _stopped(a), not a.complete)


def _whole_digests(run_dir: Path, recording: Recording) -> list[str]:
    """Return the digests of a run that came to its end, by its recording and by its run.json, which outlasts a cut."""
    run = read_run(run_dir)
    if _stopped(recording) or run.get("status") == "ERROR":
        return []
    return [digest for digest in (_digest(recording), run.get("digest")) if digest]


def _refuse_not_repeatable(run_dir: Path) -> None:
    """Raise RecordingError for a run that had inputs which neither its configuration nor its trace contains."""
    run = read_run(run_dir)  # a killed run has none; the comparison finds any difference
    vehicles = run.get("vehicles")
    if vehicles:
        for name in vehicles:
            _refuse_not_repeatable(run_dir / name)
        return
    error = run.get("error")
    killed = isinstance(error, dict) and error.get("type") == "Killed"
    if run.get("deterministic") is False and not killed and not (run_dir / TRACE_NAME).is_file():
        raise RecordingError(
            f"{run_dir}: this run on rig {run.get('rig')} does not repeat bit for bit: it had a free-running autopilot "
            "or companion, signing, input from outside (MAVLink, sticks, dashboard) or pictures of a renderer that "
            "does not repeat; replay needs a lockstep run without these"
        )


def _traces(run_dir: Path) -> list[str]:
    """Return the settings with which the traces of a run answer in place of its companions."""
    traces = {"": run_dir / TRACE_NAME}
    for name in Recording(run_dir / MCAP_NAME).scan().vehicles:  # the folder may also hold other runs
        traces[f"vehicles.{name}."] = run_dir / name / TRACE_NAME
    return [f"{place}companion.trace={trace.resolve()}" for place, trace in traces.items() if trace.is_file()]


def _without_subscribers(bench: Bench) -> list[str]:
    """Return the settings with which a run has no ROS 2 node, or waits for none if one may command the vehicle."""
    places = {"": bench} | {f"vehicles.{name}.": vehicle for name, vehicle in bench.vehicles.items()}
    return [
        f"{place}ros2.wait_for=[]" if one.config.ros2.control else f"{place}ros2.domain=null"
        for place, one in places.items()
        if one.config.ros2.domain is not None
    ]


def _stopped(recording: Recording) -> bool:
    """Return True if the recorded run ended as ERROR, such as by a lost link or a signal."""
    return recording.metadata.get("hil_result", {}).get("status") == "ERROR"


def _digest(recording: Recording) -> str | None:
    return recording.metadata.get("hil_result", {}).get("digest")


def _tick_ns(a: Recording, b: Recording) -> int:
    """Return the tick of both recordings. Raises RecordingError if they differ or one has none."""
    ticks = []
    for recording in (a, b):
        text = recording.metadata.get("hil_run", {}).get("tick_ns", "")
        if not text.isdigit() or int(text) == 0:
            raise RecordingError(
                f"{recording.path}: has no tick_ns in its metadata, so it is not a recording of this bench"
            )
        ticks.append(int(text))
    if ticks[0] != ticks[1]:
        raise RecordingError(f"{a.path} ticks every {ticks[0]} ns and {b.path} every {ticks[1]} ns")
    return ticks[0]


def _one_sided(difference: Difference) -> bool:
    """Return True if one recording lacks the message."""
    return difference.recorded is None or difference.fresh is None


def _pairs(a: Recording, b: Recording) -> Iterator[tuple[RecordedMessage | None, RecordedMessage | None]]:
    """Yield pairs of messages from the first unequal chunk on. Chunks of equal bytes are not decoded."""
    chunks_a, chunks_b = a.chunks(), b.chunks()
    for left, right in zip_longest(chunks_a, chunks_b):
        if left is not None and left == right:
            a.read_declarations(left)
            b.read_declarations(right)
            continue
        yield from zip_longest(_messages_from(a, left, chunks_a), _messages_from(b, right, chunks_b))
        return


def _messages_from(recording: Recording, chunk: Chunk | None, chunks: Iterator[Chunk]) -> Iterator[RecordedMessage]:
    """Yield the messages of this chunk and all later ones, without the ignored topics."""
    while chunk is not None:
        for message in recording.messages_of(chunk):
            if not message.topic.endswith(_IGNORED):
                yield message
        chunk = next(chunks, None)


def _differing_field(a: RecordedMessage, b: RecordedMessage) -> tuple[str, Any, Any]:
    """Return name and both values of the first field in which two messages of one port differ."""
    if a.type_name == b.type_name and a.data != b.data:
        left, right = a.decode(), b.decode()
        if a.type_name == _MAVLINK:
            difference = _differing_mavlink(left["data"], right["data"])
            if difference:
                return difference
        for name in [*left, *(n for n in right if n not in left)]:
            x, y = left.get(name, "absent"), right.get(name, "absent")
            if _unequal(x, y):
                if isinstance(x, bytes | tuple) and isinstance(y, bytes | tuple) and max(len(x), len(y)) > _BYTES_SHOWN:
                    return _differing_element(name, x, y)
                return name, x, y
        return "bytes", a.data.hex(), b.data.hex()  # equal values, different bits: 0.0 and -0.0, or two NaNs
    for name in ("type_name", "sequence", "publish_time_ns"):
        if getattr(a, name) != getattr(b, name):
            return name, getattr(a, name), getattr(b, name)
    raise AssertionError("called with equal messages")


def _differing_element(name: str, x: Sequence[Any], y: Sequence[Any]) -> tuple[str, Any, Any]:
    """Return index and both values of the first differing element of two long fields, such as pictures."""
    if len(x) != len(y):
        return f"length of {name}", len(x), len(y)
    index = next(i for i, (a, b) in enumerate(zip(x, y, strict=True)) if a != b)
    return f"{name}[{index}]", x[index], y[index]


def _differing_mavlink(a: bytes, b: bytes) -> tuple[str, Any, Any] | None:
    """Return the field in which two MAVLink messages differ, None if either is not one whole frame."""
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
    """Return True if the values differ; NaN equals NaN."""
    return x != y and not (x != x and y != y)


def fly_and_compare(run_dir: Path, out: Path | None, errors: Console) -> ReplayResult:
    """Run the recorded configuration of a run again and compare. Errors of the fresh run go to `errors`.

    Raises HilError.
    """
    from hil.config import load_bench
    from hil.run.bench_run import run_bench

    def run_again(config: Path, folder: Path) -> None:
        # Companions do not run again: their recorded answers are in the trace. Nobody follows the fresh run.
        settings = ["foxglove.port=null", *_traces(run_dir), *_without_subscribers(load_bench(config, flown=False))]
        fresh = run_bench(load_bench(config, settings=settings), folder)
        if fresh.status == "ERROR":
            errors.print(f"the fresh run ended as an error: {fresh.run['error']['message']}", markup=False)

    return replay(run_dir, run_again, out_dir=out)
