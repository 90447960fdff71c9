"""Buildings: what is drawn against what is solid, windows behind the wall, colours of textures."""

from __future__ import annotations

from functools import cache

import cv2
import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer
from sim.scene.maps import textures
from sim.scene.maps.catalog import GENERATORS
from sim.scene.scene import load_scene
from sim.world_loader import load_world
from tests.unit.sim.frame.test_frame_raster import looking

_DRAWN = np.array([1, 1, 1, 0, 0, 0], np.uint8)
_SOLID_ONLY = np.array([0, 0, 0, 1, 0, 0], np.uint8)


@cache
def suburb() -> tuple[mujoco.MjModel, mujoco.MjData]:
    generator = GENERATORS["urban_delivery"]
    scene_map = generator.generate(generator.parameters(), 1)
    model = mujoco.MjModel.from_xml_string(scene_map.mjcf, dict(scene_map.assets))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def hit(
    model: mujoco.MjModel, data: mujoco.MjData, p: NDArray[np.float64], d: NDArray[np.float64], group: NDArray[np.uint8]
) -> tuple[float, str]:
    """Return distance and name of the first geom of these groups on a ray."""
    geom = np.zeros(1, np.int32)
    distance = mujoco.mj_ray(model, data, p, d, group, 1, -1, geom)
    return float(distance), model.geom(int(geom[0])).name if distance >= 0.0 else ""


def test_faces_of_houses_lie_on_their_solid_walls_and_panes_behind_them() -> None:
    model, data = suburb()
    walls = [
        g
        for g in range(model.ngeom)
        if model.geom(g).name.startswith("house_") and model.geom(g).name.endswith("_walls")
    ]
    panes = faces = 0
    for geom in walls:
        house = model.geom(geom).name.removesuffix("_walls")
        body = int(model.geom_bodyid[geom])
        R = data.xmat[body].reshape(3, 3)
        for side in (1.0, -1.0):  # front and back, along x of the house
            for y in np.arange(-2.6, 2.7, 0.37):
                for z in (0.5, 1.1, 1.62, 2.3):
                    p = data.xpos[body] + R @ np.array([side * 4.6, y, z])
                    d = R @ np.array([-side, 0.0, 0.0])
                    solid, solid_name = hit(model, data, p, d, _SOLID_ONLY)
                    drawn, drawn_name = hit(model, data, p, d, _DRAWN)
                    if solid_name != f"{house}_walls" or not drawn_name.startswith(house):
                        continue  # a fence, a bush or a car before it
                    if "_glass" in drawn_name:
                        panes += 1
                        assert 0.1 < drawn - solid < 0.2, drawn_name
                    elif not drawn_name.endswith("_door"):
                        faces += 1
                        # Jambs and what stands before the wall; nothing is missing behind it.
                        assert -0.13 < drawn - solid < 0.2, drawn_name
    assert faces > 500
    assert panes > 100


def test_no_ray_passes_the_windows_of_a_wall_with_holes() -> None:
    geometry = FrameGeometry(load_world(load_scene("urban_delivery")))
    camera = CameraModel.from_fov(320, 240, 60.0)
    depth = np.empty((240, 320), np.float32)
    renderer = FrameRenderer(geometry, camera)
    # In front of the depot, 6.2 m from its wall.
    renderer.render(looking((-1.0, 2.0, 2.9), (-1.0, 8.0, 2.9)), {"depth": depth})
    seen = depth[60:140]  # storeys, above the ground and below the eaves
    assert seen.max() < 6.2 + 0.2
    assert (seen > 6.2 + 0.1).mean() > 0.05  # panes behind the wall
    assert (np.abs(seen - 6.2) < 0.01).mean() > 0.4


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("grass", 0.08, 0.20), ("asphalt", 0.05, 0.12), ("street", 0.05, 0.13), ("concrete", 0.18, 0.35),
        ("wall_brick", 0.09, 0.22), ("wall_render", 0.45, 0.65), ("road_paint", 0.4, 0.75), ("earth", 0.10, 0.30),
    ],
)  # fmt: skip
def test_textures_have_the_albedo_of_real_materials(name: str, low: float, high: float) -> None:
    bgr = cv2.imdecode(np.frombuffer(textures.png(name), np.uint8), cv2.IMREAD_COLOR)
    assert bgr is not None
    linear = (bgr[:, :, ::-1].astype(np.float64) / 255.0) ** 2.2
    luminance = linear.mean(axis=(0, 1)) @ np.array([0.2126, 0.7152, 0.0722])
    assert low < luminance < high
