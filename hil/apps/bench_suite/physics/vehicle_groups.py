"""Rows and checks of several vehicles: a collision, and 100 vehicles with the sensors of an autopilot.

    collision     two x500 meet off centre at 10 m/s each   greatest relative change of momentum or angular momentum
    100 vehicles  circles of 2 m at up to 2.1 m/s, 2 s      greatest distance from the same flights alone [m]

The 100 vehicles are flown by `AttitudeLoop`; each has an IMU at every tick, GPS at 10 Hz, barometer and magnetometer at
50 Hz. Their time is processor time of one core, without the controllers'.
"""

from __future__ import annotations

import gc
import time

import numpy as np

from hil.apps.bench_suite.physics.attitude_loop import AttitudeLoop, Circle
from hil.apps.bench_suite.physics.flight_cases import TICK_S, Float64, torque_free
from hil.apps.bench_suite.result import Check, Row, ShowStatus
from signals.rotation import matrix_of
from signals.samples import TruthState
from sim.physics import multirotor
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_group import VehicleGroup
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation, Sensor

_TICK_NS = round(TICK_S * 1e9)
_OFF = (0.0,) * 4
_METHOD = "this project, order 8 @ 4 ms"
_SENSORS = (("imu", "icm20689", 250), ("gps", "here_plus", 10), ("baro", "ms5611", 50), ("mag", "ist8310", 50))
_COUNT, _SECONDS, _ROUND_TICKS = 100, 2.0, 1500


def group_rows(status: ShowStatus) -> tuple[list[Row], list[Check]]:
    """Measure both cases."""
    status("collision of two vehicles")
    change, energy, took_s = _collision()
    status(f"{_COUNT} vehicles with sensors")
    apart_m, cpu_s = _swarm()
    per_tick_us = cpu_s * TICK_S / _COUNT * 1e6
    rows = [
        Row("collision", _METHOD, change, "1", took_s, {"energy_left": energy}),
        Row(f"{_COUNT} vehicles", _METHOD, apart_m, "m", cpu_s, {"us_per_vehicle_and_tick": per_tick_us}),
    ]
    return rows, [
        Check("collision: change of momentum and angular momentum", change, "<=", 1e-9, "1"),
        Check("collision: energy after over energy before", energy, "<=", 1.0, "1"),
        Check(f"{_COUNT} vehicles: distance from the same flights alone", apart_m, "<=", 0.0, "m"),
        Check(
            f"{_COUNT} vehicles, sensors: processor time per simulated second", 1e3 * cpu_s, "<=", 500.0, "ms", "speed"
        ),
    ]


def _collision() -> tuple[float, float, float]:
    """Return the relative change of the moments, the energy left, and wall seconds per simulated second."""
    scene = load_scene("airfield").model_copy(update={"gravity_mps2": 0.0})
    vehicles = {}
    for name, side, offset_m in (("a", -1.0, 0.0), ("b", 1.0, 0.1)):
        start = FlightStart(p_WB=(side, offset_m, 300.0 + offset_m))
        vehicles[name] = VehiclePhysics(torque_free(load_vehicle("x500")), scene, _TICK_NS, start=start)
        vehicles[name].state[7] = -10.0 * side
    group, before = VehicleGroup(vehicles), _moments(vehicles)
    ticks, began = 100, time.perf_counter()
    for tick in range(ticks):
        group.advance(tick, [_OFF, _OFF])
    took_s = (time.perf_counter() - began) / (ticks * TICK_S)
    after = _moments(vehicles)
    scale = 10.0 * vehicles["a"].vehicle.mass_kg * np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])  # of one vehicle
    return float(np.abs((after[:6] - before[:6]) / scale).max()), float(after[6] / before[6]), took_s


def _moments(vehicles: dict[str, VehiclePhysics]) -> Float64:
    """Return momentum [3], angular momentum about (0, 0, 300) [3], both in W, and kinetic energy."""
    total = np.zeros(7)
    for physics in vehicles.values():
        s, mass, inertia = physics.state, physics.vehicle.mass_kg, np.array(physics.vehicle.inertia_kgm2)
        total[:3] += mass * s[7:10]
        total[3:6] += mass * np.cross(s[:3] - np.array([0.0, 0.0, 300.0]), s[7:10])
        total[3:6] += np.array(matrix_of(s[3:7])).reshape(3, 3) @ (inertia * s[10:13])
        total[6] += 0.5 * mass * float(s[7:10] @ s[7:10]) + 0.5 * float(inertia @ (s[10:13] * s[10:13]))
    return total


class _Flyer:
    """One vehicle of the swarm with its controller and sensors."""

    def __init__(self, index: int) -> None:
        vehicle, scene = load_vehicle("x500"), load_scene("airfield")
        x, y = 6.0 * (index % 10), 6.0 * (index // 10)
        self.physics = VehiclePhysics(vehicle, scene, _TICK_NS, start=FlightStart(p_WB=(x + 2.0, y, 20.0)))
        self.physics.state[13:] = multirotor.speed_radps(vehicle, multirotor.hover_control(vehicle))
        self._loop = AttitudeLoop(vehicle, gain=1.0, circle=Circle((x, y, 20.0), 2.0, _ROUND_TICKS))
        self._sensors: list[tuple[Sensor, int]] = []
        for name, preset, rate_hz in _SENSORS:
            installation = Installation(name, rate_hz=rate_hz, seed=index, scene=scene, step_ns=_TICK_NS)
            self._sensors.append((make_sensor(installation, preset=preset), round(1.0 / (rate_hz * TICK_S))))

    def controls(self, truth: TruthState) -> tuple[float, ...]:
        return self._loop.commands((*truth.p_WB, *truth.q_WB, *truth.v_WB_W, *truth.w_WB_B))

    def sample(self, truth: TruthState) -> None:
        for sensor, every in self._sensors:
            if truth.tick % every == 0:
                sensor.sample(truth, truth.tick // every)


def _swarm() -> tuple[float, float]:
    """Return the greatest distance from the flights alone, and processor seconds per simulated second."""
    flyers = [_Flyer(index) for index in range(_COUNT)]
    group = VehicleGroup({str(index): flyer.physics for index, flyer in enumerate(flyers)})
    ticks, cpu_s = round(_SECONDS / TICK_S), 0.0
    gc.disable()  # as during a run
    try:
        truths = group.advance(0, [_OFF] * _COUNT)
        for tick in range(1, ticks + 1):
            controls = [flyer.controls(truth) for flyer, truth in zip(flyers, truths, strict=True)]
            began = time.process_time()
            truths = group.advance(tick, controls)
            for flyer, truth in zip(flyers, truths, strict=True):
                flyer.sample(truth)
            cpu_s += time.process_time() - began
    finally:
        gc.enable()
    apart_m = 0.0
    for index in (0, _COUNT // 2, _COUNT - 1):
        alone = _Flyer(index)
        truth = alone.physics.advance(0, _OFF)
        for tick in range(1, ticks + 1):
            truth = alone.physics.advance(tick, alone.controls(truth))
        apart_m = max(apart_m, float(np.linalg.norm(alone.physics.state[:3] - flyers[index].physics.state[:3])))
    return apart_m, cpu_s / _SECONDS
