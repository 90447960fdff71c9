"""Bicycle that somebody rides, as an actor: frame with saddle, wheels, cranks and pedals.

Wheels, cranks and pedals turn with the distance. It neither steers nor leans in corners.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from signals.samples import Vec3
from signals.units import TURN_RAD
from sim import _kernels
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.models import model
from sim.scene.maps.vehicles import bicycle_layout as city
from sim.scene.maps.vehicles.kinds import add_drawn
from sim.scene.maps.vehicles.paints import vehicle_materials
from sim.scene.maps.walk_path import WalkPath

_GEAR = 2.0  # turns of a wheel for one of the cranks
_PIECES = ("frame", "wheel_front", "wheel_rear", "cranks", "pedal_l", "pedal_r")  # the bodies


class RiddenBicycle(_kernels.RoadVehicle):
    """`Actor` of a bicycle. `size`: 1 for an adult's; `saddle_m`: x and z of the top of the saddle."""

    def __init__(
        self, name: str, path: WalkPath, size: float, saddle_m: tuple[float, float], *, ground_m: float
    ) -> None:
        self.name = name
        self.path, self.max_speed_mps = path, path.max_speed_mps
        self.size, self.saddle_m = size, saddle_m
        self.bodies = tuple(f"{name}_{piece}" for piece in _PIECES)
        self.wheel_m, self.crank_m = size * city.WHEEL_M, size * city.CRANK_M
        # A lap has a whole number of turns, so that nothing jumps at its end.
        round_m = TURN_RAD * self.wheel_m
        self.wheel_turns_per_m = max(1, round(path.lap_m / round_m)) / path.lap_m
        self.crank_turns_per_m = max(1, round(path.lap_m / (_GEAR * round_m))) / path.lap_m
        x, z = (size * value for value in city.CRANK_AXLE_M)
        middle = 0.5 * size * city.HEIGHT_M
        high = max(saddle_m[1], size * city.HEIGHT_M) - middle
        half_length, half_width = 0.52 * size * city.LENGTH_M, 0.5 * size * city.WIDTH_M
        super().__init__(
            path=path,
            wheels_B=np.array([
                *((size * axle, 0.0, self.wheel_m, self.wheel_turns_per_m, 0.0) for axle in city.AXLES_M),
                *((x, 0.0, z, self.crank_turns_per_m, arm) for arm in (0.0, self.crank_m, -self.crank_m)),
            ]),
            ground_m=ground_m,
            bound_z_m=ground_m + middle,
            bound_radius_m=sqrt(half_length * half_length + half_width * half_width + high * high) + 0.05,
        )  # fmt: skip


def add_ridden_bicycle(builder: MapBuilder, bicycle: RiddenBicycle, paint: str) -> None:
    """Add the bicycle as an actor of the map."""
    builder.classify("bicycle", "bicycle_*")
    vehicle_materials(builder)
    size, made = bicycle.size, model("vehicles/bicycle_ridden")
    frame, *turning = builder.actor(bicycle)
    add_drawn(builder, frame, made, (paint, 0), piece="frame", scale=size)
    *contacts, saddle = made.contacts
    for i, contact in enumerate(contacts):
        half, (x, y, z) = tuple(size * v for v in contact.size), contact.pos
        frame.proxy(contact.kind, half, pos=(size * x, size * y, size * z), material="vehicle_trim", part=f"proxy_{i}")
    # The saddle moves along its post.
    x, z = bicycle.saddle_m
    raised: Vec3 = (x - size * city.SADDLE_M[0], 0.0, z - size * (city.SADDLE_M[1] + city.SADDLE_HALF_M))
    add_drawn(builder, frame, made, (paint, 0), piece="saddle", prefix="saddle_", scale=size, pos=raised)
    for body, name in zip(turning, _PIECES[1:], strict=True):
        piece = name.removesuffix("_front").removesuffix("_rear")
        add_drawn(builder, body, made, (paint, 0), piece=piece, prefix=f"{piece}_", scale=size)
    half = tuple(size * v for v in saddle.size)
    frame.proxy(saddle.kind, half, material="vehicle_trim", pos=(x, 0.0, z - half[2]), part="proxy_saddle")
