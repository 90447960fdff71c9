"""Parked cars and vans: a mesh body, glass, four wheels."""

from __future__ import annotations

from sim.scene.maps import surfaces
from sim.scene.maps.map_builder import MapBuilder, pitch_quat, roll_quat, yaw_quat
from sim.scene.maps.meshes import extrude_xz
from sim.scene.random_generator import RandomGenerator

_PAINTS = {
    "silver": (0.70, 0.72, 0.74), "black": (0.09, 0.09, 0.10), "white": (0.92, 0.92, 0.91), "red": (0.62, 0.08, 0.07),
    "blue": (0.10, 0.20, 0.45), "green": (0.12, 0.28, 0.20), "olive": (0.31, 0.33, 0.20),
}  # fmt: skip
_QUARTER_TURN_RAD = 1.5707963267948966
# Profiles (x, z) seen from the right, front towards +x.
_SEDAN_LOW = [(-2.15, 0.28), (2.15, 0.28), (2.2, 0.55), (2.1, 0.78), (1.0, 0.92), (-1.9, 0.95), (-2.2, 0.75)]
_SEDAN_TOP = [(-1.55, 0.94), (1.02, 0.92), (0.30, 1.42), (-0.95, 1.45)]
_VAN_LOW = [(-2.5, 0.32), (2.45, 0.32), (2.5, 0.75), (2.3, 1.12), (-2.5, 1.12)]
_VAN_TOP = [(-2.5, 1.12), (2.3, 1.12), (1.55, 2.05), (1.2, 2.15), (-2.45, 2.15)]


def add_car(
    builder: MapBuilder,
    rng: RandomGenerator,
    x: float,
    y: float,
    heading_rad: float,
    *,
    van: bool = False,
    paint: str = "",
) -> None:
    """Add a car of 4.4 x 1.8 m or a van of 5 x 2 m: 7 geoms."""
    builder.material("tyre", surfaces.RUBBER, rgb=(0.07, 0.07, 0.07), specular=0.0)
    builder.material("car_glass", surfaces.GLASS, rgb=(0.12, 0.16, 0.20), specular=0.8, shininess=0.8)
    builder.material("headlamp", surfaces.GLASS, rgb=(0.92, 0.92, 0.86), specular=0.8, shininess=0.8)
    paint = paint or rng.pick(tuple(_PAINTS)[:-1])
    material = builder.material(f"car_{paint}", surfaces.PAINTED_METAL, rgb=_PAINTS[paint], specular=0.6, shininess=0.6)
    kind = "van" if van else "sedan"
    half = 0.98 if van else 0.88
    low = builder.mesh(f"{kind}_low", extrude_xz(_VAN_LOW if van else _SEDAN_LOW, half))
    top = builder.mesh(f"{kind}_top", extrude_xz(_VAN_TOP if van else _SEDAN_TOP, half - 0.08))
    body = builder.body("vehicle", (x, y, 0.0), yaw_quat(heading_rad))
    body.geom("mesh", asset=low, material=material, part="body")
    body.geom("mesh", asset=top, material=material if van else "car_glass", part="cabin")
    if van:
        body.geom(
            "box", (0.02, 0.75, 0.36), pos=(1.98, 0.0, 1.58), quat=pitch_quat(-0.68), material="car_glass", solid=False
        )
    else:
        body.geom("box", (0.62, 0.76, 0.02), pos=(-0.32, 0.0, 1.45), material=material, part="roof", solid=False)
    wheel = roll_quat(_QUARTER_TURN_RAD)
    axle = 1.55 if van else 1.32
    for i, (px, py) in enumerate(((axle, half), (axle, -half), (-axle, half), (-axle, -half))):
        py -= 0.06 if py > 0 else -0.06
        body.geom("cylinder", (0.32, 0.11), pos=(px, py, 0.32), quat=wheel, material="tyre", part=f"wheel_{i}")
