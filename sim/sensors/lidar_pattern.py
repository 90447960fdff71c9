"""Scan pattern of a LiDAR: rays of one sweep in its own frame L (forward, left, up), each with its time.

Spinning: channel c of column j fires at

    t = j * column + c * firing            after the start of the turn, while t < period
    azimuth = start -+ 2 pi t / period + offset_c,     direction = (cos e cos a, cos e sin a, sin e),  e = elevation_c

The turn starts at the back (azimuth pi), so the middle of the sweep looks ahead.

Rosette: two equal prisms that rotate against each other deflect the beam by the sum of two rotating vectors
(first-order optics of a Risley pair):

    direction ~ (1, r),     r = tan(FOV / 2) / 2 * (e^{i w1 t} + e^{i w2 t}),     t from the start of the run

Speeds are whole rpm, so the figure repeats after 60 s / (their greatest common divisor), 30 s for 7294 and -4664. The
figure of a real device does not repeat, because its motors drift.

Times of a sweep count back from its end, the capture. Directions are computed with `det_sin` and `det_cos`, so their
bits are the same on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from signals._kernel import det_cos, det_sin
from signals.documents.validate import StrictModel
from signals.time import NS_PER_S
from signals.units import RAD_PER_DEG
from sim._kernels import coherent_order

_NS_PER_MIN = 60 * NS_PER_S
MAX_POINTS = 1_000_000  # per sweep
_SIDE_BY_SIDE = 8  # rays that are cast together

Float64 = NDArray[np.float64]
Elevation = Annotated[float, Field(ge=-90.0, le=90.0)]
Azimuth = Annotated[float, Field(ge=-180.0, le=180.0)]


@dataclass(frozen=True)
class Sweep:
    """Rays of one sweep in firing order: arrays of one length, read-only by convention."""

    directions_L: Float64  # (n, 3), unit
    origin_z_m: Float64  # (n,) z of the beam's origin in L
    ring: NDArray[np.uint16]  # (n,) 0: the lowest channel
    time_offset_ns: NDArray[np.int32]  # (n,) from the capture, -period <= offset < 0


class Pattern(Protocol):
    """Source of the rays of each sweep."""

    def sweep(self, seq: int) -> Sweep:
        """Return the rays of sweep `seq`; the same object if all sweeps are equal."""
        ...


def casting_order(directions_L: Float64, ring: NDArray[np.uint16]) -> NDArray[np.int32]:
    """Return an order of casting in which rays of similar direction are neighbours. It affects speed only.

    For a spinning head: groups of eight columns, with rising rings in one group and falling rings in the next.
    """
    n = len(ring)
    if n == 0 or ring.min() == ring.max():
        order = np.empty(n, np.int32)
        coherent_order(directions_L, order)
        return order
    by_ring = np.argsort(ring, kind="stable")
    counts = np.bincount(ring)
    column = np.empty(n, np.int64)
    column[by_ring] = np.arange(n) - np.repeat(np.cumsum(counts) - counts, counts)
    block = column // _SIDE_BY_SIDE
    height = np.where(block % 2 == 0, ring.astype(np.int64), -ring.astype(np.int64))
    return np.lexsort((column, height, block)).astype(np.int32)


class SpinningPattern(StrictModel):
    """Pattern of a spinning head with a column of channels."""

    kind: Literal["spinning"]
    elevation_deg: Annotated[tuple[Elevation, ...], Field(min_length=1, max_length=256)]  # in firing order
    azimuth_offset_deg: tuple[Azimuth, ...] = ()  # per channel, to the left; empty: none
    origin_z_m: tuple[Annotated[float, Field(ge=-1.0, le=1.0)], ...] = ()  # per channel; empty: none
    firing_ns: Annotated[int, Field(ge=0, le=10_000_000)]  # from one channel to the next; 0: all channels at once
    column_ns: Annotated[int, Field(gt=0, le=1_000_000_000)] | None = None  # from one column to the next
    columns: Annotated[int, Field(gt=0, le=100_000)] | None = None  # per turn, for a device with a fixed number
    clockwise: bool = True  # seen from above

    @model_validator(mode="after")
    def _consistent(self) -> SpinningPattern:
        if (self.column_ns is None) == (self.columns is None):
            raise ValueError("a spinning pattern needs either column_ns or columns")
        n = len(self.elevation_deg)
        for name in ("azimuth_offset_deg", "origin_z_m"):
            got = len(getattr(self, name))
            if got not in (0, n):
                raise ValueError(f"{name} has {got} values for {n} channels")
        if self.column_ns is not None and (n - 1) * self.firing_ns >= self.column_ns:
            raise ValueError(f"{n} channels of {self.firing_ns} ns do not fit into a column of {self.column_ns} ns")
        return self

    @property
    def ring_elevations_deg(self) -> tuple[float, ...]:
        """Elevation of each ring. Rings count from the lowest channel up, in any firing order."""
        return tuple(sorted(self.elevation_deg))

    def points(self, period_ns: int) -> int:
        """Return the number of rays of one sweep."""
        columns = self.columns if self.columns is not None else period_ns // (self.column_ns or period_ns)
        return max(1, columns) * len(self.elevation_deg)

    def over(self, period_ns: int) -> Pattern:
        """Return the pattern of a device that turns once in `period_ns`."""
        return _Spinning(self, period_ns)


class RosettePattern(StrictModel):
    """Pattern of one beam behind two prisms that rotate against each other."""

    kind: Literal["rosette"]
    field_of_view_deg: Annotated[float, Field(gt=0.0, lt=170.0)]  # full angle of the cone
    prism_rpm: tuple[Annotated[int, Field(ge=-100_000, le=100_000)], Annotated[int, Field(ge=-100_000, le=100_000)]]
    points_per_s: Annotated[int, Field(gt=0, le=10_000_000)]

    @property
    def ring_elevations_deg(self) -> tuple[float, ...]:
        """Elevation of each ring: empty, since the pattern has no rings."""
        return ()

    def points(self, period_ns: int) -> int:
        """Return the number of rays of one sweep."""
        return max(1, self.points_per_s * period_ns // NS_PER_S)

    def over(self, period_ns: int) -> Pattern:
        """Return the pattern cut into sweeps of `period_ns`."""
        return _Rosette(self, period_ns)


AnyPattern = Annotated[SpinningPattern | RosettePattern, Field(discriminator="kind")]


def _angles(angles_rad: Float64) -> tuple[Float64, Float64]:
    """Return cosines and sines, the same bits on every machine."""
    values = angles_rad.tolist()
    return np.array([det_cos(a) for a in values]), np.array([det_sin(a) for a in values])


class _Spinning:
    """Rays of a spinning head; all sweeps are equal."""

    def __init__(self, pattern: SpinningPattern, period_ns: int) -> None:
        self._pattern = pattern
        self._period_ns = period_ns

    def sweep(self, seq: int) -> Sweep:  # noqa: ARG002
        """Return the rays of a turn."""
        return self._turn

    @cached_property
    def _turn(self) -> Sweep:
        p, period_ns = self._pattern, self._period_ns
        channels = len(p.elevation_deg)
        columns = p.points(period_ns) // channels
        if p.columns is not None:
            start_ns = np.arange(columns, dtype=np.int64) * period_ns // columns
        else:
            start_ns = np.arange(columns, dtype=np.int64) * (p.column_ns or 0)
        fire_ns = start_ns[:, None] + np.arange(channels, dtype=np.int64) * p.firing_ns
        # With `columns`, the last channels may fire after the end of the turn; they get its last instant.
        fire_ns = np.minimum(fire_ns, period_ns - 1)
        sense = -1.0 if p.clockwise else 1.0
        turn_cos, turn_sin = _angles((2.0 * np.pi) * (0.5 + sense * (fire_ns.ravel() / period_ns)))
        offset = np.array(p.azimuth_offset_deg or (0.0,) * channels) * RAD_PER_DEG
        offset_cos, offset_sin = (np.tile(x, columns) for x in _angles(offset))
        level, up = (np.tile(x, columns) for x in _angles(np.array(p.elevation_deg) * RAD_PER_DEG))
        directions = np.stack(
            [
                level * (turn_cos * offset_cos - turn_sin * offset_sin),
                level * (turn_sin * offset_cos + turn_cos * offset_sin),
                up,
            ],
            axis=-1,
        )
        # Rings count from the lowest channel up, in any firing order.
        order = sorted(range(channels), key=lambda c: (p.elevation_deg[c], c))
        ring = np.empty(channels, dtype=np.uint16)
        ring[order] = np.arange(channels, dtype=np.uint16)
        origin_z_m = np.tile(np.array(p.origin_z_m or (0.0,) * channels), columns)
        offset_ns = (fire_ns.ravel() - period_ns).astype(np.int32)
        # With `columns`, neighbouring columns may overlap in time.
        firing_order = np.argsort(offset_ns, kind="stable")
        return Sweep(
            directions[firing_order],
            origin_z_m[firing_order],
            np.tile(ring, columns)[firing_order],
            offset_ns[firing_order],
        )


class _Rosette:
    """Rosette whose prisms keep turning from sweep to sweep, so that every sweep differs."""

    def __init__(self, pattern: RosettePattern, period_ns: int) -> None:
        self._pattern = pattern
        self._period_ns = period_ns
        n = pattern.points(period_ns)
        self._fire_ns = np.arange(n, dtype=np.int64) * period_ns // n
        half_rad = 0.5 * pattern.field_of_view_deg * RAD_PER_DEG
        self._radius = 0.5 * det_sin(half_rad) / det_cos(half_rad)
        # Angles within a sweep, computed once; a sweep adds the angle at its start by the addition theorem.
        self._within = [_angles((2.0 * np.pi) * ((rpm * self._fire_ns) / _NS_PER_MIN)) for rpm in pattern.prism_rpm]
        self._zero = np.zeros(n)
        self._ring = np.zeros(n, dtype=np.uint16)
        self._offset_ns = (self._fire_ns - period_ns).astype(np.int32)

    def sweep(self, seq: int) -> Sweep:
        """Return the rays of sweep `seq`; sweep 0 begins at the start of the run."""
        left, up = self._zero, self._zero
        for rpm, (cosine, sine) in zip(self._pattern.prism_rpm, self._within, strict=True):
            # Whole turns are removed in integers, so the phase stays exact for hours.
            phase = 2.0 * np.pi * ((rpm * seq * self._period_ns) % _NS_PER_MIN / _NS_PER_MIN)
            c, s = det_cos(phase), det_sin(phase)
            left = left + (c * cosine - s * sine)
            up = up + (s * cosine + c * sine)
        left, up = self._radius * left, self._radius * up
        directions = np.empty((len(left), 3))
        inverse = 1.0 / np.sqrt(1.0 + (left * left + up * up))
        directions[:, 0] = inverse
        directions[:, 1] = left * inverse
        directions[:, 2] = up * inverse
        return Sweep(directions, self._zero, self._ring, self._offset_ns)
