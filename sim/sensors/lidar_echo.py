"""What a LiDAR makes of the light that comes back: echoes, losses, noise.

Light. A surface of reflectivity rho met at incidence theta sends back rho cos(theta) (Lambertian). A beam with
divergence is five rays: the middle and four at half the radius, each a fifth of the light. What returns from within
`echo_separation_m` is one echo, at the mean range weighted by light; of several echoes the device reports one.
Haze of extinction beta takes light on the way out and back, exp(-2 beta r) of each ray (sim/scene/weather.py); what the
haze itself sends back is left out.

Loss. An echo of strength e = rho cos(theta) is seen to

    limit = range_at_10_percent_m * sqrt(e / 0.1)                       (light falls with the square of the range)

for sure up to 0.9 limit, never beyond 1.1 limit, with a probability that falls in a line between; besides, each echo is
lost with `dropout_probability`.

Measurement. range = round(true + sigma n), kept within [min_range_m, max_range_m].

Noise of ray i of sweep `seq` is draw seq * rays + i of the streams `<name>.range` and `<name>.dropout`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim._kernels import normal_block, uniform_block
from sim.sensors.lidar_parameters import LidarParameters
from sim.sensors.noise_key import noise_key

Float64 = NDArray[np.float64]

_SURE, _NEVER = 0.9, 1.1  # of the limit; how sharp it is depends on the detector
_REFERENCE = 0.1  # reflectivity that `range_at_10_percent_m` is stated for
_NO_LIGHT = 1e-12  # weight of a black surface in a mean


@dataclass(frozen=True)
class Echoes:
    """One echo a ray. `range_m` is +inf where there is none."""

    range_m: Float64  # (n,)
    strength: Float64  # (n,) rho cos(theta), of all of the beam's light
    geom: NDArray[np.int32]  # (n,) the surface that gave most of it


def single_echoes(range_m: Float64, strength: Float64, geom: NDArray[np.int32]) -> Echoes:
    """Echoes of beams that are one ray."""
    return Echoes(range_m, strength, geom)


def choose_echoes(
    range_m: Float64, strength: Float64, geom: NDArray[np.int32], *, which: str, separation_m: float
) -> Echoes:
    """The echo that is reported of each beam of (m, n) rays; `which` is "first", "last" or "strongest"."""
    m, n = range_m.shape
    order = np.argsort(range_m, axis=0, kind="stable")
    r = np.take_along_axis(range_m, order, axis=0)
    e = np.take_along_axis(strength, order, axis=0) / m
    g = np.take_along_axis(geom, order, axis=0)
    none = np.full(n, np.inf)
    best = Echoes(none.copy(), np.zeros(n), np.full(n, -1, np.int32))
    found = np.zeros(n, dtype=bool)
    # The echo being gathered: its last range, sums over its rays, and its brightest ray.
    last, weight, moment, light = none.copy(), np.zeros(n), np.zeros(n), np.zeros(n)
    brightest, brightest_geom = np.full(n, -1.0), np.full(n, -1, np.int32)
    for j in range(m + 1):
        hit = np.isfinite(r[j]) if j < m else np.zeros(n, dtype=bool)
        with np.errstate(invalid="ignore"):
            joins = hit & (weight > 0.0) & (r[j] - last <= separation_m) if j < m else hit
        ends = (weight > 0.0) & ~joins
        if which == "first":
            report = ends & ~found
        elif which == "last":
            report = ends
        else:
            report = ends & (~found | (light > best.strength))
        with np.errstate(divide="ignore", invalid="ignore"):
            best.range_m[report] = (moment / weight)[report]
        best.strength[report] = light[report]
        best.geom[report] = brightest_geom[report]
        found |= ends
        if j == m:
            break
        fresh = ~joins
        weight[fresh] = moment[fresh] = light[fresh] = 0.0
        brightest[fresh] = -1.0
        w = np.where(hit, e[j] + _NO_LIGHT, 0.0)
        weight += w
        moment += np.where(hit, w * np.where(hit, r[j], 0.0), 0.0)
        light += np.where(hit, e[j], 0.0)
        brighter = hit & (e[j] > brightest)
        brightest[brighter] = e[j][brighter]
        brightest_geom[brighter] = g[j][brighter]
        last = np.where(hit, r[j], last)
    return best


class Receiver:
    """Losses and noise of one LiDAR."""

    def __init__(self, parameters: LidarParameters, *, rays: int, seed: int, name: str) -> None:
        self._p = parameters
        self._rays = rays
        self._noise_key = noise_key(seed, f"{name}.range")
        self._loss_key = noise_key(seed, f"{name}.dropout")
        self._normal = np.empty(rays)
        self._uniform = np.empty(rays)

    @property
    def farthest_m(self) -> float:
        """True range beyond which nothing is reported: noise brings nothing nearer by more than 9 sigma."""
        return self._p.max_range_m + 9.0 * self._p.range_noise_m + self._p.range_resolution_m

    def measure(self, echoes: Echoes, seq: int) -> tuple[NDArray[np.bool_], Float64, Float64]:
        """Which echoes of sweep `seq` are reported, and range and intensity of all rays (of use where reported)."""
        p = self._p
        first = seq * self._rays
        hit = np.isfinite(echoes.range_m)
        true_m = np.where(hit, echoes.range_m, 0.0)
        measured = true_m
        if p.range_noise_m > 0.0:
            normal_block(self._noise_key, first, self._normal)
            measured = true_m + p.range_noise_m * self._normal
        measured = np.floor(measured / p.range_resolution_m + 0.5) * p.range_resolution_m
        kept = hit & (measured >= p.min_range_m) & (measured <= p.max_range_m)
        if p.range_at_10_percent_m is not None or p.dropout_probability > 0.0:
            uniform_block(self._loss_key, first, self._uniform)
            kept &= self._uniform >= self._loss(true_m, echoes.strength)
        intensity = echoes.strength
        if p.intensity_falloff_m is not None:
            near = np.maximum(true_m, p.intensity_falloff_m)
            ratio = p.intensity_falloff_m / near
            intensity = intensity * (ratio * ratio)
        return kept, measured, np.minimum(intensity, 1.0)

    def _loss(self, true_m: Float64, strength: Float64) -> Float64 | float:
        """Probability that an echo is not seen."""
        p = self._p
        if p.range_at_10_percent_m is None:
            return p.dropout_probability
        limit = p.range_at_10_percent_m * np.sqrt(strength / _REFERENCE)
        # A black surface has no limit to divide by: lost.
        fraction = true_m / np.maximum(limit, 1e-9)
        lost = np.clip((fraction - _SURE) / (_NEVER - _SURE), 0.0, 1.0)
        return lost + (1.0 - lost) * p.dropout_probability
