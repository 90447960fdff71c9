"""Kinds of vehicles, and one vehicle of a kind at a place."""

from __future__ import annotations

from signals.samples import Vec3
from sim.scene.maps.map_builder import MapBuilder, yaw_quat
from sim.scene.maps.vehicles.car import car_parts
from sim.scene.maps.vehicles.car_shape import SHAPES
from sim.scene.maps.vehicles.paints import draw_paint, paint_material, vehicle_materials
from sim.scene.random_generator import RandomGenerator


def add_vehicle(
    builder: MapBuilder, rng: RandomGenerator, kind: str, x: float, y: float, heading_rad: float, *, paint: str = "",
    ground_m: float = 0.0,
) -> None:
    vehicle_materials(builder)
    parts = car_parts(SHAPES[kind])
    body = builder.body("car", (x, y, ground_m), yaw_quat(heading_rad))
    paint = paint or draw_paint(rng)
    for name, mesh in parts.items():
        material = paint_material(builder, paint) if name == "paint" else "vehicle_plate_0" if name == "plate" else f"vehicle_{name}"
        asset = builder.mesh(f"{kind}_{name}", mesh)
        body.geom("mesh", asset=asset, material=material, solid=False, part=name)
