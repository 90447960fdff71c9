"""Clouds, hills and distant fields: what they change, what they leave, and how much of the sky they cover."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.raster_cases import camera_pose, looking
from signals.channels import CHANNELS
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import Execution, FrameRenderer
from sim.frame.shading import PLAIN, Shading
from sim.scene.light import Light
from tests.accuracy.test_frame_shading import geometry_of, linear
from tests.unit.sim.frame.test_frame_raster import ISAS

Array = NDArray[np.float64]
CAMERA = CameraModel.from_fov(96, 96, 60.0)
SURROUNDED = replace(PLAIN, surroundings=True)
HILLS_END = 0.075  # sine of the elevation above which there is sky alone
GROUND = '<geom name="ground" type="plane" size="0 0 1" rgba="0.4 0.5 0.3 1"/>'


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> FrameGeometry:
    return geometry_of(tmp_path_factory.mktemp("sky"), "", GROUND)


def taken(geometry: FrameGeometry, shading: Shading, view: tuple[float, float], **told) -> dict[str, Array]:  # type: ignore[no-untyped-def]
    """Return all channels 5 m above the ground. `view`: azimuth from the east, and elevation downwards [deg]."""
    renderer = FrameRenderer(geometry, CAMERA, shading=shading, **told)
    out = renderer.buffers(*CHANNELS)
    renderer.render(camera_pose(np.array((0.0, 0.0, 5.0)), looking(*view, roll_deg=0.0)), out)
    return out


def sines_up(view: tuple[float, float]) -> Array:
    columns, rows = np.meshgrid(np.arange(96) + 0.5, np.arange(96) + 0.5)
    d = np.stack([(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones((96, 96))], axis=-1)
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    return np.asarray((d @ looking(*view, roll_deg=0.0).T)[..., 2])


def test_only_colour_changes(plane: FrameGeometry) -> None:
    bare, full = (taken(plane, shading, (20.0, 5.0)) for shading in (PLAIN, SURROUNDED))
    assert not np.array_equal(bare["rgb"], full["rgb"])
    for name in CHANNELS:
        assert name == "rgb" or np.array_equal(bare[name], full[name], equal_nan=True), name


def test_the_ground_within_150_m_stays(plane: FrameGeometry) -> None:
    bare, full = (taken(plane, shading, (20.0, 5.0)) for shading in (PLAIN, SURROUNDED))
    near = bare["range"] < 150.0
    assert near.mean() > 0.3
    assert np.array_equal(bare["rgb"][near], full["rgb"][near])
    far = (bare["range"] > 500.0) & np.isfinite(bare["range"])
    assert far.any()
    assert not np.array_equal(bare["rgb"][far], full["rgb"][far])


def test_without_clouds_the_sky_above_the_hills_is_plain(plane: FrameGeometry) -> None:
    light = Light(clouds=0.0)
    for view in ((0.0, -30.0), (130.0, -45.0), (250.0, -12.0)):
        up = sines_up(view)[..., None]
        k = up * (2.0 - up)
        horizon, zenith = np.array(light.sky_horizon_rgb), np.array(light.sky_zenith_rgb)
        expected = horizon + k * (zenith - horizon)
        seen = linear(np.asarray(taken(plane, SURROUNDED, view, light=light)["rgb"], float))
        sky = up[..., 0] > HILLS_END
        assert np.abs(seen - expected)[sky].max() < 0.009  # 1.2 codes: rounding, and the fit of the curve of sRGB


def test_the_sky_is_covered_as_asked(plane: FrameGeometry) -> None:
    shares = []
    for clouds in (0.1, 0.4, 0.7, 1.0):
        covered = []
        for azimuth_deg in range(0, 360, 60):
            view = (float(azimuth_deg), -35.0)
            clear, cloudy = (
                np.asarray(taken(plane, SURROUNDED, view, light=Light(clouds=c))["rgb"], float) for c in (0.0, clouds)
            )
            covered.append(np.abs(cloudy - clear).max(axis=-1) > 25.0)
        shares.append(float(np.mean(covered)))
    assert shares == sorted(shares)
    few, some, _, full = shares
    assert few < 0.25
    assert 0.2 < some < 0.65
    assert full > 0.85


def test_hills_stand_all_round_without_a_gap(plane: FrameGeometry) -> None:
    heights = []
    for azimuth_deg in range(0, 360, 40):  # views overlap: 60 degrees wide
        view = (float(azimuth_deg), 0.0)
        up = sines_up(view)
        bare, full = (
            np.asarray(taken(plane, s, view, light=Light(clouds=0.0))["rgb"], float) for s in (PLAIN, SURROUNDED)
        )
        hill = (np.abs(full - bare).max(axis=-1) > 2.0) & (up > 0.0)
        assert hill[up > HILLS_END].sum() == 0
        column = hill.sum(axis=0)
        assert column.min() >= 1  # in every direction
        assert np.abs(np.diff(column)).max() <= 3  # no jump where the table begins again
        heights += column.tolist()
    assert np.std(heights) > 0.5  # they rise and fall


def test_sets_of_instructions_agree(plane: FrameGeometry) -> None:
    for view in ((75.0, 3.0), (190.0, -40.0)):
        pictures = [taken(plane, SURROUNDED, view, execution=Execution(isa=isa))["rgb"] for isa in ISAS]
        assert all(np.array_equal(pictures[0], other) for other in pictures[1:])
