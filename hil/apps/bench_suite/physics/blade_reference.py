"""The blade-element momentum model of a rotor for multirotor_reference.py, in another form than the kernel's.

Everything is dimensional and by rotor, with vectors: thrust of the blades, shaft power as work and losses, closure in
x = u_n / v and y = V / v. The induced velocity is a state: from G(v, ...) = T_blades - T_momentum = 0 follows
dv/dt = -(dG/dx dx/dt + dG/dt) / (dG/dv), with CasADi's derivatives. Each tick starts from
a root of G by Brent's method.
The kernel and rotor_equations.py solve G = 0 by Newton's method at every instant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from sim.physics.forces.blade_element import inflow_thrust_kg_per_rad
from sim.physics.forces.rotors import RotorConstants
from sim.physics.vehicle import Vehicle
from sim.scene.atmosphere import EXPONENT, LAPSE_K_PER_M, SEA_LEVEL_K
from sim.scene.scene import Site

Float64 = NDArray[np.float64]
_SEA_LEVEL_KGPM3 = 1.225
_EARTH_RADIUS_M = 6_356_766.0


def relative_density(z: Any, site: Site) -> Any:
    """Return the density below 11 km over 1.225 kg/m3, as an expression of the height over the site."""
    altitude = site.altitude_m + z
    level = LAPSE_K_PER_M / SEA_LEVEL_K * _EARTH_RADIUS_M * altitude / (_EARTH_RADIUS_M + altitude)
    return (1 - level) ** EXPONENT / (1 - level + site.warmer_k / SEA_LEVEL_K)


@dataclass
class Hub:
    """The flow at a rotor: expressions in B."""

    velocity: ca.SX
    height: ca.SX  # over the ground [m]
    up: ca.SX  # cosine of the rotor's tilt


class BladeRotor:
    """Equations of rotor `index` of a vehicle; `left` is the share of its blades' forces that a fault leaves."""

    def __init__(self, vehicle: Vehicle, index: int, left: Any, *, ground: bool, axis: ca.SX | None = None) -> None:
        c, rotor = vehicle.constants_of_rotors[index], vehicle.rotors[index]
        assert c.blade_element is not None
        self._c, self._b = c, c.blade_element
        self.axis = ca.DM(rotor.axis) if axis is None else axis  # of a rotor that tilts, an expression
        self.spin = rotor.spin.sign
        self.above = rotor.coaxial_below
        self._ground = ground
        self._momentum = 2 * self._b.air_density_kgpm3 * np.pi * c.radius_m**2
        self._k = left * c.thrust_coefficient_n_per_radps2
        self._slope = left * inflow_thrust_kg_per_rad(c, self._b)
        self._hover = ca.sqrt(self._k / self._momentum)  # v_h / O
        self._pitch = self._k + self._slope * self._hover
        given = self._b.translational_thrust_kg_per_m
        self._edge = 1.5 * self._pitch / c.radius_m**2 if given is None else left * given
        self._profile = self._k * (c.moment_ratio_m - self._b.induced_power_factor * self._hover)
        self.wake = _wake(c) if self.above is not None else 0.0

    def _across(self, hub: Hub) -> ca.SX:
        return hub.velocity - ca.dot(hub.velocity, self.axis) * self.axis

    def _loss(self, hub: Hub, speed: ca.SX) -> ca.SX | float:
        """Share of the induced velocity that the ground takes: Hayden, bounded and faded out."""
        if not self._ground or self._b.ground_inflow_loss == 0.0:
            return 0.0
        z = hub.height / (self._c.ground_radius_m or self._c.radius_m)
        fade = ca.fmax(hub.up, 0) ** 4 * ca.fmax(1 - (z / 32) ** 2, 0) ** 4
        hayden = 4 * 0.0379  # over z^2
        calm = 1 / (1 + ca.sumsqr(self._across(hub)) / (self._hover * speed) ** 2)
        return fade * calm / (1 / self._b.ground_inflow_loss + z**2 / hayden)

    def _flow(self, hub: Hub, speed: ca.SX, v: ca.SX, wake: ca.SX | float) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return flow along the axis without the rotor's own, with it, and the share of edgewise flow that counts."""
        climb = ca.dot(hub.velocity, self.axis) + self.wake * wake
        mu2 = ca.sumsqr(self._across(hub)) / (speed * self._c.radius_m) ** 2
        return climb, climb + (1 - self._loss(hub, speed)) * v, 1 / (1 + mu2)

    def blade_thrust(self, hub: Hub, speed: ca.SX, v: ca.SX, wake: ca.SX | float) -> ca.SX:
        _, through, counts = self._flow(hub, speed, v, wake)
        edgewise = self._edge * counts * ca.sumsqr(self._across(hub))
        return self._pitch * speed**2 + edgewise - self._slope * speed * through

    def flux(self, hub: Hub, speed: ca.SX, v: ca.SX, wake: ca.SX | float) -> ca.SX:
        climb, _, _ = self._flow(hub, speed, v, wake)
        across2 = ca.sumsqr(self._across(hub))
        x, y2 = climb / v, across2 / v**2
        ring = (-1.24 + 0.46 * x + 2.73 * x**2) / (1 + 1.21 * (x + 0.19) ** 2 + 2 * y2) ** 4
        return ca.sqrt(across2 + (climb + v) ** 2 + climb**2 * ring)

    def gap(self, hub: Hub, speed: ca.SX, v: ca.SX, wake: ca.SX | float) -> ca.SX:
        """Return the thrust of the blades less that of momentum theory [N]: 0 for the induced velocity."""
        return self.blade_thrust(hub, speed, v, wake) - self._momentum * v * self.flux(hub, speed, v, wake)

    def force_and_moment(self, hub: Hub, speed: ca.SX, v: ca.SX, wake: ca.SX | float) -> tuple[ca.SX, ca.SX]:
        """Return force and moment on the hub at the density of the file, without the spin's own."""
        R, b = self._c.radius_m, self._b
        across = self._across(hub)
        climb, through, counts = self._flow(hub, speed, v, wake)
        thrust = self.blade_thrust(hub, speed, v, wake)
        at_disc = through - climb
        drag = (
            self._c.drag_kg_per_rad * speed + self._edge * counts * through + 2 * self._profile * speed / R**2
        ) * across
        losses = self._profile * (speed**3 + b.profile_power_growth * counts * ca.sumsqr(across) * speed / R**2)
        power = thrust * (climb + b.induced_power_factor * at_disc) - ca.dot(drag, across) + losses
        advancing = counts * (self._pitch * speed - self._slope * through / 2) * across
        behind = self._slope * at_disc * speed * R * np.sqrt(2) / 4 / self.flux(hub, speed, v, wake)
        moment = -b.hub_moment_share * (self.spin * advancing + behind * ca.cross(self.axis, across))
        return thrust * self.axis - drag, moment - self.spin * power / speed * self.axis

    @property
    def relative(self) -> float:
        """1.225 kg/m3 over the density of the file."""
        return _SEA_LEVEL_KGPM3 / self._b.air_density_kgpm3


def _wake(c: RotorConstants) -> float:
    """Return chi from the static thrust of a lower rotor at equal speeds, found by Brent's method."""
    assert c.blade_element is not None
    k, slope = c.thrust_coefficient_n_per_radps2, inflow_thrust_kg_per_rad(c, c.blade_element)
    disc = 2 * c.blade_element.air_density_kgpm3 * np.pi * c.radius_m**2
    hover = np.sqrt(k / disc)

    thrust = c.coaxial_thrust_ratio * k
    through = hover + (k - thrust) / slope  # blade element theory

    def excess(v: float) -> float:
        climb = through - v
        ring = (-1.24 + 0.46 * climb / v + 2.73 * (climb / v) ** 2) / (1 + 1.21 * (climb / v + 0.19) ** 2) ** 4
        return float(disc * v * np.sqrt(through**2 + climb**2 * ring) - thrust)

    return float(through - brentq(excess, 1e-6 * through, through, xtol=1e-16, rtol=1e-15)) / float(hover)


class InflowRoots:
    """Finds the induced velocities at an instant: uppers first, then the lower rotors in their wakes."""

    def __init__(self, rotors: list[BladeRotor], gap: ca.Function) -> None:
        self._order = sorted(range(len(rotors)), key=lambda i: rotors[i].above is not None)
        self._gap = gap  # of (x, v, controls)

    def solve(self, x: Float64, guess: Float64, control: Float64) -> Float64:
        v = guess.copy()
        for i in self._order:

            def gap(value: float, i: int = i) -> float:
                v[i] = value
                return float(self._gap(x, v, control)[i])

            start = float(v[i])
            for reach in (1e-6 * abs(start), 300.0):
                low, high = start - reach, start + reach
                if gap(low) * gap(high) < 0.0:
                    break
            v[i] = brentq(gap, low, high, xtol=1e-15, rtol=1e-15)
        return v


def with_inflow(
    problem: dict[str, ca.SX], rotors: list[BladeRotor], induced: ca.SX, gap: ca.SX
) -> tuple[dict[str, ca.SX], InflowRoots]:
    """Return a problem of CVODES (x, t, u, ode) with the induced velocities as states more, and what finds their roots.

    `gap` [rotors] is 0 at the induced velocities `induced`; it may depend on x, t and u.
    """
    x, t, u, ode = (problem[key] for key in ("x", "t", "u", "ode"))
    at_start = ca.Function("gap", [x, induced, u], [ca.substitute(gap, t, 0)])
    change = ca.jtimes(gap, x, ode) + ca.jacobian(gap, t)
    own = -ca.solve(ca.jacobian(gap, induced), change)
    return problem | {"x": ca.vertcat(x, induced), "ode": ca.vertcat(ode, own)}, InflowRoots(rotors, at_start)
