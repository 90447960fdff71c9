"""Textures as the raster and the path tracer take them from a model."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import cv2
import mujoco
import numpy as np
import pytest

from sim.frame import scenery
from sim.frame.path_traced.looks import make_looks
from sim.scene.surface_appearance import SurfaceAppearance
from sim.scene.surfaces import DEFAULT_SURFACE

MJCF = """<mujoco><asset>
  <texture name="colour" type="2d" file="colour.png" %s/><texture name="relief" type="2d" file="relief.png"/>
  <material name="wall"><layer role="rgb" texture="colour"/><layer role="normal" texture="relief"/></material>
  <material name="bare" rgba="0.5 0.25 0.25 1"><layer role="normal" texture="relief"/></material>
</asset><worldbody>
  <geom type="box" size="1 1 1" material="wall"/><geom type="box" size="1 1 1" material="bare"/>
</worldbody></mujoco>"""
MOVED = SurfaceAppearance(0.0, 1.0, 1.0, 1.0, (0.25, 0.5))


class Recorder:
    """Stands in for the native scenery and keeps what it is given."""

    def __init__(self) -> None:
        self.textures: list[np.ndarray] = []
        self.geoms: list[tuple[Any, ...]] = []

    def add_texture(self, levels: list[np.ndarray], *_: bool, **__: bool) -> int:
        self.textures.append(levels[0])
        return len(self.textures) - 1

    def add_geom(self, *values: Any) -> None:
        self.geoms.append(values)


def model_of(channels: int = 3) -> mujoco.MjModel:
    rng = np.random.default_rng(4)
    files = {
        "colour.png": rng.integers(0, 256, (8, 8, channels)).astype(np.uint8),
        "relief.png": rng.integers(0, 256, (16, 16, 3)).astype(np.uint8),
    }
    assets = {name: cv2.imencode(".png", image)[1].tobytes() for name, image in files.items()}
    return mujoco.MjModel.from_xml_string(MJCF % ('nchannel="4"' if channels == 4 else ""), assets)


def textures_of(model: mujoco.MjModel, appearance: SurfaceAppearance | None, by: str) -> list[np.ndarray]:
    """Return the colour of the first material, its normals, and those of the second, as a renderer gets them."""
    if by == "raster":
        made: Any = scenery.make_scenery(model, appearances=[appearance] * model.ngeom)
        return [made.textures[made.geoms[geom][column]] for geom, column in ((0, 2), (0, -1), (1, -1))]
    world: Any = SimpleNamespace(
        model=model, geom_appearance=[appearance] * model.ngeom, surfaces=[DEFAULT_SURFACE], geom_surface=[0, 0]
    )
    looks = make_looks(world)
    numbers = [int(looks.material[geom, column]) for geom, column in ((0, 3), (0, 10), (1, 10))]
    return [looks.textures[number][..., :3] for number in numbers]


@pytest.mark.parametrize("by", ["raster", "path tracer"])
def test_a_random_shift_moves_relief_and_colour_alike(by: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scenery, "Scenery", Recorder)
    model = model_of()
    still, moved = textures_of(model, None, by), textures_of(model, MOVED, by)
    for before, after in zip(still, moved, strict=True):
        rows, columns = int(0.25 * before.shape[0]), int(0.5 * before.shape[1])
        assert (np.roll(before, (rows, columns), axis=(0, 1)) == after).all()
    with_alpha = model_of(channels=4)  # such a colour stays, and its relief with it
    relief = [textures_of(with_alpha, appearance, by)[1] for appearance in (None, MOVED)]
    assert (relief[0] == relief[1]).all()


def test_a_surface_with_a_relief_and_no_colour_texture_changes_its_colour(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scenery, "Scenery", Recorder)
    darker = SurfaceAppearance(0.0, 0.5, 1.0, 2.0, (0.0, 0.0))
    made: Any = scenery.make_scenery(model_of(), appearances=[darker, darker])
    assert made.geoms[1][0] == pytest.approx((0.25, 0.125, 0.125))
    assert made.geoms[1][3:5] == (0.5, 0.5)
