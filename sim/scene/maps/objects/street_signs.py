"""Traffic lights and stop signs."""

from __future__ import annotations

from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.map_builder import MapBuilder, yaw_quat
from sim.scene.maps.models import model

_LAMP_M = 0.105  # radius of a lens
HEAD_M = 2.55  # lower edge of a traffic light's head
# Light of the lenses: lit and dark.
_LENSES = {
    "red": ((1.0, 0.10, 0.06), (0.22, 0.02, 0.02)),
    "amber": ((1.0, 0.62, 0.08), (0.22, 0.13, 0.02)),
    "green": ((0.10, 0.95, 0.45), (0.02, 0.17, 0.08)),
}


def add_traffic_light(builder: MapBuilder, x: float, y: float, heading_rad: float, lit: str) -> None:
    """Add a light of 3.5 m on a post at the kerb; its lenses look along `heading_rad`. `lit`: red, amber or green."""
    builder.material("signal_post", surfaces.METAL, rgb=(0.42, 0.44, 0.45), specular=0.4, shininess=0.4)
    builder.material("signal_black", surfaces.BLACK_PLASTIC, rgb=(0.05, 0.05, 0.05), specular=0.1)
    builder.material("signal_white", surfaces.ROAD_PAINT, rgb=(0.92, 0.92, 0.90), specular=0.1)
    signal, z = model("objects/traffic_light"), HEAD_M
    # The post is an object of its own: people and networks mean the head by a traffic light.
    post = builder.body("pole", (x, y, 0.0), yaw_quat(heading_rad))
    post.geom("cylinder", (0.055, 1.75), pos=(-0.06, 0.0, 1.75), material="signal_post", part="post")
    body = builder.body("traffic_light", (x, y, 0.0), yaw_quat(heading_rad))
    for piece, material in (("head", "signal_black"), ("board", "signal_white")):
        asset = builder.mesh(f"signal_{piece}", signal.mesh(piece))
        body.geom("mesh", asset=asset, material=material, solid=False, part=piece)
    body.proxy("box", (0.10, 0.24, 0.53), pos=(0.10, 0.0, z + 0.465), material="signal_black", part="proxy")
    for k, colour in enumerate(("green", "amber", "red")):
        material = f"lens_{colour}_{'lit' if colour == lit else 'dark'}"
        builder.material(material, surfaces.PLASTIC, rgb=_LENSES[colour][colour != lit], specular=0.3)
        body.geom(
            "ellipsoid", (0.03, _LAMP_M, _LAMP_M), pos=(0.205, 0.0, z + 0.155 + 0.31 * k), material=material,
            solid=False, part=colour,
        )  # fmt: skip


def add_stop_sign(builder: MapBuilder, x: float, y: float, heading_rad: float) -> None:
    """Add a stop sign, 0.75 m across on a post of 2.6 m; its face looks along `heading_rad`."""
    builder.texture("stop_sign", textures.png("stop_sign"))
    builder.material("stop_sign", surfaces.SIGN_SHEETING, texture="stop_sign", specular=0.2, shininess=0.3)
    builder.material("signal_post", surfaces.METAL, rgb=(0.42, 0.44, 0.45), specular=0.4, shininess=0.4)
    post = builder.body("pole", (x, y, 0.0), yaw_quat(heading_rad))
    post.geom("cylinder", (0.035, 1.3), pos=(-0.05, 0.0, 1.3), material="signal_post", part="post")
    body = builder.body("stop_sign", (x, y, 0.0), yaw_quat(heading_rad))
    plate = model("objects/stop_sign")
    for piece, material in (("face", "stop_sign"), ("back", "signal_post")):
        asset = builder.mesh(f"stop_{piece}", plate.mesh(piece))
        body.geom("mesh", asset=asset, material=material, solid=False, part=piece)
    body.proxy("box", (0.01, 0.36, 0.36), pos=(-0.01, 0.0, 2.25), material="signal_post", part="proxy")
