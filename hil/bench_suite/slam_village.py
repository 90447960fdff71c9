"""Villages of `hil bench slam`: what stands in them at a height, and a way through that a vehicle could fly.

What stands there is known as for the judge of a flight to a goal (hil/goal/true_slice.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.companion.started import use_client
from hil.goal.true_slice import true_slice
from sim.frame.source import SharedFrames
from sim.scene.map_section import GeneratedMap
from sim.scene.scene import Scene, load_scene
from sim.scene.world import load_world

Float64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

LOW_M, HIGH_M = -40.0, 110.0  # of both axes
_CELL_M = 0.1
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


def surfaces(place: Village, low_m: float, high_m: float) -> Mask:
    """Cells from (LOW_M, LOW_M) on, row y, column x, in which something stands between two heights."""
    area_W = (LOW_M, LOW_M, HIGH_M, HIGH_M)
    return true_slice(place.frames.geometry, low_m=low_m, high_m=high_m, area_W=area_W, cell_m=_CELL_M).occupied


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
