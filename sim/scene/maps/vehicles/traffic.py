"""Cars that drive along a closed path, as actors: the chassis and four rolling wheels.

They keep their path and speed; they do not stop for anything.
"""

from __future__ import annotations

from functools import cache
from math import sqrt

import numpy as np

from signals.units import TURN_RAD
from sim import _kernels
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.vehicles.car import car_parts, car_proxies, wheel_centres, wheel_parts
from sim.scene.maps.vehicles.car_shape import SHAPES, CarShape
from sim.scene.maps.vehicles.kinds import Model, add_parts, part_material
from sim.scene.maps.vehicles.paints import PLATES, draw_paint
from sim.scene.maps.walk_path import WalkPath
from sim.scene.random_generator import RandomGenerator

_SPOKES = 5
_KINDS = ("sedan", "hatchback", "estate", "suv")


class DrivenCar(_kernels.RoadVehicle):
    """`Actor` of a car; its bodies are the chassis and the wheels."""

    def __init__(self, name: str, shape: CarShape, path: WalkPath) -> None:
        self.name = name
        self.path, self.max_speed_mps = path, path.max_speed_mps
        self.shape = shape
        self.bodies = (f"{name}_chassis", *(f"{name}_wheel_{i}" for i in range(4)))
        turns_per_m = max(1, round(path.lap_m / (TURN_RAD * shape.wheel_m))) / path.lap_m
        middle = 0.5 * shape.height_m
        reach = sqrt(0.25 * shape.length_m * shape.length_m + 0.36 * shape.width_m * shape.width_m + middle * middle)
        super().__init__(
            path=path,
            wheels_B=np.array([(*centre, turns_per_m, 0.0) for centre in wheel_centres(shape)]),
            ground_m=0.0,
            bound_z_m=middle,
            bound_radius_m=reach + 0.1,
        )


@cache
def _model(kind: str) -> Model:
    """Return the model of a chassis with its driver."""
    shape = SHAPES[kind]
    return Model(
        f"{kind}_driven", "car", "vehicle",
        lambda: car_parts(shape, driver=True, wheels=False), lambda: car_proxies(shape)[:2],
    )  # fmt: skip


def add_driven_car(builder: MapBuilder, rng: RandomGenerator, path: WalkPath) -> DrivenCar:
    """Add a car with its driver as an actor of the map."""
    kind = rng.pick(_KINDS)
    paint, plate = draw_paint(rng), rng.index(PLATES)
    shape, model = SHAPES[kind], _model(kind)
    builder.classify("vehicle", "car_*")
    car = DrivenCar(builder.next_name("car"), shape, path)
    chassis, *wheels = builder.actor(car)
    add_parts(builder, chassis, model, paint, plate)
    for wheel, (_, y, _) in zip(wheels, wheel_centres(shape), strict=True):
        side = 1.0 if y > 0.0 else -1.0
        for part, mesh in wheel_parts(shape, _SPOKES, side).items():
            asset = builder.mesh(f"{kind}_wheel_{'left' if side > 0 else 'right'}_{part}", mesh)
            wheel.geom(
                "mesh", asset=asset, material=part_material(builder, part, paint, plate), solid=False, part=part,
            )  # fmt: skip
    return car
