"""Corner reflectors against rays that are mirrored three times, and in the map that has them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.distortion import BrownConrady, KannalaBrandt
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer
from sim.radar.corner_echoes import effective_area_m2
from sim.radar.echoes import Echoes
from sim.radar.mask import Mask
from sim.radar.scatterers import Scatterers
from sim.scene.scene import Scene, load_scene
from sim.scene.world import World
from sim.world_loader import load_world
from tests.worlds.radar_scenes import ANTENNA, CHIRP, EASTWARDS, POWER_SCALE, RECEIVER

POSE = CameraPose((0.0, 0.0, 1.8), EASTWARDS, (2.0, -1.0, 0.5))
EDGES = (0.2, 0.3, 0.2)  # of the map's reflectors
PERSON = {"generator": "radar_range", "person": False}


def scene(*boxes: dict[str, object]) -> World:
    plain = load_scene("radar_range").model_dump()
    return load_world(Scene.model_validate(plain | {"name": "range", "map": PERSON, "boxes": boxes}))


def echoes_of(world: World, camera: CameraModel, pose: CameraPose = POSE, mask: Mask = Mask()) -> tuple[int, Echoes]:  # noqa: B008
    made = Scatterers(camera, world, CHIRP, ANTENNA, RECEIVER, mask)
    renderer = FrameRenderer(FrameGeometry(world), camera)
    picture = renderer.buffers(*made.channels)
    renderer.render(pose, picture)
    echoes = made.collect(picture, pose)
    assert len(echoes.amplitude) == made.last.kept + made.last.corners
    return made.last.corners, echoes


@pytest.mark.parametrize(
    "cosines", [(1, 1, 1), (0.9, 1, 1.2), (0.2, 1, 1.1), (0.3, 0.4, 1), (0.1, 0.1, 1), (1, 1, 0.05)]
)
def test_area_against_rays_that_bounce(cosines: tuple[float, float, float]) -> None:
    """Parallel rays onto three unit plates: those that meet each once come back as they went."""
    d = np.array(cosines) / np.linalg.norm(cosines)
    side = np.linalg.svd(d[None])[2][1:]  # the plane that they come through
    steps = np.linspace(-2.0, 2.0, 801)[:-1] + 0.0025
    at = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    p, v = at @ side + 10.0 * d, np.repeat(-d[None], len(at), axis=0)
    met = np.zeros((len(at), 3), bool)
    for _ in range(3):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.where(v < 0.0, -p / v, np.inf)  # to each plane, from its front
        hits = np.full(t.shape, np.inf)
        for k in range(3):
            q = p + v * np.where(np.isfinite(t[:, k]), t[:, k], 0.0)[:, None]
            others = np.delete(q, k, axis=1)
            inside = np.all((others >= 0.0) & (others <= 1.0), axis=1) & (t[:, k] > 1e-9)
            hits[inside, k] = t[inside, k]
        first = hits.argmin(axis=1)
        hit = np.isfinite(hits.min(axis=1))
        p = p + v * np.where(hit, hits.min(axis=1), 0.0)[:, None]
        rows = np.flatnonzero(hit)
        v[rows, first[rows]] *= -1.0
        p[rows, first[rows]] = 0.0
        met[rows, first[rows]] = True
    area = np.count_nonzero(met.all(axis=1)) * (steps[1] - steps[0]) ** 2
    expected = effective_area_m2((float(d[0]), float(d[1]), float(d[2])), 1.0)
    assert area == pytest.approx(expected, rel=0.01, abs=0.003)


def test_no_way_by_three_plates_from_behind_or_along_one() -> None:
    assert effective_area_m2((0.6, 0.8, 0.0), 1.0) == 0.0
    assert effective_area_m2((0.6, -0.6, 0.5), 1.0) == 0.0
    assert effective_area_m2((math.sqrt(1 / 3),) * 3, 0.2) == pytest.approx(math.sqrt(3.0) * 0.04, rel=1e-12)


def test_the_reflectors_of_the_map_echo_as_their_formula_says() -> None:
    count, echoes = echoes_of(scene(), CameraModel.from_fov(320, 240, 90.0))
    assert count == 3
    where = [(5.0, 25.0, 1.2), (8.0, -22.0, 1.2), (11.0, 10.0, 2.0)]
    for i, (flat_m, azimuth_deg, height_m) in enumerate(where):
        row = len(echoes.range_m) - 3 + i
        azimuth = math.radians(azimuth_deg)
        to = np.array([flat_m * math.cos(azimuth), flat_m * math.sin(azimuth), height_m - 1.8])
        range_m = float(np.linalg.norm(to))
        assert echoes.range_m[row] == pytest.approx(range_m, rel=1e-12)
        assert echoes.direction_R[row] == pytest.approx(to / range_m, rel=1e-12)
        assert echoes.speed_mps[row] == pytest.approx(-(to @ [2.0, -1.0, 0.5]) / range_m, rel=1e-12)
        sigma = 12.0 * math.pi * EDGES[i] ** 4 / CHIRP.wavelength_m**2
        share = ANTENNA.share(echoes.direction_R[row : row + 1])[0]
        assert echoes.amplitude[row] ** 2 == pytest.approx(POWER_SCALE * share * sigma / range_m**4, rel=1e-9)


@pytest.mark.parametrize("distortion", [BrownConrady(-0.1, 0.01, 0.001, -0.001), KannalaBrandt(-0.02, 0.003, 0.0, 0.0)])
def test_distorted_cameras_see_them_too(distortion: BrownConrady | KannalaBrandt) -> None:
    assert echoes_of(scene(), CameraModel.from_fov(320, 240, 80.0, distortion))[0] == 3


def test_what_stands_before_one_hides_it_and_what_stands_behind_does_not() -> None:
    camera = CameraModel.from_fov(320, 240, 90.0)
    azimuth = math.radians(-22.0)

    def box(range_m: float) -> dict[str, object]:
        centre = [range_m * math.cos(azimuth), range_m * math.sin(azimuth), 1.4]
        return {"name": "wall", "center_m": centre, "size_m": [0.3, 0.3, 2.0]}

    assert echoes_of(scene(box(6.0)), camera)[0] == 2
    assert echoes_of(scene(box(9.5)), camera)[0] == 3


def test_masks_and_views_that_leave_them_out() -> None:
    camera, world = CameraModel.from_fov(320, 240, 90.0), scene()
    assert echoes_of(world, camera, mask=Mask(max_range_m=10.0))[0] == 2
    assert echoes_of(world, camera, mask=Mask(azimuth_deg=(0.0, 45.0)))[0] == 2
    assert echoes_of(world, camera, mask=Mask(classes=("ground",)))[0] == 0
    assert echoes_of(world, camera, mask=Mask(classes=("reflector",)))[0] == 3
    behind = CameraPose((20.0, 0.0, 1.8), (0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0))  # looks west
    assert echoes_of(world, camera, behind)[0] == 0
    away = CameraPose((0.0, 0.0, 1.8), (0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0))
    assert echoes_of(world, camera, away)[0] == 0
