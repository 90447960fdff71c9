"""The windsock of an airfield points where the wind of the bench blows to, and lifts with it."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hil.config import load_bench
from hil.config.windsock import with_windsock
from sim.scene.scene import load_scene
from sim.world_loader import load_world


def sock(tmp_path: Path, text: str) -> tuple[float, float]:
    """Return direction (counter-clockwise from east) and angle under the horizon of the sock [deg]."""
    file = tmp_path / "bench.yaml"
    file.write_text("rig: mock\nscene: airstrip\n" + text)
    world = load_world(load_bench(file).scene)
    model = world.model
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, i) or "" for i in range(model.nbody)]
    parts = np.array([model.body_pos[i] for i, name in enumerate(names) if name.startswith("windsock")])
    assert len(parts) == 5
    x, y, z = parts[-1] - parts[0]
    return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(-z, math.hypot(x, y)))


@pytest.mark.parametrize(
    ("wind_W", "to_deg", "droop_deg"),
    [((3.0, 3.0), 45.0, 72.0 * (1.0 - math.sqrt(18.0) / 8.0)), ((0.0, -4.0), -90.0, 36.0), ((-9.0, 0.0), 180.0, 3.6)],
)
def test_it_shows_the_steady_wind(tmp_path: Path, wind_W: tuple[float, float], to_deg: float, droop_deg: float) -> None:
    x, y = wind_W
    to, droop = sock(tmp_path, f"wind: {{steady_W_mps: [{x}, {y}, 0]}}\n")
    assert math.remainder(to - to_deg, 360.0) == pytest.approx(0.0, abs=1e-3)
    assert droop == pytest.approx(droop_deg, abs=1e-3)


def test_it_hangs_in_calm_air(tmp_path: Path) -> None:
    assert sock(tmp_path, "")[1] == pytest.approx(72.0, abs=1e-3)


def test_a_scene_that_says_what_it_shows_is_left_alone() -> None:
    scene = load_scene("airstrip")
    assert scene.map is not None
    told = scene.model_copy(update={"map": scene.map.model_copy(update={"wind_mps": 6.0})})
    assert with_windsock(told, (1.0, 0.0, 0.0)) is told
    park = load_scene("city_park")
    assert with_windsock(park, (1.0, 0.0, 0.0)) is park
