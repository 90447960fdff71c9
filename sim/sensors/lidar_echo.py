"""Receiver of a LiDAR: echoes, losses and noise.

Light. A surface of reflectivity rho, hit at incidence theta, returns rho cos(theta) (Lambertian). A beam with
divergence is five rays: the middle and four at half the radius, each with a fifth of the light. Returns within
`echo_separation_m` of each other are one echo at their mean range, weighted by light; of several echoes the device
reports one. Haze, rain and snow of extinction beta attenuate each ray by exp(-2 beta r) (sim/scene/weather.py); drops
and flakes (sim/sensors/lidar_drops.py) and fog (lidar_fog.py) give false returns.

Loss. An echo of strength e = rho cos(theta) is detected up to

    limit = range_at_10_percent_m * sqrt(e / 0.1)                       (light falls with the square of the range)

The probability of detection is 1 up to 0.9 limit, 0 beyond 1.1 limit, and falls linearly in between. In addition, each
echo is lost with `dropout_probability`.

Measurement. range = round(true + n), limited to [min_range_m, max_range_m]; `range_noise_m` includes the rounding
(sim/sensors/rounding.py).

The noise of ray i of sweep `seq` is number seq * rays + i of the streams `<name>.range` and `<name>.dropout`.

The arithmetic of loss and measurement is sim/native/frame/lidar_receiver.isa.cpp.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from signals.noise import noise_key
from sim._kernels import LidarReceiver
from sim.sensors.lidar_parameters import LidarParameters
from sim.sensors.lidar_pattern import Sweep
from sim.sensors.rounding import drawn_sigma

Float64 = NDArray[np.float64]
Scalar = TypeVar("Scalar", bound=np.generic)

REFERENCE, SEEN_TO = 0.1, 1.1  # reflectivity for which a range is given; range / limit beyond which nothing is seen
_NO_LIGHT = 1e-12  # weight of a black surface in a mean


@dataclass(frozen=True)
class Echoes:
    """One echo per ray. `range_m` is +inf for a ray without an echo."""

    range_m: Float64  # (n,)
    strength: Float64  # (n,) rho cos(theta), as a share of the beam's light
    geom: NDArray[np.int32]  # (n,) the surface that returned most of the light


class Cloud(NamedTuple):
    """Arrays of a sample in the order of its fields, one element per point."""

    points_L: NDArray[np.float32]
    range_m: NDArray[np.float32]
    intensity: NDArray[np.float32]
    ring: NDArray[np.uint16]
    time_offset_ns: NDArray[np.int32]
    segmentation: NDArray[np.uint8]


def single_echoes(range_m: Float64, strength: Float64, geom: NDArray[np.int32]) -> Echoes:
    """Return the echoes of beams of one ray each."""
    return Echoes(range_m, strength, geom)


def choose_echoes(
    range_m: Float64, strength: Float64, geom: NDArray[np.int32], *, which: str, separation_m: float
) -> Echoes:
    """Return the reported echo of each of n beams of m rays (arrays: (m, n)).

    `which`: "first", "last" or "strongest".
    """
    m, n = range_m.shape
    order = np.argsort(range_m, axis=0, kind="stable")
    r = np.take_along_axis(range_m, order, axis=0)
    e = np.take_along_axis(strength, order, axis=0) / m
    g = np.take_along_axis(geom, order, axis=0)
    none = np.full(n, np.inf)
    best = Echoes(none.copy(), np.zeros(n), np.full(n, -1, np.int32))
    found = np.zeros(n, dtype=bool)
    # State of each beam's current echo: its last range, sums over its rays, and its brightest ray.
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
        starts = ~joins
        weight[starts] = moment[starts] = light[starts] = 0.0
        brightest[starts] = -1.0
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
        p = self._p = parameters
        self._rays = rays
        self._native = LidarReceiver(
            noise_key=noise_key(seed, f"{name}.range"),
            loss_key=noise_key(seed, f"{name}.dropout"),
            noise_m=drawn_sigma(p.range_noise_m, p.range_resolution_m),
            resolution_m=p.range_resolution_m,
            min_range_m=p.min_range_m,
            max_range_m=p.max_range_m,
            range_at_10_percent_m=p.range_at_10_percent_m,
            dropout=p.dropout_probability,
            intensity_falloff_m=p.intensity_falloff_m,
        )
        # Buffers for a sweep in which every ray has an echo.
        self._points_L = np.empty((rays, 3), np.float32)
        self._range_m, self._intensity = np.empty(rays, np.float32), np.empty(rays, np.float32)
        self._ring, self._time_offset_ns = np.empty(rays, np.uint16), np.empty(rays, np.int32)
        self._segmentation = np.empty(rays, np.uint8)
        self._ray, self._count = np.empty(rays, np.int32), 0

    @property
    def farthest_m(self) -> float:
        """True range beyond which no echo is reported, since noise shortens a range by at most 9 sigma."""
        return self._p.max_range_m + 9.0 * self._p.range_noise_m + self._p.range_resolution_m

    def measure(
        self,
        echoes: Echoes,
        seq: int,
        *,
        sweep: Sweep,
        place: NDArray[np.int32],
        offset_ns: NDArray[np.int32],
        geom_class: NDArray[np.uint8],
    ) -> Cloud:
        """Return the points of sweep `seq`. For each ray, `place` is its index in `echoes`, `offset_ns` its time."""
        count = self._native.receive(
            seq * self._rays,
            place,
            echoes.range_m,
            echoes.strength,
            echoes.geom,
            sweep.directions_L,
            sweep.origin_z_m,
            sweep.ring,
            offset_ns,
            geom_class,
            self._points_L,
            self._range_m,
            self._intensity,
            self._ring,
            self._time_offset_ns,
            self._segmentation,
            ray=self._ray,
        )
        self._count = count
        return Cloud(
            own(self._points_L[:count]),
            own(self._range_m[:count]),
            own(self._intensity[:count]),
            own(self._ring[:count]),
            own(self._time_offset_ns[:count]),
            own(self._segmentation[:count]),
        )

    @property
    def reported(self) -> NDArray[np.int32]:
        """The number of the ray, in firing order, of each point that `measure` has returned last; read-only."""
        return own(self._ray[: self._count])


def own(values: NDArray[Scalar]) -> NDArray[Scalar]:
    """Return a read-only copy."""
    values = values.copy()
    values.flags.writeable = False
    return values
