"""Reflection of surfaces for waves that arrive and leave in different directions, and of surfaces as mirrors.

The bistatic form of sigma0 in reflection.hpp: with c_i and c_s the cosines to the normal of the ways to the source and
to the receiver, h their unit bisector, beta the angle between h and the normal, c_l the cosine between h and either
way, and phi = 4 pi h_rms / lambda,

    sigma0 = rho^2 |Gamma(c_l)|^2 exp(-tan^2 beta / (2 s^2)) / (2 s^2 cos^4 beta)
             + 4 (1 - rho^2) |Gamma(c_i)| |Gamma(c_s)| c_i c_s
    rho^2  = exp(-(phi (c_i + c_s) / 2)^2)

(Kirchhoff's lobe in geometric optics: Ulaby, Moore and Fung, Microwave Remote Sensing II, 1982, sec. 12-4; Lambert).
For c_i = c_s it is the sigma0 of one way. A flat surface as a mirror reflects the power

    g^2 = |Gamma(c)|^2 exp(-(phi c)^2)

(Ament, Proc. IRE 41, 1953, p. 142). The bent tail of the lobe at grazing ways, beyond cos beta = 0.1, is left out.

Tables are linear: exp to 1e-5 of its value, |Gamma|^2 over the root of the cosine to 0.01 dB. All steps are + - * / and
sqrt of single elements, so that all machines get the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_exp
from sim._kernels import radar_fresnel_power
from sim.radar.reflection import Reflection, at_carrier
from sim.scene.scene_map import Surface

Float64 = NDArray[np.float64]
Ids = NDArray[np.int64]

_GAMMA_STEPS = 1024
_EXP_STEPS = 128  # in a unit of the exponent
_EXP_REACH = 60
_LEAST_COS_BETA = 0.1


class BistaticReflection:
    """Tables of a world's surfaces at a carrier."""

    def __init__(self, surfaces: Sequence[Surface], carrier_hz: float, reflection: Reflection) -> None:
        self._slope2 = 2.0 * reflection.facet_slope * reflection.facet_slope
        self._gamma2 = np.zeros((len(surfaces), _GAMMA_STEPS + 2))
        self._phase_height = np.zeros(len(surfaces))
        roots = [i / _GAMMA_STEPS for i in range(_GAMMA_STEPS + 1)]
        cosines = [root * root for root in roots]
        for k, surface in enumerate(surfaces):
            if k == 0:
                continue  # no surface
            eps_r, eps_i, self._phase_height[k] = at_carrier(surface, carrier_hz)
            row = [radar_fresnel_power(eps_r, eps_i, c) for c in cosines]
            self._gamma2[k] = [*row, row[-1]]
        nodes = [det_exp(-i / _EXP_STEPS) for i in range(_EXP_STEPS * _EXP_REACH + 1)]
        self._exp = np.array([*nodes, 0.0, 0.0])

    def mirror_power(self, surface: Ids, cosine: Float64) -> Float64:
        """Return g^2, (n,)."""
        phase = self._phase_height[surface] * cosine
        return self._reflectance(surface, cosine) * self._decay(phase * phase)

    def sigma0(self, surface: Ids, cos_in: Float64, cos_out: Float64, cos_beta: Float64, cos_local: Float64) -> Float64:
        """Return sigma0, (n,); all cosines above 0."""
        phase = 0.5 * self._phase_height[surface] * (cos_in + cos_out)
        coherent = self._decay(phase * phase)
        b2 = np.square(np.maximum(cos_beta, _LEAST_COS_BETA))
        lobe = self._decay((1.0 - b2) / (b2 * self._slope2)) / (self._slope2 * b2 * b2)
        both = self._reflectance(surface, cos_in) * self._reflectance(surface, cos_out)
        rough = 4.0 * (1.0 - coherent) * np.sqrt(both) * cos_in * cos_out
        return np.asarray(coherent * self._reflectance(surface, cos_local) * lobe + rough)

    def _reflectance(self, surface: Ids, cosine: Float64) -> Float64:
        """Return |Gamma|^2."""
        place = np.sqrt(np.clip(cosine, 0.0, 1.0)) * _GAMMA_STEPS
        node = place.astype(np.int64)
        low = self._gamma2[surface, node]
        return np.asarray(low + (place - node) * (self._gamma2[surface, node + 1] - low))

    def _decay(self, x: Float64) -> Float64:
        """Return exp(-x), x >= 0."""
        place = np.minimum(x, float(_EXP_REACH)) * _EXP_STEPS
        node = place.astype(np.int64)
        low = self._exp[node]
        return np.asarray(low + (place - node) * (self._exp[node + 1] - low))
