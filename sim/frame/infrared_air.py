"""Transmission of the air for thermal cameras, 8 to 14 um.

Gases, by the formula of thermal cameras (FLIR; Minkina and Dudzik, "Infrared thermography", 2009, ch. 3), d in m, t
in degrees Celsius and w in g/m3 of water:

    tau = X exp(-sqrt(d) (a1 + b1 sqrt(w))) + (1 - X) exp(-sqrt(d) (a2 + b2 sqrt(w)))
    w   = humidity exp(1.5587 + 0.06939 t - 2.7816e-4 t^2 + 6.8455e-7 t^3)

Haze of visibility V [km], by Kruse's formula (Kruse, McGlauchlin and McQuistan, "Elements of infrared technology",
1962) for 10 um: the extinction of visible light times (10 / 0.55)^-q, q = 0.585 V^(1/3) up to 6 km, 1.3 up to 50 km,
then 1.6. In thick fog it tends to that of visible light. Rain and snow: drops far larger than the wavelength, as in
visible light.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_exp, det_log, det_pow
from sim.scene.atmosphere import ZERO_DEGC_K
from sim.scene.heat import HUMIDITY
from sim.scene.scene import Scene
from sim.scene.weather import CONTRAST_EXPONENT

Float64 = NDArray[np.float64]
_X, _A1, _A2, _B1, _B2 = 1.9, 0.006569, 0.01262, -0.002276, -0.00667
_FARTHEST_M, _NODES = 20_000.0, 2048


def gas_transmission(distance_m: float, air_k: float) -> float:
    """Return tau of clear air."""
    t = air_k - ZERO_DEGC_K
    w = HUMIDITY * det_exp(1.5587 + 0.06939 * t - 2.7816e-4 * t * t + 6.8455e-7 * t * t * t)
    root, moist = sqrt(distance_m), sqrt(w)
    first = _X * det_exp(-root * (_A1 + _B1 * moist))
    return min(max(first + (1.0 - _X) * det_exp(-root * (_A2 + _B2 * moist)), 0.0), 1.0)


def haze_per_m(visible_per_m: float) -> float:
    """Return the extinction of haze at 10 um from that of visible light."""
    if visible_per_m <= 0.0:
        return 0.0
    visibility_km = 1e-3 * CONTRAST_EXPONENT / visible_per_m
    q = 1.6 if visibility_km > 50.0 else 1.3
    if visibility_km < 6.0:
        q = 0.585 * det_pow(visibility_km, 1.0 / 3.0)
    return visible_per_m * det_exp(-q * det_log(10.0 / 0.55))


class AirTransmission:
    """Transmission by range in one scene: a table over the square root of the range."""

    def __init__(self, scene: Scene, air_k: float) -> None:
        falling = scene.weather.precipitation
        per_m = haze_per_m(scene.haze_per_m) + (0.0 if falling is None else falling.extinction_per_m)
        self._per_root_m = (_NODES - 1) / sqrt(_FARTHEST_M)
        table = []
        for k in range(_NODES):
            distance_m = (k / self._per_root_m) * (k / self._per_root_m)
            table.append(gas_transmission(distance_m, air_k) * det_exp(-per_m * distance_m))
        self._table = np.array(table)

    def of(self, range_m: Float64) -> Float64:
        """Return tau at finite ranges, elementwise; beyond 20 km that there."""
        place = np.minimum(np.sqrt(range_m) * self._per_root_m, _NODES - 1.0)
        node = np.minimum(place.astype(np.int64), _NODES - 2)
        low = self._table[node]
        return low + (place - node) * (self._table[node + 1] - low)
