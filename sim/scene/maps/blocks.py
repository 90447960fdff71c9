"""Blocks: flat ground with coloured cubes, cones, cylinders and a ball, in the manner of AirSim's scene of this name.

Objects have the names that AirSim's users know, such as TemplateCube_Rounded_16, Cone_5, Cylinder_3 and OrangeBall.
North is +y. A radius of 14 m round the start is free, and 4 m beside the path 125 m north, 130 m west and back.
Objects are at most 6 m high within 50 m of the start, and 18 m within 85 m.
"""

from __future__ import annotations

from functools import cache
from math import sqrt
from typing import Annotated

import numpy as np
from pydantic import Field

from signals.documents.validate import StrictModel
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene import surfaces
from sim.scene.maps.layout import Layout
from sim.scene.maps.map_builder import MapBuilder, yaw_quat
from sim.scene.maps.meshes import Mesh, revolve
from sim.scene.maps.texture_tools import clouds, grain, grid, mix, png_of
from sim.scene.random_generator import RandomGenerator
from sim.scene.scene_map import SceneMap

_CELL_M = 22.0  # one group of objects stands in each cell, if it is free
_REACH_CELLS = 6
_BEVEL_M = 0.08
_PATH = ((0.0, 0.0), (0.0, 131.0), (0.0, 125.0), (-136.0, 125.0), (-130.0, 125.0), (-130.0, -6.0), (-130.0, 0.0))
_COLOURS = {
    "orange": (0.88, 0.36, 0.07),
    "white": (0.80, 0.80, 0.79),
    "grey": (0.42, 0.43, 0.44),
    "blue": (0.16, 0.34, 0.58),
}


class Parameters(StrictModel):
    """Numbers of objects."""

    cubes: Annotated[int, Field(ge=0, le=400)] = 160
    cones: Annotated[int, Field(ge=0, le=60)] = 12
    cylinders: Annotated[int, Field(ge=0, le=60)] = 8


@cache
def _tile_png(light: float) -> bytes:
    """Return a tile with a dark joint and a thin cross, in grey."""
    u, v = grid()
    edge = np.minimum(np.minimum(u, 1.0 - u), np.minimum(v, 1.0 - v))
    cross = np.minimum(np.abs(u - 0.5), np.abs(v - 0.5))
    t = 0.82 + 0.14 * clouds("blocks", 6) + 0.04 * grain("blocks")
    t = np.where(cross < 0.006, t * 0.86, t)
    t = np.where(edge < 0.012, t * 0.55, t)
    return png_of(mix((0.0, 0.0, 0.0), (light, light, light), t))


def _rounded_cube(edge_m: float) -> Mesh:
    """Return a cube on z = 0 with bevelled edges; its texture repeats every 2 m on each side."""
    mesh = Mesh.empty()
    h, b = 0.5 * edge_m, 0.5 * edge_m - _BEVEL_M

    def at(axis: int, sign: float, u: float, v: float, out: float) -> Vec3:
        """Return a point of the side at `out` on `axis`; u and v on the next two axes."""
        point = [0.0, 0.0, 0.0]
        point[axis], point[(axis + 1) % 3], point[(axis + 2) % 3] = sign * out, u, v
        return (point[0], point[1], point[2] + h)

    for axis in range(3):
        for sign in (-1.0, 1.0):
            flat = [(-b, -b), (b, -b), (b, b), (-b, b)]
            if sign < 0.0:
                flat.reverse()
            # Texture upright on the walls: v is the height.
            uv = [((v, u) if axis == 1 else (u, v)) for u, v in flat]
            mesh.add_polygon([at(axis, sign, u, v, h) for u, v in flat], [(p / 2.0, q / 2.0) for p, q in uv])
        for s in (-1.0, 1.0):
            for t in (-1.0, 1.0):  # the edge between side s of `axis` and side t of the next one
                corners = [
                    at(axis, s, t * b, -b, h), at(axis, s, t * b, b, h),
                    at(axis, s, t * h, b, b), at(axis, s, t * h, -b, b),
                ]  # fmt: skip
                if s * t > 0.0:
                    corners.reverse()
                mesh.add_polygon(corners, [(0.0, 0.0), (b, 0.0), (b, 0.04), (0.0, 0.04)])
    for x in (-1.0, 1.0):
        for y in (-1.0, 1.0):
            for z in (-1.0, 1.0):
                corners = [(x * h, y * b, z * b + h), (x * b, y * h, z * b + h), (x * b, y * b, z * h + h)]
                if x * y * z < 0.0:
                    corners.reverse()
                mesh.add_polygon(corners, [(0.0, 0.0), (0.04, 0.0), (0.02, 0.04)])
    return mesh


class _Blocks:
    def __init__(self, parameters: Parameters, seed: int) -> None:
        self.parameters = parameters
        self.seed = seed
        self.builder = MapBuilder("blocks")
        self.layout = Layout()
        self.cubes = 0

    def rng(self, name: str) -> RandomGenerator:
        return RandomGenerator(self.seed, f"blocks.{name}")

    def materials(self) -> None:
        b = self.builder
        b.texture("tile", _tile_png(1.0))
        b.texture("floor", _tile_png(0.62))
        b.material("floor", surfaces.CONCRETE, texture="floor", tile_m=4.0, specular=0.0)
        for name, rgb in _COLOURS.items():
            b.material(name, surfaces.PLASTER, rgb=rgb, texture="tile", specular=0.1, shininess=0.3)
            b.material(f"{name}_plain", surfaces.PLASTER, rgb=rgb, specular=0.2, shininess=0.4)

    def ground(self) -> None:
        self.builder.ground("plane", (0.0, 0.0, 1.0), material="floor", name="Ground")
        self.builder.classify("ground", "Ground")
        self.layout.take_disc(0.0, 0.0, 14.0)
        for start, end in zip(_PATH[::2], (*_PATH[1::2], (6.0, 0.0)), strict=True):
            self.layout.take_band((start, end), 6.0)

    def cube(self, x: float, y: float, z: float, edge_m: float, colour: str) -> None:
        """Add one cube; its solid shape is the hull of what is drawn."""
        if self.cubes == self.parameters.cubes:
            return
        self.cubes += 1
        b = self.builder
        asset = b.mesh(f"cube_{edge_m:g}", _rounded_cube(edge_m))
        body = b.named_body(f"TemplateCube_Rounded_{self.cubes}", (x, y, z), yaw_quat(0.0))
        body.geom("mesh", asset=asset, material=colour)

    def landmarks(self) -> None:
        """Add the ball beside the start, a cone, and a wall at the end of the free lane north."""
        b = self.builder
        b.named_body("OrangeBall", (-9.5, 22.0, 2.5), yaw_quat(0.0)).geom("sphere", (2.5,), material="orange_plain")
        self.layout.take_disc(-9.5, 22.0, 4.0)
        self.cone("PulsingCone", 10.0, 24.0, 1.8, 4.0, "white_plain")
        for i in range(7):
            for level in range(2):
                x = 10.0 * (i - 3)
                self.cube(x, 147.0, 10.0 * level, 10.0, "orange" if (i + level) % 2 else "white")
        self.layout.take_box(-40.0, 138.0, 40.0, 156.0)
        b.classify("obstacle", "TemplateCube_Rounded_*")
        b.classify("object", "OrangeBall", "PulsingCone", "Cone_*", "Cylinder_*")

    def cone(self, name: str, x: float, y: float, radius_m: float, height_m: float, material: str) -> None:
        b = self.builder
        # The rim has vertices of its own on both sides, so that it is a sharp edge.
        profile = [(radius_m, 0.0), (radius_m, 0.0), (0.02, height_m)]
        asset = b.mesh(f"cone_{radius_m:g}_{height_m:g}", revolve(profile, 32))
        b.named_body(name, (x, y, 0.0), yaw_quat(0.0)).geom("mesh", asset=asset, material=material)
        self.layout.take_disc(x, y, radius_m + 1.0)

    def groups(self) -> None:
        """Add cubes in rows, stairs and towers, one group in a cell."""
        rng = self.rng("groups")
        n = _REACH_CELLS
        cells = rng.shuffled([(i, j) for i in range(-n, n + 1) for j in range(-n, n + 1)])
        others = [("cone", k + 1) for k in range(self.parameters.cones)]
        others += [("cylinder", k + 1) for k in range(self.parameters.cylinders)]
        for i, j in cells:
            x, y = _CELL_M * i + rng.between(-3.0, 3.0), _CELL_M * j + rng.between(-3.0, 3.0)
            far = sqrt(x * x + y * y)
            wanted = 3.0 if far < 62.0 else 10.0
            if not self.layout.free(x, y, wanted):
                continue
            if others and rng.chance(0.3):
                kind, number = others.pop()
                self.round_object(rng, kind, number, x, y)
            elif far < 62.0:
                self.group(rng, x, y, rng.pick((2.0, 2.0, 3.0)), 2)
            elif far < 100.0:
                self.group(rng, x, y, rng.pick((4.0, 6.0)), 3)
            else:
                self.group(rng, x, y, rng.pick((6.0, 8.0)), 3)
        for kind, number in others:
            self.layout.scatter(
                rng, 1, 2.5, (-100.0, -100.0, 100.0, 100.0),
                lambda x, y, kind=kind, number=number: self.round_object(rng, kind, number, x, y),  # type: ignore[misc]
            )  # fmt: skip
        # The rest as single cubes, as far as there is room.
        area = (-150.0, -150.0, 150.0, 150.0)
        rest = self.parameters.cubes - self.cubes
        self.layout.scatter(rng, rest, 2.4, area, lambda x, y: self.cube(x, y, 0.0, 2.0, "grey"))

    def group(self, rng: RandomGenerator, x: float, y: float, edge_m: float, most: int) -> None:
        """Add a row, a stair or a tower of up to `most` cubes across and upwards."""
        colours = rng.shuffled(tuple(_COLOURS))[:2]
        shape = rng.index(3)
        dx, dy = ((1.0, 0.0), (0.0, 1.0))[rng.index(2)]
        across = 1 if shape == 2 else min(most, 3)
        for k in range(across):
            levels = (1 + rng.index(2), k + 1, most)[shape]
            for level in range(min(levels, most)):
                offset = (k - 0.5 * (across - 1)) * edge_m
                self.cube(x + dx * offset, y + dy * offset, level * edge_m, edge_m, colours[(k + level) % 2])
        self.layout.take_disc(x, y, 0.75 * edge_m * across)

    def round_object(self, rng: RandomGenerator, kind: str, number: int, x: float, y: float) -> None:
        material = f"{rng.pick(tuple(_COLOURS))}_plain"
        if kind == "cone":
            self.cone(f"Cone_{number}", x, y, rng.pick((1.5, 2.0)), rng.pick((3.0, 5.0)), material)
            return
        radius, half = rng.pick((1.0, 1.5)), rng.pick((1.5, 3.0))
        body = self.builder.named_body(f"Cylinder_{number}", (x, y, half), yaw_quat(TURN_RAD * rng.unit()))
        body.geom("cylinder", (radius, half), material=material)
        self.layout.take_disc(x, y, radius + 1.0)


def generate(parameters: Parameters, seed: int) -> SceneMap:
    blocks = _Blocks(parameters, seed)
    blocks.materials()
    blocks.ground()
    blocks.landmarks()
    blocks.groups()
    return blocks.builder.build()
