"""The equations of a rotor by blade-element momentum theory, as pure functions of numbers, arrays or CasADi symbols.

The kernel has the same equations (sim/native/forces/blade_rotors.hpp). All coefficients are lumps (blade_element.py),
so that each can be identified from flight.

    u_n   velocity of the hub through the air along the rotor's axis n (climb > 0)     u_a   across it, V = |u_a|
    v     induced velocity aloft; at the rotor it is v' = (1 - gamma) v                w = u_n + v'
    r     density over that for which the coefficients hold                            O     rotor speed, >= 0

Thrust, blade element theory with uniform inflow (Leishman, Principles of Helicopter Aerodynamics, 2nd ed., ch. 3, 5):

    T = r (c_t O^2 + c_V p V^2 - c_l O w)
    c_t = k + c_l sqrt(kappa), so that T = k O^2 in hover;  c_V = 1.5 c_t / R^2 by theory;  kappa = k / (2 rho pi R^2)
    p = (O R)^2 / ((O R)^2 + V^2) takes the terms of edgewise flow out where most of the disc is in reverse flow

Induced velocity, momentum theory (Glauert) with a closure for descent:

    T = r 2 rho A v W,   W^2 = V^2 + (u_n + v)^2 + u_n^2 v^6 (a v^2 + b u_n v + c u_n^2) / E^4
    E = v^2 + ((u_n + s v) / d)^2 + e V^2,   1/d^2 = 1.21, s = 0.19, a = -1.24, b = 0.46, c = 2.73, e = 2

The last term of W^2 is a fit to the measured curve of descent (Leishman's polynomial, ch. 2: v / v_h = 1 - 1.125 x -
1.372 x^2 - 1.718 x^3 - 0.655 x^4 for -2 <= x = u_n / v_h <= 0) and to momentum theory in climb and in the windmill
state, where it vanishes. It agrees with the polynomial within 8 % down to x = -1.9, with the theory of climb within
0.5 %, with that of the windmill state below x = -2.2 within 0.5 %; in hover it is exact, with the slope of momentum
theory. W is above 0 and v W rises with v, so that there is one solution; it does not depend on r. e takes the vortex
ring state out in forward flight. W keeps its value when u_n and v both change their signs, which is negative thrust.

Ground effect (Hayden, The effect of the ground on helicopter hovering power required, AHS Forum 32, 1976: the induced
power falls to 1 / (0.9926 + 0.0379 (2 R / z)^2)), bounded at the ground, with the fade of rotor_air.hpp:

    gamma = 2.43 f / (2.43 / gamma_0 + (4 z / R)^2),   2.43 = 16 * 4 * 0.0379
    f = max(0, cos tilt)^4 (1 - (z / 32 R)^2)^4 kappa O^2 / (kappa O^2 + V^2)
    R is here that of a rotor with the ground effect of the whole vehicle: rotor_air.hpp.

Force across, moments of the hub, torque:

    H = -r (k_d O + c_V p w + 2 c_q O / R^2) u_a         k_d: flapping; then induced and profile drag of the blades
    M = -r h (s p (c_t O - c_l w / 2) u_a + sqrt(2) c_l v' O R / (4 W) n x u_a)
        s spin, h share of the moments that the blades carry to the hub. First the advancing blade's lift, then the
        inflow's rise to the rear (White and Blake: v (1 + sqrt(2) sin chi (r / R) cos psi))
    Q O = T (u_n + kappa_i v') - |H| V + r c_q O (O^2 + 4.65 p V^2 / R^2)     shaft power: work done on the vehicle and
        losses;  c_q = k (m_ratio - kappa_i sqrt(kappa)), so that Q = m_ratio k O^2 in hover

Q is evaluated with T / O and H / O, which exist for a rotor that stands. A lower coaxial rotor has chi times the upper
rotor's induced velocity added to u_n in all of this.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from sim.physics.forces.blade_element import HAYDEN, RotorLumps, StaticRotor

# Newton's method from this start reaches |v - exact| <= 1e-13 max(v_h, |v|) in 8 steps, for every |u_n|, V <= 3000 v_h.
NEWTON_STEPS = 8
SHIFT, INVERSE_WIDTH2, ACROSS = 0.19, 1.21, 2.0  # s, 1/d^2, e
DIP, SKEW, MIXING = -1.24, 0.46, 2.73  # a, b, c
_TINY = 1e-30  # (m/s)^2: keeps 0/0 of a rotor that stands in still air at 0
_GROUND_REACH_RADII = 32.0

Value = Any  # float, array, or casadi.SX: whatever has + - * / and ** 0.5


class RotorLoads(NamedTuple):
    """Loads of a rotor on the body at its hub, and its flow in the air."""

    thrust_n: Value
    across_kg_per_s: Value  # force across = -this u_a
    torque_nm: Value  # against the spin, about n
    roll_kg_m_per_s: Value  # moment = -spin this u_a
    pitch_kg_m_per_s: Value  # moment = -this n x u_a
    induced_mps: Value  # v
    power_w: Value


def flux2(u_n: Value, across2: Value, v: Value) -> tuple[Value, Value]:
    """Return W^2 and its derivative by v."""
    lean = u_n + SHIFT * v
    spread = v * v + INVERSE_WIDTH2 * (lean * lean) + ACROSS * across2 + _TINY
    share = v * v / spread
    share3 = share * share * share
    curve = DIP * (v * v) + SKEW * (u_n * v) + MIXING * (u_n * u_n)
    pull = u_n * u_n / spread
    through = u_n + v
    spread_dv = 2.0 * v + 2.0 * INVERSE_WIDTH2 * SHIFT * lean
    curve_dv = 2.0 * DIP * v + SKEW * u_n
    value = across2 + through * through + pull * share3 * curve
    # share3 / spread' = 6 v^5 / spread^4 - 4 v^6 spread' / spread^5
    slope = 2.0 * through + pull * (
        share3 * (curve_dv - 4.0 * curve * spread_dv / spread) + 6.0 * share * share * v * curve / spread
    )
    return value, slope


def induced_velocity(
    lumps: RotorLumps, speed: Value, u_n: Value, across2: Value, gamma: Value = 0.0, *, steps: int = NEWTON_STEPS
) -> Value:
    """Return v: the root of `inflow_balance`."""
    pushed, slowed = _push_and_slowing(lumps, speed, u_n, across2, gamma)
    v = pushed / (slowed + (across2 + lumps.kappa_m2 * speed * speed + 0.3 * u_n * u_n + _TINY) ** 0.5 + 0.3 * u_n)
    for _ in range(steps):
        balance, slope = inflow_balance(lumps, speed, u_n, across2, gamma, v)
        v = v - balance / slope
    return v


def inflow_balance(
    lumps: RotorLumps, speed: Value, u_n: Value, across2: Value, gamma: Value, v: Value
) -> tuple[Value, Value]:
    """Return what is 0 at the induced velocity, and its derivative by v, which is above 0:

    v W + (c_l O / 2 rho A) (1 - gamma) v - (c_t O^2 + c_V p V^2 - c_l O u_n) / (2 rho A)
    """
    pushed, slowed = _push_and_slowing(lumps, speed, u_n, across2, gamma)
    w2, w2_dv = flux2(u_n, across2, v)
    flux = (w2 + _TINY) ** 0.5
    return v * (flux + slowed) - pushed, flux + 0.5 * v * w2_dv / flux + slowed


def _push_and_slowing(lumps: RotorLumps, speed: Value, u_n: Value, across2: Value, gamma: Value) -> tuple[Value, Value]:
    loading = lumps.c_l * speed / lumps.disc_kg_per_m
    rim2 = speed * speed * (lumps.radius_m * lumps.radius_m)
    edge = lumps.c_v * across2 * rim2 / (rim2 + across2 + _TINY)
    return (lumps.c_t * speed * speed + edge) / lumps.disc_kg_per_m - loading * u_n, loading * (1.0 - gamma)


def ground_inflow_loss(lumps: RotorLumps, speed: Value, across2: Value, height_m: Value, up: Value) -> Value:
    """Return gamma of a hub `height_m` over the ground; `up` is the cosine of the tilt. Both cut off smoothly at 0."""
    if isinstance(lumps.ground_floor, float | int) and lumps.ground_floor == 0.0:
        return 0.0
    near = 1.0 - height_m * height_m / (_GROUND_REACH_RADII * lumps.ground_radius_m) ** 2
    near, level = _positive(near), _positive(up)
    induced2 = lumps.kappa_m2 * speed * speed
    fade = level**4 * near**4 * induced2 / (induced2 + across2 + _TINY)
    z = 4.0 * height_m / lumps.ground_radius_m
    return HAYDEN * fade / (lumps.ground_floor + z * z)


def coaxial_wake(c: StaticRotor, lumps: RotorLumps) -> float:
    """Return chi: the flow at a lower rotor from above is chi times the upper rotor's induced velocity.

    The lower rotor's static thrust at equal speeds is t k O^2, t = `coaxial_thrust_ratio`. With v_l = n v_h and
    s = n + chi the flow through it, blade element theory gives t k = k + c_l sqrt(kappa) (1 - s), and momentum theory
    t = n W / v_h, which is n s but for the closure. n is found by bisection.
    """
    t = c.coaxial_thrust_ratio
    through = 1.0 + (1.0 - t) * c.thrust_coefficient_n_per_radps2 / (lumps.c_l * float(lumps.kappa_m2**0.5))
    low, high = 0.0, through
    for _ in range(60):
        n = 0.5 * (low + high)
        if n * flux2(through - n, 0.0, n)[0] ** 0.5 < t:
            low = n
        else:
            high = n
    return through - 0.5 * (low + high)


def loads(
    lumps: RotorLumps,
    speed: Value,
    u_n: Value,
    across2: Value,
    *,
    gamma: Value = 0.0,
    density_ratio: Value = 1.0,
    steps: int = NEWTON_STEPS,
    induced_mps: Value | None = None,
) -> RotorLoads:
    """Return the loads of a rotor at `speed` [rad/s] in the flow u_n [m/s], V^2.

    The u_n of a lower coaxial rotor has the wake in it. `induced_mps`: v where the caller solves for it.
    """
    c, r = lumps, density_ratio
    v = induced_velocity(c, speed, u_n, across2, gamma, steps=steps) if induced_mps is None else induced_mps
    at_disc = (1.0 - gamma) * v
    w = u_n + at_disc
    rim2 = speed * speed * (c.radius_m * c.radius_m)
    per_speed = c.radius_m * c.radius_m * speed / (rim2 + across2 + _TINY)  # p / O
    edgewise = per_speed * speed
    thrust_per_speed = c.c_t * speed + c.c_v * per_speed * across2 - c.c_l * w
    across_per_speed = c.k_d + c.c_v * per_speed * w + 2.0 * c.c_q / (c.radius_m * c.radius_m)
    profile = c.c_q * (speed * speed + c.profile_power_growth * edgewise * across2 / (c.radius_m * c.radius_m))
    torque = thrust_per_speed * (u_n + c.induced_power_factor * at_disc) - across_per_speed * across2 + profile
    flux = (flux2(u_n, across2, v)[0] + _TINY) ** 0.5
    return RotorLoads(
        thrust_n=r * thrust_per_speed * speed,
        across_kg_per_s=r * across_per_speed * speed,
        torque_nm=r * torque,
        roll_kg_m_per_s=r * c.hub_moment_share * edgewise * (c.c_t * speed - 0.5 * c.c_l * w),
        pitch_kg_m_per_s=r * c.hub_moment_share * (0.25 * 2.0**0.5) * c.c_l * at_disc * speed * c.radius_m / flux,
        induced_mps=v,
        power_w=r * torque * speed,
    )


def _positive(x: Value) -> Value:
    """Return max(x, 0); `fabs` keeps it an expression of arrays and symbols alike."""
    return 0.5 * (x + abs(x)) if isinstance(x, float | int) else 0.5 * (x + (x * x) ** 0.5)
