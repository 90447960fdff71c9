"""Scenes and patterns of `hil bench lidar`: the park, and as many shapes as one likes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.bench_suite.raster_cases import world_of
from hil.signals._kernel import det_cos, det_sin
from sim._kernels import RayCaster, coherent_order
from sim.frame.geometry import FrameGeometry
from sim.frame.mujoco_backend import WorldPose
from sim.scene.scene import load_scene
from sim.scene.world import World, load_world

Float64 = NDArray[np.float64]

PATTERNS = {"16x900": (16, 900, 15.0), "32x1024": (32, 1024, 20.0), "64x2048": (64, 2048, 22.5)}
_KINDS = ("sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")


@dataclass(frozen=True)
class Place:
    """A scene made ready for both, and where to look from."""

    name: str
    model: mujoco.MjModel
    data: mujoco.MjData
    geometry: FrameGeometry
    caster: RayCaster
    origins_W: tuple[tuple[float, float, float], ...]

    @property
    def geoms(self) -> int:
        """How many there are."""
        return int(self.model.ngeom)


@dataclass(frozen=True)
class Rays:
    """A pattern, level, with the order it is taken in and room for what is found (made once, as a sensor does)."""

    directions_W: Float64
    order: NDArray[np.int32]
    range_m: Float64
    geom: NDArray[np.int32]


def pattern_rays(name: str) -> Rays:
    """Rays of one of PATTERNS: channels evenly from -edge to +edge, columns evenly round."""
    channels, columns, edge_deg = PATTERNS[name]
    up = np.linspace(-edge_deg, edge_deg, channels) * (np.pi / 180.0)
    round_ = np.arange(columns) * (2.0 * np.pi / columns)
    c, s = (np.array([f(x) for x in round_.tolist()]) for f in (det_cos, det_sin))
    level, z = (np.array([f(x) for x in up.tolist()]) for f in (det_cos, det_sin))
    grid = np.broadcast_arrays(c[:, None] * level, s[:, None] * level, z)
    directions = np.ascontiguousarray(np.stack(grid, axis=-1).reshape(-1, 3))
    order = np.empty(len(directions), np.int32)
    coherent_order(directions, order)
    return Rays(directions, order, np.empty(len(directions)), np.empty(len(directions), np.int32))


def park() -> Place:
    """city_park, its people where they are at t = 0."""
    world = load_world(load_scene("city_park"))
    return _place("city_park", world, ((0.3, 0.2, 1.5), (10.0, 5.0, 8.0), (-20.0, 13.0, 3.0)))


def shapes(count: int, *, far_beyond_m: float | None = None, near: int = 0) -> Place:
    """`count` shapes of all kinds within 80 x 80 m and 9 m up.

    With `far_beyond_m` only the first `near` of them are there, all others between that distance and ten times it.
    """
    name = f"{count} geoms" if far_beyond_m is None else f"{count} geoms, {near} in reach"
    world = world_of("".join(_lines(count, far_beyond_m, near)))
    return _place(name, world, ((0.3, 0.2, 2.0), (15.0, -12.0, 6.0), (-25.0, 20.0, 1.0)))


def _place(name: str, world: World, origins_W: tuple[tuple[float, float, float], ...]) -> Place:
    geometry = FrameGeometry(world)  # as it is at t = 0
    data = WorldPose(world).at(0)
    mujoco.mj_forward(world.model, data)  # mj_multiRay also needs the bounding volumes of bodies
    return Place(name, world.model, data, geometry, RayCaster(geometry.native), origins_W)


def _lines(count: int, far_beyond_m: float | None, near: int) -> Iterator[str]:
    rng = np.random.default_rng(count if far_beyond_m is None else near)
    ball = rng.normal(size=(40, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    yield f'<mujoco><asset><mesh name="stone" vertex="{" ".join(f"{x:.5f}" for x in ball.ravel())}"/></asset>'
    yield '<worldbody><geom name="ground" type="plane" size="0 0 1"/>'
    for i in range(count - 1):
        kind = _KINDS[i % len(_KINDS)]
        x, y, z = rng.uniform(-1.0, 1.0, 3) * (40.0, 40.0, 4.0) + (0.0, 0.0, 4.5)
        if far_beyond_m is not None and i >= near:
            distance, angle = far_beyond_m * rng.uniform(1.1, 10.0), rng.uniform(0.0, 2.0 * np.pi)
            x, y = distance * np.cos(angle), distance * np.sin(angle)
        size = 'mesh="stone"' if kind == "mesh" else 'size="{:.3f} {:.3f} {:.3f}"'.format(*rng.uniform(0.1, 1.2, 3))
        quat = "{:.4f} {:.4f} {:.4f} {:.4f}".format(*rng.normal(size=4))
        yield f'<geom name="shape_{i}" type="{kind}" {size} pos="{x:.3f} {y:.3f} {z:.3f}" quat="{quat}"/>'
    yield "</worldbody></mujoco>"
