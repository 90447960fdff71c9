"""Flights of a data set, which give the samples of the flight sensors (IMU, GPS and the like) and the times of frames.

The mission is repeated until there are enough frames. Each flight after the first has its own seed for the flight
sensors. A preset course has no end, so it takes one flight.

The time of the data set continues from flight to flight. The time of the files is that time plus `EPOCH_NS`.

A flight sample belongs to the batch during which it was released: from the batch's first moment up to the first moment
of the next batch.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.apps.dataset.moments import Batch, BatchCollector, DueSample, OtherVehicles, SampleClock
from hil.apps.dataset.plan import BATCH_FRAMES, EPOCH_NS, DatasetPlan
from hil.config.schema import MAX_SEED
from hil.run.bench_run import fly
from hil.run.part import Part, RunContext
from hil.run.parts.simulated.unmet_faults import Unmet
from hil.run.recorder.mcap.topics import Columns, columns_of
from hil.run.recorder.no_recorder import NoRecorder
from signals.errors import RecordingError
from signals.samples import Sample, TruthState
from signals.time import NS_PER_S


class PortSamples(NamedTuple):
    """Samples of one sensor as columns, in the order of release; `released_ns` is in the time of the files."""

    kind: type
    columns: Columns
    released_ns: NDArray[np.int64]


class FlightData(NamedTuple):
    """True states, flight samples and events of one batch, as columns of `columns_of`; `others`: of other vehicles.

    Stamps, release times and event times are in the time of the files. The columns are made as soon as the batch ends:
    until it is written, separate Python objects would take far more memory than arrays.
    """

    truths: Columns
    samples: dict[str, PortSamples]  # by port
    events: list[tuple[int, str, str]]  # time [ns], kind, text
    others: Mapping[str, Columns] = {}  # true states by vehicle


def _shifted(sample: Sample, by_ns: int) -> Sample:
    shifted: Sample = sample._replace(
        t_capture_ns=sample.t_capture_ns + by_ns, t_available_ns=sample.t_available_ns + by_ns
    )
    return shifted


def _port_samples(rows: list[tuple[Sample, int]]) -> PortSamples:
    samples, released_ns = zip(*rows, strict=True)
    kind = type(samples[0])
    return PortSamples(kind, columns_of(kind, list(samples), EPOCH_NS), np.array(released_ns) + EPOCH_NS)


OnBatch = Callable[[Batch, FlightData], None]


class FlightRecorder(NoRecorder):
    """Recorder that writes no files, but passes each finished batch and its flight data to `on_batch`."""

    def __init__(self, plan: DatasetPlan, on_batch: OnBatch) -> None:
        super().__init__(plan.config.tick_ns)
        self._plan, self._on_batch = plan, on_batch
        self._clock = SampleClock(plan.frame_sensors, plan.config.tick_hz)
        self._others = OtherVehicles(plan.other_vehicles, plan.frame_sensors)
        self.batches = BatchCollector(plan.reference, frames=plan.frames, batch_frames=BATCH_FRAMES)
        # Collected since the first frame of this batch, in the time of the data set:
        self._truths: list[TruthState] = []
        self._other_truths: dict[str, list[TruthState]] = {name: [] for name in plan.other_vehicles}
        self._samples: dict[str, list[tuple[Sample, int]]] = {}  # by port: sample, released at [ns]
        self._events: list[tuple[int, str, str]] = []
        self._placed: dict[str, TruthState] = {}  # states of the other vehicles at this tick
        self._base_ns = 0  # time of the data set at which the current flight began
        self._now_ns = 0
        self._first_ns = -1  # time of the data set's first frame
        self._last_ns = -1  # time of its last frame, once that is known
        self._recording = False
        self.unmet: list[Unmet] | None = None  # declared faults and gusts that no flight so far has met
        latencies = [getattr(s.parameters, "latency_s", 0.0) for s in plan.flight_sensors.values()]
        self._settle_ns = round(max(latencies, default=0.0) * NS_PER_S) + plan.config.tick_ns
        mission = plan.bench.mission
        endless = plan.config.dataset.trajectory is not None or mission is None
        self._waypoints = 0 if mission is None or endless else len(mission.waypoints)
        self._record_all = plan.config.dataset.record == "flight" or mission is None

    def start_flight(self) -> None:
        """Begin a flight: its times follow those of the flight before, from a whole second on."""
        if self._now_ns:
            self._base_ns = (self._now_ns // NS_PER_S + 1) * NS_PER_S
        self._clock.start_flight()
        self._others.start_flight()
        self._recording = self._record_all

    def is_over(self, count_reached: Callable[[], int], ended: bool) -> bool:
        """Return True if the flight may end. Call after every tick.

        `count_reached` returns the number of waypoints reached so far; `ended` is True if the mission has ended.
        """
        if self._last_ns >= 0:
            return self._now_ns >= self._last_ns + self._settle_ns
        if self._record_all or (self._recording and not self._waypoints):
            return ended
        reached = count_reached()
        past_last = ended or (self._waypoints > 1 and reached >= self._waypoints)
        self._recording = reached >= 1 and not past_last
        return past_last

    def place(self, truths: Mapping[str, TruthState]) -> None:
        """Receive the true states of all vehicles of a bench with several, before `truth` of the same tick."""
        shift_ns = self._base_ns
        self._placed = {name: truths[name]._replace(t_ns=truths[name].t_ns + shift_ns) for name in self._other_truths}
        self._others.place(self._placed)

    def truth(self, truth: TruthState) -> None:
        """Collect the true state and the samples due at this tick."""
        t_ns = self._now_ns = truth.t_ns + self._base_ns
        if self._base_ns:
            truth = truth._replace(t_ns=t_ns)
        due = self._clock.due(truth)
        if self._last_ns >= 0:
            return
        if due and self._recording:
            self._add_due(truth, due)
        if self.batches.started and self._recording:
            self._truths.append(truth)
            for name, other in self._placed.items():
                self._other_truths[name].append(other)

    def _add_due(self, truth: TruthState, due: tuple[DueSample, ...]) -> None:
        batch = self.batches.add(truth, due, self._others)
        if batch is not None:
            self._emit(batch)
        if self._first_ns < 0 and self.batches.started:
            self._first_ns = truth.t_ns
        if self.batches.full:
            self._last_ns = truth.t_ns

    def _emit(self, batch: Batch) -> None:
        data = FlightData(
            columns_of(TruthState, self._truths, EPOCH_NS),
            {port: _port_samples(rows) for port, rows in self._samples.items()},
            [(t_ns + EPOCH_NS, kind, text) for t_ns, kind, text in self._events],
            {name: columns_of(TruthState, truths, EPOCH_NS) for name, truths in self._other_truths.items()},
        )
        self._truths, self._samples, self._events = [], {}, []
        self._other_truths = {name: [] for name in self._other_truths}
        self._on_batch(batch, data)

    def sample(self, port: str, sample: Sample) -> None:
        """Collect a flight sample captured between the first and the last frame."""
        base_ns, captured_ns = self._base_ns, sample.t_capture_ns + self._base_ns
        if self._first_ns < 0 or captured_ns < self._first_ns or not (self._recording or self._last_ns >= 0):
            return
        if self._last_ns >= 0 and captured_ns > self._last_ns:
            return
        shifted = _shifted(sample, base_ns) if base_ns else sample
        self._samples.setdefault(port, []).append((shifted, self._now_ns))

    def event(self, t_ns: int, kind: str, text: str) -> None:
        """Collect an event between the first and the last frame."""
        if self._first_ns >= 0 and self._last_ns < 0:
            self._events.append((t_ns + self._base_ns, kind, text))

    def flown(self, unmet: list[Unmet]) -> None:
        """End a flight that did not meet these faults and gusts."""
        missed = [one.what for one in unmet]
        self.unmet = unmet if self.unmet is None else [one for one in self.unmet if one.what in missed]

    def finish(self) -> None:
        """Emit the last, incomplete batch. Call once, after the last flight."""
        batch = self.batches.take()
        if batch is not None:
            self._emit(batch)


class EnoughFrames(Part):
    """Part that ends the flight when the data set has its frames."""

    name = "frames"

    def __init__(self, recorder: FlightRecorder) -> None:
        self._recorder = recorder
        self._over = False

    def begin(self, run: RunContext) -> None:
        """Store the run: its other parts tell if the mission has ended and how many waypoints are reached."""
        self._run = run
        self._ends = [p.ended for p in run.parts if p is not self and type(p).ended is not Part.ended]

    def after_tick(self, tick: int) -> None:  # noqa: ARG002 (called once a tick)
        """Update whether the flight may end."""
        ended = any(end() for end in self._ends)
        self._over = self._recorder.is_over(lambda: self._run.part("mission").reached, ended)

    def ended(self) -> bool:
        """Return True if the data set has all that it needs of this flight."""
        return self._over

    def unmet(self) -> list[Unmet]:
        """Return the declared faults and gusts that the flight has not met."""
        part = self._run.part("unmet_faults")
        return [] if part is None else list(part.unmet)


def fly_for_frames(plan: DatasetPlan, on_batch: OnBatch) -> FlightRecorder:
    """Fly until there are `plan.frames` frames, calling `on_batch` with each batch in order.

    Raises HilError if a flight fails, RecordingError if a flight gives no frame.
    """
    recorder: Any = FlightRecorder(plan, on_batch)
    with tempfile.TemporaryDirectory(prefix="hil-dataset-") as folder:
        flight = 0
        while not recorder.batches.full:
            frames_before = recorder.batches.frames
            recorder.start_flight()
            seed = (plan.config.seed + flight) % (MAX_SEED + 1)
            bench, part = plan.flight_bench(seed), EnoughFrames(recorder)
            fly(bench, Path(folder), recorder, part, vehicle=plan.vehicle, place=recorder.place)
            recorder.flown(part.unmet())
            if recorder.batches.frames == frames_before:
                raise RecordingError(_no_frames_message(plan, flight))
            flight += 1
    recorder.finish()
    finished: FlightRecorder = recorder
    return finished


def _no_frames_message(plan: DatasetPlan, flight: int) -> str:
    which = "the flight" if flight == 0 else f"flight {flight + 1}"
    return (
        f"{which} gave no frame within its {plan.config.duration_s:g} s of simulated time: its first waypoint was not "
        f"reached, or {plan.reference} samples too rarely. Watch the flight with `hil run`, or set dataset.record: "
        "flight"
    )
