"""Details of the ground that are only drawn: streets with lanes, kerb stones, manhole covers, puddles, worn grass."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt

from signals._kernel import det_cos, det_sin
from signals.units import TURN_RAD
from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.meshes import Mesh, Vec2, ellipse, slab
from sim.scene.random_generator import RandomGenerator

STREET_M, STREET_WIDTH_M = 14.0, 7.0  # extent of the texture `street`
_KERB_STONES_M = 8.0
_SPOT_ABOVE_M = 0.004
_CROSSING_V = (0.1, 0.9)  # part of the texture `street` without gutters


def ground_materials(builder: MapBuilder) -> None:
    for name in ("street", "kerb", "road_paint", "manhole"):
        builder.texture(name, textures.png(name))
    builder.texture("worn_spot", textures.png("worn_spot"), holes=True)
    builder.material("street", surfaces.ASPHALT, texture="street", specular=0.05, shininess=0.2)
    builder.material("kerb_stones", surfaces.STONE, texture="kerb", specular=0.0)
    builder.material("road_paint", surfaces.ROAD_PAINT, texture="road_paint", tile_m=2.0, specular=0.0)
    builder.material("manhole", surfaces.METAL, texture="manhole", specular=0.2, shininess=0.3)
    builder.material("puddle", surfaces.WATER, rgb=(0.20, 0.20, 0.20), specular=0.9, shininess=0.95)
    builder.material("worn_spot", surfaces.SOIL, texture="worn_spot", specular=0.0)


def _with_depth(mesh: Mesh) -> Mesh:
    """Return the mesh with a small triangle upright below its first point: MuJoCo refuses bodies without any depth."""
    x, y, z = mesh.vertices[0]
    mesh.add_polygon([(x, y, z - 0.02), (x + 0.02, y, z - 0.02), (x, y, z - 0.04)], [(0.0, 0.0)] * 3)
    return mesh


@dataclass(frozen=True)
class Strip:
    """Straight piece of a street: begin and end of its middle line, height of its surface. `crossing`: no gutters."""

    begin: Vec2
    end: Vec2
    z_m: float
    crossing: bool = False


def street(strips: Iterable[Strip], rng: RandomGenerator) -> Mesh:
    """Return the surface of a street 7 m wide; pieces of 56 m are mirrored at random."""
    mesh = Mesh.empty()
    half = 0.5 * STREET_WIDTH_M
    for strip in strips:
        (x0, y0), (x1, y1) = strip.begin, strip.end
        length = sqrt((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0))
        ax, ay = (x1 - x0) / length, (y1 - y0) / length
        v0, v1 = _CROSSING_V if strip.crossing else (0.0, 1.0)
        done = 0.0
        while done < length - 1e-6:
            step = min(4.0 * STREET_M, length - done)
            u0, u1 = 0.0, step / STREET_M
            if rng.chance(0.5):
                u0, u1 = u1, u0
            if rng.chance(0.5):
                v0, v1 = v1, v0
            ends = [(x0 + s * ax, y0 + s * ay) for s in (done, done + step)]
            (bx, by), (ex, ey) = ends
            z = strip.z_m
            points = [
                (bx + half * ay, by - half * ax, z), (ex + half * ay, ey - half * ax, z),
                (ex - half * ay, ey + half * ax, z), (bx - half * ay, by + half * ax, z),
            ]  # fmt: skip
            mesh.add_polygon(points, [(u0, v0), (u1, v0), (u1, v1), (u0, v1)])
            done += step
    return _with_depth(mesh)


def kerbs(edges: Iterable[tuple[Vec2, Vec2]], top_m: float) -> Mesh:
    """Return kerb stones 0.15 m wide along the edges, which have the street at their right."""
    mesh = Mesh.empty()
    for (x0, y0), (x1, y1) in edges:
        length = sqrt((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0))
        ox, oy = (y1 - y0) / length, -(x1 - x0) / length  # to the right
        u = length / _KERB_STONES_M
        z = top_m + 0.004
        out = [(x + 0.004 * ox, y + 0.004 * oy) for x, y in ((x0, y0), (x1, y1))]
        inner = [(x - 0.15 * ox, y - 0.15 * oy) for x, y in ((x0, y0), (x1, y1))]
        for (ax, ay, az), (bx, by, bz), v in (
            ((*out[0], 0.0), (*out[1], 0.0), 0.0), ((*out[0], z), (*out[1], z), 0.45),
        ):  # fmt: skip
            far = [(*out[1], z), (*out[0], z)] if v == 0.0 else [(*inner[1], z), (*inner[0], z)]
            mesh.add_polygon([(ax, ay, az), (bx, by, bz), *far], [(0, v), (u, v), (u, v + 0.45), (0, v + 0.45)])
    return _with_depth(mesh)


def spots(places: Iterable[tuple[float, float, float, float]], z_m: float, rng: RandomGenerator) -> Mesh:
    """Return bare or dry spots (x, y, radius, 1: bare or 0: dry), squares turned at random."""
    mesh = Mesh.empty()
    for x, y, radius, bare in places:
        angle = rng.between(0.0, TURN_RAD)
        c, s = radius * det_cos(angle), radius * det_sin(angle)
        corners = [(x - c + s, y - s - c), (x + c + s, y + s - c), (x + c - s, y + s + c), (x - c - s, y - s + c)]
        u = 0.0 if bare else 0.5
        mesh.add_polygon(
            [(a, b, z_m + _SPOT_ABOVE_M) for a, b in corners], [(u, 0.0), (u + 0.5, 0.0), (u + 0.5, 1.0), (u, 1.0)]
        )
    return _with_depth(mesh)


def covers(places: Iterable[Vec2], z_m: float) -> Mesh:
    """Return manhole covers of 0.8 m, with the ring of concrete round them."""
    mesh = Mesh.empty()
    for x, y in places:
        h = 0.4
        corners = [(x - h, y - h, z_m), (x + h, y - h, z_m), (x + h, y + h, z_m), (x - h, y + h, z_m)]
        mesh.add_polygon(corners, [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    return _with_depth(mesh)


def puddles(places: Iterable[tuple[float, float, float, float]], z_m: float, rng: RandomGenerator) -> Mesh:
    """Return flat puddles (x, y, half length in x, half length in y) with winding shores."""
    mesh = Mesh.empty()
    for x, y, half_x, half_y in places:
        radii = [rng.between(0.7, 1.15) for _ in range(20)]
        smooth = [(radii[i - 1] + 2.0 * radii[i] + radii[(i + 1) % 20]) / 4.0 for i in range(20)]
        outline = [(a * r, b * r) for (a, b), r in zip(ellipse(half_x, half_y, 20), smooth, strict=True)]
        one = slab(outline, z_m - 0.004, z_m, tile_m=1.0)
        first = len(mesh.vertices)
        mesh.vertices += [(a + x, b + y, c) for a, b, c in one.vertices]
        mesh.uvs += one.uvs
        mesh.triangles += [(a + first, b + first, c + first) for a, b, c in one.triangles]
    return _with_depth(mesh)
