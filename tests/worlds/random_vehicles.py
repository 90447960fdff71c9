"""Random vehicles for the fit: what an owner measures beforehand is random and known, the rest random and hidden.

known to the fit    mass, places of the rotors: a scale and a tape measure
hidden              thrust, torque, inertias, motor lags, drags (`hidden_vehicle`), delays, biases
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.physics.vehicle import Vehicle
from tests.worlds.excited_flight import Sensing, hidden_vehicle, nominal_vehicle


@dataclass(frozen=True)
class RandomVehicle:
    """The vehicle that the fit begins with, the one that flies, and what its log does to the signals."""

    nominal: Vehicle
    truth: Vehicle
    sensing: Sensing


def random_vehicle(seed: int) -> RandomVehicle:
    """Return one of many vehicles between half and twice the x500's inertia."""
    random = np.random.default_rng([seed, 11])
    base = nominal_vehicle()
    heavier, longer = (float(np.exp(random.uniform(-0.2, 0.2))) for _ in range(2))
    rotors = [
        rotor.model_copy(
            update={
                "position_m": tuple(
                    float(round(longer * x + shift, 4))
                    for x, shift in zip(rotor.position_m, random.uniform(-0.01, 0.01, 3), strict=True)
                )
            }
        )
        for rotor in base.rotors
    ]
    nominal = base.model_copy(
        update={
            "mass_kg": base.mass_kg * heavier,
            "inertia_kgm2": tuple(i * heavier * longer**2 for i in base.inertia_kgm2),
            "rotors": rotors,
        }
    )
    imu_delay_s = float(random.uniform(0.0, 0.012))
    gyro, accel = random.normal(0.0, 0.01, 3), random.normal(0.0, 0.1, 3)
    sensing = Sensing(
        imu_delay_s=imu_delay_s,
        pose_delay_s=imu_delay_s + float(random.uniform(0.0, 0.02)),
        gyro_bias_radps=(float(gyro[0]), float(gyro[1]), float(gyro[2])),
        accel_bias_mps2=(float(accel[0]), float(accel[1]), float(accel[2])),
    )
    return RandomVehicle(nominal, hidden_vehicle(nominal, seed), sensing)
