"""Mesh of the 3-D view: triangles at the geoms of the world, people and vehicles at their places."""

from __future__ import annotations

import math
import struct
from typing import Any

import mujoco
import numpy as np
import pytest

from hil.apps.dash.views.scene_mesh import scene_triangles
from hil.apps.view.command import load_frames
from sim.frame.scene_mesh import Actors, _colour, into_frame

CORNER = np.dtype([("at", "<f4", 3), ("colour", "u1", 4)])


def parsed(data: bytes) -> tuple[Any, list[tuple[tuple[float, ...], Any]]]:
    """Return the static mesh, and (place, corners) of each moving one. Asserts that no bytes are left over."""

    def mesh(at: int) -> tuple[Any, int]:
        (count,) = struct.unpack_from("<I", data, at)
        return np.frombuffer(data, CORNER, count, at + 4), at + 4 + count * CORNER.itemsize

    still, at = mesh(0)
    (actors,) = struct.unpack_from("<I", data, at)
    at += 4
    moving = []
    for _ in range(actors):
        place = struct.unpack_from("<4f", data, at)
        corners, at = mesh(at + 16)
        moving.append((place, corners))
    assert at == len(data)
    return still, moving


@pytest.fixture(scope="module")
def park() -> Any:
    _, world, _ = load_frames("city_park", None)
    return world


def test_every_visible_geom_is_there_in_whole_triangles(park: Any) -> None:
    still, moving = parsed(scene_triangles(park))
    assert len(still) % 3 == 0
    assert len(still) > 1000
    assert np.all(np.isfinite(still["at"]))
    assert set(still["colour"][:, 3].tolist()) == {255}
    assert len(moving) == len(park.map.actors) > 0
    assert all(len(corners) > 0 for _, corners in moving)


def test_a_box_is_where_its_geom_is(park: Any) -> None:
    still, _ = parsed(scene_triangles(park))
    model = park.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    boxes = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_BOX) & park.geom_visible & (park.geom_actor < 0))
    geom = max(boxes.tolist(), key=lambda g: float(model.geom_size[g].max()))
    for signs in np.ndindex(2, 2, 2):
        half = model.geom_size[geom] * (2.0 * np.array(signs) - 1.0)
        corner = data.geom_xpos[geom] + data.geom_xmat[geom].reshape(3, 3) @ half
        assert np.min(np.linalg.norm(still["at"] - corner, axis=1)) < 1e-3


def test_moving_meshes_fit_their_actors(park: Any) -> None:
    actors = Actors(park)
    _, moving = parsed(scene_triangles(park))
    for (place, corners), actor in zip(moving, park.map.actors, strict=True):
        x, y, z, yaw = place
        cos, sin = math.cos(yaw), math.sin(yaw)
        p = corners["at"].astype(np.float64) @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1.0]]) + (x, y, z)
        centre, radius_m = actor.bound(0)
        assert np.max(np.linalg.norm(p - centre, axis=1)) <= radius_m + 0.05
        assert np.allclose(into_frame(p.astype(np.float32), (x, y, z, yaw)), corners["at"], atol=1e-4)
    then, later = actors.places(0), actors.places(5_000_000_000)
    moved = [math.dist(a[:3], b[:3]) for a, b in zip(then, later, strict=True)]
    assert max(moved) > 1.0
    assert all(m <= 5.0 * actor.max_speed_mps + 1.0 for m, actor in zip(moved, park.map.actors, strict=True))


@pytest.mark.parametrize("kind", ["grey", "grey with alpha", "colour"])
def test_a_surface_has_the_mean_colour_of_its_texture(kind: str) -> None:
    """A texture of two channels is grey and alpha; alpha must not count as a colour."""
    shades = np.full((4, 4, 3), 100, np.uint8)
    pixels = {
        "grey": shades[..., 0],
        "grey with alpha": np.dstack([shades[..., 0], 0 * shades[..., 0]]),
        "colour": shades,
    }
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><asset><texture name="t" type="2d" builtin="flat" rgb1="0 0 0" width="4" height="4"/>
        <material name="m" texture="t" rgba="1 1 1 1"/></asset>
        <worldbody><geom type="box" size="1 1 1" material="m"/></worldbody></mujoco>"""
    )
    texels = pixels[kind].reshape(-1)
    model.tex_nchannel[0] = len(texels) // 16
    model.tex_data[: len(texels)] = texels
    assert _colour(model, 0).tolist() == [100, 100, 100, 255]
