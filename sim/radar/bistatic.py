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
sqrt of single elements (sim/native/radar/mirror_search.cpp), so that all machines get the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_exp
from sim._kernels import MIRROR_DECAY_REACH, MIRROR_DECAY_STEPS, MIRROR_GAMMA_STEPS, MirrorTable, radar_fresnel_power
from sim.radar.reflection import Reflection, at_carrier
from sim.scene.scene_map import Surface

Float64 = NDArray[np.float64]
Ids = NDArray[np.int64]


class BistaticReflection:
    """Tables of a world's surfaces at a carrier."""

    def __init__(self, surfaces: Sequence[Surface], carrier_hz: float, reflection: Reflection) -> None:
        gamma2 = np.zeros((len(surfaces), MIRROR_GAMMA_STEPS + 2))
        phase_height = np.zeros(len(surfaces))
        roots = [i / MIRROR_GAMMA_STEPS for i in range(MIRROR_GAMMA_STEPS + 1)]
        cosines = [root * root for root in roots]
        for k, surface in enumerate(surfaces):
            if k == 0:
                continue  # no surface
            eps_r, eps_i, phase_height[k] = at_carrier(surface, carrier_hz)
            row = [radar_fresnel_power(eps_r, eps_i, c) for c in cosines]
            gamma2[k] = [*row, row[-1]]
        nodes = [det_exp(-i / MIRROR_DECAY_STEPS) for i in range(MIRROR_DECAY_STEPS * MIRROR_DECAY_REACH + 1)]
        slope2 = 2.0 * reflection.facet_slope * reflection.facet_slope
        self.table = MirrorTable(gamma2, phase_height, np.array([*nodes, 0.0, 0.0]), slope2)

    def mirror_power(self, surface: Ids, cosine: Float64) -> Float64:
        """Return g^2, (n,)."""
        out = np.empty(len(surface))
        self.table.mirror_powers(surface, np.ascontiguousarray(cosine), out)
        return out

    def sigma0(self, surface: Ids, cos_in: Float64, cos_out: Float64, cos_beta: Float64, cos_local: Float64) -> Float64:
        """Return sigma0, (n,); all cosines above 0."""
        out = np.empty(len(surface))
        self.table.sigma0(surface, np.stack([cos_in, cos_out, cos_beta, cos_local]), out)
        return out
