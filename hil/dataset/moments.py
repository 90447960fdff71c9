"""When frames are taken: the moments of a flight at which cameras, LiDARs and radars look, gathered into batches.

Sample numbers count from the beginning of the first flight, as in `hil run`, so a sample has the noise that it has in a
run of the same bench. Times are of the data set: those of a second flight go on where the first one ended.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from hil.config import SensorConfig
from hil.signals.samples import TruthState
from hil.signals.time import RateAccumulator


class Look(NamedTuple):
    """One sample to be taken. `before`: the truth of the sensor's sample before, for those that move during one."""

    sensor: str
    seq: int
    before: TruthState | None


class Moment(NamedTuple):
    """A tick at which somebody looks; `frame` is its number, -1 where the reference sensor does not."""

    truth: TruthState
    looks: tuple[Look, ...]
    frame: int


@dataclass(frozen=True)
class Batch:
    """Some frames in a row and everything that is sampled from the first one up to the one after the last."""

    index: int
    first_frame: int
    frames: int
    moments: tuple[Moment, ...]

    @property
    def crc(self) -> int:
        """Tells flights apart: every bit of every truth counts."""
        crc = 0
        for moment in self.moments:
            crc = zlib.crc32(repr(moment).encode(), crc)
        return crc


@dataclass
class Clock:
    """Tells, tick by tick, who looks. One for the whole data set; `begin_flight` before each flight."""

    sensors: Mapping[str, SensorConfig]
    tick_hz: int
    _rates: dict[str, RateAccumulator] = field(default_factory=dict)
    _seq: dict[str, int] = field(default_factory=dict)
    _before: dict[str, TruthState] = field(default_factory=dict)

    def begin_flight(self) -> None:
        self._before.clear()
        for name, sensor in self.sensors.items():
            mhz = round(sensor.rate_hz * 1000)
            self._rates[name] = RateAccumulator(event_mhz=mhz, tick_mhz=self.tick_hz * 1000)

    def looks(self, truth: TruthState) -> tuple[Look, ...]:
        """Call once a tick. In the order of `sensors`."""
        found = []
        for name, rate in self._rates.items():
            if rate.due():
                seq = self._seq.get(name, 0)
                self._seq[name] = seq + 1
                if self.sensors[name].kind == "lidar":
                    found.append(Look(name, seq, self._before.get(name)))
                    self._before[name] = truth
                else:
                    found.append(Look(name, seq, None))
        return tuple(found)


class BatchMaker:
    """Gathers moments. A batch is over when the first frame of the next one comes, or the last frame of all."""

    def __init__(self, reference: str, *, frames: int, batch_frames: int) -> None:
        self._reference, self._frames, self._size = reference, frames, batch_frames
        self._moments: list[Moment] = []
        self._next_frame = 0
        self._index = 0

    @property
    def full(self) -> bool:
        """Whether all frames have been taken."""
        return self._next_frame >= self._frames

    @property
    def begun(self) -> bool:
        """Whether the first frame has been taken: what comes before it belongs to nothing."""
        return self._next_frame > 0

    @property
    def frames(self) -> int:
        """Taken so far."""
        return self._next_frame

    def add(self, truth: TruthState, looks: tuple[Look, ...]) -> Batch | None:
        """The moments of a tick; returns a batch that is over. No more than one, because frames are ticks apart."""
        is_frame = any(look.sensor == self._reference for look in looks)
        if not looks or not (is_frame or self.begun):
            return None
        batch = None
        if is_frame and self._next_frame and self._next_frame % self._size == 0:
            batch = self.take()
        frame = -1
        if is_frame:
            frame = self._next_frame
            self._next_frame += 1
        self._moments.append(Moment(truth, looks, frame))
        return batch

    def take(self) -> Batch | None:
        """What was gathered, as a batch; None where there is nothing."""
        if not self._moments:
            return None
        moments, self._moments = tuple(self._moments), []
        frames = sum(moment.frame >= 0 for moment in moments)
        first = next((moment.frame for moment in moments if moment.frame >= 0), self._next_frame)
        batch = Batch(self._index, first, frames, moments)
        self._index += 1
        return batch
