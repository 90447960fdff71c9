"""Wheels on level ground, with steering and brakes. Equations: sim/native/forces/wheels.cpp.

In a vehicle file:

    forces:
      - kind: wheels
        steering: {max_deg: 20, min_deg: -20, rate_degps: 200, time_constant_s: 0.05}    # +1: nose to the left
        wheels:
          - {name: nose, position_m: [0.30, 0, -0.20], radius_m: 0.04, stiffness_npm: 900, damping_nspm: 25, steers: 1}
          - {name: left, position_m: [-0.1, 0.2, -0.2], radius_m: 0.04, stiffness_npm: 1500, damping_nspm: 40}
          - {name: right, position_m: [-0.1, -0.2, -0.2], radius_m: 0.04, stiffness_npm: 1500, damping_nspm: 40}

The ground is level, at the height of the start (`start.p_W`): that of a runway. Hull, skids and belly touch the scene
as contact spheres, in MuJoCo; give a vehicle with wheels such spheres above its wheels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Literal

import pydantic
from pydantic import Field

from signals.documents.validate import StrictModel
from sim import _kernels
from sim.physics.forces.force import Command, Effects, ForceParameters, Point
from sim.physics.forces.surface import kernel_servo

_Degrees = Annotated[float, Field(ge=-85.0, le=85.0)]


_STEEPEST_RAD = math.radians(45.0)


def _zero(falling: Callable[[float], float], low: float, high: float) -> float:
    """Return where a falling function is 0, or the end nearest to it."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if falling(middle) > 0.0 else (low, middle)
    return 0.5 * (low + high)


class Steering(StrictModel):
    """Servo of the wheels that steer; a positive angle turns them to the left."""

    max_deg: _Degrees  # at command +1
    min_deg: _Degrees  # at command -1
    rate_degps: Annotated[float, Field(gt=0.0, le=10_000.0)] | None = None  # null: no limit
    time_constant_s: Annotated[float, Field(ge=1e-3, le=2.0)] = 0.05


class Wheel(StrictModel):
    """One wheel with its strut; strut and tyre are one spring with one damper."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    position_m: Point  # middle of the axle without load, in B
    radius_m: Annotated[float, Field(gt=1e-3, le=2.0)]
    stiffness_npm: Annotated[float, Field(ge=10.0, le=1e6)]
    damping_nspm: Annotated[float, Field(ge=0.0, le=1e5)]
    friction: Annotated[float, Field(gt=0.01, le=3.0)] = 0.8  # rubber on dry asphalt
    rolling: Annotated[float, Field(ge=0.0, le=1.0)] = 0.03  # small tyre on asphalt; 0.05 to 0.1 on short grass
    cornering_per_rad: Annotated[float, Field(gt=0.1, le=100.0)] = 8.0  # cornering stiffness over load
    slide_m: Annotated[float, Field(ge=5e-4, le=0.1)] = 5e-3  # deflection of the contact patch at which it slides
    steers: Annotated[float, Field(ge=-1.0, le=1.0)] = 0.0  # share of the steering angle
    brakes: Annotated[float, Field(ge=0.0, le=3.0)] = 0.0  # friction that the brake adds at command 1
    castering: bool = False  # it turns freely into its way: no side force

    @pydantic.model_validator(mode="after")
    def _one_thing(self) -> Wheel:
        if self.castering and self.steers:
            raise ValueError(f"wheel {self.name}: one that is castering does not steer")
        return self


class Wheels(ForceParameters):
    """Wheels of a vehicle. Commands: steering (-1..1) if a wheel steers, then brake (0..1) if one brakes."""

    kind: Literal["wheels"]
    wheels: Annotated[tuple[Wheel, ...], Field(min_length=1, max_length=4)]
    steering: Steering | None = None

    @pydantic.model_validator(mode="after")
    def _fits(self) -> Wheels:
        names = [wheel.name for wheel in self.wheels]
        if len(set(names)) != len(names):
            raise ValueError(f"wheels must have different names, not {names}")
        steers = any(wheel.steers for wheel in self.wheels)
        if steers != (self.steering is not None):
            raise ValueError("steering needs a wheel that steers, and a wheel that steers needs steering")
        return self

    @property
    def commands(self) -> tuple[Command, ...]:
        commands = []
        if self.steering is not None:
            commands.append(Command("steering", signed=True))
        if any(wheel.brakes > 0.0 for wheel in self.wheels):
            commands.append(Command("brake", signed=False))
        return tuple(commands)

    def standing_height_m(self, weight_n: float) -> float:
        """Return the height of the body origin over the ground on which its wheels stand, level, by their loads' sum.

        The struts are compressed as those of a level vehicle with its centre of mass amid them: where it settles
        differs by what makes it pitch.
        """
        bare = max(wheel.radius_m - wheel.position_m[2] for wheel in self.wheels)
        touching = [w for w in self.wheels if bare - (w.radius_m - w.position_m[2]) < 1e-3]
        return bare - weight_n / sum(wheel.stiffness_npm for wheel in touching)

    def standing_pitch_rad(self, weight_n: float) -> float:
        """Return the pitch at which the moments of the wheels' loads about the centre of mass are in balance.

        With the compressions d_i = r_i - h - x_i sin(pitch) - z_i cos(pitch) of a body at the height h: sum k_i d_i is
        the weight, and sum k_i d_i (x_i cos(pitch) - z_i sin(pitch)) is 0, over the wheels that touch (d_i > 0).
        """

        def loads(pitch: float, height: float) -> list[float]:
            s, c = math.sin(pitch), math.cos(pitch)
            low = [w.radius_m - height - w.position_m[0] * s - w.position_m[2] * c for w in self.wheels]
            return [w.stiffness_npm * max(d, 0.0) for w, d in zip(self.wheels, low, strict=True)]

        def tips_back(pitch: float) -> float:  # above 0: the nose rises
            high = max(w.radius_m + math.hypot(*w.position_m) for w in self.wheels)
            height = _zero(lambda h: sum(loads(pitch, h)) - weight_n, -high, high)
            s, c = math.sin(pitch), math.cos(pitch)
            arms = [w.position_m[0] * c - w.position_m[2] * s for w in self.wheels]
            return sum(n * arm for n, arm in zip(loads(pitch, height), arms, strict=True))

        return _zero(tips_back, -_STEEPEST_RAD, _STEEPEST_RAD)

    @property
    def rolling_resistance(self) -> float:
        return max(wheel.rolling for wheel in self.wheels)

    def make(self, effects: Effects) -> _kernels.Wheels:
        del effects
        steering = []
        if self.steering is not None:
            s = self.steering
            steering.append(kernel_servo(s.max_deg, s.min_deg, s.rate_degps, s.time_constant_s))
        return _kernels.Wheels(
            wheels=[
                (
                    *w.position_m,
                    w.radius_m,
                    w.stiffness_npm,
                    w.damping_nspm,
                    w.friction,
                    w.rolling,
                    w.cornering_per_rad,
                    w.slide_m,
                    w.steers,
                    w.brakes,
                )
                for w in self.wheels
            ],
            castering=[w.castering for w in self.wheels],
            steering=steering,
            ground_m=0.0,
        )
