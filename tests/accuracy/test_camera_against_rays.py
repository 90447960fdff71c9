"""The chain from the vehicle's pose to a pixel (mount, lens, shutter, renderer) against MuJoCo's rays."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest

from signals.rotation import applied, matrix_of
from signals.samples import ImageSample, TruthState
from sim.frame.mount import Mount, moved
from sim.frame.source import SharedFrames
from sim.scene.scene import Box, load_scene
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation

BOXES = tuple(
    Box(name=f"box_{i}", center_m=(4.0 + 3.0 * i, (-1) ** i * 2.0 * i, 1.0 + 0.5 * i), size_m=(1.5, 2.0, 2.0 + i))
    for i in range(4)
)
SCENE = load_scene("airfield").model_copy(update={"boxes": BOXES})
MOUNT = {"mount_m": (0.12, -0.03, 0.05), "mount_rpy_deg": (5.0, 12.0, -8.0)}
LENSES: dict[str, dict[str, Any]] = {
    "pinhole": {"fov_deg": 90.0},
    "calibrated": {"fov_deg": None, "intrinsics": {"fx": 70.0, "fy": 68.0, "cx": 50.2, "cy": 35.1}},
    "brown_conrady": {"fov_deg": 80.0, "distortion": {"model": "brown_conrady", "k1": -0.1, "k2": 0.01, "p1": 0.002}},
    "fisheye": {"fov_deg": 190.0, "distortion": {"model": "kannala_brandt", "k1": -0.02, "k2": 0.003}},
}


def truth(seed: int) -> TruthState:
    rng = np.random.default_rng(seed)
    roll, pitch, yaw = rng.uniform(-15, 15), rng.uniform(-15, 15), rng.uniform(-30, 30)
    q = Mount((0.0, 0.0, 0.0), (roll, pitch, yaw), optical=False).q_BC
    p = (float(rng.uniform(-3, 0)), float(rng.uniform(-2, 2)), float(rng.uniform(2, 4)))
    zero = (0.0, 0.0, 0.0)
    return TruthState(0, 0, p, q, (2.0, -1.0, 0.5), (0.3, -0.4, 1.5), zero, zero, (0.0,) * 4, False)


@pytest.fixture(scope="module")
def frames() -> SharedFrames:
    from sim.world_loader import load_world

    return SharedFrames(load_world(SCENE))


def ray_ranges(frames: SharedFrames, p_WC: Any, R_WC: Any, rays_C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    model = frames.world.model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ranges, geoms = [], []
    found = np.zeros(1, np.int32)
    for ray in rays_C:
        direction = np.array(applied(R_WC, tuple(ray)))
        distance = mujoco.mj_ray(model, data, np.array(p_WC), direction, None, 1, -1, found)
        ranges.append(distance if distance >= 0.0 else math.inf)
        geoms.append(int(found[0]))
    return np.array(ranges), np.array(geoms)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("readout_s", [0.0, 0.02], ids=["at once", "rolling"])
def test_every_pixel_agrees_with_its_ray(frames: SharedFrames, lens: str, readout_s: float) -> None:
    camera = make_sensor(
        Installation("front", rate_hz=10.0, seed=1, scene=SCENE, step_ns=4_000_000, frames=frames),
        preset="camera_320x240",
        overrides={"resolution": (96, 72), "channels": ("range", "geom", "radial_velocity"), "far_m": 300.0}
        | {"rolling_shutter_s": readout_s}
        | MOUNT
        | LENSES[lens],
    )
    state = truth(5)
    sample = camera.sample(state, 0)
    assert isinstance(sample, ImageSample)
    rays_C = camera.model.rays()  # type: ignore[attr-defined]
    rng = np.random.default_rng(1)
    agreed = 0
    assert sample.p_WC == pytest.approx(Mount(**MOUNT).pose(state).p_WC)  # the stamp is the middle row's
    assert sample.q_WC == pytest.approx(Mount(**MOUNT).attitude(state))
    for row in rng.choice(72, 24, replace=False):
        late_s = readout_s * ((row // 4 * 4 + 2) / 72 - 0.5)
        p_WB, q_WB, v_WB_W, w_WB_B = moved(state, late_s)
        R_WB = matrix_of(q_WB)
        p_WC = np.add(p_WB, applied(R_WB, MOUNT["mount_m"]))  # type: ignore[arg-type]
        mount = Mount((0.0, 0.0, 0.0), MOUNT["mount_rpy_deg"])  # type: ignore[arg-type]
        R_WC = matrix_of(mount.attitude(state._replace(q_WB=q_WB)))
        columns = rng.choice(96, 12, replace=False)
        ranges, geoms = ray_ranges(frames, p_WC, R_WC, rays_C[row, columns])
        seen = sample.channels["geom"][row, columns]
        same = (seen == geoms) & (ranges < 60.0)  # an edge very close to a pixel's centre may fall either way
        agreed += int(((seen == geoms) | (ranges > 250.0)).sum())
        assert np.abs(sample.channels["range"][row, columns][same] - ranges[same]).max(initial=0.0) < 1e-3
        # Only the camera moves: the radial velocity is its own, negated along the ray.
        v_WC = np.add(v_WB_W, np.cross(applied(R_WB, w_WB_B), applied(R_WB, MOUNT["mount_m"])))  # type: ignore[arg-type]
        own = [-float(np.dot(v_WC, applied(R_WC, tuple(ray)))) for ray in rays_C[row, columns]]
        assert np.abs(sample.channels["radial_velocity"][row, columns] - own)[same].max(initial=0.0) < 1e-4
    assert agreed >= 0.99 * 24 * 12
