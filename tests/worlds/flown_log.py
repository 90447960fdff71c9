"""The log of a flight of closed form whose motors fit its motion: an x500 without lag, drag and noise.

The path p(t) is smooth; the attitude points the thrust along dv/dt + g and holds a heading psi(t); rates and angular
accelerations follow by differences on a fine grid, and the four rotor speeds from

    k O^2 = E^-1 (m |dv/dt + g|, I dw/dt + w x I w)         E of sim/physics/multirotor.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hil.run.flight_logs.flight_log import FlightLog, Series
from sim.physics.multirotor import effectiveness
from sim.physics.vehicle import Vehicle, load_vehicle

Array = NDArray[np.float64]

G = 9.80665
GROUND_M = 0.2289  # height of the x500's origin over the ground that it stands on
TAKE_OFF_S, CLIMB_S = 3.0, 4.0


def smooth_step(x: Array) -> Array:
    """Rise from 0 to 1 between x = 0 and 1 with four continuous derivatives."""
    x = np.clip(x, 0.0, 1.0)
    return x**5 * (126.0 - 420.0 * x + 540.0 * x**2 - 315.0 * x**3 + 70.0 * x**4)


def flown_log(
    duration_s: float = 40.0, *, motion: float = 1.0, rate_hz: float = 100.0, vehicle: Vehicle | None = None
) -> FlightLog:
    """Return a log that begins and ends on the ground with the motors at rest; `motion` scales its horizontal part."""
    vehicle = vehicle or load_vehicle("x500")
    fine = 10
    h = 1.0 / (fine * rate_hz)
    t = np.arange(0.0, duration_s, h)
    land_s = duration_s - TAKE_OFF_S - CLIMB_S
    up = smooth_step((t - TAKE_OFF_S) / CLIMB_S) - smooth_step((t - land_s) / CLIMB_S)
    inside = smooth_step((t - TAKE_OFF_S - CLIMB_S) / 5.0) - smooth_step((t - land_s + 5.0) / 5.0)
    p = np.stack(
        [
            motion * inside * (2.0 * np.sin(1.1 * t) + 0.06 * np.sin(5.0 * t)),
            motion * inside * (1.5 * np.sin(1.6 * t) + 0.04 * np.sin(6.1 * t)),
            GROUND_M + 6.0 * up + motion * inside * np.sin(0.7 * t),
        ],
        axis=1,
    )
    v = np.gradient(p, h, axis=0)
    a = np.gradient(v, h, axis=0)
    heading = motion * inside * 0.5 * np.sin(0.9 * t)
    z = a + np.array([0.0, 0.0, G])
    thrust = np.linalg.norm(z, axis=1)
    z = z / thrust[:, None]
    x = np.stack([np.cos(heading), np.sin(heading), np.zeros_like(t)], axis=1)
    y = np.cross(z, x)
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    R = np.stack([np.cross(y, z), y, z], axis=2)
    w_x = np.swapaxes(R, 1, 2) @ np.gradient(R, h, axis=0)
    w = np.stack([w_x[:, 2, 1], w_x[:, 0, 2], w_x[:, 1, 0]], axis=1)
    inertia = np.array(vehicle.inertia_kgm2)
    torque = inertia * np.gradient(w, h, axis=0) + np.cross(w, w * inertia)
    wrench = np.hstack([vehicle.mass_kg * thrust[:, None], torque])
    c = vehicle.rotor_constants
    squares = wrench @ np.linalg.inv(effectiveness(vehicle)[2:]).T / c.thrust_coefficient_n_per_radps2
    command = np.sqrt(np.maximum(squares, 0.0)) / c.max_speed_radps
    command[(t < TAKE_OFF_S) | (t > land_s + CLIMB_S)] = 0.0
    rows = slice(fine, len(t) - fine, fine)
    accel = np.stack([np.zeros_like(t), np.zeros_like(t), thrust], axis=1)
    q = Rotation.from_matrix(R[rows]).as_quat(scalar_first=True)

    def series(values: Array) -> Series:
        return Series(np.ascontiguousarray(t[rows]), np.ascontiguousarray(values))

    return FlightLog(
        name="flown",
        source=Path("flown.ulg"),
        motors=series(command[rows]),
        motors_kind="command",
        pose=series(np.hstack([p[rows], q])),
        velocity=series(v[rows]),
        rate=series(w[rows]),
        accel=series(accel[rows]),
        voltage=None,
        estimated=False,
        start_s=float(t[rows][0]),
        end_s=float(t[rows][-1]),
    )


def with_series(log: FlightLog, name: str, change: Any) -> FlightLog:
    """Return the log with `change(t_s, values)`, which returns both, applied to one series."""
    series: Series = getattr(log, name)
    t_s, values = change(series.t_s.copy(), series.values.copy())
    return replace(log, **{name: Series(np.ascontiguousarray(t_s), np.ascontiguousarray(values))})


def scaled(log: FlightLog, name: str, factor: float, columns: slice = slice(None)) -> FlightLog:
    def change(t_s: Array, values: Array) -> tuple[Array, Array]:
        values[:, columns] *= factor
        return t_s, values

    return with_series(log, name, change)
