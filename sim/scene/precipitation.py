"""Rain and snow: how many drops or flakes the air holds, and how much light they take.

Rates are millimetres of water per hour. Drops have an exponential distribution of sizes,

    N(m) = n0 exp(-s m)    per m3 of air and mm of m,   0 <= m <= m_max

with m the diameter of a raindrop (Marshall and Palmer, J. Meteorology 5, 1948) or of the drop that a flake melts into
(Gunn and Marshall, J. Meteorology 15, 1958). A flake of density 0.178 D^-0.922 g/cm3, D in mm (Brandes et al., J. Appl.
Meteorology and Climatology 46, 2007), has the diameter D = (m^3 / 0.178)^(1 / 2.078).

Extinction of light is the measured one of Recommendation ITU-R P.1814: 1.076 R^0.67 dB/km in rain, and in dry snow
(5.42e-5 wavelength_nm + 5.496) R^1.38 dB/km, here at 550 nm; at the 905 nm of a LiDAR it is 0.4 % more.

Reflectivity is that of a Lambertian disc as wide as the drop that returns as much light. A raindrop returns light at
its front and, focused, at its back: with n = 1.33, r = ((n - 1) / (n + 1))^2 and geometric optics, the cross section is
pi a^2 r (1 + (1 - r)^2 (n / (2 - n))^2); a disc has 4 pi a^2 times its reflectivity. A flake is ice of reflectivity 0.9
(Hahner et al., CVPR 2022) that fills 0.4 of its circle (an aggregate: Heymsfield and Miloshevich, J. Atmospheric
Sciences 60, 2003); a sphere returns 2/3 of what a disc does.

Drops fall at 9.65 - 10.3 exp(-0.6 D) m/s (Atlas et al., Reviews of Geophysics 11, 1973), flakes at 0.8 D^0.16
(Locatelli and Hobbs, J. Geophysical Research 79, 1974), D in mm.
"""

from __future__ import annotations

from dataclasses import dataclass

from signals._kernel import det_exp, det_pow

_PER_M_OF_DB_PER_KM = 2.302585092994046e-4  # ln 10 / 10 / 1000

_INDEX = 1.33
_FACE = ((_INDEX - 1.0) / (_INDEX + 1.0)) ** 2
_RAIN_REFLECTIVITY = _FACE * (1.0 + (1.0 - _FACE) ** 2 * (_INDEX / (2.0 - _INDEX)) ** 2) / 4.0
_SNOW_REFLECTIVITY = 0.9 * 0.4 * 2.0 / 3.0
_SLOWEST_MPS = 0.1  # of drizzle, where the formula of Atlas et al. ends


@dataclass(frozen=True)
class Precipitation:
    """Drops or flakes in the air."""

    extinction_per_m: float  # of light
    n0_per_m3_mm: float
    slope_per_mm: float
    largest_mm: float  # water; a greater drop breaks up
    # m = scale D^power: mm of water from mm of width
    water_scale: float
    water_power: float
    reflectivity: float
    flakes: bool = False

    def fall_mps(self, width_mm: float) -> float:
        """Return the speed at which a drop or flake of this width falls through the air."""
        if self.flakes:
            return 0.8 * det_pow(width_mm, 0.16)
        return max(9.65 - 10.3 * det_exp(-0.6 * width_mm), _SLOWEST_MPS)

    def width_mm(self, water_mm: float) -> float:
        """Return the width of a drop or flake that holds a drop of water of this diameter."""
        return det_pow(water_mm / self.water_scale, 1.0 / self.water_power)

    def water_mm(self, width_mm: float) -> float:
        """Return the diameter of the water of a drop or flake of this width."""
        return self.water_scale * det_pow(width_mm, self.water_power) if width_mm > 0.0 else 0.0

    def per_m3(self, width_mm: float) -> float:
        """Return how many drops or flakes of at least this width a cubic metre holds."""
        least_mm = self.water_mm(width_mm)
        if least_mm >= self.largest_mm:
            return 0.0
        rest = det_exp(-self.slope_per_mm * least_mm) - det_exp(-self.slope_per_mm * self.largest_mm)
        return self.n0_per_m3_mm / self.slope_per_mm * rest


def rain(rate_mm_per_h: float) -> Precipitation:
    """Return rain of a rate above 0."""
    return Precipitation(
        extinction_per_m=1.076 * det_pow(rate_mm_per_h, 0.67) * _PER_M_OF_DB_PER_KM,
        n0_per_m3_mm=8000.0,
        slope_per_mm=4.1 * det_pow(rate_mm_per_h, -0.21),
        largest_mm=6.0,
        water_scale=1.0,
        water_power=1.0,
        reflectivity=_RAIN_REFLECTIVITY,
    )


def snow(rate_mm_per_h: float) -> Precipitation:
    """Return dry snow of a rate above 0, as water."""
    return Precipitation(
        extinction_per_m=(5.42e-5 * 550.0 + 5.4958776) * det_pow(rate_mm_per_h, 1.38) * _PER_M_OF_DB_PER_KM,
        n0_per_m3_mm=3800.0 * det_pow(rate_mm_per_h, -0.87),
        slope_per_mm=2.55 * det_pow(rate_mm_per_h, -0.48),
        largest_mm=4.0,
        water_scale=det_pow(0.178, 1.0 / 3.0),
        water_power=2.078 / 3.0,
        reflectivity=_SNOW_REFLECTIVITY,
        flakes=True,
    )
