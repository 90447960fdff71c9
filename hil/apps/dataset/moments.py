"""Sampling schedule of a data set: the ticks at which cameras, LiDARs and radars are due, gathered into batches.

Sample numbers count from the start of the first flight, as in `hil run`, so a sample has the same noise as in a run of
the same bench. Times are in the time of the data set, which continues from flight to flight.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from hil.apps.dataset.formats.labels import PictureLabels
from hil.config import SensorConfig
from signals.samples import ImageSample, PointCloudSample, TruthState
from signals.time import RateAccumulator, period_ns_from_hz
from sim.physics.vehicle import Vehicle
from sim.physics.vehicle_bodies import VehicleBodies
from sim.sensors.catalog import KINDS


class DueSample(NamedTuple):
    """One sample to take.

    `previous` is the true state at the previous sample of a LiDAR or a spinning radar, whose sweep spans the motion
    since then. It is None for other sensors and for the first sample of a flight.
    """

    sensor: str
    seq: int
    previous: TruthState | None


class Moment(NamedTuple):
    """A tick with at least one due sample. `frame` is the frame's number, -1 if the reference sensor is not due.

    `others`: for each other vehicle in this world, its states as the samples see them (`OtherVehicles.seen`).
    """

    truth: TruthState
    due: tuple[DueSample, ...]
    frame: int
    others: Mapping[str, bytes] = {}


class Taken(NamedTuple):
    """The labelled picture and the sweeps of one moment; None, or none, if they are not due."""

    picture: ImageSample | None
    labels: PictureLabels | None
    sweeps: Mapping[str, PointCloudSample]


@dataclass(frozen=True)
class Batch:
    """Consecutive frames, and all samples due from the first of them up to the first frame of the next batch."""

    index: int
    first_frame: int
    frames: int
    moments: tuple[Moment, ...]

    @property
    def crc(self) -> int:
        """CRC-32 over every bit of every true state and sample number; it identifies the flight."""
        crc = 0
        for truth, due, frame, others in self.moments:
            crc = zlib.crc32(f"Moment({truth=}, {due=}, {frame=})".encode(), crc)
            for states in others.values():
                crc = zlib.crc32(states, crc)
        return crc


@dataclass
class SampleClock:
    """Schedule of the samples, tick by tick. Make one per data set and call `start_flight` before each flight."""

    sensors: Mapping[str, SensorConfig]
    tick_hz: int
    _rates: dict[str, RateAccumulator] = field(default_factory=dict)
    _seq: dict[str, int] = field(default_factory=dict)
    _previous: dict[str, TruthState] = field(default_factory=dict)

    def start_flight(self) -> None:
        """Restart all rates; sample numbers continue."""
        self._previous.clear()
        for name, sensor in self.sensors.items():
            mhz = round(sensor.rate_hz * 1000)
            self._rates[name] = RateAccumulator(event_millihz=mhz, tick_millihz=self.tick_hz * 1000)

    def due(self, truth: TruthState) -> tuple[DueSample, ...]:
        """Return the samples due at this tick, in the order of `sensors`. Call once per tick."""
        samples = []
        for name, rate in self._rates.items():
            if rate.due():
                seq = self._seq.get(name, 0)
                self._seq[name] = seq + 1
                if KINDS[self.sensors[name].kind].sweeps:
                    samples.append(DueSample(name, seq, self._previous.get(name)))
                    self._previous[name] = truth
                else:
                    samples.append(DueSample(name, seq, None))
        return tuple(samples)


class OtherVehicles:
    """The other vehicles of a bench with several, which the sensors of the recorded one see."""

    def __init__(self, vehicles: Mapping[str, Vehicle], sensors: Mapping[str, SensorConfig]) -> None:
        """`sensors`: the recorded vehicle's cameras, LiDARs and radars."""
        self._vehicles = vehicles
        self._sweep_ns = {n: period_ns_from_hz(s.rate_hz) for n, s in sensors.items() if KINDS[s.kind].sweeps}
        self._bodies: dict[str, VehicleBodies] = {}

    def start_flight(self) -> None:
        """Forget the states of the flight before."""
        self._bodies = {name: VehicleBodies(name, vehicle) for name, vehicle in self._vehicles.items()}

    def place(self, truths: Mapping[str, TruthState]) -> None:
        """Add the states of a tick, in the time of the data set."""
        for name, bodies in self._bodies.items():
            bodies.place(truths[name])

    def seen(self, t_ns: int, due: tuple[DueSample, ...]) -> dict[str, bytes]:
        """Return the states at `t_ns`, and those during the LiDAR sweeps that end then, for `SharedFrames.restore`."""
        sweep_ns = max(self._sweep_ns.get(sample.sensor, 0) for sample in due)
        return {name: bodies.states_since(t_ns - sweep_ns) for name, bodies in self._bodies.items()}


class BatchCollector:
    """Collector of moments into batches. A batch ends at the first frame of the next batch, or with the last frame."""

    def __init__(self, reference: str, *, frames: int, batch_frames: int) -> None:
        self._reference, self._frames, self._size = reference, frames, batch_frames
        self._moments: list[Moment] = []
        self._next_frame = 0
        self._index = 0

    @property
    def full(self) -> bool:
        """True if all frames have been taken."""
        return self._next_frame >= self._frames

    @property
    def started(self) -> bool:
        """True if the first frame has been taken. Samples before it are discarded."""
        return self._next_frame > 0

    @property
    def frames(self) -> int:
        """Number of frames taken so far."""
        return self._next_frame

    def add(self, truth: TruthState, due: tuple[DueSample, ...], others: OtherVehicles) -> Batch | None:
        """Add the due samples of one tick and return the batch that this tick ends, if any."""
        is_frame = any(sample.sensor == self._reference for sample in due)
        if not due or not (is_frame or self.started):
            return None
        batch = None
        if is_frame and self._next_frame and self._next_frame % self._size == 0:
            batch = self.take()
        frame = -1
        if is_frame:
            frame = self._next_frame
            self._next_frame += 1
        self._moments.append(Moment(truth, due, frame, others.seen(truth.t_ns, due)))
        return batch

    def take(self) -> Batch | None:
        """Return the gathered moments as a batch and start the next one; None if there are none."""
        if not self._moments:
            return None
        moments, self._moments = tuple(self._moments), []
        frames = sum(moment.frame >= 0 for moment in moments)
        first = next((moment.frame for moment in moments if moment.frame >= 0), self._next_frame)
        batch = Batch(self._index, first, frames, moments)
        self._index += 1
        return batch
