"""Pictures that had to show a place: a camera over level ground, with a wall."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.stats import nbinom

from hil.config.companion.clients import make_client_importable

make_client_importable()

from hil_companion.locate import existence  # noqa: E402
from hil_companion.locate.existence import Evidence, Evidences  # noqa: E402
from hil_companion.locate.geolocation import Camera  # noqa: E402
from hil_companion.locate.objects import Group, Objects  # noqa: E402
from hil_companion.locate.tracks import Sighting, Tracks  # noqa: E402
from hil_companion.locate.views import Views  # noqa: E402
from hil_companion.navigation.inertial import NavState  # noqa: E402

HEIGHT_M, FOCAL_PX, SIZE_PX = 10.0, 300.0, (640, 480)
SECOND = 1_000_000_000


def camera() -> Camera:
    """Return a camera that looks along x of the vehicle: z of C is x of B, x of C is -y, y of C is -z."""
    calibration: dict[str, Any] = {
        "width": SIZE_PX[0],
        "height": SIZE_PX[1],
        "camera_matrix": [[FOCAL_PX, 0.0, 319.5], [0.0, FOCAL_PX, 239.5], [0.0, 0.0, 1.0]],
        "coefficients": [0.0] * 5,
        "distortion": "plumb_bob",
        "p_BC": [0.0, 0.0, 0.0],
        "q_BC": [0.5, -0.5, 0.5, -0.5],
    }
    return Camera("front", calibration)


def pose(x: float = 0.0, yaw_rad: float = 0.0) -> NavState:
    q = (math.cos(0.5 * yaw_rad), 0.0, 0.0, math.sin(0.5 * yaw_rad))
    return NavState(0, (x, 0.0, HEIGHT_M), (0.0, 0.0, 0.0), q)


def ground(wall_m: float = math.inf) -> np.ndarray:
    """Return planar depths: level ground below the horizon, and a wall across the view at `wall_m`."""
    rows = np.arange(SIZE_PX[1]) + 0.5 - 0.5 * SIZE_PX[1]
    depth = np.where(rows > 0.0, HEIGHT_M * FOCAL_PX / np.maximum(rows, 1e-9), np.inf)
    return np.repeat(np.minimum(depth, wall_m)[:, None], SIZE_PX[0], axis=1).astype(np.float32)


def shows(place: tuple[float, float, float], depth_m: np.ndarray | None, at: NavState | None = None) -> bool:
    views = Views(camera())
    views.add(pose() if at is None else at, depth_m)
    return views.showing(0, place) == [1]


def test_a_place_is_in_view_up_to_the_border_the_range_and_what_is_before_it() -> None:
    assert shows((20.0, 0.0, 0.9), ground())
    assert not shows((-20.0, 0.0, 0.9), ground())  # behind
    assert not shows((45.0, 0.0, 0.9), ground())  # too far
    assert not shows((9.0, 0.0, 0.9), ground())  # below the lower border: 10 m ahead the ground enters the picture
    border_m = 20.0 * 0.5 * SIZE_PX[0] / FOCAL_PX  # to the side, at 20 m
    margin_m = 0.2 + 8.0 * 20.0 / FOCAL_PX
    assert shows((20.0, border_m - margin_m - 0.2, 0.9), ground())
    assert not shows((20.0, border_m - margin_m + 0.2, 0.9), ground())
    assert not shows((20.0, 0.0, 0.9), ground(wall_m=15.0))
    assert shows((20.0, 0.0, 0.9), ground(wall_m=25.0))
    assert shows((20.0, 0.0, 0.9), ground(wall_m=19.5))  # as near as the surface of the body can be
    assert not shows((20.0, 0.0, 0.9), None)


def test_a_twig_hides_nobody_and_a_trunk_does() -> None:
    for width_px, seen in ((2, True), (40, False)):
        depth = ground()
        depth[:, 321 : 321 + width_px] = 8.0
        depth[:, 320 - width_px // 2 : 320] = 8.0 if width_px > 10 else depth[:, 320 - width_px // 2 : 320]
        assert shows((20.0, 0.0, 0.9), depth) is seen


def test_pictures_are_counted_from_one_and_those_without_a_pose_show_nothing() -> None:
    views = Views(camera())
    place = (20.0, 0.0, 0.9)
    for k in range(8):
        views.add(None if k == 2 else pose(yaw_rad=math.pi if k % 2 else 0.0), ground())
    assert views.showing(7, place) == [1, 5, 7]
    views.add(pose(), ground())
    assert views.showing(7, place) == [1, 5, 7, 9]  # goes on where it was
    assert views.showing(7, (-20.0, 0.0, 0.9)) == [2, 4, 6, 8]  # another place: from the first picture
    assert views.showing(8, place) == [1, 5, 7, 9]


def test_a_hit_speaks_for_a_person_and_a_miss_against_one_who_stands() -> None:
    def odds(hits: int, misses: int, boxes: int = 6) -> float:
        evidences = Evidences()
        for _ in range(boxes):
            evidences.add(Evidence(1.5))
        return evidences.odds(hits, misses)

    dependence = 1.0 + 0.1 * (6 + 4 - 1)
    looked = 6 * math.log(0.92 / 0.37) + 4 * math.log(0.08 / 0.63)
    assert odds(6, 4) == pytest.approx(-6.0 + (6 * 1.5 + looked) / dependence)
    assert odds(6, 0) > odds(0, 0) > odds(6, 6)
    assert odds(2, 30) < -10.0


def test_a_bush_that_is_a_person_in_every_third_picture_is_nobody() -> None:
    for every, people in ((1, 1), (3, 0)):
        tracks, views, objects = Tracks(), Views(camera()), Objects()
        for k in range(40):
            views.add(pose(), ground())
            boxes = [Sighting("person", (20.0, 0.0, 0.9), np.eye(2) * 0.04, evidence=Evidence(2.5, middle_m=0.9))]
            tracks.add(k * SECOND // 2, boxes if k % every == 0 else [])
        assert len(objects.found(tracks.tracks, views)) == people
        assert len(Objects().found(tracks.tracks)) == 1  # without the misses it is a person


def test_a_hidden_person_is_not_missed() -> None:
    tracks, views = Tracks(), Views(camera())
    for k in range(40):
        hidden = k % 3 != 0
        views.add(pose(), ground(wall_m=12.0 if hidden else math.inf))
        boxes = [Sighting("person", (20.0, 0.0, 0.9), np.eye(2) * 0.04, evidence=Evidence(2.5, middle_m=0.9))]
        tracks.add(k * SECOND // 2, [] if hidden else boxes)
    assert len(Objects().found(tracks.tracks, views)) == 1


@pytest.mark.parametrize(("count", "in_view"), [(0, 30.0), (3, 60.0), (40, 90.0), (7, 0.0)])
def test_the_number_of_sightings_is_negative_binomial(count: int, in_view: float) -> None:
    def log_chance(mean: float, shape: float) -> float:
        return float(nbinom.logpmf(count, shape, shape / (shape + mean * in_view)))

    ratio = existence._seen_ratio(count, in_view, *existence._UPRIGHT_SEEN)
    if in_view == 0.0:
        assert ratio == pytest.approx(0.0, abs=1e-6)  # what no picture could show says nothing
    else:
        expected = log_chance(*existence._UPRIGHT_SEEN) - log_chance(*existence._OTHERS_SEEN)
        assert ratio == pytest.approx(min(existence._MOST_SEEN, expected), abs=1e-6)


def test_who_walks_in_view_and_is_hardly_ever_seen_is_nobody() -> None:
    for last, people in ((72, 1), (8, 0)):
        tracks, views = Tracks(), Views(camera())
        for k in range(72):
            views.add(pose(), ground())
            y = 4.0 - abs(4.0 - 0.5 * (k % 16))  # to one side and back
            box = Sighting("person", (20.0, y, 0.9), np.eye(2) * 0.04, evidence=Evidence(1.2, middle_m=0.9))
            tracks.add(k * SECOND // 2, [box] if k < last else [])
        assert len(Objects().found(tracks.tracks, views)) == people
        assert len(Objects().found(tracks.tracks)) == 1  # its boxes alone are those of a person


def test_a_person_of_few_sightings_whose_places_were_seldom_in_view_is_one() -> None:
    tracks, views = Tracks(), Views(camera())
    for k in range(72):
        views.add(pose(yaw_rad=0.0 if k < 8 else math.pi), ground())
        box = Sighting("person", (20.0, 0.6 * k - 2.4, 0.9), np.eye(2) * 0.04, evidence=Evidence(2.5, middle_m=0.9))
        tracks.add(k * SECOND // 2, [box] if k < 8 else [])
    assert len(Objects().found(tracks.tracks, views)) == 1


def test_who_was_at_two_places_does_not_sit() -> None:
    bag = Evidences()
    for _ in range(8):
        bag.add(Evidence(-4.0, 2.5, 0.53, on_seat=True))
    assert bag.odds() > 0.0 > bag.odds(still=False)
    tracks = Tracks()
    for k, x in ((0, 0.0), (1, 0.0), (2, 0.0), (3, 0.0), (60, 30.0), (61, 30.0), (62, 30.0), (63, 30.0)):
        seat = Sighting("person", (x, 0.0, 0.5), np.eye(2) * 0.04, evidence=Evidence(-4.0, 2.5, 0.53, on_seat=True))
        tracks.add(k * SECOND // 2, [seat])
    assert Group(tracks.tracks).odds < 0.0
    assert all(Group([track]).odds > -2.0 for track in tracks.tracks)


@pytest.mark.parametrize(("apart_m", "people"), [(0.2, 1), (0.8, 2)])
def test_two_sure_objects_nearer_than_two_bodies_are_one(apart_m: float, people: int) -> None:
    tracks = Tracks()
    for k in range(20):
        boxes = [Sighting("person", (x, 0.0, 0.9), np.eye(2) * 0.01, evidence=Evidence(4.0)) for x in (0.0, apart_m)]
        tracks.add(k * SECOND // 2, boxes if k % 3 == 0 else boxes[:1])
    groups = [Group([track]) for track in tracks.tracks if track.sightings > 1]
    assert len(groups) == 2
    assert all(group.odds > 8.0 for group in groups)
    assert len(Objects().found(tracks.tracks)) == people
