"""Bicycle that somebody rides, as an actor: frame with saddle, wheels, cranks and pedals.

Wheels, cranks and pedals turn with the distance. It neither steers nor leans in corners.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from math import sqrt

import numpy as np

from signals.samples import Vec3
from signals.units import TURN_RAD
from sim import _kernels
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.vehicles import bicycle as city
from sim.scene.maps.vehicles.kinds import Model, add_parts, part_material
from sim.scene.maps.vehicles.parts import Parts, Proxy
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
    size = bicycle.size
    model = _model(size)
    frame, *turning = builder.actor(bicycle)
    add_parts(builder, frame, model, paint, 0)
    # The saddle moves along its post.
    x, z = bicycle.saddle_m
    raised: Vec3 = (x - size * city.SADDLE_M[0], 0.0, z - size * (city.SADDLE_M[1] + city.SADDLE_HALF_M))
    made = [(frame, "saddle", raised)]
    made += [(body, piece.removesuffix("_front").removesuffix("_rear"), (0.0, 0.0, 0.0))
             for body, piece in zip(turning, _PIECES[1:], strict=True)]  # fmt: skip
    for body, piece, pos in made:
        for part, mesh in _meshes(piece, size).items():
            asset = builder.mesh(f"{model.name}_{piece}_{part}", mesh)
            material = part_material(builder, part, paint, 0)
            body.geom("mesh", asset=asset, material=material, pos=pos, solid=False, part=f"{piece}_{part}")
    saddle = _proxies(size)[-1]
    at = (x, 0.0, z - saddle.size[2])
    frame.proxy(saddle.kind, saddle.size, material="vehicle_trim", pos=at, part="proxy_saddle")


@cache
def _model(size: float) -> Model:
    """Return the model of the frame."""
    return Model(
        f"bicycle_ridden_{round(100 * size)}", "bicycle", "bicycle", lambda: _scaled(city.frame_parts(), size),
        lambda: _proxies(size)[:-1],
    )  # fmt: skip


_MAKERS: dict[str, Callable[[], Parts]] = {
    "saddle": city.saddle_parts,
    "wheel": city.wheel_parts,
    "cranks": city.crank_parts,
    "pedal_l": partial(city.pedal_parts, 1.0),
    "pedal_r": partial(city.pedal_parts, -1.0),
}


@cache
def _meshes(piece: str, size: float) -> Parts:
    return {part: mesh for part, mesh in _scaled(_MAKERS[piece](), size).items() if mesh.triangles}


def _scaled(parts: Parts, size: float) -> Parts:
    return {
        part: Mesh([(size * x, size * y, size * z) for x, y, z in mesh.vertices], mesh.uvs, mesh.triangles)
        for part, mesh in parts.items()
    }


def _proxies(size: float) -> list[Proxy]:
    """Return the contact shapes, the saddle's last."""
    return [
        Proxy(proxy.kind, tuple(size * value for value in proxy.size), tuple(size * value for value in proxy.pos))  # type: ignore[arg-type]
        for proxy in city.bicycle_proxies()
    ]
