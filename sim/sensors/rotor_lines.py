"""Amplitudes of a vehicle's vibration at a point of its body: arguments of sim/native/rotor_vibration.hpp.

A rigid body of mass m and inertia I about its centre of mass, shaken at the hub r by F, at the sensor's place p:

    f = F / m + alpha x p,   alpha = I^-1 (r x F),   w = integral of alpha
    F = b O^2 (cos theta e1 + s sin theta e2)        imbalance; spin s, e1 and e2 in the rotor's plane
    F = s_k k_T O^2 sin(k n theta) n                 passing blades; n their number, n the rotor's axis

theta is the integral of the rotor's speed from an angle that is drawn once for each rotor and line: the same for all
sensors of a vehicle, which feel the same airframe.
"""

from __future__ import annotations

import math
from typing import Any

from signals._kernel import det_cos, det_sin
from signals.noise import NoiseStream, noise_key
from signals.rotation import cross
from signals.units import TURN_RAD
from sim.physics import multirotor
from sim.physics.forces.rotors import Rotor
from sim.physics.vehicle import Vehicle
from sim.physics.vibration import Vibration, estimate

Vector = tuple[float, float, float]
_LEAST_ACROSS = 1e-9
_STREAM = "vibration"  # of a vehicle: its sensors share it


def vibration_of(vehicle: Vehicle) -> Vibration:
    """Return the vibration that the vehicle's file declares, else the estimate from its size."""
    group = vehicle.leading_group
    constants = vehicle.rotor_constants if group is None else group.constants
    return vehicle.vibration or estimate(constants.inertia_kgm2, constants.radius_m)


def vibration_arguments(vehicle: Vehicle, seed: int, place_m: Vector) -> dict[str, Any]:
    """Return the keyword arguments that describe the airframe. Raises ValueError for a vehicle without rotors."""
    if not vehicle.rotors:
        raise ValueError(f"vibration is that of rotors, and the vehicle {vehicle.name!r} has none")
    vibration = vibration_of(vehicle)
    orders = [1.0, *(float(vibration.blades * (k + 1)) for k in range(len(vibration.blade_pass_thrust)))]
    lanes = len(vehicle.rotors) * len(orders)
    angles = (TURN_RAD * NoiseStream(seed, _STREAM, lanes=lanes).uniform_block(0)[0]).tolist()
    k_T = [constants.thrust_coefficient_n_per_radps2 for constants in vehicle.constants_of_rotors]
    cosine: list[float] = []
    sine: list[float] = []
    for r, rotor in enumerate(vehicle.rotors):
        for line, order in enumerate(orders):
            c_N, s_N = _force(k_T[r], vibration, rotor, line, angles[r * len(orders) + line])
            (c_f, c_w), (s_f, s_w) = (_felt(vehicle, rotor, force, place_m) for force in (c_N, s_N))
            # The integral of cos h theta is sin h theta / (h O), and that of sin is -cos / (h O).
            cosine += [*c_f, *(-x / order for x in s_w)]
            sine += [*s_f, *(x / order for x in c_w)]
    mount = vibration.mount
    low_hz, high_hz = vibration.broadband_hz
    return {
        "order": orders,
        "cosine": cosine,
        "sine": sine,
        "mount_radps": 0.0 if mount is None else TURN_RAD * mount.frequency_hz,
        "mount_damping": 0.0 if mount is None else mount.damping_ratio,
        "broadband": [*vibration.broadband_accel_mps2, *vibration.broadband_gyro_radps],
        "broadband_radps": [TURN_RAD * low_hz, TURN_RAD * high_hz],
        "reference_radps": multirotor.speed_radps(vehicle, min(1.0, multirotor.hover_control(vehicle))),
        "key": noise_key(seed, f"{_STREAM}.broadband"),
    }


def _force(k_T: float, v: Vibration, rotor: Rotor, line: int, angle: float) -> tuple[Vector, Vector]:
    """Return what multiplies O^2 cos(h theta) and O^2 sin(h theta) of a line's force [N s2], in B."""
    c, s = det_cos(angle), det_sin(angle)
    n = rotor.axis
    if line > 0:
        size = v.blade_pass_thrust[line - 1] * k_T
        return _scaled(n, size * s), _scaled(n, size * c)
    across = math.sqrt(n[1] * n[1] + n[2] * n[2])  # of x_B to the axis
    e1: Vector = (0.0, 0.0, 1.0)  # for a propeller along x_B, as in forces/rotors.cpp
    if across > _LEAST_ACROSS:
        e1 = ((1.0 - n[0] * n[0]) / across, -n[0] * n[1] / across, -n[0] * n[2] / across)
    e2 = cross(n, e1)
    b, turn = v.imbalance_kgm, rotor.spin.sign
    along, aside = (b * c, turn * b * s), (-b * s, turn * b * c)
    return _plus(_scaled(e1, along[0]), _scaled(e2, along[1])), _plus(_scaled(e1, aside[0]), _scaled(e2, aside[1]))


def _felt(vehicle: Vehicle, rotor: Rotor, force: Vector, place_m: Vector) -> tuple[Vector, Vector]:
    """Return specific force at a place and angular acceleration for a force at the rotor's hub."""
    torque, I = cross(rotor.position_m, force), vehicle.inertia_kgm2  # noqa: E741 (the field's letter)
    alpha = (torque[0] / I[0], torque[1] / I[1], torque[2] / I[2])
    return _plus(_scaled(force, 1.0 / vehicle.mass_kg), cross(alpha, place_m)), alpha


def _scaled(v: Vector, size: float) -> Vector:
    return (v[0] * size, v[1] * size, v[2] * size)


def _plus(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])
