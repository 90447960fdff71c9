"""Every shape, turned and overlapping, against the slow exact reference, through every kind of lens."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from hil.bench_suite.raster import buffers
from hil.bench_suite.raster_cases import camera_pose, looking, world_of
from sim.frame.camera_model import CameraModel
from sim.frame.distortion import BrownConrady, KannalaBrandt
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer
from tests.reference.frame_reference import cast
from tests.reference.frame_shapes import posed, shapes_mjcf

CAMERAS = {
    "pinhole": CameraModel(120, 90, 60.0, 60.0, 60.0, 45.0),
    "off_centre": CameraModel(101, 75, 70.0, 55.0, 40.3, 52.1),
    "brown_conrady": CameraModel.from_fov(120, 90, 80.0, BrownConrady(-0.2, 0.05, 0.001, -0.0005, 0.0)),
    "fisheye": CameraModel.from_fov(100, 100, 180.0, KannalaBrandt(0.02, -0.003, 0.0, 0.0)),
}
_TRIANGLES = (int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_HFIELD))


@pytest.mark.parametrize("lens", CAMERAS)
@pytest.mark.parametrize(
    ("seed", "p_W", "azimuth_deg", "down_deg"), [(1, (-13, 0, 5), 0, 15), (2, (2, 12, 8), -100, 40)]
)
def test_against_the_reference(
    lens: str, seed: int, p_W: tuple[float, ...], azimuth_deg: float, down_deg: float
) -> None:
    camera = CAMERAS[lens]
    world = world_of(shapes_mjcf(seed))
    R_WC = looking(azimuth_deg, down_deg, roll_deg=7.0)
    rays_C = camera.rays().reshape(-1, 3)
    # The near plane of a pinhole is a plane, that of other cameras a sphere.
    t_min = 0.05 / rays_C[:, 2] if camera.pinhole else 0.05
    exact = cast(world.model, posed(world.model), np.array(p_W, float), rays_C @ R_WC.T, t_min=t_min)
    out = buffers(camera, ("geom", "range", "depth", "normal", "instance"))
    FrameRenderer(FrameGeometry(world), camera).render(camera_pose(np.array(p_W, float), R_WC), out)
    shape = (camera.height, camera.width)
    geom = exact.geom.reshape(shape)
    assert (out["geom"] == geom).mean() >= 0.998
    inside = np.ones(shape, bool)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            inside &= np.roll(geom, (dy, dx), (0, 1)) == geom
    inside[[0, -1]] = inside[:, [0, -1]] = False
    assert (out["geom"][inside] == geom[inside]).mean() >= 0.9995
    compared = inside & (geom >= 0) & (out["geom"] == geom)
    range_m = exact.range_m.reshape(shape)
    assert len(np.unique(geom[compared])) >= 10
    assert np.abs(out["range"][compared] - range_m[compared]).max() <= 1e-4
    depth = range_m[compared] * camera.rays()[..., 2][compared]
    assert np.abs(out["depth"][compared] - depth).max() <= 1e-4
    primitive = compared & ~np.isin(world.model.geom_type[geom], _TRIANGLES)
    normal_C = (exact.normal_W @ R_WC).reshape(*shape, 3)
    sine = np.linalg.norm(np.cross(out["normal"].astype(float), normal_C), axis=-1)[primitive]
    # At a crease of one geom (the rim of a cylinder, the edge of a box) the last bits choose the side.
    assert np.mean(sine > np.sin(np.deg2rad(0.1))) <= 1e-3
    assert (np.einsum("ijk,ijk->ij", out["normal"], normal_C)[primitive] > 0).mean() >= 0.999
    np.testing.assert_array_equal(out["instance"][geom < 0], 0)
    assert np.isinf(out["range"][(geom < 0) & inside]).all()
