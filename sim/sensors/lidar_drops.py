"""False returns of a LiDAR from rain and snow.

A beam of aperture a and divergence theta is w = a + theta r wide at range r. A drop of width D in it returns

    e = rho min(D / w, 1)^2 exp(-2 beta r)                                    (share of the beam's light)

with rho of sim/scene/precipitation.py, and is detected if e >= e_min = max(0.1 (r / L)^2, e_0): like any surface up to
L = 1.1 range_at_10_percent_m (sim/sensors/lidar_echo.py), but near the device not below `least_drop_echo`, because no
receiver is as sensitive there as that law would make it. So the drops that count at r are those wider than

    D_min(r) = w sqrt(e_min exp(2 beta r) / rho)

and, drops lying in the air at random (Poisson), the nearest of them is within r with probability

    F(r) = 1 - exp(-integral of n(D_min) pi/4 w^2 dr),     n(D): drops per m3 of at least the width D.

One draw per ray gives the range from a table of F, one more the drop's width from the distribution above D_min. A drop
nearer than the surface is reported by a device that reports first echoes; one of strongest echoes, if e / r^2 is
greater than the surface's; one of last echoes, where no surface is detected. This is the method of Kilic et al. (LISA,
2021) with the nearest drop drawn in closed form. A false return has class 0 and instance 0.

Left out: a second drop behind the nearest (for strongest echoes of cloudbursts), and that neighbouring beams meet the
same drop within about 5 m.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_exp
from signals.noise import noise_key
from sim._kernels import LidarDrops
from sim.scene.precipitation import Precipitation
from sim.sensors.lidar_echo import REFERENCE, SEEN_TO, Echoes
from sim.sensors.lidar_parameters import LidarParameters

_STEP_M = 0.01  # of the table of F; the sum is a trapezoid rule
_NEGLIGIBLE = 1e-9  # drops per metre of a beam, below which the table ends
_USUAL_DIVERGENCE_RAD = 0.003  # of a device whose `beam_divergence_rad` is 0: one ray per point


class Beam(NamedTuple):
    """Width and sensitivity of a beam."""

    aperture_m: float
    divergence_rad: float
    least_power_per_m2: float  # strength / range^2 of the weakest detected echo
    least_strength: float  # of a drop

    def width_m(self, range_m: float) -> float:
        return self.aperture_m + self.divergence_rad * range_m


def beam_of(parameters: LidarParameters) -> Beam:
    """Return the beam. A device without `range_at_10_percent_m` detects 10 % up to its greatest range."""
    p = parameters
    limit_m = p.max_range_m if p.range_at_10_percent_m is None else SEEN_TO * p.range_at_10_percent_m
    return Beam(p.aperture_m, p.beam_divergence_rad or _USUAL_DIVERGENCE_RAD, REFERENCE / limit_m**2, p.least_drop_echo)


def drops_per_m(falling: Precipitation, beam: Beam, extinction_per_m: float, range_m: float) -> float:
    """Return how many detectable drops a metre of the beam holds at a range."""
    width_m = beam.width_m(range_m)
    least_strength = max(beam.least_power_per_m2 * range_m**2, beam.least_strength)
    seen_strength = falling.reflectivity * det_exp(-2.0 * extinction_per_m * range_m)  # of a drop as wide as the beam
    least_mm = 1e3 * width_m * math.sqrt(least_strength / seen_strength)
    if least_strength > seen_strength:
        return 0.0
    return falling.per_m3(least_mm) * 0.25 * math.pi * width_m**2


def nearest_drop(
    falling: Precipitation, beam: Beam, extinction_per_m: float, within_m: tuple[float, float]
) -> NDArray[np.float64]:
    """Return F at the least range and every `_STEP_M` after it, up to the greatest or where no drop is detectable."""
    from_m, to_m = within_m
    before = drops_per_m(falling, beam, extinction_per_m, from_m)
    total, table = 0.0, [0.0]
    for k in range(1, max(2, math.ceil((to_m - from_m) / _STEP_M))):
        here = drops_per_m(falling, beam, extinction_per_m, from_m + k * _STEP_M)
        total += 0.5 * _STEP_M * (before + here)
        table.append(1.0 - det_exp(-total))
        if here < _NEGLIGIBLE:
            break
        before = here
    return np.array(table)


class FalseReturns:
    """Drops in the beams of one LiDAR."""

    def __init__(
        self,
        falling: Precipitation,
        parameters: LidarParameters,
        *,
        extinction_per_m: float,
        seed: int,
        name: str,
        geom_of_drop: int,
    ) -> None:
        """`extinction_per_m`: of the whole air. `geom_of_drop`: geom of a false return in the echoes."""
        p, beam = parameters, beam_of(parameters)
        self._geom_of_drop = geom_of_drop
        self.nearest = nearest_drop(falling, beam, extinction_per_m, (p.min_range_m, p.max_range_m))
        self._native = LidarDrops(
            key=noise_key(seed, f"{name}.drops"),
            echo=p.echo,
            aperture_m=beam.aperture_m,
            divergence_rad=beam.divergence_rad,
            two_way_per_m=2.0 * extinction_per_m,
            least_power=beam.least_power_per_m2,
            least_strength=beam.least_strength,
            reflectivity=falling.reflectivity,
            water_scale=falling.water_scale,
            water_power=falling.water_power,
            slope_per_mm=falling.slope_per_mm,
            largest_mm=falling.largest_mm,
            from_m=p.min_range_m,
            step_m=_STEP_M,
        )

    def added(self, echoes: Echoes, place: NDArray[np.int32], first: int) -> Echoes:
        """Return the echoes with drops. Ray i of the sweep is element `place[i]` and uses draw `first` + i."""
        fallen = Echoes(echoes.range_m.copy(), echoes.strength.copy(), echoes.geom.copy())
        self._native.add(self.nearest, first, place, self._geom_of_drop, fallen.range_m, fallen.strength, fallen.geom)
        return fallen
