"""Cars that drive along a closed path, as actors: the chassis and four rolling wheels.

They keep their path and speed; they do not stop for anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from signals.errors import ConfigError
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim import _kernels
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.model import Model
from sim.scene.maps.models import model
from sim.scene.maps.vehicles.kinds import add_drawn, add_parts
from sim.scene.maps.vehicles.paints import PLATES, draw_paint
from sim.scene.maps.walk_path import WalkPath
from sim.scene.random_generator import RandomGenerator

_MEASURES = ("length", "width", "height", "wheel")
_SIDES = ("left", "right")
_KINDS = ("sedan", "hatchback", "estate", "suv")


@dataclass(frozen=True)
class CarSize:
    """Measures of a car: radius of its wheels, and the middles of their outer faces, the left front one first."""

    length_m: float
    width_m: float
    height_m: float
    wheel_m: float
    wheels_m: tuple[Vec3, ...]

    @staticmethod
    def of(car: Model) -> CarSize:
        """Return the measures that a model states. Raises ConfigError if it does not."""
        facts = car.facts
        try:
            wheels = tuple((float(x), float(y), float(z)) for x, y, z in facts["wheels_m"])
            length_m, width_m, height_m, wheel_m = (float(facts[f"{name}_m"]) for name in _MEASURES)
        except (KeyError, TypeError, ValueError):
            wheels = ()
        if len(wheels) != 4 or not all(f"wheel_{side}" in car.pieces for side in _SIDES):
            message = (
                "drives, but lacks nodes wheel_left and wheel_right, or wheel_m and wheels_m in its scene's extras"
            )
            raise ConfigError.at(f"{car.name}.own.glb", message, f"see {car.name}.glb beside it")
        return CarSize(length_m, width_m, height_m, wheel_m, wheels)


class DrivenCar(_kernels.RoadVehicle):
    """`Actor` of a car; its bodies are the chassis and the wheels."""

    def __init__(self, name: str, shape: CarSize, path: WalkPath) -> None:
        self.name = name
        self.path, self.max_speed_mps = path, path.max_speed_mps
        self.shape = shape
        self.bodies = (f"{name}_chassis", *(f"{name}_wheel_{i}" for i in range(4)))
        turns_per_m = max(1, round(path.lap_m / (TURN_RAD * shape.wheel_m))) / path.lap_m
        middle = 0.5 * shape.height_m
        reach = sqrt(0.25 * shape.length_m * shape.length_m + 0.36 * shape.width_m * shape.width_m + middle * middle)
        super().__init__(
            path=path,
            wheels_B=np.array([(*centre, turns_per_m, 0.0) for centre in shape.wheels_m]),
            ground_m=0.0,
            bound_z_m=middle,
            bound_radius_m=reach + 0.1,
        )


def add_driven_car(builder: MapBuilder, rng: RandomGenerator, path: WalkPath) -> DrivenCar:
    """Add a car with its driver as an actor of the map."""
    kind = rng.pick(_KINDS)
    paint, plate = draw_paint(rng), rng.index(PLATES)
    driven = model(f"vehicles/{kind}_driven")
    builder.classify("vehicle", "car_*")
    car = DrivenCar(builder.next_name("car"), CarSize.of(driven), path)
    chassis, *wheels = builder.actor(car)
    add_parts(builder, chassis, driven, paint, plate)
    for wheel, (_, y, _) in zip(wheels, car.shape.wheels_m, strict=True):
        add_drawn(builder, wheel, driven, (paint, plate), piece=f"wheel_{_SIDES[y < 0.0]}")
    return car
