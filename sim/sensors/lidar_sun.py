"""Noise of sunlight in a LiDAR's receiver: less range over bright ground, false returns when it looks at the sun.

Light of the sun adds shot noise, whose variance grows with the radiance in the beam's view. In parts of the receiver's
own noise, with b the radiance in parts of that of white ground under a vertical sun,

    sigma^2 = sigma_0^2 (1 + k b),     b = rho (n . s)                   for sunlit surfaces of reflectivity rho
                                       b = pi / (6.8e-5 sr) = 46,200     for the disc of the sun

(Richmond and Cain, "Direct-detection LADAR systems", SPIE 2010, ch. 2). The device raises its threshold T sigma with
the noise, up to `greatest_rise`. As light falls with the square of the range, the range limit of sim/sensors/
lidar_echo.py becomes limit (sigma_0 / sigma)^(1/2). Where the noise is greater than the threshold can follow, it
crosses it by itself, at the rate of Rice (Bell System Technical J. 23, 1944)

    rate = exp(-t^2 / 2) / (2 sqrt(3) tau),     t: threshold over noise, tau: width of the pulse

so that the nearest false return of such a beam is within r with the probability 1 - exp(-2 r rate / c). It has the
strength of a surface that is just detected, class 0 and instance 0.

The sun is 0.53 degrees wide; a beam sees it if its middle is within half of that and half its divergence. Haze weakens
it as in pictures (sim/scene/light.py). All surfaces that face the sun count as lit: shadows are not looked for; light
of the sky and of clouds, and stray light in the optics, are left out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_cos, det_exp
from signals.noise import exponential_nodes, noise_key
from signals.rotation import dot
from signals.units import LIGHT_MPS, RAD_PER_DEG
from sim.scene.light import light_in_haze
from sim.scene.scene import Scene
from sim.sensors.lidar_drops import beam_of
from sim.sensors.lidar_echo import Cloud, Echoes
from sim.sensors.lidar_parameters import LidarParameters

Float64 = NDArray[np.float64]
SUN_RADIANCE = 46_200.0  # of white ground's
_SUN_RADIUS_RAD = 0.2665 * RAD_PER_DEG
_TWO_ROOT_3 = 3.4641016151377544
_NODES = 4096


class Seen(NamedTuple):
    """Echoes as the receiver tells them from noise."""

    echoes: Echoes
    dimmed: Float64  # factor of each echo's strength for its detection


def with_true_intensity(cloud: Cloud, dimmed: Float64) -> Cloud:
    """Return the cloud with intensities of the echoes' own strength."""
    intensity = np.minimum(cloud.intensity / dimmed, 1.0).astype(np.float32)
    intensity.flags.writeable = False
    return cloud._replace(intensity=intensity)


class SunNoise:
    """Noise of the sun in one LiDAR."""

    def __init__(
        self,
        parameters: LidarParameters,
        to_sun_W: tuple[float, float, float],
        sun_share: float,
        reflectivity: Float64,
        *,
        seed: int,
        name: str,
    ) -> None:
        """`sun_share`: of the sun's light that haze leaves. `reflectivity`: of each geom, the last one: of a drop."""
        p, beam = parameters, beam_of(parameters)
        assert p.sunlight is not None
        sun = p.sunlight
        self._to_sun_W, self._reflectivity = to_sun_W, np.append(reflectivity, 0.0)  # and of no geom, -1
        self._k = sun.white_ground_noise * sun_share
        self._geom_of_drop, self._least_power = len(reflectivity) - 1, beam.least_power_per_m2
        self._far_m = p.max_range_m
        self._in_sun = det_cos(_SUN_RADIUS_RAD + 0.5 * beam.divergence_rad)
        ratio = math.sqrt(1.0 + self._k * SUN_RADIANCE)
        t = sun.threshold_sigma * min(ratio, sun.greatest_rise) / ratio
        self.per_m = 2.0 / LIGHT_MPS * det_exp(-0.5 * t * t) / (_TWO_ROOT_3 * p.pulse_s)  # in the sun
        self._key = np.array(noise_key(seed, f"{name}.sun"), np.uint64)
        self._minus_log = exponential_nodes(_NODES)

    @classmethod
    def of(
        cls, scene: Scene, parameters: LidarParameters, reflectivity: Float64, *, seed: int, name: str
    ) -> SunNoise | None:
        """Return the noise in a scene; None at night."""
        light = scene.light
        brightest = max(light.sun_rgb)
        if light.sun_elevation_deg <= 0.0 or brightest == 0.0:
            return None
        share = max(light_in_haze(light, scene.extinction_per_m).sun_rgb) / brightest
        return cls(parameters, light.to_sun_W, share, reflectivity, seed=seed, name=name)

    def seen(self, echoes: Echoes, normal: Float64, direction: Float64, place: NDArray[np.int32], seq: int) -> Seen:
        """Return what is seen of the echoes of sweep `seq`. Ray i is element `place[i]` of all arrays."""
        facing = dot(normal.T, self._to_sun_W)
        facing = np.where(dot(normal.T, direction.T) > 0.0, -facing, facing)
        # Normals of rays without an echo are undefined.
        radiance = np.where(np.isfinite(echoes.range_m), self._reflectivity[echoes.geom] * np.maximum(facing, 0.0), 0.0)
        towards = dot(direction.T, self._to_sun_W)
        length = np.sqrt(dot(direction.T, direction.T))
        blinded = ~np.isfinite(echoes.range_m) & (towards >= self._in_sun * length)
        dimmed = 1.0 / np.sqrt(1.0 + self._k * radiance)
        seen = Echoes(echoes.range_m, echoes.strength * dimmed, echoes.geom)
        if blinded.any():
            ray = np.flatnonzero(blinded[place])
            u = np.random.Philox(key=self._key, counter=[0, 0, 0, seq]).random_raw(len(place))[ray] >> np.uint64(52)
            range_m = self._minus_log[u.astype(np.int64)] / self.per_m
            at, near = place[ray], range_m <= self._far_m
            at, range_m = at[near], range_m[near]
            seen = Echoes(echoes.range_m.copy(), seen.strength, echoes.geom.copy())
            seen.range_m[at], seen.geom[at] = range_m, self._geom_of_drop
            # Above the range of the receiver's lottery for weak echoes: this crossing has been drawn already.
            seen.strength[at] = np.maximum(2.0 * self._least_power * range_m * range_m, 1e-6)
        return Seen(seen, dimmed)
