"""Force and torque that a vehicle file gives its rotors for logged motors, for checks and first guesses.

    speed    c_i = O_max (1 + e (V / V_nominal - 1)) sqrt(f u^2 + (1 - f) u)  of a command u;  else the logged speed
    lag      dO_i/dt = (c_i - O_i) / tau,  tau_up or tau_down, solved exactly between two samples (commands only)
    wrench   sum_i E_i k O_i^2,  E_i of sim/physics/multirotor.py

Drag and inflow are left out; the estimator has the whole model.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.flight_log import FlightLog
from sim.physics.multirotor import effectiveness
from sim.physics.vehicle import Vehicle

Rows = NDArray[np.float64]


def steady_speeds_radps(log: FlightLog, vehicle: Vehicle) -> Rows:
    """Return the speed [n, rotors] that each rotor would reach, at the motors' times."""
    values = log.motors.values
    if log.motors_kind == "speed_radps":
        return values
    c = vehicle.rotor_constants
    u = np.clip(values, 0.0, 1.0)
    speeds = c.max_speed_radps * np.sqrt(c.thrust_model_factor * u * u + (1.0 - c.thrust_model_factor) * u)
    if log.voltage is not None and vehicle.battery is not None:
        volts = np.interp(log.motors.t_s, log.voltage.t_s, log.voltage.values[:, 0])
        speeds = speeds * (1.0 + c.voltage_slope * (volts / vehicle.battery.nominal_voltage_v - 1.0))[:, None]
    return speeds


def lagged_speeds_radps(log: FlightLog, steady: Rows, *, up_s: float, down_s: float) -> Rows:
    """Return the speeds with the motors' lag; measured speeds as they are."""
    if log.motors_kind == "speed_radps" or not len(steady):
        return steady
    steps = np.diff(log.motors.t_s)
    up, down = np.exp(-steps / up_s), np.exp(-steps / down_s)
    speeds = np.empty_like(steady)
    speeds[0] = now = steady[0]
    for i, target in enumerate(steady[:-1]):
        now = target + (now - target) * np.where(target > now, up[i], down[i])
        speeds[i + 1] = now
    return speeds


def wrench(speeds_radps: Rows, vehicle: Vehicle) -> Rows:
    """Return force [N] and torque about the centre of mass [N m] in B, [n, 6]."""
    k = vehicle.rotor_constants.thrust_coefficient_n_per_radps2
    return (k * speeds_radps * speeds_radps) @ effectiveness(vehicle).T


def greatest_specific_force_mps2(vehicle: Vehicle) -> float:
    """Return thrust of all rotors at full speed over mass."""
    c = vehicle.rotor_constants
    full = np.full((1, len(vehicle.rotors)), c.max_speed_radps)
    return float(wrench(full, vehicle)[0, 2]) / vehicle.mass_kg
