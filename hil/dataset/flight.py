"""The flights of a data set: truth, IMU, GPS and the like as they come, and the moments at which frames are taken.

The mission is flown again and again until there are enough frames; each flight after the first has a seed of its own
for the sensors sampled in it, and times that go on. A preset course has no end, so it is one flight.

What a batch covers of the flight's own samples is told by when they were released: from the first moment of the batch
up to the first of the next.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.bench import fly
from hil.config.schema import MAX_SEED
from hil.dataset.moments import Batch, BatchMaker, Clock, Look
from hil.dataset.plan import BATCH_FRAMES, EPOCH_NS, DatasetPlan
from hil.recorder.digest import RawFrame
from hil.recorder.recorder import Recorder
from hil.recorder.topics import Columns, columns_of
from hil.signals.errors import RecordingError
from hil.signals.samples import ActuatorFrame, Sample, TruthState
from hil.signals.time import NS_PER_S


class PortSamples(NamedTuple):
    """What one sensor gave, in the order of release."""

    kind: type
    columns: Columns
    released_ns: NDArray[np.int64]  # times of the files


class FlightPart(NamedTuple):
    """What the flight itself gave during one batch, as `columns_of` gives it; times derived there are of the files.

    Made as soon as the batch is over: Python's own numbers would lie far apart in memory until it is written.
    """

    truths: Columns
    samples: dict[str, PortSamples]  # by port
    events: list[tuple[int, str, str]]  # times of the files


def _later(sample: Sample, by_ns: int) -> Sample:
    later: Sample = sample._replace(
        t_capture_ns=sample.t_capture_ns + by_ns, t_available_ns=sample.t_available_ns + by_ns
    )
    return later


def _port_samples(rows: list[tuple[Sample, int]]) -> PortSamples:
    samples, released_ns = zip(*rows, strict=True)
    kind = type(samples[0])
    return PortSamples(kind, columns_of(kind, list(samples), EPOCH_NS), np.array(released_ns) + EPOCH_NS)


OnBatch = Callable[[Batch, FlightPart], None]


class FlightTap(Recorder):
    """Sits where a run has its recorder."""

    def __init__(self, plan: DatasetPlan, on_batch: OnBatch) -> None:
        super().__init__(Path(), mcap=False, tlog=False, tick_ns=plan.config.tick_ns)
        self._plan, self._on_batch = plan, on_batch
        self._clock = Clock(plan.frame_sensors, plan.config.tick_hz)
        self.batches = BatchMaker(plan.reference, frames=plan.frames, batch_frames=BATCH_FRAMES)
        # Since the first frame of this batch, times of the data set:
        self._truths: list[TruthState] = []
        self._samples: dict[str, list[tuple[Sample, int]]] = {}  # by port: sample, released at [ns]
        self._events: list[tuple[int, str, str]] = []
        self._base_ns = 0  # time of the data set at which the present flight began
        self._now_ns = 0
        self._first_ns = -1  # of the data set's first frame
        self._last_ns = -1  # and of its last, once that is known
        self._recording = False
        latencies = [getattr(s.parameters, "latency_s", 0.0) for s in plan.flight_sensors.values()]
        self._settle_ns = round(max(latencies, default=0.0) * NS_PER_S) + plan.config.tick_ns
        mission = plan.bench.mission
        endless = plan.config.dataset.trajectory is not None or mission is None
        self._waypoints = 0 if mission is None or endless else len(mission.waypoints)
        self._all = plan.config.dataset.record == "flight" or mission is None

    def begin_flight(self) -> None:
        """Before each flight."""
        if self._now_ns:
            self._base_ns = (self._now_ns // NS_PER_S + 1) * NS_PER_S
        self._clock.begin_flight()
        self._recording = self._all

    def over(self, reached: Callable[[], int], ended: bool) -> bool:
        """After every tick: whether the flight may end."""
        if self._last_ns >= 0:
            return self._now_ns >= self._last_ns + self._settle_ns
        if self._all or (self._recording and not self._waypoints):
            return ended
        count = reached()
        past_last = ended or (self._waypoints > 1 and count >= self._waypoints)
        self._recording = count >= 1 and not past_last
        return past_last

    def truth(self, truth: TruthState) -> None:
        t_ns = self._now_ns = truth.t_ns + self._base_ns
        if self._base_ns:
            truth = truth._replace(t_ns=t_ns)
        looks = self._clock.looks(truth)
        if self._last_ns >= 0:
            return
        if looks and self._recording:
            self._look(truth, looks)
        if self.batches.begun and self._recording:
            self._truths.append(truth)

    def _look(self, truth: TruthState, looks: tuple[Look, ...]) -> None:
        batch = self.batches.add(truth, looks)
        if batch is not None:
            self._hand_over(batch)
        if self._first_ns < 0 and self.batches.begun:
            self._first_ns = truth.t_ns
        if self.batches.full:
            self._last_ns = truth.t_ns

    def _hand_over(self, batch: Batch) -> None:
        part = FlightPart(
            columns_of(TruthState, self._truths, EPOCH_NS),
            {port: _port_samples(rows) for port, rows in self._samples.items()},
            [(t_ns + EPOCH_NS, kind, text) for t_ns, kind, text in self._events],
        )
        self._truths, self._samples, self._events = [], {}, []
        self._on_batch(batch, part)

    def sample(self, port: str, sample: Sample) -> None:
        base_ns, captured_ns = self._base_ns, sample.t_capture_ns + self._base_ns
        if self._first_ns < 0 or captured_ns < self._first_ns or not (self._recording or self._last_ns >= 0):
            return
        if self._last_ns >= 0 and captured_ns > self._last_ns:
            return
        moved = _later(sample, base_ns) if base_ns else sample
        self._samples.setdefault(port, []).append((moved, self._now_ns))

    def event(self, t_ns: int, kind: str, text: str) -> None:
        if self._first_ns >= 0 and self._last_ns < 0:
            self._events.append((t_ns + self._base_ns, kind, text))

    def sent(self, tick: int, t_ns: int, data: bytes) -> None:
        """The wire to the autopilot is not recorded."""

    def received(self, tick: int, t_ns: int, frames: Sequence[RawFrame]) -> None:
        """Nor what comes back."""

    def actuators(self, frame: ActuatorFrame) -> None:
        """Nor commands."""

    def finish(self) -> None:
        """Hand over what is left. Call once, after the last flight."""
        batch = self.batches.take()
        if batch is not None:
            self._hand_over(batch)


def fly_for_frames(plan: DatasetPlan, on_batch: OnBatch) -> FlightTap:
    """Fly until there are enough frames. Raises HilError where the flight fails or gives no frame."""
    tap: Any = FlightTap(plan, on_batch)
    bench = plan.flight_bench
    with tempfile.TemporaryDirectory(prefix="hil-dataset-") as folder:
        flight = 0
        while not tap.batches.full:
            before = tap.batches.frames
            tap.begin_flight()
            seed = (plan.config.seed + flight) % (MAX_SEED + 1)
            config = bench.config.model_copy(update={"seed": seed})
            fly(replace(bench, config=config), Path(folder), tap, tap.over)
            if tap.batches.frames == before:
                raise RecordingError(_no_frames(plan, flight))
            flight += 1
    tap.finish()
    made: FlightTap = tap
    return made


def _no_frames(plan: DatasetPlan, flight: int) -> str:
    which = "the flight" if flight == 0 else f"flight {flight + 1}"
    return (
        f"{which} gave no frame within its {plan.config.duration_s:g} s of simulated time: its first waypoint was not "
        "reached, or nothing looks that often; see what becomes of it with `hil run`, or set dataset.record: flight"
    )
