"""Labels of radar frames: objects of a picture with the range, direction, speed and expected power of their echoes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer
from sim.radar.echoes import Echoes
from sim.radar.ghost_echoes import Ghosts
from sim.radar.ghost_objects import ghost_objects
from sim.radar.mask import Mask
from sim.radar.object_echoes import ObjectEcho, ObjectEchoes
from sim.radar.receiver import Receiver
from sim.scene.world import World
from tests.worlds.radar_scenes import ANTENNA, CHIRP, EASTWARDS, LAMBERT, POWER_SCALE, RECEIVER, world_of

CHANNELS = ("range", "normal", "material", "radial_velocity", "instance")
CAMERA = CameraModel.from_fov(640, 480, 70.0)
RADIUS_M = 0.3
# Three spheres: straight ahead, to the left and above, and beyond the chirp's 12 m.
BODIES = "".join(
    f'<body name="{name}" pos="{x} {y} {z}"><geom size="{RADIUS_M}" material="m"/></body>'
    for name, x, y, z in (("ahead", 6, 0, 0), ("left", 8, 3, 2), ("far", 14, -4, 0))
)
PLACES = ((6.0, 0.0, 0.0), (8.0, 3.0, 2.0))
POSE = CameraPose((0.0, 0.0, 0.0), EASTWARDS, (2.0, 0.0, 0.0))


def picture_from(world: World, pose: CameraPose) -> dict[str, NDArray[Any]]:
    renderer = FrameRenderer(FrameGeometry(world), CAMERA)
    picture = renderer.buffers(*CHANNELS)
    renderer.render(pose, picture)
    return picture


def objects_in(world: World, receiver: Receiver = RECEIVER, mask: Mask = Mask()) -> dict[str, ObjectEcho]:  # noqa: B008
    finder = ObjectEchoes(CAMERA, world, CHIRP, ANTENNA, receiver, mask)
    found = finder.find(picture_from(world, POSE), POSE)
    return {world.instance_names[o.instance]: o for o in found}


def test_spheres_have_the_place_speed_and_power_of_the_radar_equation(tmp_path: Path) -> None:
    """Lambertian spheres of (8/3) pi r^2, 3/4 of their radius nearer than their middles; the radar flies at 2 m/s."""
    found = objects_in(world_of(tmp_path, BODIES, LAMBERT))
    assert list(found) == ["ahead", "left"]
    for o, place in zip(found.values(), PLACES, strict=True):
        distance_m = float(np.linalg.norm(place))
        range_m = distance_m - 0.75 * RADIUS_M
        assert o.range_m == pytest.approx(range_m, abs=0.01)
        assert o.nearest_m == pytest.approx(distance_m - RADIUS_M, abs=0.003)
        assert o.azimuth_rad == pytest.approx(math.atan2(place[1], place[0]), abs=2e-3)
        assert o.elevation_rad == pytest.approx(math.asin(place[2] / distance_m), abs=2e-3)
        assert o.speed_mps == pytest.approx(-2.0 * place[0] / distance_m, abs=0.01)
        gain = ANTENNA.share(np.array([place]) / distance_m)[0]
        # From near by, rays meet the sphere at greater angles: to first order in r / R, 1.5 r / R of the power is lost.
        nearby = 1.0 - 1.5 * RADIUS_M / distance_m
        expected = POWER_SCALE * gain * nearby * 8.0 / 3.0 * math.pi * RADIUS_M**2 / range_m**4
        assert abs(10.0 * math.log10(o.power_counts2 / expected)) < 0.05
        assert o.power_w == pytest.approx(o.power_counts2 / RECEIVER.counts_per_sqrt_watt**2)


def test_filters_lower_the_power_behind_them_alone(tmp_path: Path) -> None:
    world = world_of(tmp_path, BODIES, LAMBERT)
    plain = objects_in(world)["ahead"]
    f_hz = CHIRP.beat_frequency_hz(plain.range_m)
    filtered = RECEIVER.model_copy(update={"hp_cutoff_hz": f_hz, "aaf_cutoff_hz": 2.0 * f_hz})
    o = objects_in(world, filtered)["ahead"]
    assert o.power_w == pytest.approx(plain.power_w)
    assert o.power_counts2 == pytest.approx(plain.power_counts2 * 0.5 * 0.8, rel=0.01)


def test_mask_and_hidden_objects_have_no_row(tmp_path: Path) -> None:
    world = world_of(tmp_path, BODIES, LAMBERT)
    assert list(objects_in(world, mask=Mask(max_range_m=7.0))) == ["ahead"]
    assert list(objects_in(world, mask=Mask(azimuth_deg=(10.0, 40.0)))) == ["left"]
    wall = '<body name="wall" pos="4 0 0"><geom type="box" size=".1 .4 .4" material="m"/></body>'
    assert set(objects_in(world_of(tmp_path, BODIES + wall, LAMBERT))) == {"wall", "left"}


def test_an_empty_picture_has_no_objects(tmp_path: Path) -> None:
    behind = '<body name="behind" pos="-5 0 0"><geom size=".3" material="m"/></body>'
    assert objects_in(world_of(tmp_path, behind, LAMBERT)) == {}


def test_a_frame_without_ghosts_has_no_labels_of_ghosts() -> None:
    """High above all mirrors a radar with bounces finds none, and a data set goes on."""
    none = np.empty(0)
    ids = np.empty(0, np.int64)
    ghosts = Ghosts(Echoes(none, none, np.empty((0, 3)), none, np.empty((0, 3))), np.empty(0, np.uint8), ids, ids)
    assert ghost_objects(ghosts, CHIRP, RECEIVER) == []
