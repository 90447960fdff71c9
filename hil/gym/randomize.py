"""Random vehicles: mass, inertia, motors, drag, wind, delay and noise that differ from episode to episode.

    factor       of mass, inertia, motor_lag and drag: even between its limits; 0.2 means 0.8 to 1.2
    wind_mps     greatest speed of a steady wind that is added to the bench's; even, from an even direction, horizontal
    delay_s      greatest delay of an action, even, in whole ticks
    sensor_noise limits of a factor on all errors of each observed camera, LiDAR, IMU and GPS, even in its logarithm
    state_noise  greatest deviation of white noise on each feature of the state; even

A draw is a pure function of the seed of the episode and its own name (signals.noise), so that no draw changes another.
The ideal controller stays that of the bench's vehicle, as the firmware of a real one does not know its errors.
"""

from __future__ import annotations

from math import pi
from typing import Annotated, NamedTuple

from pydantic import AfterValidator, Field, model_validator

from signals._kernel import det_cos, det_sin
from signals.documents.validate import StrictModel
from signals.noise import NoiseStream
from signals.samples import Vec3
from sim.physics.forces.rotors import RotorConstants
from sim.physics.vehicle import Vehicle
from sim.randomize.settings import NoiseLimits
from sim.randomize.settings import Randomize as SceneRandomize

_Factor = Annotated[float, Field(ge=0.1, le=10.0)]


_Share = Annotated[float, Field(ge=0.0, le=0.9)]


def _limits(value: tuple[float, float] | float | None) -> tuple[float, float] | None:
    """Return 1 - x and 1 + x for a number x."""
    return (1.0 - value, 1.0 + value) if isinstance(value, float) else value


_Factors = Annotated[tuple[_Factor, _Factor] | _Share | None, AfterValidator(_limits)]


class Randomize(StrictModel):
    """Limits of the draws of an episode; without a key it is as in the bench."""

    mass: _Factors = None
    inertia: _Factors = None
    motor_lag: _Factors = None
    drag: _Factors = None  # of body and rotors
    wind_mps: Annotated[float, Field(ge=0.0, le=50.0)] = 0.0
    delay_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    sensor_noise: (
        tuple[Annotated[float, Field(ge=0.01, le=100.0)], Annotated[float, Field(ge=0.01, le=100.0)]] | None
    ) = None
    state_noise: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Randomize:
        for name in ("mass", "inertia", "motor_lag", "drag", "sensor_noise"):
            limits = getattr(self, name)
            if limits is not None and limits[0] > limits[1]:
                raise ValueError(f"{name}: the lower limit {limits[0]:g} is above the upper one {limits[1]:g}")
        return self

    def draw(self, seed: int) -> Draw:
        """Return the choices of the episode with this seed."""

        def factor(name: str, limits: tuple[float, float] | float | None) -> float:
            if not isinstance(limits, tuple):  # None: a number was made a pair when it was read
                return 1.0
            return limits[0] + (limits[1] - limits[0]) * _unit(seed, name)

        speed_mps = self.wind_mps * _unit(seed, "wind_speed") if self.wind_mps else 0.0
        heading = 2.0 * pi * _unit(seed, "wind_direction") if self.wind_mps else 0.0
        return Draw(
            factor("mass", self.mass),
            factor("inertia", self.inertia),
            factor("motor_lag", self.motor_lag),
            factor("drag", self.drag),
            (speed_mps * det_cos(heading), speed_mps * det_sin(heading), 0.0),
            self.delay_s * _unit(seed, "delay") if self.delay_s else 0.0,
            self.state_noise * _unit(seed, "state_noise") if self.state_noise else 0.0,
        )

    def scene(self) -> SceneRandomize | None:
        """Return the section `randomize` of a bench that draws the noise of sensors; None: that of the bench stays."""
        if self.sensor_noise is None:
            return None
        limits = dict.fromkeys(NoiseLimits.model_fields, self.sensor_noise)
        return SceneRandomize(noise=NoiseLimits.model_validate(limits))


# `randomize=True`: what a small multirotor and its payload may differ by.
EVERYTHING = Randomize(
    mass=0.2,
    inertia=0.2,
    motor_lag=0.3,
    drag=0.5,
    wind_mps=3.0,
    delay_s=0.02,
    sensor_noise=(0.5, 2.0),
    state_noise=0.01,
)


def switch(value: Randomize | bool | None) -> Randomize | None:
    """Return the settings of `randomize`: True is everything, False nothing."""
    return (EVERYTHING if value else None) if isinstance(value, bool) else value


class Draw(NamedTuple):
    """Choices of one episode: four factors, and what is added."""

    mass: float = 1.0
    inertia: float = 1.0
    motor_lag: float = 1.0
    drag: float = 1.0
    wind_W_mps: Vec3 = (0.0, 0.0, 0.0)
    delay_s: float = 0.0
    state_noise: float = 0.0

    def applied_to(self, v: Vehicle) -> Vehicle:
        """Return the vehicle with the factors."""
        lag, drag = self.motor_lag, self.drag

        def changed(c: RotorConstants) -> RotorConstants:
            return c.model_copy(
                update={
                    "time_constant_up_s": lag * c.time_constant_up_s,
                    "time_constant_down_s": lag * c.time_constant_down_s,
                    # The lag of a motor is proportional to the inertia that it turns.
                    "inertia_kgm2": c.inertia_kgm2 if c.motor is None else lag * c.inertia_kgm2,
                    "drag_kg_per_rad": drag * c.drag_kg_per_rad,
                }
            )

        x, y, z = v.inertia_kgm2
        f = self.inertia
        linear, quadratic = v.body_drag_linear_n_per_mps, v.body_drag_quadratic_n_per_m2ps2
        return v.model_copy(
            update={
                "mass_kg": self.mass * v.mass_kg,
                "inertia_kgm2": (f * x, f * y, f * z),
                "rotor_constants": changed(v.rotor_constants),
                "rotor_sets": {
                    name: of.model_copy(update={"rotor_constants": changed(of.rotor_constants)})
                    for name, of in v.rotor_sets.items()
                },
                "body_drag_linear_n_per_mps": (drag * linear[0], drag * linear[1], drag * linear[2]),
                "body_drag_quadratic_n_per_m2ps2": (drag * quadratic[0], drag * quadratic[1], drag * quadratic[2]),
            }
        )


def _unit(seed: int, name: str) -> float:
    """Return a number on (0, 1) that belongs to seed and name."""
    return float(NoiseStream(seed, f"gym.randomize.{name}").uniform_block(0)[0, 0])
