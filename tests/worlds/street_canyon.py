"""A street between two rows of houses, as a scene of boxes, and receivers in it."""

from __future__ import annotations

from functools import cache
from typing import Any

from signals.samples import TruthState, Vec3
from sim.frame.source import SharedFrames
from sim.scene.scene import Scene, load_scene
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation
from sim.world_loader import load_world

TICK_NS = 4_000_000
ZERO = (0.0, 0.0, 0.0)
WIDTH_M, HEIGHT_M, LENGTH_M = 20.0, 25.0, 120.0


def canyon(*, width_m: float = WIDTH_M, height_m: float = HEIGHT_M) -> Scene:
    """A street along y through the origin; houses of unequal height on both sides."""
    boxes = []
    for number, y_m in enumerate((-45.0, -15.0, 15.0, 45.0)):
        for side, name in ((-1.0, "west"), (1.0, "east")):
            tall_m = height_m * (0.7 + 0.15 * ((number + int(side > 0)) % 3))
            centre = [side * (0.5 * width_m + 10.0), y_m, 0.5 * tall_m]
            boxes.append({"name": f"{name}_{number}", "center_m": centre, "size_m": [20.0, 26.0, tall_m]})
    plain = load_scene("airfield").model_dump()
    return Scene.model_validate({**plain, "name": "canyon", "boxes": boxes})


def one_wall(distance_m: float, *, height_m: float = 60.0, length_m: float = 400.0) -> Scene:
    """A wall along y, its face `distance_m` east of the origin."""
    box = {"name": "wall", "center_m": [distance_m + 1.0, 0.0, 0.5 * height_m], "size_m": [2.0, length_m, height_m]}
    return Scene.model_validate({**load_scene("airfield").model_dump(), "name": "one_wall", "boxes": [box]})


@cache
def frames_of(scene_text: str) -> SharedFrames:
    return SharedFrames(load_world(Scene.model_validate_json(scene_text)))


def receiver_in(scene: Scene, *, preset: str = "m8n", seed: int = 1, rate_hz: float = 5.0, **overrides: Any) -> Any:
    """A GPS with `sky` in a scene; `sky=None`: without."""
    overrides.setdefault("sky", {})
    installation = Installation(
        "gps", rate_hz=rate_hz, seed=seed, scene=scene, step_ns=TICK_NS, frames=frames_of(scene.model_dump_json())
    )
    return make_sensor(installation, preset=preset, overrides=overrides)


def at(p_W: Vec3, t_s: float = 0.0, **changes: Any) -> TruthState:
    truth = TruthState(0, round(t_s * 1e9), p_W, (1.0, 0.0, 0.0, 0.0), ZERO, ZERO, ZERO, ZERO, (0.0,) * 4, False)
    return truth._replace(**changes)
