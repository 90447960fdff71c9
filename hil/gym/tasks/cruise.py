"""Cruise: hold a course, a height and an airspeed with a plane, from a start beside them.

Features, float32, clipped to -1..1. V is the target airspeed, v the velocity over ground, u that through the air, t the
direction of the course, and "left" is seen along it:

    (z - height) / range_m,  (|u| - V) / V,  v.t / 2V,  v.left / V,  v_z / V     deviations
    R^T u / 2V                                                                    flow, in B
    R^T up,  w / 5 rad/s                                                          attitude, rates
    rotor speeds over their maximum,  surfaces over 1 rad

reward       1 / (1 + (dz / 10 m)^2 + (dV / 2 m/s)^2 + 10 (1 - cos of the error of the course)) of each step, less
             0.05 min(1, |w| / 5 rad/s)
terminated   contact, |dz| > `range_m`, upside down, slower than half of V, or beyond the limits of the model
truncated    after `episode_s`
is_success   in `info`: within 3 m, 1 m/s and 6 degrees for the last 5 s
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from pydantic import Field, model_validator

from hil.gym.flight import Flight
from hil.gym.options import FlightOptions
from hil.gym.target_task import random_vector
from hil.gym.task import Ends, Rewards, Step, Task, seed_of
from signals._kernel import det_cos, det_sin, rotate_into_body
from signals.errors import ConfigError
from signals.noise import NoiseStream
from signals.rotation import matrix_of, norm
from signals.samples import Quat, Vec3
from signals.units import RAD_PER_DEG
from sim.physics.fixed_wing import Airframe, is_plane
from sim.physics.multirotor import speed_radps

_DEVIATIONS = 5
_RATE_RADPS = 5.0
_NEAR_M, _NEAR_MPS, _NEAR_COS, _NEAR_S = 3.0, 1.0, 0.9945, 5.0
_PI = 3.141592653589793


class CruiseOptions(FlightOptions):
    """Start of the episode, around the target."""

    action: Literal["controls"] = "controls"
    episode_s: Annotated[float, Field(gt=0.0, le=86_400.0)] = 30.0
    height_m: Annotated[float, Field(ge=10.0, le=5000.0)] = 60.0  # above the start of the bench
    airspeed_mps: Annotated[float, Field(gt=0.0, le=150.0)] | None = None  # None: the vehicle's cruise
    start_offset_m: Annotated[float, Field(ge=0.0, le=1000.0)] = 5.0  # greatest, of the height
    start_course_deg: Annotated[float, Field(ge=0.0, le=180.0)] = 20.0  # greatest, to each side
    start_bank_deg: Annotated[float, Field(ge=0.0, le=60.0)] = 10.0  # greatest
    start_rate_radps: Annotated[float, Field(ge=0.0, le=20.0)] = 0.1  # greatest, on each axis
    range_m: Annotated[float, Field(gt=0.0, le=10_000.0)] = 30.0

    @model_validator(mode="after")
    def _begins_in_range(self) -> CruiseOptions:
        if self.start_offset_m >= min(self.range_m, self.height_m):
            raise ValueError(f"start_offset_m {self.start_offset_m:g} must be less than range_m and height_m")
        return self


class CruiseTask(Task):
    """Cruise of a batch."""

    Options = CruiseOptions
    bench = "gym_plane"

    def __init__(self, flights: Sequence[Flight], options: CruiseOptions, name: str) -> None:
        bench = flights[0].bench
        if not is_plane(bench.vehicle):
            message = f"vehicle: {bench.vehicle.name!r} is no plane, and this task flies one"
            raise ConfigError.at(name, message, 'settings=["vehicle=skywalker_x8"]')
        self.flights, self._o = list(flights), options
        count, vehicle = len(self.flights), bench.vehicle
        airframe = Airframe(vehicle, bench.scene.site)
        self._V = round(airframe.cruise_mps, 3) if options.airspeed_mps is None else options.airspeed_mps
        # Where the episode begins need not be the trim to the last bit, which depends on the machine's libraries.
        trim = airframe.trim(self._V)
        self._alpha_rad = round(trim.alpha_rad, 4)
        self._rotors_radps = [round(speed_radps(vehicle, trim.throttle), 1)] * len(vehicle.rotors)
        self.width = _DEVIATIONS + 9 + len(vehicle.rotors) + len(vehicle.servos)
        self.observation_space = Box(-1.0, 1.0, (self.width,), np.float32)
        self._course: list[Vec3] = [(1.0, 0.0, 0.0)] * count
        self._height = np.zeros(count)
        self._noise: dict[int, NoiseStream] = {}
        self._near = np.zeros(count, np.int64)  # steps in succession
        self._near_steps = max(1, round(_NEAR_S / options.step_s))
        # Error of height and airspeed, cosine of the error of the course, size of the rates, z of the body's up.
        self._measures = np.zeros((count, 5))

    def begin(self, row: int, flight: Flight, random: np.random.Generator) -> None:
        self.flights[row] = flight
        seed = seed_of(random)
        flight.restart(seed)
        o, V = self._o, self._V
        x, y, z = flight.truth.p_WB
        course = random.uniform(-_PI, _PI)
        self._course[row], self._height[row] = (det_cos(course), det_sin(course), 0.0), z + o.height_m
        yaw = course + random.uniform(-1.0, 1.0) * o.start_course_deg * RAD_PER_DEG
        bank = random.uniform(-1.0, 1.0) * o.start_bank_deg * RAD_PER_DEG
        up = self._height[row] + random.uniform(-1.0, 1.0) * o.start_offset_m
        wx, wy, wz = flight.physics.wind_W_mps
        flight.vehicle.place(
            (x, y, up),
            _attitude(yaw, -self._alpha_rad, bank),
            (V * det_cos(yaw) + wx, V * det_sin(yaw) + wy, wz),
            random_vector(random, (o.start_rate_radps,) * 3),
            self._rotors_radps,
        )
        self._noise.pop(row, None)
        if flight.draw.state_noise:
            self._noise[row] = NoiseStream(seed, "gym.state", lanes=self.width)
        self._near[row] = 0
        flight.begin(seed_of(random), (x, y, float(self._height[row])))

    def observe(self) -> NDArray[np.float32]:
        features = np.array([self._features(row) for row in range(len(self.flights))])
        for row, noise in self._noise.items():
            flight = self.flights[row]
            features[row] += flight.draw.state_noise * np.array(noise.normal(flight.world.tick))
        return np.clip(features, -1.0, 1.0).astype(np.float32)

    def _features(self, row: int) -> list[float]:
        """Return the features of one vehicle, and write its measures."""
        flight, V = self.flights[row], self._V
        truth, vehicle = flight.truth, flight.physics.vehicle
        v, (cx, cy, _) = truth.v_WB_W, self._course[row]
        wx, wy, wz = flight.physics.wind_W_mps
        u = rotate_into_body(truth.q_WB, (v[0] - wx, v[1] - wy, v[2] - wz))
        up, w = matrix_of(truth.q_WB)[6:9], truth.w_WB_B
        airspeed, ground = norm(u), norm((v[0], v[1], 0.0))
        along, left = v[0] * cx + v[1] * cy, v[1] * cx - v[0] * cy
        dz, dV = truth.p_WB[2] - float(self._height[row]), airspeed - V
        self._measures[row] = dz, dV, along / max(ground, 1e-9), norm(w), up[2]
        most = vehicle.rotor_constants.max_speed_radps
        return [
            *(dz / self._o.range_m, dV / V, along / (2.0 * V), left / V, v[2] / V),
            *(each / (2.0 * V) for each in u),
            *up,
            *(each / _RATE_RADPS for each in w),
            *(each / most for each in truth.rotor_speed_radps),
            *truth.surface_rad,
        ]

    def judge(self, step: Step) -> tuple[Rewards, Ends]:
        dz, dV, course, rate, up = self._measures.T
        near = (np.abs(dz) < _NEAR_M) & (np.abs(dV) < _NEAR_MPS) & (course > _NEAR_COS)
        self._near[step.flies] = np.where(near[step.flies], self._near[step.flies] + 1, 0)
        off = (0.1 * dz) * (0.1 * dz) + (0.5 * dV) * (0.5 * dV) + 10.0 * (1.0 - course)
        rewards = 1.0 / (1.0 + off) - 0.05 * np.minimum(1.0, rate / _RATE_RADPS)
        lost = (np.abs(dz) > self._o.range_m) | (up < 0.0) | (dV < -0.5 * self._V)
        return rewards, lost | step.crashed

    def info(self) -> dict[str, NDArray[Any]]:
        dz, dV, course, _, _ = self._measures.T
        return {
            "is_success": self._near >= self._near_steps,
            "height_error_m": dz,
            "airspeed_error_mps": dV,
            "course_cos": course,
        }

    def marks(self, row: int) -> Sequence[Vec3]:
        """The place on the course that is 5 s ahead."""
        x, y, _ = self.flights[row].truth.p_WB
        cx, cy, _ = self._course[row]
        return [(x + 5.0 * self._V * cx, y + 5.0 * self._V * cy, float(self._height[row]))]


def _attitude(yaw_rad: float, pitch_rad: float, bank_rad: float) -> Quat:
    """Return the attitude of body FLU in world ENU: about z, then y (nose down positive), then x (right wing down)."""
    (cy, sy), (cp, sp), (cr, sr) = ((det_cos(0.5 * a), det_sin(0.5 * a)) for a in (yaw_rad, pitch_rad, bank_rad))
    return (
        cy * cp * cr + sy * sp * sr,
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
    )
