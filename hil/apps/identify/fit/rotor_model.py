"""Force and moment of one rotor on the body, for the fit: the quadratic model of docs/physics.md.

Speed O, spin s = +1 counter-clockwise, axis n, velocity u of the hub through the air, u_n = u . n, u_a = u - u_n n:
    thrust        T = (k O^2 - k_z O u_n) n
    rotor drag    H = -k_d O u_a
    torque        -s (m k O^2 + J dO/dt) n - w x (s J O n)
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from hil.apps.identify.fit import parameters as at
from sim.physics.forces.rotors import Rotor


def wrench(rotor: Rotor, p: Any, *, O: Any, dO: Any, air_B: Any, w_B: Any) -> tuple[Any, Any]:  # noqa: E741
    """Return force [N] and moment about the centre of mass [Nm], both in B, as symbols.

    `p`: values in the order of `parameters.vehicle_unknowns`; `air_B`: velocity of the centre of mass through the air.
    """
    n, r = ca.DM(np.array(rotor.axis)), ca.DM(np.array(rotor.position_m)) - p[at.CENTRE : at.CENTRE + 3]
    u = air_B + ca.cross(w_B, r)
    u_n = ca.dot(u, n)
    u_a = u - u_n * n
    thrust = p[at.THRUST] * O * O - p[at.AXIAL_DRAG] * O * u_n
    force = thrust * n - p[at.ROTOR_DRAG] * O * u_a
    s, J = rotor.spin.sign, p[at.ROTOR_INERTIA]
    moment = ca.cross(r, force)
    moment -= s * (p[at.MOMENT_RATIO] * p[at.THRUST] * O * O + J * dO) * n + ca.cross(w_B, s * J * O * n)
    return force, moment
