"""Wind: a steady wind, Dryden turbulence, and gusts.

    wind(t) at the vehicle = steady + turbulence + sum of gusts           [m/s in W; positive: towards east, north, up]

The wind is evaluated at the ticks and is linear in between.

Turbulence is MIL-F-8785C's low-altitude Dryden model (sim/native/dryden.hpp) at one point: the air does not rotate over
the vehicle's span. Its longitudinal axis lies along the steady wind (east if there is none). The filters run with the
vehicle's speed through the steady air, but at least 1 m/s, so a hovering vehicle meets turbulence even in calm air.
Gusts are the same everywhere; a passing front is a gust without an end.

Turbulence has its own noise stream, "wind", so it changes the noise of no other source.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from math import pi
from typing import Annotated, Literal, NamedTuple

import pydantic
from pydantic import Field

from signals._kernel import det_cos
from signals.documents.validate import StrictModel
from signals.noise import NoiseStream
from signals.samples import Vec3
from signals.time import NS_PER_S
from sim._kernels import Dryden

Speed = Annotated[float, Field(ge=-50.0, le=50.0)]
Velocity = tuple[Speed, Speed, Speed]

# Mean wind at 20 ft for these levels (MIL-F-8785C 3.7.3.1): 15, 30 and 45 knots.
_LEVELS_MPS = {"light": 7.717, "moderate": 15.433, "severe": 23.15}
_LANES = 5
_MIN_AIRSPEED_MPS = 1.0


class Turbulence(StrictModel):
    """Strength of turbulence: the mean wind at 20 ft (6.1 m), or one of the standard's levels."""

    level: Literal["light", "moderate", "severe"] | None = None
    wind_20ft_mps: Annotated[float, Field(ge=0.0, le=50.0)] | None = None

    @pydantic.model_validator(mode="after")
    def _one_strength(self) -> Turbulence:
        if (self.level is None) == (self.wind_20ft_mps is None):
            raise ValueError("turbulence needs either level or wind_20ft_mps")
        return self

    @property
    def strength_mps(self) -> float:
        """Mean wind at 20 ft."""
        if self.level is not None:
            return _LEVELS_MPS[self.level]
        assert self.wind_20ft_mps is not None
        return self.wind_20ft_mps


class GustEvent(StrictModel):
    """Gust in MIL-F-8785C's 1-cosine shape: rises over `rise_s`, holds for `hold_s`, falls over `fall_s`.

    Without `fall_s` the gust does not end: a wind front.
    """

    at_s: Annotated[float, Field(ge=0.0, le=86_400.0)]
    velocity_W_mps: Velocity  # at full strength, added to the other wind
    rise_s: Annotated[float, Field(gt=0.0, le=3600.0)]
    hold_s: Annotated[float, Field(ge=0.0, le=86_400.0)] = 0.0
    fall_s: Annotated[float, Field(gt=0.0, le=3600.0)] | None = None

    def strength(self, t_ns: int) -> float:
        """Return the strength at an instant, 0..1."""
        t = (t_ns - round(self.at_s * NS_PER_S)) / NS_PER_S
        if t <= 0.0:
            return 0.0
        if t < self.rise_s:
            return 0.5 * (1.0 - det_cos(pi * t / self.rise_s))
        t -= self.rise_s + self.hold_s
        if t <= 0.0 or self.fall_s is None:
            return 1.0
        return 0.5 * (1.0 + det_cos(pi * t / self.fall_s)) if t < self.fall_s else 0.0

    @property
    def end_s(self) -> float | None:
        """End of the gust; None: it stays."""
        return None if self.fall_s is None else self.at_s + self.rise_s + self.hold_s + self.fall_s

    @property
    def text(self) -> str:
        """Text of the event in the recording."""
        x, y, z = self.velocity_W_mps
        end = "stays" if self.fall_s is None else f"over at {self.end_s:g} s"
        return f"gust of ({x:g}, {y:g}, {z:g}) m/s (east, north, up) rises for {self.rise_s:g} s, {end}"


class Wind(StrictModel):
    """Wind over a scene."""

    steady_W_mps: Velocity = (0.0, 0.0, 0.0)
    turbulence: Turbulence | None = None
    gusts: tuple[GustEvent, ...] = ()


class WindEvent(NamedTuple):
    """Beginning or end of a gust."""

    tick: int
    text: str


class WindAtVehicle:
    """Wind at one vehicle, tick by tick. One instance serves one flight."""

    def __init__(self, wind: Wind, *, seed: int, tick_ns: int) -> None:
        self.wind = wind
        self.constant = wind.turbulence is None and not wind.gusts
        self._seed, self._tick_ns = seed, tick_ns
        self._dryden: Dryden | None = None
        self._dryden_mps = 0.0  # strength of `_dryden`; the turbulence is its output times `_share`
        self._share = self._share_to = 1.0
        self._share_step = 0.0  # a tick
        x, y, _ = wind.steady_W_mps
        speed = math.sqrt(x * x + y * y)
        # Direction of the turbulence's longitudinal axis.
        self._east, self._north = (x / speed, y / speed) if speed > 0.0 else (1.0, 0.0)
        if wind.turbulence is not None:
            self._start_dryden(wind.turbulence.strength_mps, 0)

    def _start_dryden(self, strength_mps: float, tick: int) -> None:
        self._noise = NoiseStream(self._seed, "wind", lanes=_LANES)
        self._dryden_mps = strength_mps
        self._dryden = Dryden(
            normals=self._noise.normal(tick), wind_20ft_mps=strength_mps, dt_s=self._tick_ns / NS_PER_S
        )

    def start(self, height_m: float) -> Vec3:
        """Return the wind at tick 0 [m/s in W]."""
        return self._sum(0, self._dryden.sample(height_m) if self._dryden is not None else None)

    def at(self, tick: int, height_m: float, v_WB_W: Vec3) -> Vec3:
        """Return the wind [m/s in W] at a vehicle of this height and velocity; call for every tick in order, from 1."""
        turbulence: Vec3 | None = None
        if self._dryden is not None:
            sx, sy, sz = self.wind.steady_W_mps
            x, y, z = v_WB_W[0] - sx, v_WB_W[1] - sy, v_WB_W[2] - sz
            airspeed = math.sqrt(x * x + y * y + z * z)
            # A NaN speed becomes the lower limit here; the range check of the state reports it.
            airspeed = airspeed if airspeed > _MIN_AIRSPEED_MPS else _MIN_AIRSPEED_MPS
            turbulence = self._dryden.step(height_m, airspeed, self._noise.normal(tick))
            if self._share != 1.0 or self._share_to != 1.0:
                along, left, up = turbulence
                turbulence = (self._share * along, self._share * left, self._share * up)
                change = self._share_to - self._share
                most = self._share_step
                self._share = self._share_to if abs(change) <= most else self._share + math.copysign(most, change)
        return self._sum(tick, turbulence)

    def set_steady(self, wind_W_mps: Vec3) -> None:
        """Set the steady wind from now on; the axis of the turbulence stays."""
        self.wind = self.wind.model_copy(update={"steady_W_mps": wind_W_mps})

    def set_turbulence(self, wind_20ft_mps: float, tick: int) -> None:
        """Change the strength of the turbulence evenly over a second from `tick` on; 0: none is left.

        Its deviations are proportional to the wind at 20 ft, so the filters run on as they are.
        """
        if self._dryden is None or self._dryden_mps == 0.0:
            self._start_dryden(max(wind_20ft_mps, 1.0), tick)
            self._share = 0.0
        self._share_to = wind_20ft_mps / self._dryden_mps
        self._share_step = abs(self._share_to - self._share) * self._tick_ns / NS_PER_S
        self.constant = False

    def add(self, gust: GustEvent) -> list[WindEvent]:
        """Add a gust that has not begun; return its events."""
        self.wind = self.wind.model_copy(update={"gusts": (*self.wind.gusts, gust)})
        self.constant = False
        return self._events_of((gust,))

    def events(self) -> list[WindEvent]:
        """Return the beginnings and ends of all gusts."""
        return self._events_of(self.wind.gusts)

    def _events_of(self, gusts: Sequence[GustEvent]) -> list[WindEvent]:
        found = []
        for gust in gusts:
            found.append(WindEvent(self._tick_of(gust.at_s), gust.text))
            if gust.end_s is not None:
                found.append(WindEvent(self._tick_of(gust.end_s), "gust is over"))
        return found

    def _tick_of(self, at_s: float) -> int:
        return -(-round(at_s * NS_PER_S) // self._tick_ns)

    def _sum(self, tick: int, turbulence: Vec3 | None) -> Vec3:
        x, y, z = self.wind.steady_W_mps
        for gust in self.wind.gusts:
            share = gust.strength(tick * self._tick_ns)
            gx, gy, gz = gust.velocity_W_mps
            x, y, z = x + share * gx, y + share * gy, z + share * gz
        if turbulence is not None:
            along, left, up = turbulence
            x += along * self._east - left * self._north
            y += along * self._north + left * self._east
            z += up
        return (x, y, z)
