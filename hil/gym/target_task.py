"""Tasks in which the vehicle flies to targets: features of its state, and starts near them.

Features, float32, clipped to -1..1 (`observe_flights` in sim/native/bind_rigid_body.cpp):

    R^T (target_j - p) / range_m      for each target of the observation
    R^T v / 10 m/s,   w / 10 rad/s,   R row by row,   rotor speeds over their maximum
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from hil.gym.actions import RigDriver
from hil.gym.flight import Flight
from hil.gym.task import Task
from signals._kernel import det_cos, det_sin
from signals.errors import ConfigError
from signals.noise import NoiseStream
from signals.samples import Quat, Vec3
from sim._kernels import observe_flights

SPEED_SCALE, RATE_SCALE = 1.0 / 10.0, 1.0 / 10.0
_STATE_FEATURES = 15
_PI = 3.141592653589793


class TargetTask(Task):
    """Common part of the tasks with targets."""

    def __init__(self, flights: Sequence[Flight], name: str, *, targets: int, range_m: float, more: int = 0) -> None:
        """`targets`: number in the observation; `range_m`: the distance that is 1; `more`: further features."""
        if isinstance(flights[0].driver, RigDriver):
            message = "begins in the air, and an autopilot boots on the ground"
            raise ConfigError.at(name, message, "use controller rig with hil/Bench-v0")
        self.name = name
        self.flights = list(flights)
        count, rotors = len(self.flights), len(self.flights[0].bench.vehicle.rotors)
        self.width = 3 * targets + _STATE_FEATURES + rotors
        self._bodies = [flight.physics.body for flight in self.flights]
        self._scale = (1.0 / range_m, SPEED_SCALE, RATE_SCALE)
        self.target_W: NDArray[np.float64] = np.zeros((count, targets, 3))
        self.measures: NDArray[np.float64] = np.zeros((count, 4))
        self.distance_m, _, _, self.cos_tilt = self.measures.T
        self._noise: dict[int, NoiseStream] = {}  # by row, of those whose features are noisy
        self.features = self.width + more
        self.observation_space = Box(-1.0, 1.0, (self.features,), np.float32)

    def enter(self, row: int, flight: Flight, seed: int) -> None:
        """Restart a flight with a seed, as that of a row."""
        self.flights[row] = flight
        flight.restart(seed)
        self._bodies[row] = flight.physics.body
        self._noise.pop(row, None)
        if flight.draw.state_noise:
            self._noise[row] = NoiseStream(seed, "gym.state", lanes=self.width)

    def write_features(self, features: NDArray[np.float32]) -> NDArray[np.float32]:
        """Write the features of all rows to the first columns, and update the measures. Return `features`."""
        observe_flights(self._bodies, self.target_W, self._scale, features, self.measures)
        for row, noise in self._noise.items():
            flight = self.flights[row]
            white = np.array(noise.normal(flight.world.tick))
            noisy = features[row, : self.width] + flight.draw.state_noise * white
            features[row, : self.width] = np.clip(noisy, -1.0, 1.0)
        return features

    def observe(self) -> Any:
        return self.write_features(np.empty((len(self.flights), self.features), np.float32))

    def marks(self, row: int) -> Sequence[Vec3]:
        return [(x, y, z) for x, y, z in self.target_W[row].tolist()]


def hover_speeds(flight: Flight) -> list[float]:
    """Return the rotor speeds at which the thrust of all rotors is the weight [rad/s]."""
    vehicle = flight.physics.vehicle
    up = sum(rotor.axis[2] for rotor in vehicle.rotors)
    weight_n = vehicle.mass_kg * flight.bench.scene.gravity_mps2
    k = vehicle.rotor_constants.thrust_coefficient_n_per_radps2
    return [min((weight_n / (up * k)) ** 0.5, vehicle.rotor_constants.max_speed_radps)] * len(vehicle.rotors)


def random_attitude(random: np.random.Generator, tilt_rad: float) -> Quat:
    """Return a random heading, tilted by up to `tilt_rad` about a random horizontal axis."""
    yaw, axis = random.uniform(-_PI, _PI), random.uniform(-_PI, _PI)
    half = 0.5 * random.uniform(0.0, tilt_rad)
    c, s = det_cos(0.5 * yaw), det_sin(0.5 * yaw)
    w, x, y = det_cos(half), det_sin(half) * det_cos(axis), det_sin(half) * det_sin(axis)
    return c * w, c * x - s * y, c * y + s * x, s * w


def random_vector(random: np.random.Generator, size: Vec3) -> Vec3:
    """Return a vector whose components are uniform within +-size."""
    x, y, z = random.uniform(-1.0, 1.0, 3).tolist()
    return x * size[0], y * size[1], z * size[2]
