"""Signals at an antenna: which satellites are above the mask, how strong each arrives, and by which way.

    C/N0 = C/N0_zenith + G(u) - L        [dB-Hz], less beside jammers (interference.py)
    G(u) = -9 (1 - u)                    [dB], u the cosine of the angle to the antenna's axis

0 dB along the axis, -9 dB across, -18 dB behind. The axis is z of the body, so that a tilt of the vehicle counts; the
vehicle itself hides nothing. The left-handed part of a reflection arrives 10 dB weaker. L: foliage.

A satellite behind a solid has the signal of its strongest reflection, if there is one. Reflections that arrive from
below the mask are left out, as those by the ground are: they belong to a preset's figures in the open. So no reflection
is missed where nothing of the scene is above the mask and no ray is cast.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from signals.rotation import dot, minus, norm
from signals.samples import Vec3
from sim.gnss.decibel import decibel
from sim.gnss.interference import SIGNAL_DBW, Emitter, jammed_dbhz, received_dbw
from sim.gnss.multipath import reflection_amplitude
from sim.gnss.parameters import ReceiverParameters, SkyParameters
from sim.gnss.signal_paths import Reflection, SignalPaths, foliage_loss_db
from sim.gnss.surroundings import Surroundings
from sim.gnss.systems import System

Float64 = NDArray[np.float64]

NO_SIGNAL = float("-inf")
MOST_EXTRA_M = 600.0  # of a reflection that is looked for
_PATTERN_DB = 9.0
_CROSS_POLAR = 0.31622776601683794  # amplitude of -10 dB
_WEAKEST = 1e-6  # amplitude


@dataclass(slots=True)
class Image:
    """A reflection and its level over that of a satellite at the antenna's zenith."""

    reflection: Reflection
    level_db: float


@dataclass(slots=True)
class Signal:
    """Signal of one satellite above the mask."""

    satellite: int  # in the receiver's table
    system: System
    direction: Vec3  # east, north, up
    level_db: float  # of the direct way, over that of a satellite at the antenna's zenith
    open_db: float  # the same without foliage
    hidden: bool
    images: list[Image] = field(default_factory=list)
    image: Image | None = None  # the one that a hidden satellite is received by
    cn0_dbhz: float = NO_SIGNAL
    below_db: float = 0.0  # C/N0 over that of the direct signal in the open, at most 0


def gain_db(up_W: Vec3, direction: Vec3) -> float:
    """Return the antenna's gain over that along its axis."""
    return -_PATTERN_DB * (1.0 - dot(up_W, direction))


class Listener:
    """The antenna of one receiver in a scene."""

    def __init__(
        self, surroundings: Surroundings, receiver: ReceiverParameters, sky: SkyParameters, *, mask_sine: float
    ) -> None:
        self._around, self._p, self._sky = surroundings, receiver, sky
        self._mask_sine = mask_sine
        self._mask_tangent = mask_sine / float(np.sqrt(1.0 - mask_sine * mask_sine))
        self.paths = SignalPaths(surroundings)
        self.samples = self.clear = 0  # all samples, and those without a ray to a satellite

    def listen(
        self, antenna_W: Vec3, up_W: Vec3, every: Float64, systems: list[System], received: list[tuple[float, float]]
    ) -> list[Signal]:
        """Return the signals of the satellites above the mask.

        `every`: unit vectors to all satellites (n, 3). `received`: power [dBW] and Q of each transmitter.
        """
        above = np.flatnonzero(every[:, 2] >= self._mask_sine)
        directions = np.ascontiguousarray(every[above])
        numbers, rows = above.tolist(), [(d[0], d[1], d[2]) for d in directions.tolist()]
        signals = []
        for number, direction in zip(numbers, rows, strict=True):
            level = gain_db(up_W, direction)
            signals.append(Signal(number, systems[number], direction, level, level, hidden=False))
        self.samples += 1
        if self._sky.skip_clear_sky and self.paths.is_clear(antenna_W, self._mask_tangent):
            self.clear += 1
        else:
            self._cast(antenna_W, up_W, directions, signals)
        for signal in signals:
            self._tune(signal, received)
        return signals

    def received_dbw(self, emitter: Emitter, antenna_W: Vec3, up_W: Vec3) -> float:
        """Return the power of a transmitter at the antenna."""
        way = minus(emitter.place_W_m, antenna_W)
        distance_m = norm(way)
        direction = (way[0] / distance_m, way[1] / distance_m, way[2] / distance_m) if distance_m > 0.0 else up_W
        hidden = self.paths.is_hidden(antenna_W, emitter.place_W_m)
        return received_dbw(emitter, distance_m, gain_db=gain_db(up_W, direction), hidden=hidden)

    def _cast(self, antenna_W: Vec3, up_W: Vec3, directions: Float64, signals: list[Signal]) -> None:
        reach = self.paths.to_satellites(antenna_W, directions)
        for signal, geom, way_m in zip(signals, reach.geom.tolist(), reach.foliage_m.tolist(), strict=True):
            signal.hidden = geom >= 0
            signal.level_db -= foliage_loss_db(way_m, self._sky.foliage_db_per_m)
        if not self._sky.reflections:
            return
        for reflection in self.paths.reflections(antenna_W, directions, MOST_EXTRA_M):
            if reflection.direction[2] < self._mask_sine:
                continue
            strength = reflection_amplitude(
                reflection.cosine,
                float(self._around.permittivity[reflection.geom]),
                conducts=bool(self._around.conducts[reflection.geom]),
                cross_polar=_CROSS_POLAR,
            )
            level = gain_db(up_W, reflection.direction) + 2.0 * decibel(max(strength, _WEAKEST))
            level -= foliage_loss_db(reflection.foliage_m, self._sky.foliage_db_per_m)
            signals[reflection.satellite].images.append(Image(reflection, level))

    def _tune(self, signal: Signal, received: list[tuple[float, float]]) -> None:
        level = signal.level_db
        if signal.hidden:
            if not signal.images:
                return
            signal.image = max(signal.images, key=lambda image: image.level_db)
            level = signal.image.level_db
        signal.cn0_dbhz = clean = self._p.zenith_cn0_dbhz + level
        if received:
            signal_dbw = SIGNAL_DBW + level
            over = tuple((power_dbw - signal_dbw, q) for power_dbw, q in received)
            signal.cn0_dbhz = jammed_dbhz(clean, over, signal.system.chips_per_s)
        signal.below_db = min(level - signal.open_db + (signal.cn0_dbhz - clean), 0.0)
