"""The recorder: taps on the tick, fanned out to the sinks. It never feeds back.

Order of the taps in one tick: `truth`, then `sample` for each released sample, `sent`, `received`, `actuators`;
`event` at any time. The digest is computed whatever is recorded, and does not depend on it.

Files, in the run's directory: `run.mcap` (see `hil.recorder.mcap_sink`) and `flight.tlog` (`tlog_sink`). Both are
readable up to the last flush when the process is killed, at most one simulated second before its end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple, Protocol

from firmware_bridge.codecs.mavlink_frame import split_frames
from firmware_bridge.codecs.signing import SETUP_SIGNING
from hil.recorder.digest import Digest, RawFrame
from hil.recorder.frame_description import FrameDescription
from hil.recorder.mcap_file import SafeFile, open_unbuffered
from hil.recorder.mcap_sink import McapSink
from hil.recorder.tlog_sink import TlogSink
from hil.recorder.track import Track
from hil.signals.detections import Detections
from hil.signals.errors import RecordingError
from hil.signals.samples import FRAME_SAMPLES, ActuatorFrame, FrameSample, RadarSample, Sample, TruthState
from hil.signals.time import NS_PER_S

MCAP_NAME = "run.mcap"
TLOG_NAME = "flight.tlog"
_FLUSH_NS = NS_PER_S  # at most this much simulated time is lost when the process is killed
_FLUSH_TICKS = 512  # and so many ticks, on benches that tick faster
_FLUSH_FRAMES = 4096  # and MAVLink frames, of at most 280 bytes each: about 1 MiB in memory
_FLUSH_BYTES = 16 << 20  # and pictures and point clouds in memory
_EVENTS_KEPT = 2000  # for the report; the recording itself keeps all


class Event(NamedTuple):
    """Something worth a line in the report."""

    t_ns: int
    kind: str
    text: str


class Watch(Protocol):
    """Whoever looks on while a run goes: takes references, changes nothing."""

    def sample(self, port: str, sample: Sample) -> None: ...

    def event(self, t_ns: int, kind: str, text: str) -> None: ...

    def detected(self, client: str, detections: Detections) -> None: ...


class Album:
    """A few frames of each sensor for the report: enough to show one of the flight, however long it is.

    Keeps frames 0, 1, 2, 4, 8, ... of each port, the three newest of them: one is from the middle. A radar's middle may
    hold nothing: of it the frame with the most points, then the most tracks, the first of equals.
    """

    def __init__(self) -> None:
        self._kept: dict[str, list[FrameSample]] = {}
        self._last: dict[str, int] = {}
        self._fullest: dict[str, tuple[tuple[int, int], FrameSample]] = {}

    def add(self, port: str, sample: FrameSample) -> None:
        """Look at one frame."""
        seq = sample.seq
        self._last[port] = seq
        if seq & (seq - 1) == 0:
            kept = self._kept.setdefault(port, [])
            kept.append(sample)
            del kept[:-3]
        if isinstance(sample, RadarSample):
            found = (len(sample.channels.get("points", ())), len(sample.channels.get("tracks", ())))
            if found > (self._fullest[port][0] if port in self._fullest else (0, 0)):
                self._fullest[port] = found, sample

    def shown(self) -> dict[str, FrameSample]:
        """Of each port a radar's fullest frame, else the kept one that is nearest to the middle of the flight; by port
        in alphabetical order."""
        return {
            port: self._fullest[port][1] if port in self._fullest else self._middle(port) for port in sorted(self._kept)
        }

    def _middle(self, port: str) -> FrameSample:
        half = self._last[port] / 2
        return min(self._kept[port], key=lambda sample: abs(sample.seq - half))


class Recorder:
    """Fan-out to the sinks that are on.

    Raises `RecordingError` from the tap or from `close` where a file cannot be written: once per file, after which
    that file takes nothing more and what it holds stays readable.
    """

    def __init__(
        self,
        out_dir: Path,
        *,
        mcap: bool,
        tlog: bool,
        tick_ns: int,
        metadata: Mapping[str, str] | None = None,
        attachments: Mapping[str, bytes] | None = None,
        open_file: Callable[[Path], BinaryIO] = open_unbuffered,
        watch: Watch | None = None,
    ) -> None:
        """`metadata` and `attachments` (name -> content, e.g. the resolved config) go into the MCAP file."""
        self._digest = Digest()
        self.track = Track(tick_ns)
        self.album = Album()
        self.events: list[Event] = []
        self._tick = 0
        self._closed = False
        self._watch = watch
        self._mcap: McapSink | None = None
        self._sinks: list[McapSink | TlogSink] = []
        if mcap or tlog:
            out_dir.mkdir(parents=True, exist_ok=True)
        if mcap:
            self._mcap = McapSink(
                SafeFile(out_dir / MCAP_NAME, open_file),
                tick_ns=tick_ns,
                metadata=metadata,
                attachments=attachments,
            )
            self._sinks.append(self._mcap)
        if tlog:
            self._sinks.append(TlogSink(SafeFile(out_dir / TLOG_NAME, open_file)))
        self._period_ns = min(_FLUSH_NS, _FLUSH_TICKS * tick_ns)
        self._flush_ns = self._period_ns

    @property
    def digest(self) -> str:
        """Digest of everything so far, hexadecimal."""
        return self._digest.hexdigest()

    def truth(self, truth: TruthState) -> None:
        """Begin a tick. Where writing out the ticks before it fails, this one is still taken in, then it raises."""
        t_ns = truth.t_ns
        failure: RecordingError | None = None
        if t_ns >= self._flush_ns or (
            self._mcap and (self._mcap.frames_waiting > _FLUSH_FRAMES or self._mcap.bytes_waiting > _FLUSH_BYTES)
        ):
            self._flush_ns = t_ns + self._period_ns
            try:
                self.flush()
            except RecordingError as error:
                failure = error
        self._tick = truth.tick
        self._digest.truth(truth)
        self.track.truth(truth)
        if self._mcap:
            self._mcap.truth(truth)
        if failure:
            raise failure

    def describe(self, port: str, description: FrameDescription) -> None:
        """Say what the camera or LiDAR of `port` is, before its first sample."""
        if self._mcap:
            self._mcap.describe(port, description)

    def sample(self, port: str, sample: Sample) -> None:
        """A sample was released on `port`."""
        if isinstance(sample, FRAME_SAMPLES):
            self._digest.frame(port, sample)
            self.album.add(port, sample)
        if self._mcap:
            self._mcap.sample(port, sample)
        if self._watch is not None:
            self._watch.sample(port, sample)

    def sent(self, tick: int, t_ns: int, data: bytes) -> None:
        """`data` went to the autopilot in this tick, possibly several frames of it."""
        del tick
        self._digest.sent(data)
        if self._sinks and data:
            pieces = [piece for piece in split_frames(data) if piece[0] != SETUP_SIGNING]  # it carries the key
            for sink in self._sinks:
                sink.sent(t_ns, pieces)

    def received(self, tick: int, t_ns: int, frames: Sequence[RawFrame]) -> None:
        """`frames` came from the autopilot in this tick."""
        del tick
        self._digest.received(frames)
        self.overheard(t_ns, [frame for frame in frames if frame.msgid != SETUP_SIGNING])

    def overheard(self, t_ns: int, frames: Sequence[RawFrame]) -> None:
        """What the router's clients said to one another: recorded, but not of the autopilot's wire, so not hashed."""
        for sink in self._sinks:
            sink.received(t_ns, frames)

    def actuators(self, frame: ActuatorFrame) -> None:
        """The command that the physics will use in the next tick."""
        self.track.actuators(frame)
        if self._mcap:
            self._mcap.actuators(frame)

    def event(self, t_ns: int, kind: str, text: str) -> None:
        """Something worth a line: a phase, a status text, a fault."""
        if len(self.events) < _EVENTS_KEPT:
            self.events.append(Event(t_ns, kind, text))
        if self._mcap:
            self._mcap.event(t_ns, kind, text)
        if self._watch is not None:
            self._watch.event(t_ns, kind, text)

    def detected(self, t_ns: int, client: str, detections: Detections) -> None:
        """A companion has made something out in a picture. Its opinion, and no part of the digest."""
        if self._mcap:
            self._mcap.detected(t_ns, client, detections)
        if self._watch is not None:
            self._watch.detected(client, detections)

    def flush(self) -> None:
        """Put everything so far on disk. Raises the first RecordingError met, after every file was tried."""
        self._each(lambda sink: sink.flush(self._tick))

    def close(self, status: str) -> None:
        """Finish the files; `status` (PASS, FAIL, ERROR) and the digest go into the recording. Idempotent.

        Raises the first RecordingError met, after every file has been closed.
        """
        if self._closed:
            return
        self._closed = True
        result = {"status": status, "digest": self.digest}
        self._each(lambda sink: sink.close(self._tick, result))

    def _each(self, act: Callable[[McapSink | TlogSink], None]) -> None:
        failures = []
        for sink in self._sinks:
            try:
                act(sink)
            except RecordingError as error:
                failures.append(error)
        if failures:
            raise failures[0]
