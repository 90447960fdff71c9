"""Power by azimuth and range that a radar with a turning beam receives in one revolution.

Rays i on a grid of azimuth and elevation, each of the solid angle dOmega_i, meet a surface at the range R_i under the
cosine c_i. With the two-way pattern G^2 in azimuth about the beam's axis a_k and in elevation, and d the width of a bin

    P[k, b] = K sum_i G_a^2(a_i - a_k) G_e^2(e_i) sigma0(c_i) dOmega_i / (c_i R_i^2) W(R_i / d - b)
    K       = P_t G_0^2 lambda^2 / (4 pi)^3         W(x) = ( sinc(x) / (1 - x^2) )^2

(radar equation with dA = R^2 dOmega / c; W: power response of a Hann window, Harris, Proc. IEEE 66, 1978). Where the
neighbours of a ray meet the same plane surface, its power is spread evenly over the ranges half way to theirs, which on
the ground are many bins: otherwise each row of rays would draw a ring. Powers add: a bin holds many scatterers, and its
value is the mean over their phases. To it the receiver adds complex normal noise n of mean power N, and codes it in
steps of decibels:

    P' = |sqrt(P) + n|^2 = P + N E + 2 sqrt(P N E) cos(phi),   E exponential, phi uniform
    code = round( (10 log10(P' / 1 mW) - floor) / step ), 0 to 255

Sums run in the order of rays, azimuths and bins; E, cos(phi) and codes come from tables: the bits are the same on every
machine. Left out: speckle, multipath, Doppler's shift of ranges, echoes beyond the last bin.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from signals._kernel import det_cos, det_log, det_pow, det_sin
from signals.documents.validate import StrictModel
from signals.units import RAD_PER_DEG, TURN_RAD
from sim.radar.antenna import Pattern
from sim.radar.bistatic import BistaticReflection
from sim.radar.chirp import SPEED_OF_LIGHT_MPS
from sim.radar.reflection import Reflection
from sim.scene.scene_map import Surface

Float64 = NDArray[np.float64]
Ids = NDArray[np.int64]

CODES = 256
_RANGE_TAPS = (-1, 0, 1, 2)  # bins about the one below the range
_RESPONSE_STEPS = 256
_PATTERN_FLOOR = 1e-4  # two-way, in azimuth
_TABLE = 1 << 16  # of exponentials and cosines
_LEAST_COSINE = 1e-3
_SAME_NORMAL = 0.999
_FOUR_PI = 2.0 * TURN_RAD


class Beam(StrictModel):
    """A turning beam and its receiver."""

    frequency_hz: Annotated[float, Field(ge=1e9, le=3e11)]
    azimuths: Annotated[int, Field(ge=16, le=2048)]  # in a revolution
    bins: Annotated[int, Field(ge=16, le=8192)]
    bin_m: Annotated[float, Field(ge=0.01, le=10.0)]
    antenna: Pattern  # of the beam, out and back
    tx_power_dbm: Annotated[float, Field(ge=-60.0, le=60.0)]
    noise_dbm: Annotated[float, Field(ge=-200.0, le=0.0)]  # mean power of noise in a bin
    floor_dbm: Annotated[float, Field(ge=-200.0, le=0.0)]  # of code 0
    step_db: Annotated[float, Field(ge=0.05, le=2.0)] = 0.5
    elevation_deg: tuple[Annotated[float, Field(ge=-89.0, le=89.0)], Annotated[float, Field(ge=-89.0, le=89.0)]]
    # Rays, in azimuth and elevation: edges of objects are placed by them.
    columns_per_azimuth: Annotated[int, Field(ge=1, le=8)] = 2
    elevation_spacing_deg: Annotated[float, Field(ge=0.1, le=5.0)] = 0.5

    @model_validator(mode="after")
    def _elevations_in_order(self) -> Beam:
        low, high = self.elevation_deg
        if not low < high:
            raise ValueError(f"elevation_deg [{low:g}, {high:g}] is empty")
        return self

    @property
    def max_range_m(self) -> float:
        return (self.bins - 1) * self.bin_m


class SpinningBeam:
    """Rays of a revolution, and the power of what they meet. Columns of rays turn clockwise from ahead."""

    def __init__(self, beam: Beam, surfaces: tuple[Surface, ...]) -> None:
        low, high = beam.elevation_deg
        self._beam = beam
        self._reflection = BistaticReflection(surfaces, beam.frequency_hz, Reflection())
        self.columns = beam.azimuths * beam.columns_per_azimuth
        step_rad = TURN_RAD / self.columns
        rows = max(1, round((high - low) / beam.elevation_spacing_deg))
        edges = [(low + (high - low) * i / rows) * RAD_PER_DEG for i in range(rows + 1)]
        middles = [0.5 * (a + b) for a, b in pairwise(edges)]
        sines = np.array([det_sin(e) for e in edges])
        up = np.array([[det_cos(e), 0.0, det_sin(e)] for e in middles])
        # The first and the last azimuth see beyond the revolution's ends: `pad` columns more on either side.
        pad = 0
        while _two_way(beam.antenna, (pad + 1) * step_rad) >= _PATTERN_FLOOR and pad < self.columns // 4:
            pad += 1
        numbers = range(-pad, self.columns + pad)
        turn = [(det_cos(-j * step_rad), det_sin(-j * step_rad)) for j in numbers]
        self.azimuth_L = np.array([[c, s, 0.0] for c, s in turn[pad : pad + self.columns : beam.columns_per_azimuth]])
        directions = np.empty((len(turn), rows, 3))
        for j, (c, s) in enumerate(turn):
            directions[j] = np.stack([c * up[:, 0], s * up[:, 0], up[:, 2]], axis=1)
        self.directions_L = directions.reshape(-1, 3)
        self.column: Ids = np.repeat(np.array(numbers, np.int64), rows)
        self._grid = len(turn), rows
        elevation = beam.antenna.share(up)
        watt = 1e-3 * det_pow(10.0, 0.1 * beam.tx_power_dbm)
        wavelength_m = SPEED_OF_LIGHT_MPS / beam.frequency_hz
        gain_m = beam.antenna.axis_gain * wavelength_m
        scale = watt * gain_m * gain_m / (_FOUR_PI * _FOUR_PI * _FOUR_PI)
        weight = scale * elevation * elevation * step_rad * (sines[1:] - sines[:-1])
        self._weight = np.tile(weight, len(turn))
        # Azimuths that a column of each place in a step reaches, and the gain towards it.
        per_step = beam.columns_per_azimuth
        self._taps = [
            (k, np.array([_two_way(beam.antenna, (part - k * per_step) * step_rad) for part in range(per_step)]))
            for k in range(-(pad // per_step) - 1, pad // per_step + 2)
        ]
        self._response = np.array(
            [[_hann(i / _RESPONSE_STEPS - tap) for i in range(_RESPONSE_STEPS + 1)] for tap in _RANGE_TAPS]
        )
        levels_dbm = [beam.floor_dbm + (code + 0.5) * beam.step_db for code in range(CODES - 1)]
        self._levels_w = np.array([1e-3 * det_pow(10.0, 0.1 * level) for level in levels_dbm])
        self.noise_w = 1e-3 * det_pow(10.0, 0.1 * beam.noise_dbm)
        # E at the middles of equal shares of its distribution, and cos(phi) at the middles of equal steps.
        self._exponential = np.array([-det_log((i + 0.5) / _TABLE) for i in range(_TABLE)])
        self._cosine = np.array([det_cos(TURN_RAD * (i + 0.5) / _TABLE) for i in range(_TABLE)])

    @property
    def shape(self) -> tuple[int, int]:
        """Azimuths, bins."""
        return self._beam.azimuths, self._beam.bins

    def echoes(self, range_m: Float64, surface: Ids, cosine: Float64) -> tuple[Ids, Float64]:
        """Return the rays with an echo, and its power K sum / W on the axis of the beam [W]. `surface`: 0 is none."""
        some = np.flatnonzero((surface > 0) & (cosine > _LEAST_COSINE) & (range_m < self._beam.max_range_m))
        some = some[range_m[some] > self._beam.bin_m]
        c, r = cosine[some], range_m[some]
        sigma0 = self._reflection.sigma0(surface[some], c, c, c, np.ones(len(c)))
        return some, self._weight[some] * sigma0 / (c * r * r)

    def spans(self, range_m: Float64, geom: Ids, normal: Float64) -> tuple[Float64, Float64]:
        """Return the nearest and farthest range of the surface in each ray's cell [m], for all rays."""
        grid = self._grid
        r = np.where(geom >= 0, range_m, 0.0).reshape(grid)
        g, n = geom.reshape(grid), normal.reshape(*grid, 3)
        low, high = range_m.copy().reshape(grid), range_m.copy().reshape(grid)
        for axis in (0, 1):
            before, after = np.zeros(grid), np.zeros(grid)  # ranges half way to the neighbours, from the ray's own
            a, b = (np.s_[:-1], np.s_[1:]) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
            cosine = n[a][..., 0] * n[b][..., 0] + n[a][..., 1] * n[b][..., 1] + n[a][..., 2] * n[b][..., 2]
            half = np.where((g[a] == g[b]) & (cosine > _SAME_NORMAL), 0.5 * (r[b] - r[a]), 0.0)
            after[a], before[b] = half, -half
            # At the rim of a surface, its cell reaches as far as on the other side.
            before, after = np.where(before == 0.0, -after, before), np.where(after == 0.0, -before, after)
            low += np.minimum(before, after)
            high += np.maximum(before, after)
        return low.reshape(-1), high.reshape(-1)

    def cells(self, some: Ids, range_m: Float64, *, taps: int = len(_RANGE_TAPS)) -> tuple[Ids, Float64]:
        """Return the cells that the rays `some` of ranges (len(some),) reach, and their shares: (m, len(some)) each.

        Cells are numbered azimuth by azimuth; shares are G_a^2 W. `taps` 1: the nearest bin alone.
        """
        azimuths, bins = self.shape
        place = range_m / self._beam.bin_m
        below = place.astype(np.int64)
        inside = place - below
        per_step = self._beam.columns_per_azimuth
        part, nearest = self.column[some] % per_step, self.column[some] // per_step
        at = inside * _RESPONSE_STEPS
        node = np.minimum(at.astype(np.int64), _RESPONSE_STEPS - 1)
        cells, shares = [], []
        for k, gain in self._taps:
            azimuth = nearest + k
            first = np.clip(azimuth, 0, azimuths - 1) * bins
            two_way = np.where((azimuth >= 0) & (azimuth < azimuths), gain[part], 0.0)
            if taps == 1:
                cells.append(first + np.minimum((place + 0.5).astype(np.int64), bins - 1))
                shares.append(two_way)
                continue
            for tap, response in zip(_RANGE_TAPS, self._response, strict=True):
                low = response[node]
                cells.append(first + np.clip(below + tap, 0, bins - 1))
                shares.append(two_way * (low + (at - node) * (response[node + 1] - low)))
        return np.array(cells), np.array(shares)

    def power(self, some: Ids, power_w: Float64, range_m: Float64, spans: tuple[Float64, Float64]) -> Float64:
        """Return P, (azimuths, bins) [W], of the rays `some` with their powers; ranges and spans are of all rays."""
        azimuths, bins = self.shape
        size = azimuths * bins
        low, high = (span[some] / self._beam.bin_m for span in spans)
        wide = high - low > 1.0
        total: Float64 = np.zeros(size)
        rays = some[~wide]
        if len(rays):
            cells, shares = self.cells(rays, range_m[rays])
            total = total + np.bincount(cells.reshape(-1), (shares * power_w[~wide]).reshape(-1), minlength=size)
        if wide.any():
            total = total + self._spread(some[wide], power_w[wide], low[wide], high[wide])
        return np.asarray(total.reshape(azimuths, bins))

    def _spread(self, rays: Ids, power_w: Float64, low: Float64, high: Float64) -> Float64:
        """Return the power of rays that is spread evenly from `low` to `high`, in bins.

        The steps of the density at both ends, each shared by two bins, are summed along the range.
        """
        azimuths, bins = self.shape
        columns = bins + 2  # a step past the last bin falls into the last two
        density = power_w / (high - low)
        per_step = self._beam.columns_per_azimuth
        part, nearest = self.column[rays] % per_step, self.column[rays] // per_step
        cells, steps = [], []
        for k, gain in self._taps:
            azimuth = nearest + k
            first = np.clip(azimuth, 0, azimuths - 1) * columns
            height = np.where((azimuth >= 0) & (azimuth < azimuths), gain[part], 0.0) * density
            for edge, sign in ((low, 1.0), (high, -1.0)):
                at = np.clip(edge, 0.0, bins - 0.5) + 0.5
                node = at.astype(np.int64)  # of the bin whose middle is within half a bin
                inside = at - node
                cells += [first + node, first + node + 1]
                steps += [sign * height * (1.0 - inside), sign * height * inside]
        made = np.bincount(np.concatenate(cells), np.concatenate(steps), minlength=azimuths * columns)
        mass: Float64 = np.cumsum(made.reshape(azimuths, columns), axis=1)[:, :bins].astype(np.float64)
        mass = np.maximum(mass, 0.0)  # rounding
        wide: Float64 = mass.copy()  # W is 1/4 at the next bins
        wide[:, 1:] += 0.25 * mass[:, :-1]
        wide[:, :-1] += 0.25 * mass[:, 1:]
        return wide.reshape(-1)

    def codes(self, power_w: Float64, bits: NDArray[np.uint64]) -> NDArray[np.uint8]:
        """Return the codes of P with noise; `bits` are random, one word for each cell."""
        noise = self.noise_w * self._exponential[bits & np.uint64(_TABLE - 1)]
        turn = self._cosine[(bits >> np.uint64(16)) & np.uint64(_TABLE - 1)]
        received = power_w + noise + 2.0 * np.sqrt(power_w * noise) * turn
        return np.searchsorted(self._levels_w, received, side="right").astype(np.uint8)


def _two_way(antenna: Pattern, off_rad: float) -> float:
    share = float(antenna.share(np.array([[det_cos(off_rad), det_sin(off_rad), 0.0]]))[0])
    return share * share


def _hann(x: float) -> float:
    """Return W, 1 at 0 and 1/4 at +-1."""
    if abs(x) < 1e-9:
        return 1.0
    if abs(abs(x) - 1.0) < 1e-9:
        return 0.25
    angle = 0.5 * TURN_RAD * x
    value = det_sin(angle) / (angle * (1.0 - x * x))
    return value * value


def cartesian(codes: NDArray[np.uint8], bin_m: float, *, half_width_m: float, pixels: int) -> Float64:
    """Return a picture from above of the nearest cells, (pixels, pixels), ahead upwards. For display."""
    azimuths, bins = codes.shape
    places = (np.arange(pixels) + 0.5) / pixels * 2.0 - 1.0
    right, ahead = np.meshgrid(places * half_width_m, -places * half_width_m)
    turn = np.arctan2(right, ahead) / TURN_RAD % 1.0
    row = np.rint(turn * azimuths).astype(np.int64) % azimuths
    column = np.rint(np.hypot(right, ahead) / bin_m).astype(np.int64)
    return np.where(column < bins, codes[row, np.minimum(column, bins - 1)], 0).astype(np.float64)
