"""Flights of vehicles with hidden parameters as a log shows them, from the physics: noise, delays, light wind."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.flight_log import FlightLog, Series
from signals.units import STANDARD_GRAVITY_MPS2
from sim._kernels import ideal_imu
from sim.physics import multirotor
from sim.physics.disturbances import Disturbances
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import Vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from sim.scene.wind import Turbulence, Wind
from tests.worlds.rotor_models import quadratic

TICK_S = 0.004


@dataclass(frozen=True)
class Sensing:
    """Deviations and delays of what is logged. Delays are those of the stamps behind the instant they belong to."""

    imu_delay_s: float = 0.0
    pose_delay_s: float = 0.0
    gyro_radps: float = 0.01
    accel_mps2: float = 0.15
    position_m: float = 0.002
    attitude_rad: float = 0.003
    velocity_mps: float = 0.02
    gyro_bias_radps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accel_bias_mps2: tuple[float, float, float] = (0.0, 0.0, 0.0)


def nominal_vehicle() -> Vehicle:
    """Return the x500 with faster motors, so that the heaviest of the hidden vehicles can still climb and turn."""
    x500 = quadratic("x500")
    constants = x500.rotor_constants.model_copy(update={"max_speed_radps": 1250.0})
    return x500.model_copy(update={"rotor_constants": constants})


def hidden_vehicle(nominal: Vehicle, seed: int) -> Vehicle:
    """Return a vehicle like the nominal one, with the constants that a fit is to find moved at random by up to 30 %."""
    random = np.random.default_rng([seed, 7])

    def by(share: float = 0.3) -> float:
        return float(np.exp(random.uniform(-share, share)))

    c, m = nominal.rotor_constants, nominal.mass_kg
    constants = c.model_copy(
        update={
            "thrust_coefficient_n_per_radps2": c.thrust_coefficient_n_per_radps2 * by(0.15),
            "moment_ratio_m": c.moment_ratio_m * by(),
            "time_constant_up_s": 0.025 * by(0.5),
            "time_constant_down_s": 0.035 * by(0.4),
            "inertia_kgm2": c.inertia_kgm2 * by(),
            "drag_kg_per_rad": c.drag_kg_per_rad * by(),
            "axial_drag_kg_per_rad": 1.5e-4 * by(),
            "ground_thrust_ratio": 1.0,
            "descent_loss": 0.0,
        }
    )
    ix, iy, iz = (i * by(0.2) for i in nominal.inertia_kgm2)
    return nominal.model_copy(
        update={
            "name": f"hidden_{seed}",
            "inertia_kgm2": (ix, iy, min(iz, 0.98 * (ix + iy))),
            "rotor_constants": constants,
            "body_drag_linear_n_per_mps": (0.15 * m * by(), 0.15 * m * by(), 0.15 * m * by()),
        }
    )


def _rotate(q: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    t = 2.0 * np.cross(q[1:], u)
    return u + q[0] * t + np.cross(q[1:], t)


def excited_log(
    vehicle: Vehicle,
    *,
    seed: int,
    duration_s: float,
    sensing: Sensing,
    wind_mps: float = 1.0,
    turbulence_mps: float = 1.0,
) -> FlightLog:
    """Return the log of a flight that turns, climbs and yaws in every direction, held by a controller of its own."""
    random = np.random.default_rng([seed, 1])
    heading = random.uniform(0, 2 * np.pi)
    wind = Wind(
        steady_W_mps=(wind_mps * np.cos(heading), wind_mps * np.sin(heading), 0.0),
        turbulence=Turbulence(wind_20ft_mps=turbulence_mps) if turbulence_mps else None,
    )
    physics = VehiclePhysics(
        vehicle,
        load_scene("airfield"),
        round(TICK_S * 1e9),
        start=FlightStart(p_WB=(0.0, 0.0, 60.0)),
        disturbances=Disturbances(wind=wind, seed=seed),
    )
    hover = multirotor.hover_control(vehicle)
    physics.state[13:] = multirotor.speed_radps(vehicle, hover)
    c, mass, inertia = vehicle.rotor_constants, vehicle.mass_kg, np.array(vehicle.inertia_kgm2)
    mixing = np.linalg.pinv(multirotor.effectiveness(vehicle)[2:])
    ticks = round(duration_s / TICK_S)
    phases, rates = random.uniform(0, 2 * np.pi, (4, 5)), np.array([0.13, 0.31, 0.7, 1.5, 2.9])
    size = np.array([[0.5], [0.5], [3.0], [0.8]]) * np.array([0.6, 0.6, 0.4, 0.25, 0.12])
    t = np.arange(ticks) * TICK_S
    wanted = (size[:, :, None] * np.sin(2 * np.pi * rates[None, :, None] * t + phases[:, :, None])).sum(axis=1)
    rows, commands = [], np.zeros((ticks, len(vehicle.rotors)))
    command = np.full(len(vehicle.rotors), hover)
    for tick in range(ticks):
        truth = physics.advance(tick, tuple(command))
        p, q, v, w = (np.array(x) for x in (truth.p_WB, truth.q_WB, truth.v_WB_W, truth.w_WB_B))
        back = np.array([q[0], *-q[1:]])
        up = _rotate(back, np.array([0.0, 0.0, 1.0]))
        level = np.clip(-0.05 * p[:2] - 0.06 * v[:2], -0.35, 0.35) + wanted[:2, tick] * [1.0, 1.0]
        goal = np.array([level[0], level[1], 1.0])
        tilt = _rotate(back, goal / np.linalg.norm(goal))
        error = np.cross([0.0, 0.0, 1.0], tilt)
        torque = inertia * (60.0 * error[:3] - 12.0 * (w - [0.0, 0.0, wanted[3, tick]]) * [1.0, 1.0, 0.25])
        lift = mass * (9.81 + 1.2 * (60.0 - p[2]) - 2.0 * v[2] + wanted[2, tick] * 1.3) / max(0.5, up[2])
        thrust = mixing @ np.array([lift, *torque])
        share = np.clip(thrust / (c.thrust_coefficient_n_per_radps2 * c.max_speed_radps**2), 0.02, 1.0)
        command = np.clip(np.sqrt(share) + 0.01 * random.standard_normal(len(share)), 0.05, 1.0)
        commands[tick] = command
        # The tick's mean, as of its middle. With the attitude at the tick's end it would err by the turn of half a
        # tick, in phase with the speed: 1 to 3 % of the drag.
        imu = ideal_imu(truth.q_WB, truth.a_WB_W, truth.w_WB_B, truth.alpha_WB_B, TICK_S, STANDARD_GRAVITY_MPS2)
        rows.append(np.concatenate([p, q, v, w, imu[:3]]))
    x = np.array(rows)
    n = len(x)
    noise = random.standard_normal
    gyro = x[:, 10:13] + sensing.gyro_bias_radps + sensing.gyro_radps * noise((n, 3))
    accel = x[:, 13:16] + sensing.accel_bias_mps2 + sensing.accel_mps2 * noise((n, 3))
    some = slice(None, None, 2)  # motion capture at half the rate
    turn = 0.5 * sensing.attitude_rad * noise((n, 3))
    q = np.array([_times(a, np.array([1.0, *b])) for a, b in zip(x[:, 3:7], turn, strict=True)])
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    pose = np.hstack([x[:, :3] + sensing.position_m * noise((n, 3)), q])[some]
    velocity = (x[:, 7:10] + sensing.velocity_mps * noise((n, 3)))[some]
    return FlightLog(
        name=vehicle.name,
        source=Path("made.log"),
        motors=Series(t, commands),
        motors_kind="command",
        pose=Series(t[some] + sensing.pose_delay_s, pose),
        velocity=Series(t[some] + sensing.pose_delay_s, velocity),
        rate=Series(t + sensing.imu_delay_s, gyro),
        accel=Series(t - 0.5 * TICK_S + sensing.imu_delay_s, accel),
        voltage=None,
        estimated=False,
        start_s=0.5,
        end_s=float(t[-1]) - 0.5,
    )


def _times(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])
