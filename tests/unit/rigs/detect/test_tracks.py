"""Tracks, evidence and identity against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.config.companion.clients import make_client_importable

make_client_importable()

from hil_companion.locate.existence import object_odds, sighting_evidence  # noqa: E402
from hil_companion.locate.objects import Objects, place_ratio  # noqa: E402
from hil_companion.locate.tracks import Sighting, Tracks  # noqa: E402

SECOND = 1_000_000_000
SIGMA_M = 0.4
RED, BLUE = np.array([50.0, 60.0, 40.0] * 2), np.array([40.0, 10.0, -50.0] * 2)


def seen_at(x: float, y: float, look: np.ndarray | None = None, evidence: float = 2.0) -> Sighting:
    return Sighting("person", (x, y, 0.9), np.eye(2) * SIGMA_M**2, look, evidence)


def walk(tracks: Tracks, from_s: float, look: np.ndarray | None, x: float, y: float, *, speed_mps: float = 1.2) -> None:
    """Add three seconds of somebody who walks east."""
    for k in range(12):
        tracks.add(round((from_s + 0.25 * k) * SECOND), [seen_at(x + speed_mps * 0.25 * k, y, look)])


def test_standing_and_crossing_people_keep_their_numbers() -> None:
    rng = np.random.default_rng(3)
    tracks = Tracks()
    ways = [lambda t: (5.0, 5.0), lambda t: (-6.0 + 1.3 * t, 0.3), lambda t: (6.0 - 1.3 * t, -1.4)]
    for k in range(40):
        t = 0.25 * k
        tracks.add(round(t * SECOND), [seen_at(*(np.array(way(t)) + 0.15 * rng.standard_normal(2))) for way in ways])
    found = Objects().found(tracks.tracks)
    assert [one.sightings for one in found] == [40, 40, 40]
    for one, way in zip(found, ways, strict=True):
        assert math.dist(one.p_W[:2], way(one.t_ns / SECOND)) < 0.4
    assert found[1].v_W[0] == pytest.approx(1.3, abs=0.25)
    tracks.add(60 * SECOND, [seen_at(5.1, 4.9)])  # he has not moved
    assert [one.sightings for one in Objects().found(tracks.tracks)] == [41, 40, 40]


def test_a_single_sighting_is_no_person() -> None:
    tracks = Tracks()
    for k in range(20):
        tracks.add(k * SECOND, [seen_at(10.0 * k, 50.0)])
    assert Objects().found(tracks.tracks) == []


def test_weak_sightings_continue_tracks_and_begin_none() -> None:
    tracks = Tracks()
    for k in range(20):
        seen = [seen_at(2.0, 0.0, evidence=6.0 if 5 <= k < 8 else -0.1), seen_at(9.0, 0.0, evidence=-0.1)]
        tracks.add(k * SECOND // 2, seen)
    (one,) = Objects().found(tracks.tracks)
    assert (one.number, one.sightings) == (0, 20)


def test_an_uncertain_range_moves_a_track_across_the_view_only() -> None:
    tracks = Tracks()
    tracks.add(0, [Sighting("person", (10.0, 0.0, 0.9), np.eye(2) * 0.01)])
    tracks.add(SECOND // 10, [Sighting("person", (10.8, 0.1, 0.9), np.diag([9.0, 0.01]))])
    x, y = tracks.tracks[0].state[:2]
    assert x == pytest.approx(10.0, abs=0.02)
    assert y == pytest.approx(0.05, abs=0.02)


def test_the_evidence_of_a_box_is_linear_in_its_features() -> None:
    assert sighting_evidence(0.0, None) == pytest.approx(2.9)
    assert sighting_evidence(0.1, -0.5, 1.65, 0.8) == pytest.approx(2.9 + 8.0 * 0.1)  # a rival of too low a score
    assert sighting_evidence(0.1, 0.1) == pytest.approx(2.9 + 0.8 - 6.65 * (0.1 + 0.27))
    assert sighting_evidence(0.0, None, 1.15) == pytest.approx(2.9 - 3.0 * 0.5)
    assert sighting_evidence(0.0, None, 9.0) == pytest.approx(2.9 - 1.3 * 1.0)
    assert sighting_evidence(0.0, None, None, 0.4) == pytest.approx(2.9 - 3.9 * 0.4)
    assert sighting_evidence(0.0, None, None, 5.0) == pytest.approx(2.9 - 5.2 * 0.8)
    assert sighting_evidence(0.0, None, on_seat=True) == pytest.approx(2.9 + 1.0)


def test_n_dependent_boxes_count_as_fewer_independent_ones() -> None:
    assert object_odds(5.0, 1) == pytest.approx(-3.8 + 5.0)
    # The variance of the mean of n equally correlated values is that of n_eff independent ones.
    for n in (1, 2, 20, 1000):
        correlation = 0.1 + 0.9 * np.eye(n)
        n_eff = n**2 / correlation.sum()
        assert object_odds(n * 0.7, n) == pytest.approx(-3.8 + 0.7 * n_eff)


def test_a_bicycle_of_many_doubtful_boxes_is_not_reported_and_a_person_of_a_few_good_ones_is() -> None:
    bicycle = sighting_evidence(0.1, 0.05, 1.2, 0.5)  # as high a score, a rival, too low
    person = sighting_evidence(0.0, -0.25, 1.4, 0.7)
    for evidence, count, people in ((bicycle, 80, 0), (person, 6, 1)):
        tracks = Tracks()
        for k in range(count):
            tracks.add(k * SECOND // 2, [seen_at(5.0, 5.0, evidence=evidence)])
        assert len(Objects().found(tracks.tracks)) == people


def test_the_position_is_of_a_long_track_for_a_short_one_may_be_of_somebody_else() -> None:
    tracks = Tracks()
    walk(tracks, 0.0, RED, 0.0, 0.0)
    for k in range(3):
        tracks.add(round((20.0 + 0.25 * k) * SECOND), [seen_at(20.0, 5.0, RED)])
    (found,) = Objects().found(tracks.tracks)
    assert (found.sightings, found.t_ns) == (15, round(2.75 * SECOND))


@pytest.mark.parametrize(("apart_m", "people"), [(1.2, 1), (2.0, 2)])
def test_two_boxes_on_one_still_person_are_one_object(apart_m: float, people: int) -> None:
    tracks = Tracks()
    for k in range(20):
        boxes = [
            Sighting("person", (x, 0.0, 0.9), np.eye(2) * 0.01, evidence=evidence)
            for x, evidence in ((0.0, 1.0), (apart_m, 0.7))
        ]
        tracks.add(k * SECOND // 2, boxes)
    found = Objects().found(tracks.tracks)
    assert len(found) == people
    assert math.hypot(*found[0].p_W[:2]) < 0.1  # the one with more evidence


def test_a_returning_walker_is_recognised_by_the_look() -> None:
    for look, people in ((RED + 2.0, 1), (BLUE, 2)):
        tracks = Tracks()
        walk(tracks, 0.0, RED, 0.0, 0.0)
        walk(tracks, 15.0, look, 17.0, 2.0, speed_mps=1.1)
        found = Objects().found(tracks.tracks)
        assert len(found) == people
        assert found[-1].t_ns == round(17.75 * SECOND)


def test_nobody_walks_faster_than_people_do() -> None:
    tracks = Tracks()
    walk(tracks, 0.0, RED, 0.0, 0.0)
    walk(tracks, 15.0, RED, 60.0, 0.0)
    assert len(Objects().found(tracks.tracks)) == 2
    first, second = tracks.tracks
    assert place_ratio(first, second) == -math.inf
    assert place_ratio(second, first) == -math.inf  # in the order of time


def test_the_place_of_a_walker_is_known_as_well_as_the_disc_within_reach_is_small() -> None:
    tracks = Tracks()
    walk(tracks, 0.0, RED, 0.0, 0.0)
    walk(tracks, 12.75, RED, 8.0, 3.0)
    first, second = tracks.tracks
    reach_m = 1.7 * 10.0 + 2.0 * math.sqrt(first.sigma_m**2 + second.first.sigma_m**2 + 0.15)
    assert place_ratio(first, second) == pytest.approx(math.log(3600.0 / (math.pi * reach_m**2)))


def test_two_in_one_picture_are_two_and_each_track_belongs_to_one() -> None:
    tracks = Tracks()
    for k in range(12):  # two people in the same clothes, in the same pictures
        tracks.add(k * SECOND // 4, [seen_at(0.3 * k, 0.0, RED), seen_at(0.3 * k, 8.0, RED)])
    for k in range(12):
        tracks.add((80 + k) * SECOND // 4, [seen_at(10.0 + 0.3 * k, 1.0, RED), seen_at(10.0 + 0.3 * k, 9.0, RED)])
    objects = Objects()
    groups = objects.groups(tracks.tracks)
    assert sorted(len(group.tracks) for group in groups) == [2, 2]
    for group in groups:
        assert not group.tracks[0].pictures & group.tracks[1].pictures
    assert [found.sightings for found in objects.found(tracks.tracks)] == [24, 24]


def test_known_ratios_give_the_same_groups() -> None:
    tracks, kept = Tracks(), Objects()
    for k, (look, x) in enumerate([(RED, 0.0), (BLUE, 5.0), (RED, 9.0), (BLUE, 12.0), (RED, 20.0)]):
        for i in range(8):
            tracks.add(round((20.0 * k + 0.25 * i) * SECOND), [seen_at(x + 0.3 * i, 0.0, look)])
            assert kept.found(tracks.tracks) == Objects().found(tracks.tracks)
    assert len(kept.found(tracks.tracks)) == 2


def test_the_position_is_that_of_the_newest_sure_sighting() -> None:
    tracks = Tracks()
    walk(tracks, 0.0, RED, 0.0, 0.0)
    far = Sighting("person", (4.2, 0.0, 0.9), np.eye(2) * 25.0, RED, 1.0)
    other = Sighting("person", (4.5, 0.3, 0.9), np.eye(2) * SIGMA_M**2, np.array([50.0, 60.0, 20.0] * 2), 1.0)
    tracks.add(round(3.0 * SECOND), [other])  # almost the same clothes
    tracks.add(round(6.0 * SECOND), [far])
    (found,) = Objects().found(tracks.tracks)
    assert (found.sightings, found.t_ns) == (14, round(2.75 * SECOND))
    assert found.p_W[0] == pytest.approx(3.3, abs=0.3)
