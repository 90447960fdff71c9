"""Frames of the four scenes and of other vehicles against mj_ray: a short version of `hil bench raster`."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from hil.apps.bench_suite.sensors.raster import buffers
from hil.apps.bench_suite.sensors.raster_cases import (
    SCENES,
    VEHICLES,
    Case,
    camera_pose,
    looking,
    scene_case,
)
from hil.apps.bench_suite.sensors.raster_errors import Errors, errors, truth
from signals.channels import CHANNELS
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.mujoco_backend import WorldPose
from sim.frame.renderer import FrameRenderer

CASES = (*SCENES, VEHICLES)
CAMERA = CameraModel.from_fov(160, 120, 90.0)


@pytest.fixture(scope="module", params=CASES)
def scene(request: pytest.FixtureRequest) -> str:
    """One scene after the other, so that processes that share this file seldom share a scene."""
    return str(request.param)


@cache
def case_of(scene: str) -> Case:
    return scene_case(scene, views=4, seed=11)


@cache
def errors_in(scene: str) -> Errors:
    case = case_of(scene)
    geometry, posed = FrameGeometry(case.world), WorldPose(case.world)
    renderer = FrameRenderer(geometry, CAMERA)
    out = buffers(CAMERA, [name for name in CHANNELS if name != "rgb"])
    parts = []
    for i, view in enumerate(case.views):
        true = truth(case, view, posed, CAMERA, 1200, i)
        geometry.pose(view.t_ns)
        renderer.render(view.pose, out)
        parts.append(errors(out, true, case.world.model))
    return Errors.merged(parts)


def test_depth_and_range(scene: str) -> None:
    found = errors_in(scene)
    assert len(found.depth_m) > 1500
    for error in (found.depth_m, found.range_m):
        assert np.quantile(error, 0.99) <= 1e-4
        assert error.max() <= 1e-3


def test_ids(scene: str) -> None:
    found = errors_in(scene)
    assert found.id_agrees.mean() >= 0.999
    assert found.id_agrees_anywhere.mean() >= 0.995


def test_normals_of_primitives(scene: str) -> None:
    found = errors_in(scene)
    assert len(found.normal_deg) > 500
    assert found.normal_deg.max() <= 0.1


def test_radial_velocity_is_the_twist_formula(scene: str) -> None:
    assert errors_in(scene).velocity_mps.max() <= 1e-4


@pytest.mark.parametrize("scene", SCENES)
def test_radial_velocity_of_limbs_is_the_rate_of_their_range(scene: str) -> None:
    """From the actors' poses alone: the same point of the same body 0.1 ms earlier and later."""
    case = case_of(scene)
    world = case.world
    geometry, posed = FrameGeometry(world), WorldPose(world)
    renderer = FrameRenderer(geometry, CAMERA)
    out = buffers(CAMERA, ("geom", "range", "radial_velocity"))
    t_ns, dt_ns, v_C = 7_300_000_000, 100_000, np.array([2.0, -1.0, 0.5])
    body_of = world.model.geom_bodyid
    seen: set[int] = set()
    for actor in world.map.actors[:3]:
        centre, radius = actor.bound(t_ns)
        R_WC = looking(40.0, 10.0)
        p_WC = np.array(centre) - 2.5 * max(radius, 0.5) * R_WC[:, 2]
        geometry.pose(t_ns)
        renderer.render(camera_pose(p_WC, R_WC, v_C), out)
        of_actor = np.isin(out["geom"], np.flatnonzero([world.model.body(b).name in actor.bodies for b in body_of]))
        rows, columns = (index[::7] for index in np.nonzero(of_actor))
        if len(rows) < 10:
            continue  # something stands in between
        bodies = body_of[out["geom"][rows, columns]]
        seen |= set(bodies.tolist())
        points_W = p_WC + out["range"][rows, columns][:, None] * (CAMERA.rays()[rows, columns] @ R_WC.T)
        data = posed.at(t_ns)
        R_WB, p_WB = data.xmat[bodies].reshape(-1, 3, 3).copy(), data.xpos[bodies].copy()
        points_B = np.einsum("nji,nj->ni", R_WB, points_W - p_WB)
        distance = []
        for sign in (-1, 1):
            data = posed.at(t_ns + sign * dt_ns)
            moved = data.xpos[bodies] + np.einsum("nij,nj->ni", data.xmat[bodies].reshape(-1, 3, 3), points_B)
            distance.append(np.linalg.norm(moved - p_WC - sign * dt_ns * 1e-9 * v_C, axis=1))
        rate = (distance[1] - distance[0]) / (2e-9 * dt_ns)
        np.testing.assert_allclose(out["radial_velocity"][rows, columns], rate, atol=1e-4)
    assert len(seen) >= 3  # limbs
