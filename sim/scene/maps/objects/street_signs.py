"""Traffic lights and stop signs."""

from __future__ import annotations

from functools import cache

import numpy as np

from signals._kernel import det_cos, det_sin
from signals.units import TURN_RAD
from sim.scene.maps import surfaces
from sim.scene.maps.dot_font import write
from sim.scene.maps.map_builder import MapBuilder, yaw_quat
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.texture_tools import encoded_png
from sim.scene.maps.vehicles.lofts import add_box, add_indexed_grid, add_sheet, add_vertex

_LAMP_M = 0.105  # radius of a lens
_HEAD_M = 2.55  # lower edge of a traffic light's head
# Light of the lenses: lit and dark.
_LENSES = {
    "red": ((1.0, 0.10, 0.06), (0.22, 0.02, 0.02)),
    "amber": ((1.0, 0.62, 0.08), (0.22, 0.13, 0.02)),
    "green": ((0.10, 0.95, 0.45), (0.02, 0.17, 0.08)),
}


@cache
def _stop_png() -> bytes:
    """Return the face of the sign, 128 pixels square: red with a white rim and white letters."""
    side = 128
    line = (np.arange(side) + 0.5) / side * 2.0 - 1.0
    u, v = np.abs(np.broadcast_to(line, (side, side))), np.abs(np.broadcast_to(line[:, None], (side, side)))
    # Distance from the middle across the sides of a regular octagon, 1 at its rim.
    reach = np.maximum(np.maximum(u, v), (u + v) * 0.7071067811865476)
    image = np.empty((side, side, 3), np.uint8)
    image[:] = (28, 20, 190)  # BGR
    image[reach > 0.90] = (240, 240, 240)
    write(image, "STOP", (43, 18), (6, 4), 24, (245, 245, 245))
    return encoded_png(image)


def add_traffic_light(builder: MapBuilder, x: float, y: float, heading_rad: float, lit: str) -> None:
    """Add a light of 3.5 m on a post at the kerb; its lenses look along `heading_rad`. `lit`: red, amber or green."""
    builder.material("signal_post", surfaces.METAL, rgb=(0.42, 0.44, 0.45), specular=0.4, shininess=0.4)
    builder.material("signal_black", surfaces.BLACK_PLASTIC, rgb=(0.05, 0.05, 0.05), specular=0.1)
    builder.material("signal_white", surfaces.ROAD_PAINT, rgb=(0.92, 0.92, 0.90), specular=0.1)
    (head, board), z = _signal(), _HEAD_M
    # The post is an object of its own: people and networks mean the head by a traffic light.
    post = builder.body("pole", (x, y, 0.0), yaw_quat(heading_rad))
    post.geom("cylinder", (0.055, 1.75), pos=(-0.06, 0.0, 1.75), material="signal_post", part="post")
    body = builder.body("traffic_light", (x, y, 0.0), yaw_quat(heading_rad))
    body.geom("mesh", asset=builder.mesh("signal_head", head), material="signal_black", solid=False, part="head")
    body.geom("mesh", asset=builder.mesh("signal_board", board), material="signal_white", solid=False, part="board")
    body.proxy("box", (0.10, 0.24, 0.53), pos=(0.10, 0.0, z + 0.465), material="signal_black", part="proxy")
    for k, colour in enumerate(("green", "amber", "red")):
        material = f"lens_{colour}_{'lit' if colour == lit else 'dark'}"
        builder.material(material, surfaces.PLASTIC, rgb=_LENSES[colour][colour != lit], specular=0.3)
        body.geom(
            "ellipsoid", (0.03, _LAMP_M, _LAMP_M), pos=(0.205, 0.0, z + 0.155 + 0.31 * k), material=material,
            solid=False, part=colour,
        )  # fmt: skip


@cache
def _signal() -> tuple[Mesh, Mesh]:
    """Return the head of a traffic light and the board behind it."""
    head, board = Mesh.empty(), Mesh.empty()
    z = _HEAD_M
    add_box(board, (0.02, -0.27, z - 0.09), (0.04, 0.27, z + 1.02))
    add_box(head, (0.0, -0.24, z - 0.06), (0.05, 0.24, z + 0.99))
    add_box(head, (0.04, -0.16, z), (0.20, 0.16, z + 0.93))
    for k in range(3):
        _add_visor(head, 0.20, z + 0.155 + 0.31 * k)
    return head, board


def _add_visor(mesh: Mesh, x: float, z: float) -> None:
    """Add the hood over a lens: three quarters of a short tube."""
    rows = []
    for out, deep in ((0.0, 0.0), (0.17, 0.0)):
        row = []
        for k in range(10):
            angle = TURN_RAD * (-0.11 + 0.72 * k / 9)
            r = 0.118 - deep
            row.append((x + out, r * det_cos(angle), z + r * det_sin(angle)))
        rows.append(row)
    add_sheet(mesh, rows)
    add_sheet(mesh, rows, flipped=True)


def add_stop_sign(builder: MapBuilder, x: float, y: float, heading_rad: float) -> None:
    """Add a stop sign, 0.75 m across on a post of 2.6 m; its face looks along `heading_rad`."""
    builder.texture("stop_sign", _stop_png())
    builder.material("stop_sign", surfaces.ROAD_PAINT, texture="stop_sign", specular=0.2, shininess=0.3)
    builder.material("signal_post", surfaces.METAL, rgb=(0.42, 0.44, 0.45), specular=0.4, shininess=0.4)
    post = builder.body("pole", (x, y, 0.0), yaw_quat(heading_rad))
    post.geom("cylinder", (0.035, 1.3), pos=(-0.05, 0.0, 1.3), material="signal_post", part="post")
    body = builder.body("stop_sign", (x, y, 0.0), yaw_quat(heading_rad))
    face, back = _plate()
    body.geom("mesh", asset=builder.mesh("stop_face", face), material="stop_sign", solid=False, part="face")
    body.geom("mesh", asset=builder.mesh("stop_back", back), material="signal_post", solid=False, part="back")
    body.proxy("box", (0.01, 0.36, 0.36), pos=(-0.01, 0.0, 2.25), material="signal_post", part="proxy")


@cache
def _plate() -> tuple[Mesh, Mesh]:
    """Return face and back of a stop sign."""
    face, back = Mesh.empty(), Mesh.empty()
    corners = []
    for k in range(8):
        angle = TURN_RAD * (k + 0.5) / 8
        corners.append((0.405 * det_cos(angle), 0.405 * det_sin(angle)))
    face.add_polygon(
        [(0.0, a, 2.25 + b) for a, b in corners], [(0.5 + 0.5 * a / 0.375, 0.5 + 0.5 * b / 0.375) for a, b in corners]
    )
    rows = [[add_vertex(back, (x_m, a, 2.25 + b)) for a, b in reversed(corners)] for x_m in (0.0, -0.012)]
    back.add_polygon([(-0.012, a, 2.25 + b) for a, b in reversed(corners)], [(0.0, 0.0)] * 8)
    add_indexed_grid(back, rows, closed=True)
    return face, back
