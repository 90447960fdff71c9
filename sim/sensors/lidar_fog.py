"""False returns of a LiDAR from fog: light that droplets scatter back.

The power from fog (soft target) and from a surface of reflectivity rho at R_0 (hard target) is, for a pulse
P_0 sin^2(pi t / (2 tau)), 0 <= t <= 2 tau, of the half-power width tau (Rasshofer, Spies and Spies, Adv. Radio Sci. 9,
2011; Hahner et al., "Fog simulation on real LiDAR point clouds", ICCV 2021)

    P_fog(R)  = C beta integral of sin^2(pi t / (2 tau)) exp(-2 alpha x) xi(x) / x^2 dt,   x = R - c t / 2
    P_hard    = C (2 / c) rho / pi exp(-2 alpha R_0) / R_0^2
    beta      = 0.046 / MOR,   MOR = ln 20 / alpha                         (backscatter of fog, 1 / (m sr))

with the overlap xi of transmitter and receiver, 0 up to 0.9 m and 1 from 1 m on, linear between. A range is reported
c tau / 2 earlier, so that the surface is at R_0. The peak of P_fog is the echo of fog, as strong as a surface at its
range R_p of

    e_p = pi beta R_p^2 (c / 2) (the integral)

Droplets are not spread evenly, and their light interferes: the echo of a ray is g e_p with g exponential of mean 1, as
of many scatterers with random phases (Goodman, "Statistical optics", 1985). Where a ray's fog is densest varies, too:
its echo is at R_p / 2 to 2 R_p, half of them nearer than R_p (variant 2 of the noise in the code that Hahner et al.
published). It is detected if g e_p >= `least_drop_echo` (sim/sensors/lidar_drops.py), so in the share

    exp(-least_drop_echo / e_p)

of the rays that meet nothing nearer. A device of first echoes reports it then; one of strongest echoes, if it is
brighter than the surface's; one of last echoes, where no surface is detected. A false return has class 0, instance 0.

`alpha` is the extinction of haze and fog alone; rain and snow weaken the echo, too, which is left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_exp, det_sin
from signals.noise import exponential_nodes, noise_key, uniform_from_bits
from signals.units import LIGHT_MPS
from sim.sensors.lidar_drops import beam_of
from sim.sensors.lidar_echo import Echoes
from sim.sensors.lidar_parameters import LidarParameters

_HALF_LIGHT_MPS = 0.5 * LIGHT_MPS
_PI = 3.141592653589793
_LN_20 = 2.995732273553991
_BACKSCATTER = 0.046  # of the meteorological optical range
_OVERLAP_M = (0.9, 1.0)
_STEP_M, _FARTHEST_M = 0.02, 6.0  # of the search for the peak
_PARTS = 200  # of a pulse, in the integral (trapezoid rule)
_NEGLIGIBLE = 1e-9  # share of rays below which fog is left out
_NODES = 4096  # of the table of -ln


class FogEcho(NamedTuple):
    """The peak of the light that fog returns."""

    range_m: float
    strength: float  # of a surface there that would return as much


def overlap(range_m: float) -> float:
    """Return the share of the beam that the receiver sees."""
    near, far = _OVERLAP_M
    return min(max((range_m - near) / (far - near), 0.0), 1.0)


def soft_power(range_m: float, extinction_per_m: float, pulse_s: float) -> float:
    """Return (c / 2) times the integral of P_fog [1/m] at a reported range."""
    length_m = 2.0 * pulse_s * _HALF_LIGHT_MPS
    far_m = range_m + 0.5 * length_m
    total = 0.0
    for k in range(1, _PARTS):  # the pulse is 0 at both ends
        x = far_m - length_m * k / _PARTS
        if x > _OVERLAP_M[0]:
            sine = det_sin(_PI * k / _PARTS)
            total += sine * sine * det_exp(-2.0 * extinction_per_m * x) * overlap(x) / (x * x)
    return total * length_m / _PARTS


def fog_echo(extinction_per_m: float, pulse_s: float) -> FogEcho:
    """Return the peak of the light of fog that no surface ends."""
    beta = _BACKSCATTER * extinction_per_m / _LN_20
    steps = range(1, int(_FARTHEST_M / _STEP_M))
    power, k = max((soft_power(k * _STEP_M, extinction_per_m, pulse_s), -k) for k in steps)
    range_m = -k * _STEP_M
    return FogEcho(range_m, _PI * beta * range_m * range_m * power)


class FogReturns:
    """Fog in the beams of one LiDAR."""

    def __init__(self, echo: FogEcho, parameters: LidarParameters, *, seed: int, name: str, geom_of_drop: int) -> None:
        """`geom_of_drop`: geom of a false return in the echoes."""
        p, beam = parameters, beam_of(parameters)
        self.echo, self._which, self._geom = echo, p.echo, geom_of_drop
        self.share = det_exp(-p.least_drop_echo / echo.strength)  # of rays with a detected echo
        self._least_power = beam.least_power_per_m2
        self._key = np.array(noise_key(seed, f"{name}.fog"), np.uint64)
        self._minus_log = exponential_nodes(_NODES)

    def added(self, echoes: Echoes, place: NDArray[np.int32], seq: int) -> Echoes:
        """Return the echoes with fog. Ray i of sweep `seq` is element `place[i]` and uses draws 2 i and 2 i + 1."""
        n = len(place)
        bits = np.random.Philox(key=self._key, counter=[0, 0, 0, seq]).random_raw(2 * n)
        u = uniform_from_bits(bits)
        ray = np.flatnonzero(u[0::2] < self.share)  # g = -ln u
        at, where = place[ray], 2.0 * u[1::2][ray]
        range_m = self.echo.range_m * np.where(where < 1.0, 1.0 / (2.0 - where), where)
        light = self.echo.strength * self._minus_log[(u[0::2][ray] * _NODES).astype(np.int64)]
        met_m = echoes.range_m[at]
        seen = range_m < met_m
        power = echoes.strength[at] / (met_m * met_m)  # 0 without a surface
        if self._which == "last":
            seen &= power < self._least_power
        elif self._which == "strongest":
            seen &= power < light / (range_m * range_m)
        at = at[seen]
        foggy = Echoes(echoes.range_m.copy(), echoes.strength.copy(), echoes.geom.copy())
        foggy.range_m[at], foggy.strength[at], foggy.geom[at] = range_m[seen], light[seen], self._geom
        return foggy


def fog_returns(
    extinction_per_m: float, parameters: LidarParameters, *, seed: int, name: str, geom_of_drop: int
) -> FogReturns | None:
    """Return the false returns of fog; None where they are too weak to be reported."""
    if extinction_per_m <= 0.0:
        return None
    echo = fog_echo(extinction_per_m, parameters.pulse_s)
    if det_exp(-parameters.least_drop_echo / echo.strength) < _NEGLIGIBLE:
        return None
    return FogReturns(echo, parameters, seed=seed, name=name, geom_of_drop=geom_of_drop)
