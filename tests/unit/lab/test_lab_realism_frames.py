"""Frames of `hil bench realism`: poses, boxes and visible shares, in a scene of boxes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hil.apps.bench_suite.sensors.raster_cases import camera_pose, looking
from lab.realism.frames import HEIGHT, WIDTH, Scenario
from lab.realism.kinds import BY_NAME
from sim.scene.surfaces import SKIN

CAR = BY_NAME["vehicle"]
SCENE = """\
<mujoco><worldbody>
  <geom name="ground" type="plane" size="50 50 1"/>
  <body name="car_0" pos="10 0 0.7"><geom type="box" size="2 0.9 0.7"/></body>
  <body name="wall_0" pos="5 {side} 1"><geom type="box" size="0.01 2 2"/></body>
</worldbody></mujoco>
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "boxes.xml"
    path.write_text(SCENE.format(side=40))
    return path


def test_poses_are_those_of_a_low_drone_and_repeat(scene: Path) -> None:
    frames = [pose[0] for pose in Scenario(str(scene), None).poses(CAR, 6, lambda _: ("low",))]
    again = [pose[0] for pose in Scenario(str(scene), None).poses(CAR, 6, lambda _: ("low",))]
    assert len(frames) == 6
    for frame, same in zip(frames, again, strict=True):
        np.testing.assert_array_equal(frame.rgb, same.rgb)
        assert frame.truths == same.truths
        assert 1.8 <= frame.distance_m <= 15.0
        assert 1.2 <= frame.height_m <= 6.0
        assert frame.truths[0].name == "car_0"
        assert frame.truths[0].counts


def test_poses_from_above_keep_to_their_elevations(scene: Path) -> None:
    scenario = Scenario(str(scene), None, (40.0, 60.0))
    middle = np.array([10.0, 0.0, 0.7])
    poses = []
    draw = scenario._draw_pose
    scenario._draw_pose = lambda *args: poses.append(draw(*args)) or poses[-1]  # type: ignore[method-assign]
    frames = [pose[0] for pose in scenario.poses(CAR, 6, lambda _: ("low",))]
    assert len(frames) == 6
    for pose, distance_m in poses:
        away = np.array(pose.p_WC) - middle
        elevation_deg = np.degrees(np.arctan2(away[2], np.hypot(away[0], away[1])))
        assert 40.0 <= elevation_deg <= 60.0
        assert 3.0 <= distance_m <= 16.0
        # The middle is in the picture, within 12 degrees across and 8 degrees up or down.
        x, y, z = np.array(pose.R_WC).reshape(3, 3).T @ -away
        assert z > 0.0
        assert abs(np.degrees(np.arctan2(np.hypot(x, y), z))) < 16.0


def test_the_box_is_that_of_the_projected_corners(scene: Path) -> None:
    scenario = Scenario(str(scene), None)
    eye, R_WC = np.array([2.0, 3.0, 2.5]), looking(-20.0, 12.0, roll_deg=2.0)
    (truth,) = scenario._truths(camera_pose(eye, R_WC), 0, 2) or ()
    corners = np.array([(10.0 + x, y, 0.7 + z) for x in (-2, 2) for y in (-0.9, 0.9) for z in (-0.7, 0.7)])
    x, y, z = R_WC.T @ (corners - eye).T
    camera = scenario._camera
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    np.testing.assert_allclose(truth.box_px, [u.min(), v.min(), u.max(), v.max()], atol=1.0)
    assert truth.share == pytest.approx(1.0, abs=0.02)


def test_the_share_tells_what_a_wall_and_the_border_hide(tmp_path: Path) -> None:
    path = tmp_path / "wall.xml"
    path.write_text(SCENE.format(side=2))  # in front of the half at y > 0, seen from x = 0
    scenario = Scenario(str(path), None)
    straight = camera_pose(np.array([0.0, 0.0, 0.7]), looking(0.0, 0.0))
    assert scenario._truths(straight, 0, 2) is None  # half of it is hidden: it does not count
    scene = Scenario(str(path), None)
    scene._frames.expect(0)
    picture = np.zeros((HEIGHT, WIDTH), np.uint16)
    scene._truth.render(straight, {"instance": picture})
    assert scene._truth_of(2, picture, straight, 0).share == pytest.approx(0.5, abs=0.02)
    # The border cuts the car in the middle.
    R_WC = looking(-35.0, 0.0)  # half of the 70 degrees across
    scene._truth.render(camera_pose(np.array([0.0, 0.0, 0.7]), R_WC), {"instance": picture})
    cut = scene._truth_of(2, picture, camera_pose(np.array([0.0, 0.0, 0.7]), R_WC), 0)
    assert cut.box_px[0] == 0.0
    assert cut.share < 0.6


def test_a_driver_is_a_person_who_never_counts(scene: Path) -> None:
    scenario = Scenario(str(scene), None)
    skin = len(scenario.world.surfaces)
    scenario.world = replace(scenario.world, surfaces=(*scenario.world.surfaces, SKIN))
    instances, surfaces = np.zeros((HEIGHT, WIDTH), np.uint16), np.zeros((HEIGHT, WIDTH), np.uint8)
    instances[100:300, 100:500] = 2  # the car
    surfaces[140:160, 200:230] = skin
    (driver,) = scenario._riders(instances, surfaces)
    assert driver.box_px == (185.0, 130.0, 245.0, 170.0)
    assert driver.kind.name == "person"
    assert not driver.counts
