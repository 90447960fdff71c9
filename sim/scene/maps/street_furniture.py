"""Benches, lamps, bins, fences and playgrounds. An object has x along it, y to its front, and the ground at z = 0."""

from __future__ import annotations

from signals.units import QUARTER_TURN_RAD
from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.map_builder import MapBuilder, pitch_quat, roll_quat, yaw_quat
from sim.scene.maps.models import model

SEAT_M = 0.45  # height of a bench's seat


def furniture_materials(builder: MapBuilder) -> None:
    builder.texture("wood", textures.png("wood"))
    builder.material("wood", surfaces.WOOD, texture="wood", tile_m=0.6)
    builder.material("iron", surfaces.PAINTED_METAL, rgb=(0.10, 0.13, 0.12), specular=0.4)
    builder.material("steel", surfaces.METAL, rgb=(0.62, 0.64, 0.66), specular=0.6, shininess=0.6)
    builder.material("lamp_glass", surfaces.GLASS, rgb=(0.97, 0.95, 0.85))
    builder.material("paint_red", surfaces.PAINTED_METAL, rgb=(0.75, 0.13, 0.10), specular=0.4)
    builder.material("paint_blue", surfaces.PAINTED_METAL, rgb=(0.10, 0.30, 0.62), specular=0.4)
    builder.material("paint_yellow", surfaces.PAINTED_METAL, rgb=(0.90, 0.72, 0.12), specular=0.4)
    builder.material("paint_green", surfaces.PAINTED_METAL, rgb=(0.15, 0.36, 0.22), specular=0.3)


def add_bench(builder: MapBuilder, x: float, y: float, heading_rad: float) -> None:
    """Add a bench of slats, 1.6 m wide; a person on it faces along `heading_rad`. 2 drawn geoms."""
    body = builder.body("bench", (x, y, 0.0), yaw_quat(heading_rad - QUARTER_TURN_RAD))
    for piece, material in (("slats", "wood"), ("iron", "iron")):
        asset = builder.mesh(f"bench_{piece}", model("objects/bench").mesh(piece))
        body.geom("mesh", asset=asset, material=material, solid=False, part=piece)
    body.proxy("box", (0.8, 0.22, 0.025), pos=(0.0, 0.0, SEAT_M - 0.025), material="wood", part="seat")
    back = roll_quat(QUARTER_TURN_RAD + 0.17)
    pos = (0.0, -0.26, SEAT_M + 0.28)
    body.proxy("box", (0.8, 0.20, 0.02), pos=pos, quat=back, material="wood", part="back")
    for side in (-1.0, 1.0):
        name = "left" if side < 0 else "right"
        pos = (0.68 * side, -0.02, 0.2)
        body.proxy("box", (0.03, 0.22, 0.2), pos=pos, material="iron", part=f"leg_{name}")


def add_lamp(builder: MapBuilder, x: float, y: float, *, height_m: float = 3.6) -> None:
    """Add a park lamp: post, bowl, hat."""
    body = builder.body("lamp", (x, y, 0.0))
    body.geom("cylinder", (0.055, height_m / 2), pos=(0.0, 0.0, height_m / 2), material="iron", part="post")
    body.geom("sphere", (0.19,), pos=(0.0, 0.0, height_m + 0.12), material="lamp_glass", part="bowl")
    body.geom("cylinder", (0.24, 0.03), pos=(0.0, 0.0, height_m + 0.33), material="iron", part="hat")


def add_street_lamp(builder: MapBuilder, x: float, y: float, heading_rad: float) -> None:
    """Add a lamp of 6.5 m with an arm along `heading_rad`, over the street."""
    body = builder.body("lamp", (x, y, 0.0), yaw_quat(heading_rad))
    body.geom("cylinder", (0.08, 3.25), pos=(0.0, 0.0, 3.25), material="steel", part="post")
    body.rod(0.05, (0, 0, 6.45, 1.5, 0, 6.7), material="steel", part="arm")
    body.geom("box", (0.35, 0.12, 0.06), pos=(1.6, 0.0, 6.68), material="lamp_glass", part="head")


def add_bin(builder: MapBuilder, x: float, y: float) -> None:
    body = builder.body("bin", (x, y, 0.0))
    body.geom("cylinder", (0.24, 0.42), pos=(0.0, 0.0, 0.42), material="paint_green", part="drum")
    body.geom("cylinder", (0.26, 0.03), pos=(0.0, 0.0, 0.87), material="iron", part="lid")


def add_swing(builder: MapBuilder, x: float, y: float, heading_rad: float) -> None:
    """Add two A-frames, a bar and two seats."""
    body = builder.body("playground", (x, y, 0.0), yaw_quat(heading_rad))
    for side in (-1.7, 1.7):
        for foot in (-0.8, 0.8):
            part = f"leg_{'l' if side < 0 else 'r'}{'f' if foot > 0 else 'b'}"
            body.rod(0.05, (side, foot, 0, side, 0, 2.3), material="paint_red", part=part)
    body.rod(0.05, (-1.8, 0, 2.3, 1.8, 0, 2.3), material="paint_red", part="bar")
    for i, seat in enumerate((-0.75, 0.75)):
        body.geom("box", (0.24, 0.11, 0.02), pos=(seat, 0.0, 0.5), material="wood", part=f"seat_{i}")
        for end in (-0.22, 0.22):
            part = f"rope_{i}{'l' if end < 0 else 'r'}"
            rope = (seat + end, 0.0, 0.5, seat + end, 0.0, 2.3)
            body.rod(0.012, rope, material="steel", part=part, solid=False)


def add_slide(builder: MapBuilder, x: float, y: float, heading_rad: float) -> None:
    """Add a tower with a chute towards +x."""
    body = builder.body("playground", (x, y, 0.0), yaw_quat(heading_rad))
    for i, (px, py) in enumerate(((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5))):
        body.geom("cylinder", (0.06, 1.25), pos=(px, py, 1.25), material="wood", part=f"post_{i}")
    body.geom("box", (0.55, 0.55, 0.04), pos=(0.0, 0.0, 1.4), material="wood", part="deck")
    tilt = 0.6
    body.geom(
        "box", (1.35, 0.28, 0.02), pos=(1.55, 0.0, 0.72), quat=pitch_quat(tilt), material="steel", part="chute"
    )  # fmt: skip
    for i, side in enumerate((-0.3, 0.3)):
        body.geom(
            "box",
            (1.35, 0.025, 0.1),
            pos=(1.59, side, 0.80),
            quat=pitch_quat(tilt),
            material="paint_yellow",
            part=f"rail_{i}",
        )
    body.geom("box", (0.7, 0.7, 0.03), pos=(0.0, 0.0, 2.55), material="paint_blue", part="roof")


def add_sandpit(builder: MapBuilder, x: float, y: float, half_m: float) -> None:
    builder.material("sand", surfaces.SAND, rgb=(0.86, 0.76, 0.55), specular=0.0)
    body = builder.body("playground", (x, y, 0.0))
    body.geom("box", (half_m, half_m, 0.05), pos=(0.0, 0.0, 0.03), material="sand", part="sand")
    for i, (px, py, hx, hy) in enumerate(
        (
            (0.0, half_m, half_m, 0.1),
            (0.0, -half_m, half_m, 0.1),
            (half_m, 0.0, 0.1, half_m),
            (-half_m, 0.0, 0.1, half_m),
        )
    ):
        body.geom("box", (hx + 0.1, hy, 0.14), pos=(px, py, 0.14), material="wood", part=f"edge_{i}")
