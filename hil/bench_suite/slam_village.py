"""Villages of `hil bench slam`: what stands in them at a height, and a way through that a vehicle could fly.

What stands there is known by the rays' own geometry: rays along both axes, 0.1 m apart, at heights over a band, go on
from every surface that they meet, and so do rays from above, for flat tops within the band. Where they meet one, a
LiDAR at that height could see one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.companion.started import use_client
from hil.goal.true_slice import surfaces_along
from sim._kernels import RayCaster
from sim.frame.source import SharedFrames
from sim.scene.map_section import GeneratedMap
from sim.scene.scene import Scene, load_scene
from sim.scene.world import load_world

Float64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

LOW_M, HIGH_M = -40.0, 110.0  # of both axes
_CELL_M = 0.1
_ROW_M = 0.1
_SLICE_M = 0.2
_WAY_CELL_M = 0.5


@dataclass(frozen=True)
class Village:
    """One seed of the generator."""

    scene: Scene
    world: Any
    frames: SharedFrames


def village(seed: int, **parameters: Any) -> Village:
    """A training village; `parameters` of the generator, such as `walkers`."""
    scene = load_scene("training_village")
    section = GeneratedMap.model_validate({"generator": "training_village", "seed": seed} | parameters)
    scene = scene.model_copy(update={"map": section})
    world = load_world(scene)
    return Village(scene, world, SharedFrames(world))


def surfaces_xy(place: Village, low_m: float, high_m: float, *, t_ns: int = 0) -> Float64:
    """Points (n, 2) of all surfaces between two heights, those of movers as they are at `t_ns`."""
    caster = RayCaster(place.frames.geometry.native)
    place.frames.expect(t_ns)
    place.frames.geometry.bring()
    count = max(2, round((high_m - low_m) / _SLICE_M) + 1)
    rows = np.arange(LOW_M, HIGH_M, _ROW_M) + 0.5 * _ROW_M
    found = []
    for axis in (0, 1):
        row, height = (a.reshape(-1) for a in np.meshgrid(rows, np.linspace(low_m, high_m, count)))
        origins = np.empty((len(row), 3))
        origins[:, axis], origins[:, 1 - axis], origins[:, 2] = LOW_M, row, height
        found += surfaces_along(caster, origins, np.eye(3)[axis], HIGH_M - LOW_M)
    x, y = (a.reshape(-1) for a in np.meshgrid(rows[::2], rows[::2]))
    above = np.stack([x, y, np.full(len(x), high_m)], axis=-1)
    found += surfaces_along(caster, above, np.array([0.0, 0.0, -1.0]), high_m - low_m)
    return np.concatenate(found)[:, :2]


def mask_of(points_xy: Float64, cell_m: float = _CELL_M) -> Mask:
    """Cells from (LOW_M, LOW_M) on that hold a point, row y, column x."""
    n = round((HIGH_M - LOW_M) / cell_m)
    mask = np.zeros((n, n), bool)
    at = np.clip(((points_xy - LOW_M) / cell_m).astype(int), 0, n - 1)
    mask[at[:, 1], at[:, 0]] = True
    return mask


def distance_m(points_xy: Float64, to: Mask, cell_m: float = _CELL_M) -> Float64:
    """How far points are from the nearest cell of a mask, to half a cell."""
    field = cv2.distanceTransform((~to).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * cell_m
    at = np.clip(((points_xy - LOW_M) / cell_m).astype(int), 0, len(to) - 1)
    return np.asarray(field[at[:, 1], at[:, 0]], float)


def way_through(blocked: Mask, start: tuple[float, float], goal: tuple[float, float], clear_m: float) -> Float64:
    """A short way (n, 2) that keeps clear of what is blocked and likes to keep farther; ValueError: there is none."""
    use_client()
    from hil_companion.explore.astar import search

    skip = round(_WAY_CELL_M / _CELL_M)
    field = cv2.distanceTransform((~blocked).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * _CELL_M
    clear = field[skip // 2 :: skip, skip // 2 :: skip]
    price = np.where(clear < clear_m, np.inf, 1.0 + 4.0 * np.clip((clear_m + 3.0 - clear) / 3.0, 0.0, 1.0) ** 2)
    begin, end = ((int((y - LOW_M) / _WAY_CELL_M), int((x - LOW_M) / _WAY_CELL_M)) for x, y in (start, goal))
    found = search(price, begin, end)
    if found is None:
        raise ValueError(f"no way from {start} to {goal} that keeps {clear_m} m clear")
    cells = np.array(found[0], float)[:, ::-1]
    xy = LOW_M + (cells + 0.5) * _WAY_CELL_M
    xy[0], xy[-1] = start, goal
    return np.asarray(xy)
