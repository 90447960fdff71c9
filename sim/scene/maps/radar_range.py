"""Radar range: flat asphalt, one person who walks away from the origin and back, and corner reflectors.

The person walks along `direction_deg` and turns `near_m` and `far_m` from the origin. A reflector is three square
plates at right angles, with its axis (1, 1, 1) towards the point `aim_m` above the origin; with edge a its radar
cross-section on the axis is 12 pi a^4 / lambda^2.
"""

from __future__ import annotations

from math import sqrt
from typing import Annotated

from pydantic import Field, model_validator

from signals._kernel import det_cos, det_sin
from signals.documents.validate import StrictModel
from signals.samples import Quat
from signals.units import TURN_RAD
from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.people import PersonTraits, add_walker
from sim.scene.maps.walk_path import there_and_back
from sim.scene.random_generator import RandomGenerator
from sim.scene.scene_map import CornerReflector, SceneMap

Distance = Annotated[float, Field(gt=0.0, le=200.0)]


class Reflector(StrictModel):
    """Corner reflector: position of its corner (z above ground) and edge of its plates."""

    range_m: Annotated[float, Field(ge=4.5, le=200.0)]
    azimuth_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    height_m: Annotated[float, Field(ge=0.0, le=20.0)] = 1.2
    edge_m: Annotated[float, Field(gt=0.0, le=1.0)] = 0.2


class Parameters(StrictModel):
    """Parameters of the walk and the reflectors."""

    near_m: Distance = 1.0
    far_m: Distance = 7.0
    direction_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 0.0
    speed_mps: Annotated[float, Field(ge=0.5, le=2.0)] = 1.2
    lane_m: Annotated[float, Field(ge=0.3, le=3.0)] = 0.5
    height_m: Annotated[float, Field(ge=1.2, le=2.1)] = 1.75
    start_lap: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    person: bool = True
    aim_m: Annotated[float, Field(ge=0.0, le=20.0)] = 1.8
    reflectors: tuple[Reflector, ...] = (
        Reflector(range_m=5.0, azimuth_deg=25.0),
        Reflector(range_m=8.0, azimuth_deg=-22.0, edge_m=0.3),
        Reflector(range_m=11.0, azimuth_deg=10.0, height_m=2.0),
    )

    @model_validator(mode="after")
    def _in_order(self) -> Parameters:
        if self.far_m < self.near_m + 2.0 * self.lane_m:
            raise ValueError("far_m must exceed near_m by at least two lanes, for the walk to fit")
        return self


def _turn_diagonal_to(direction: tuple[float, float, float]) -> Quat:
    """Return the shortest rotation from (1, 1, 1) / sqrt 3 to a unit vector: q = (1 + a.b, a x b) normalised."""
    third = sqrt(1.0 / 3.0)
    x, y, z = direction
    w = 1.0 + third * (x + y + z)
    qx, qy, qz = third * (z - y), third * (x - z), third * (y - x)
    norm = sqrt(w * w + qx * qx + qy * qy + qz * qz)
    return w / norm, qx / norm, qy / norm, qz / norm


def _add_reflector(builder: MapBuilder, reflector: Reflector, aim_m: float) -> None:
    angle = TURN_RAD * reflector.azimuth_deg / 360.0
    x, y, z = reflector.range_m * det_cos(angle), reflector.range_m * det_sin(angle), reflector.height_m
    dx, dy, dz = -x, -y, aim_m - z
    length = sqrt(dx * dx + dy * dy + dz * dz)
    q_WK = _turn_diagonal_to((dx / length, dy / length, dz / length))
    body = builder.body("reflector", (x, y, z), q_WK)
    builder.corner(CornerReflector((x, y, z), q_WK, reflector.edge_m, "reflector"))
    half, t = 0.5 * reflector.edge_m, 0.001
    # The inner faces meet at the body's origin.
    body.geom("box", (t, half, half), pos=(-t, half, half), material="steel", part="plate_x")
    body.geom("box", (half, t, half), pos=(half, -t, half), material="steel", part="plate_y")
    body.geom("box", (half, half, t), pos=(half, half, -t), material="steel", part="plate_z")
    stand = builder.body("stand", (x, y, 0.0))
    # A plastic mast behind the corner has almost no echo.
    top = max(reflector.height_m - 0.05, 0.05)
    stand.geom("cylinder", (0.02, top / 2), pos=(0.0, 0.0, top / 2), material="plastic", part="mast")
    stand.geom("cylinder", (0.22, 0.02), pos=(0.0, 0.0, 0.02), material="plastic", part="foot")


def generate(parameters: Parameters, seed: int) -> SceneMap:
    builder = MapBuilder("radar_range")
    builder.texture("asphalt", textures.png("clean_asphalt"))
    builder.material("asphalt", surfaces.ASPHALT, texture="asphalt", tile_m=6.0, specular=0.0)
    builder.material("steel", surfaces.METAL, rgb=(0.72, 0.74, 0.77), specular=0.6, shininess=0.6)
    builder.material("plastic", surfaces.PLASTIC, rgb=(0.90, 0.90, 0.88))
    builder.material("road_paint", surfaces.ROAD_PAINT, rgb=(0.93, 0.93, 0.91), specular=0.0)
    builder.ground("plane", (0.0, 0.0, 1.0), material="asphalt")
    angle = TURN_RAD * parameters.direction_deg / 360.0
    c, s = det_cos(angle), det_sin(angle)
    marks = builder.body("marking", (0.0, 0.0, 0.0), (det_cos(0.5 * angle), 0.0, 0.0, det_sin(0.5 * angle)))
    metres = range(1, min(int(parameters.far_m), 40) + 1)
    for metre in metres:
        half = 0.6 if metre % 5 == 0 else 0.3
        at = (float(metre), 0.0, -0.002)
        marks.geom("box", (0.02, half, 0.005), pos=at, material="road_paint", solid=False, part=f"metre_{metre}")
    for reflector in parameters.reflectors:
        _add_reflector(builder, reflector, parameters.aim_m)
    if parameters.person:
        near, far = parameters.near_m, parameters.far_m
        path = there_and_back(
            (near * c, near * s),
            (far * c, far * s),
            parameters.speed_mps,
            lane_m=parameters.lane_m,
            start_lap=parameters.start_lap,
        )
        add_walker(
            builder,
            RandomGenerator(seed, "radar_range.person"),
            path,
            traits=PersonTraits(height_m=parameters.height_m),
        )
    builder.classify("ground", "ground")
    return builder.build()
