"""Textures lie as MuJoCo's own renderer lays them: meshes, planes, boxes, cube maps. Skipped without OpenGL."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from hil.apps.bench_suite.sensors.raster_cases import camera_pose
from signals.samples import Vec3
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.mujoco_backend import MujocoColour, egl_problem
from sim.frame.renderer import FrameRenderer
from sim.scene.scene import load_scene
from sim.world_loader import load_world

CAMERA = CameraModel.from_fov(96, 96, 50.0)
SCENE = """\
name: textures
description: one thing with a picture on it
site: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488.0}
ground_friction: 0.8
map: {mjcf: map.xml}
"""
QUAD = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv 0 0 -1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n" + (
    "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\nf 1/1 5/1 2/2\nf 2/2 5/1 3/3\nf 3/3 5/1 4/4\nf 4/4 5/1 1/1\n"
)
THINGS = {
    "plane": '<geom type="plane" size="1 1 1" pos="0 0 4" material="flat"/>',
    "box": '<geom type="box" size="1 1 0.5" pos="0 0 4" material="flat"/>',
    "mesh": '<geom type="mesh" mesh="quad" pos="0 0 4" material="flat"/>',
    "cube": '<geom type="box" size="0.7 0.7 0.7" pos="0 0 4" material="faces"/>',
    "ball": '<geom type="sphere" size="0.9" pos="0 0 4" material="faces"/>',
}
# Viewpoint, and the axis that is up in the picture.
TOP, BOTTOM = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)), ((0.0, 0.0, -1.0), (0.0, -1.0, 0.0))
SIDES = [
    ((1.0, 0, 0), (0, 0, 1.0)),
    ((-1.0, 0, 0), (0, 0, 1.0)),
    ((0, 1.0, 0), (0, 0, 1.0)),
    ((0, -1.0, 0), (0, 0, 1.0)),
]
CASES = [(name, TOP) for name in ("plane", "box", "mesh")]
CASES += [(name, side) for name in ("cube", "ball") for side in (TOP, BOTTOM, *SIDES)]


def picture(size: int, tint: int) -> np.ndarray:
    """Return a picture with four quarters of different colours, others for every tint."""
    colours = np.array([[230, 30, 30], [30, 200, 30], [40, 60, 230], [220, 210, 40]], np.uint8)
    colours = np.roll(colours, tint, axis=0)
    quarters = np.kron(np.arange(4).reshape(2, 2), np.ones((size // 2, size // 2), int))
    return np.ascontiguousarray(colours[quarters][:, :, ::-1])


@pytest.mark.parametrize(("name", "view"), CASES)
def test_pictures_lie_as_mujoco_lays_them(name: str, view: tuple[Vec3, Vec3], tmp_path: Path) -> None:
    if egl_problem():
        pytest.skip(egl_problem())
    faces = ("right", "left", "up", "down", "front", "back")
    for k, face in enumerate(faces):
        cv2.imwrite(str(tmp_path / f"{face}.png"), picture(64, k % 4))
    (tmp_path / "quad.obj").write_text(QUAD)
    files = " ".join(f'file{face}="{face}.png"' for face in faces)
    (tmp_path / "map.xml").write_text(
        '<mujoco><asset><texture name="flat" type="2d" file="right.png"/>'
        f'<texture name="faces" type="cube" {files}/>'
        '<material name="flat" texture="flat" specular="0"/><material name="faces" texture="faces" specular="0"/>'
        '<mesh name="quad" file="quad.obj"/></asset><worldbody><light directional="true" dir="0 0 -1"/>'
        f'{THINGS[name]}<geom name="far" type="sphere" size="0.1" pos="0 30 0.2"/></worldbody></mujoco>'
    )
    (tmp_path / "scene.yaml").write_text(SCENE)
    world = load_world(load_scene(tmp_path / "scene.yaml"))
    (away, up) = (np.array(v, float) for v in view)
    forward = -away
    right = np.cross(forward, up)
    pose = camera_pose(np.array([0.0, 0.0, 4.0]) + 4.0 * away, np.stack([right, -up, forward], axis=1))
    renderer = FrameRenderer(FrameGeometry(world), CAMERA)
    ours = renderer.buffers("rgb", "geom")
    renderer.render(pose, ours)
    theirs = np.zeros((96, 96, 3), np.uint8)
    colour = MujocoColour(world, CAMERA)
    colour.pose(0)
    colour.render(pose, theirs)
    colour.close()
    inside = cv2.erode((ours["geom"] == 0).astype(np.uint8), np.ones((5, 5))) > 0
    assert inside.sum() > 400

    def hue(rgb: np.ndarray) -> np.ndarray:
        values = rgb[inside].astype(float) + 1e-3
        values -= 0.9 * values.min(axis=1, keepdims=True)
        return values / np.linalg.norm(values, axis=1, keepdims=True)

    # Lighting differs, and the two blend differently where colours meet.
    alike = (hue(ours["rgb"]) * hue(theirs)).sum(axis=1) > 0.9
    assert alike.mean() > (0.8 if name == "ball" else 0.9)
