"""The explorer's height map of the ground, and where it hovers after it gave up."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.worlds.flat_box_world import HEIGHT_M, Flat

from hil_companion.explore.ground import GROUND, OBSTACLE, UNKNOWN, Ground  # isort: skip

AREA = (-20.0, -20.0, 20.0, 20.0)
SPACING_M = 0.4


def field(x0: float, x1: float, y0: float, y1: float, z: float = 0.0) -> np.ndarray:
    x, y = (a.reshape(-1) for a in np.meshgrid(np.arange(x0, x1, SPACING_M), np.arange(y0, y1, SPACING_M)))
    return np.stack([x, y, np.full(len(x), z)], axis=1)


def test_bare_ground_roofs_and_unseen_cells() -> None:
    ground = Ground(AREA, level_m=0.0, radius_m=0.9)
    assert ground.below(0.0, 0.0) == UNKNOWN
    ground.stood_on(0.0, 0.0)
    assert ground.below(0.0, 0.0) == GROUND
    ground.add(np.concatenate([field(5.0, 15.0, -5.0, 5.0), field(8.0, 12.0, -2.0, 2.0, 3.0)]))
    assert ground.below(6.5, 0.0) == GROUND
    assert ground.below(10.0, 0.0) == OBSTACLE
    assert ground.below(7.3, 0.0) == OBSTACLE  # its edge
    assert ground.below(-10.0, 0.0) == UNKNOWN
    assert ground.below(19.9, 0.0) == UNKNOWN
    assert ground.below(1e6, 0.0) == UNKNOWN
    places = ground.places(10.0, 0.0, 5.0)
    away = np.hypot(*(places - (10.0, 0.0)).T)
    assert (np.diff(away) >= 0.0).all()
    assert 2.5 < away[0] < 4.0
    assert away.max() <= 5.0
    assert all(ground.below(x, y) == GROUND for x, y in places[:10])


def test_people_who_left_are_removed_and_people_who_stay_are_kept() -> None:
    ground = Ground(AREA, level_m=0.0, radius_m=0.9)
    person = np.array([(3.1, 3.1, 1.7)])
    for k in range(40):
        ground.add(np.concatenate([field(0.0, 6.0, 0.0, 6.0), person if k < 20 else person[:0]]))
        if k == 19:
            assert ground.below(3.1, 3.1) == OBSTACLE
    assert ground.below(3.1, 3.1) == GROUND


@pytest.mark.parametrize(("roof", "below"), [((5.0, 13.0), GROUND), ((-60.0, 60.0), OBSTACLE)])
def test_it_does_not_stay_over_a_roof_where_it_can_help_it(roof: tuple[float, float], below: str) -> None:
    """If the time runs out over a roof, the vehicle flies off it or, if it cannot, reports the obstacle below."""
    flat = Flat((), (30.0, 0.0), settings={"time_limit_s": 8.0, "unsafe_hover_s": 4.0, "height_m": HEIGHT_M})
    flat.p[2] = 0.2

    def with_roof(_t_s: float, points: np.ndarray) -> np.ndarray:
        all_m = field(-12.0, 12.0, -12.0, 12.0)
        all_m[:, 2] = np.where(abs(all_m[:, 0] + flat.p[0] - np.mean(roof)) < 0.5 * np.diff(roof), 2.0, 0.0)
        return np.concatenate([points, all_m - (0.0, 0.0, flat.p[2])])

    flat.lidar = with_roof
    flat.fly(30.0)
    report: Any = flat.explorer.report
    assert flat.outcome == "stuck"
    assert flat.explorer.finished
    assert report.below == below
    assert report.as_map()["below"] == below
    assert float(np.hypot(*flat.v[:2])) < 0.6
    if below == GROUND:
        assert not roof[0] < flat.p[0] < roof[1]
