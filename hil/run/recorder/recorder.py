"""The recorder: receives the data of every tick and passes them to the sinks. It never changes the run.

Order of the calls in one tick: `truth`, then `sample` for each released sample, `sent`, `received`, `actuators`;
`event`, `routed` and `detected` at any time. The digest is always computed and does not depend on the choice of sinks.

Files in the run's folder: `run.mcap` (mcap/mcap_sink.py) and `flight.tlog` (tlog_sink.py). If the process is killed,
both are readable up to the last flush, which is at most one simulated second earlier.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, Protocol

from firmware_bridge.codecs.mavlink_frame import Frame, split_frames
from firmware_bridge.codecs.signing import SETUP_SIGNING
from hil.run.recorder.digest import Digest
from hil.run.recorder.frame_description import FrameDescription
from hil.run.recorder.mcap.mcap_file import SafeFile, VehicleTopics, open_unbuffered
from hil.run.recorder.mcap.mcap_sink import McapRecording, McapSink
from hil.run.recorder.tlog_sink import TlogSink
from hil.run.recorder.track import Track
from hil.run_files import MCAP_NAME, TLOG_NAME
from signals.detections import Detections
from signals.errors import RecordingError
from signals.samples import (
    FRAME_SAMPLES,
    ActuatorFrame,
    FrameSample,
    ImageSample,
    RadarSample,
    Sample,
    TruthState,
)
from signals.time import NS_PER_S

_FLUSH_NS = NS_PER_S  # flush after this much simulated time, the most that is lost when the process is killed
_FLUSH_TICKS = 512  # flush after this many ticks, on benches with a higher tick rate
_FLUSH_FRAMES = 4096  # flush after this many MAVLink frames, at most 280 bytes each: about 1 MiB of memory
_FLUSH_BYTES = 16 << 20  # flush after this much memory in pictures and point clouds
_WARNING_KINDS = frozenset({"warning", "error"})
# Truth and MAVLink are hashed and split for 32 ticks at once, which takes less time than tick by tick.
_LOG_ENTRIES = 96
_TRUTH, _SENT, _RECEIVED = range(3)
_MAX_EVENTS = 2000  # in memory for the report; the recording has all


class Event(NamedTuple):
    """An event shown in the report."""

    t_ns: int
    kind: str
    text: str


class Tap(Protocol):
    """A live receiver of recorded data. It may keep references but must not change the data."""

    def sample(self, port: str, sample: Sample) -> None: ...

    def event(self, t_ns: int, kind: str, text: str) -> None: ...

    def detected(self, client: str, detections: Detections) -> None: ...


class WireTap(Protocol):
    """A tap that also takes MAVLink frames."""

    def sent(self, t_ns: int, pieces: Iterable[tuple[int, bytes]]) -> None: ...

    def received(self, t_ns: int, frames: Iterable[Frame]) -> None: ...


class Album:
    """Selects one frame of each sensor for the report, in bounded memory for any length of flight.

    Keeps the newest three of the frames 0, 1, 2, 4, 8, ... of each port; one of them is near the middle of the flight.
    The middle frame of a radar may be empty, so a radar is shown by its frame with the most points, then the most
    tracks, then the lowest number.
    """

    def __init__(self) -> None:
        self._candidates: dict[str, list[FrameSample]] = {}
        self._last: dict[str, int] = {}
        self._fullest: dict[str, tuple[tuple[int, int], FrameSample]] = {}

    def add(self, port: str, sample: FrameSample) -> None:
        """Consider one frame."""
        seq = sample.seq
        self._last[port] = seq
        if seq & (seq - 1) == 0:
            candidates = self._candidates.setdefault(port, [])
            candidates.append(sample)
            del candidates[:-3]
        if isinstance(sample, RadarSample):
            counts = (len(sample.channels.get("points", ())), len(sample.channels.get("tracks", ())))
            if counts > (self._fullest[port][0] if port in self._fullest else (0, 0)):
                self._fullest[port] = counts, sample

    def shown(self) -> dict[str, FrameSample]:
        """Return the selected frame of each port, ports in alphabetical order."""
        return {
            port: self._fullest[port][1] if port in self._fullest else self._middle(port)
            for port in sorted(self._candidates)
        }

    def _middle(self, port: str) -> FrameSample:
        half = self._last[port] / 2
        return min(self._candidates[port], key=lambda sample: abs(sample.seq - half))


class Recorder:
    """Passes the data of every tick to the digest, the enabled sinks and the taps.

    A file that cannot be written raises `RecordingError` once, from `truth`, `flush` or `close`. Afterwards that file
    receives nothing more, and its content stays readable.
    """

    def __init__(
        self,
        out_dir: Path,
        *,
        mcap: bool | VehicleTopics,
        tlog: bool,
        tick_ns: int,
        metadata: Mapping[str, str] | None = None,
        attachments: Mapping[str, bytes] | None = None,
        open_file: Callable[[Path], BinaryIO] = open_unbuffered,
        taps: Sequence[Tap] = (),
    ) -> None:
        """`metadata` and `attachments` (name -> content, e.g. the resolved config) go into the MCAP file.

        `mcap`: whether to write one, or one vehicle's part of a recording that the caller opens and closes.
        """
        self._digest = Digest()
        self.track = Track(tick_ns)
        self.album = Album()
        self.events: list[Event] = []
        self.warnings: list[Event] = []  # events of these kinds, also those that `events` has no more room for
        self._tick = 0
        self._closed = False
        self._taps = tuple(taps)
        self._unrecorded: frozenset[str] = frozenset()
        self._mcap: McapSink | None = None
        self._mcap_recording: McapRecording | None = None
        self._sinks: list[McapSink | TlogSink] = []
        if mcap or tlog:
            out_dir.mkdir(parents=True, exist_ok=True)
        if mcap is True:
            file = SafeFile(out_dir / MCAP_NAME, open_file)
            self._mcap_recording = McapRecording(
                file, tick_ns=tick_ns, metadata=metadata or {}, attachments=attachments or {}
            )
            self._mcap = McapSink(self._mcap_recording.mcap, tick_ns=tick_ns)
        elif mcap:
            self._mcap = McapSink(mcap, tick_ns=tick_ns)
        if self._mcap is not None:
            self._sinks.append(self._mcap)
        if tlog:
            self._sinks.append(TlogSink(SafeFile(out_dir / TLOG_NAME, open_file)))
        wires: list[WireTap] = [tap for tap in taps if hasattr(tap, "sent")]  # type: ignore[misc]
        self._wire_receivers: tuple[WireTap, ...] = (*self._sinks, *wires)
        self._pictured = False  # since the last look at the memory that the sinks hold
        self._live = bool(wires)
        self._log: list[tuple[int, int, Any]] = []  # what, time [ns] and data, not yet passed on
        self._period_ns = min(_FLUSH_NS, _FLUSH_TICKS * tick_ns)
        self._flush_ns = self._period_ns

    @property
    def digest(self) -> str:
        """Digest of everything so far, hexadecimal."""
        self._pass_on()
        return self._digest.hexdigest()

    def truth(self, truth: TruthState) -> None:
        """Begin a tick. If writing the earlier ticks fails, this tick is recorded before the error is raised."""
        t_ns = truth.t_ns
        failure: RecordingError | None = None
        mcap = self._mcap
        if len(self._log) >= _LOG_ENTRIES or self._pictured or t_ns >= self._flush_ns:
            self._pass_on()
            self._pictured = False
            if t_ns >= self._flush_ns or (mcap and mcap.holds(_FLUSH_FRAMES, _FLUSH_BYTES)):
                self._flush_ns = t_ns + self._period_ns
                try:
                    self.flush()
                except RecordingError as error:
                    failure = error
        self._tick = truth.tick
        self._log.append((_TRUTH, t_ns, truth))
        self.track.truth(truth)
        if mcap:
            mcap.truth(truth)
        if failure:
            raise failure

    def describe(self, port: str, description: FrameDescription) -> None:
        """Describe the sensor of `port`, before its first sample."""
        if self._mcap:
            self._mcap.describe(port, description)

    def describe_noise(self, port: str, deviations: Mapping[str, float]) -> None:
        """Describe the noise of the samples of `port` by field, 1 sigma, before its first sample."""
        if self._mcap:
            self._mcap.describe_noise(port, deviations)

    def sample(self, port: str, sample: Sample) -> None:
        """Record a sample released on `port`."""
        recorded = self._recorded(port, sample) if self._unrecorded else sample
        if recorded is not None:
            if isinstance(recorded, FRAME_SAMPLES):
                self._pass_on()
                self._pictured = True
                self._digest.frame(port, recorded)
                self.album.add(port, recorded)
            if self._mcap:
                self._mcap.sample(port, recorded)
        for tap in self._taps:
            tap.sample(port, sample)

    def leave_out(self, ports: Iterable[str]) -> None:
        """Record nothing of these ports (a sensor, or "sensor/channel"): they are computed for a watcher alone."""
        self._unrecorded = frozenset(ports)

    def _recorded(self, port: str, sample: Sample) -> Sample | None:
        """Return the part of a sample that is recorded."""
        if isinstance(sample, ImageSample | RadarSample):
            left = {name: a for name, a in sample.channels.items() if f"{port}/{name}" not in self._unrecorded}
            return sample._replace(channels=left) if left else None
        return None if port in self._unrecorded else sample

    def sent(self, tick: int, t_ns: int, data: bytes) -> None:
        """Record the bytes sent to the autopilot in this tick, any number of frames."""
        del tick
        self._log.append((_SENT, t_ns, data))
        if self._live:
            self._pass_on()

    def received(self, tick: int, t_ns: int, frames: Sequence[Frame]) -> None:
        """Record the frames received from the autopilot in this tick."""
        del tick
        self._log.append((_RECEIVED, t_ns, frames))
        if self._live:
            self._pass_on()

    def _pass_on(self) -> None:
        """Pass the log to the digest and to those that record MAVLink."""
        digest, receivers = self._digest, self._wire_receivers
        for what, t_ns, data in self._log:
            if what == _TRUTH:
                digest.truth(data)
            elif what == _SENT:
                digest.sent(data)
                if receivers and data:
                    pieces = split_frames(data)
                    if SETUP_SIGNING in dict(pieces):  # contains the key
                        pieces = [piece for piece in pieces if piece[0] != SETUP_SIGNING]
                    for receiver in receivers:
                        receiver.sent(t_ns, pieces)
            else:
                digest.received(data)
                if receivers:
                    for frame in data:
                        if frame.msgid == SETUP_SIGNING:
                            data = [frame for frame in data if frame.msgid != SETUP_SIGNING]
                            break
                    for receiver in receivers:
                        receiver.received(t_ns, data)
        self._log.clear()
        digest.update()

    def routed(self, t_ns: int, frames: Sequence[Frame]) -> None:
        """Record frames that the router passed between its clients. They are not part of the digest."""
        self._pass_on()
        for receiver in self._wire_receivers:
            receiver.received(t_ns, frames)

    def actuators(self, frame: ActuatorFrame) -> None:
        """Record the command that the physics uses in the next tick."""
        self.track.actuators(frame)
        if self._mcap:
            self._mcap.actuators(frame)

    def event(self, t_ns: int, kind: str, text: str) -> None:
        """Record an event: a phase, a status text, a fault."""
        if len(self.events) < _MAX_EVENTS:
            self.events.append(Event(t_ns, kind, text))
        if kind in _WARNING_KINDS and len(self.warnings) < _MAX_EVENTS:
            self.warnings.append(Event(t_ns, kind, text))
        if self._mcap:
            self._mcap.event(t_ns, kind, text)
        for tap in self._taps:
            tap.event(t_ns, kind, text)

    def detected(self, t_ns: int, client: str, detections: Detections) -> None:
        """Record detections of a companion. They are not part of the digest."""
        if self._mcap:
            self._mcap.detected(t_ns, client, detections)
        for tap in self._taps:
            tap.detected(client, detections)

    def close(self, status: str) -> None:
        """Finish the files; `status` (PASS, FAIL, ERROR) and the digest go into the recording. Idempotent.

        Raises the first RecordingError after all files have been closed.
        """
        if self._closed:
            return
        self._closed = True
        result = {"status": status, "digest": self.digest}
        closing = [partial(sink.close, self._tick) for sink in self._sinks]
        if self._mcap_recording is not None:
            closing.append(partial(self._mcap_recording.close, self._tick, result))
        _try_all(closing)

    def flush(self) -> None:
        """Write everything so far to disk. Raises the first RecordingError after all files have been tried."""
        self._pass_on()
        _try_all([partial(sink.flush, self._tick) for sink in self._sinks])


def _try_all(actions: Sequence[Callable[[], object]]) -> None:
    """Call all actions, then raise the first RecordingError."""
    failures = []
    for action in actions:
        try:
            action()
        except RecordingError as error:
            failures.append(error)
    if failures:
        raise failures[0]


def record_texts(recorder: Recorder, texts: Sequence[tuple[int, int, str]]) -> None:
    """Record status texts as events: MAV_SEVERITY 0 (emergency) to 3 as errors, 4 as warnings."""
    for t_ns, severity, text in texts:
        recorder.event(t_ns, "error" if severity <= 3 else "warning" if severity == 4 else "status", text)
