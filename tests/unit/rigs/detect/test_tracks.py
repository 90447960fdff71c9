"""Tracks, evidence and identity against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise, permutations
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.config.companion.clients import make_client_importable

make_client_importable()

from hil_companion.locate.appearance import Appearance, appearance_ratio  # noqa: E402
from hil_companion.locate.existence import Evidence, Evidences, sighting_evidence  # noqa: E402
from hil_companion.locate.objects import Objects  # noqa: E402
from hil_companion.locate.partition import Partition  # noqa: E402
from hil_companion.locate.rhythm import Rhythm  # noqa: E402
from hil_companion.locate.tracks import Sighting, Tracks  # noqa: E402
from hil_companion.locate.transit import transit_ratio  # noqa: E402

SECOND = 1_000_000_000
SIGMA_M = 0.4
RED, BLUE = np.array([50.0, 60.0, 40.0] * 2), np.array([40.0, 10.0, -50.0] * 2)


def seen_at(x: float, y: float, look: np.ndarray | None = None, evidence: float = 3.0) -> Sighting:
    return Sighting("person", (x, y, 0.9), np.eye(2) * SIGMA_M**2, look, Evidence(evidence, middle_m=0.9))


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
    tracks.add(60 * SECOND + SECOND // 2, [seen_at(5.1, 4.9)])
    assert [one.sightings for one in Objects().found(tracks.tracks)] == [42, 40, 40]


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
    def upright(*features: float | None) -> float:
        return sighting_evidence(*features).upright  # type: ignore[arg-type]

    assert upright(0.0, None) == pytest.approx(2.96)
    assert upright(0.1, -0.5, 1.7, 0.9) == pytest.approx(2.96 + 6.26 * 0.1)  # a rival of too low a score
    assert upright(0.1, 0.1) == pytest.approx(2.96 + 0.626 - 6.33 * (0.1 + 0.27))
    assert upright(0.0, None, 1.2) == pytest.approx(2.96 - 2.48 * 0.5)
    assert upright(0.0, None, 9.0) == pytest.approx(2.96 - 2.27 * 1.0)
    assert upright(0.0, None, None, 0.5) == pytest.approx(2.96 - 4.21 * 0.4)
    assert upright(0.0, None, None, 5.0) == pytest.approx(2.96 - 5.54 * 0.8)
    assert sighting_evidence(0.3, None, 1.2, 0.55).seated == pytest.approx(2.73 - 3.91 * 0.5)  # no score


def test_n_dependent_boxes_count_as_fewer_independent_ones() -> None:
    # The variance of the mean of n equally correlated values is that of n_eff independent ones.
    for n in (1, 2, 20, 1000):
        correlation = 0.1 + 0.9 * np.eye(n)
        n_eff = n**2 / correlation.sum()
        evidences = Evidences()
        for _ in range(n):
            evidences.add(Evidence(0.7))
        assert evidences.odds() == pytest.approx(-6.0 + 0.7 * n_eff)


def odds_of(count: int, middle_m: float, *, on_seat: bool, height_m: float = 1.7) -> float:
    evidences = Evidences()
    for _ in range(count):
        evidences.add(sighting_evidence(0.0, None, height_m, middle_m, on_seat=on_seat))
    return evidences.odds()


def test_who_is_as_low_as_a_sitter_has_to_sit_on_something() -> None:
    assert odds_of(8, 0.9, on_seat=False) > 0.0  # stands
    assert odds_of(8, 0.53, on_seat=True) > 0.0  # sits
    assert odds_of(8, 0.53, on_seat=False, height_m=1.2) < 0.0  # a dog
    assert odds_of(8, 0.53, on_seat=False) < odds_of(8, 0.53, on_seat=True)
    assert odds_of(8, 0.3, on_seat=True) < odds_of(8, 0.53, on_seat=True) - 4.0  # a bag on a bench
    halves = Evidences()
    for part in (True, False):
        some = Evidences()
        for _ in range(4):
            some.add(sighting_evidence(0.0, None, 1.7, 0.53, on_seat=part))
        halves += some
    assert halves.odds() == pytest.approx(odds_of(8, 0.53, on_seat=True))  # half of the boxes on a seat are enough


def test_a_bicycle_of_many_doubtful_boxes_is_not_reported_and_a_person_of_a_few_good_ones_is() -> None:
    bicycle = sighting_evidence(0.1, 0.05, 1.2, 0.5)  # as high a score, a rival, too low
    person = sighting_evidence(0.1, -0.25, 1.6, 0.85)
    for evidence, count, people in ((bicycle, 80, 0), (person, 6, 1)):
        tracks = Tracks()
        for k in range(count):
            tracks.add(k * SECOND // 2, [Sighting("person", (5.0, 5.0, 0.9), np.eye(2) * 0.1, None, evidence)])
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
            Sighting("person", (x, 0.0, 0.9), np.eye(2) * 0.01, evidence=Evidence(evidence))
            for x, evidence in ((0.0, 2.9), (apart_m, 1.3))
        ]
        tracks.add(k * SECOND // 2, boxes)
    found = Objects().found(tracks.tracks)
    assert len(found) == people
    assert math.hypot(*found[0].p_W[:2]) < 0.1  # the one with more evidence


def test_two_people_a_metre_apart_are_two() -> None:
    for looks in ((RED, BLUE), (RED, RED)):
        tracks = Tracks()
        for k in range(12):
            tracks.add(k * SECOND // 2, [seen_at(0.0, 0.0, looks[0]), seen_at(1.0, 0.0, looks[1])])
        found = Objects().found(tracks.tracks)
        assert [round(one.p_W[0], 1) for one in found] == [0.0, 1.0]


def test_a_false_box_repeated_at_one_place_is_nobody() -> None:
    bush = sighting_evidence(0.1, None, 1.2, 0.45)
    tracks = Tracks()
    for k in range(60):
        tracks.add(k * SECOND // 2, [Sighting("person", (5.0, 5.0, 0.5), np.eye(2) * 0.1, BLUE, bush)])
    assert Objects().found(tracks.tracks) == []


def test_a_walker_behind_a_tree_stays_one_person() -> None:
    tracks = Tracks()
    for k in range(40):
        t_s = 0.5 * k
        if not 8.0 <= t_s < 15.0:  # hidden for longer than a track lasts
            tracks.add(round(t_s * SECOND), [seen_at(1.2 * t_s, 0.0, RED)])
    assert len(tracks.tracks) == 2
    (one,) = Objects().found(tracks.tracks)
    assert one.sightings == 26


def lit(light: float, *, upper: float = 0.3, lower: float = 0.05) -> np.ndarray:
    """Return the look of a red coat over blue trousers under so much light."""
    linear = np.array([[[upper, 0.1 * upper, 0.1 * upper], [0.3 * lower, 0.5 * lower, lower]]]) * light
    return cv2.cvtColor(linear.astype(np.float32), cv2.COLOR_LRGB2LAB).astype(float).reshape(6)


def test_the_same_clothes_in_the_sun_and_in_the_shade_are_alike() -> None:
    sun, shade = (Appearance.of_track(lit(light), 10) for light in (1.0, 0.33))
    swapped = Appearance.of_track(lit(1.0)[[3, 4, 5, 0, 1, 2]], 10)
    assert appearance_ratio([sun, shade]) > 3.0
    assert appearance_ratio([sun, swapped]) < -3.0
    assert appearance_ratio([sun]) == 0.0
    assert appearance_ratio([sun, Appearance.of_track(None, 10)]) == 0.0  # nothing seen says nothing


def skylit(colour: float, *, rest: float = 1.0) -> np.ndarray:
    """Return the look of clothes of one grey, dark red below, in a shade that the blue sky lights."""
    linear = np.array([[[colour] * 3, [0.20, 0.10, 0.10]]]) * np.array([0.30, 0.32, 0.37]) * rest
    return cv2.cvtColor(linear.astype(np.float32), cv2.COLOR_LRGB2LAB).astype(float).reshape(6)


def test_the_shade_is_bluer_than_the_sun_and_that_tells_nobody_apart() -> None:
    grey = np.array([[[0.3, 0.3, 0.3], [0.20, 0.10, 0.10]]])
    bluish = np.array([[[0.28, 0.3, 0.35], [0.19, 0.10, 0.116]]])  # as the grey in the shade, but in the sun
    in_sun, other = (
        Appearance.of_track(cv2.cvtColor(c.astype(np.float32), cv2.COLOR_LRGB2LAB).astype(float).reshape(6), 10)
        for c in (grey, bluish)
    )
    in_shade = Appearance.of_track(skylit(0.3), 10)
    assert in_shade.contrasts[2:] == pytest.approx(in_sun.contrasts[2:], abs=0.03)
    assert appearance_ratio([in_sun, in_shade]) > 3.0
    assert appearance_ratio([in_sun, in_shade]) > appearance_ratio([in_shade, other]) + 3.0


def test_a_person_seen_from_two_sides_with_one_odd_part_is_still_the_same() -> None:
    front, back = lit(1.0), lit(0.5)
    back[:3] = lit(1.0)[3:]  # a rucksack hides the coat
    same = appearance_ratio([Appearance.of_track(front, 10), Appearance.of_track(back, 10)])
    other = appearance_ratio([Appearance.of_track(front, 10), Appearance.of_track(BLUE, 10)])
    assert other < same
    assert same > 3.0 * math.log(0.1)  # an odd block of contrasts costs ln eps at most
    several = [Appearance.of_track(front, 10)] * 3
    assert appearance_ratio([*several, Appearance.of_track(back, 10)]) > 3.0  # whoever leads, the others agree


def test_tracks_without_a_look_have_their_place_in_the_order() -> None:
    tracks = [Appearance.of_track(None if i % 2 else front, 10) for i, front in enumerate([BLUE, BLUE, RED, RED, BLUE])]
    ratios = {appearance_ratio(list(order)) for order in permutations(tracks)}
    assert len(ratios) == 1


@given(st.lists(st.tuples(st.floats(0.1, 3.0), st.floats(0.05, 0.9), st.integers(2, 40)), min_size=1, max_size=5))
def test_appearance_does_not_depend_on_order_and_an_odd_one_is_bounded(rows: list[tuple[float, float, int]]) -> None:
    tracks = [Appearance.of_track(lit(light, upper=upper), n) for light, upper, n in rows]
    assert appearance_ratio(tracks[::-1]) == appearance_ratio(tracks)  # of equal lengths, the contrasts say who leads
    assert appearance_ratio(tracks) >= 3.0 * math.log(0.1) * (len(tracks) - 1) - 1e-9


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 40), st.integers(-20, 20), st.booleans()), min_size=1, max_size=7), st.randoms()
)
def test_a_partition_has_each_track_once_and_never_two_of_one_picture(rows: list[Any], random: Any) -> None:
    tracks = Tracks()
    pictures: dict[int, list[Sighting]] = {}
    for start, x, red in rows:
        for k in range(4):
            pictures.setdefault(start + k, []).append(seen_at(x + 0.3 * k, float(3 * (x % 3)), RED if red else BLUE))
    for k in sorted(pictures):
        tracks.add(k * SECOND // 2, pictures[k])
    partition = Partition()
    groups = partition.groups(tracks.tracks)
    assert sorted(t.number for group in groups for t in group) == sorted(t.number for t in tracks.tracks)
    for group in groups:
        for i, a in enumerate(group):
            assert not any(a.pictures & b.pictures for b in group[i + 1 :])
        assert partition.score(frozenset(t.number for t in group)) >= 0.0 or len(group) == 1
    shuffled = list(tracks.tracks)
    random.shuffle(shuffled)
    numbers = [[t.number for t in group] for group in groups]
    assert [[t.number for t in group] for group in Partition().groups(shuffled)] == numbers
    assert [[t.number for t in group] for group in partition.groups(tracks.tracks)] == numbers  # what is known is right


def test_a_returning_walker_is_recognised_by_the_look() -> None:
    for look, people in ((RED + 2.0, 1), (BLUE, 2)):
        tracks = Tracks()
        walk(tracks, 0.0, RED, 0.0, 0.0)
        walk(tracks, 15.0, look, 7.0, 9.0, speed_mps=1.1)  # not where the first one was going
        found = Objects().found(tracks.tracks)
        assert len(found) == people
        assert found[-1].t_ns == round(17.75 * SECOND)


def test_nobody_walks_faster_than_people_do() -> None:
    tracks = Tracks()
    walk(tracks, 0.0, RED, 0.0, 0.0)
    walk(tracks, 15.0, RED, 60.0, 0.0)
    assert len(Objects().found(tracks.tracks)) == 2
    first, second = tracks.tracks
    assert transit_ratio(first, second) == -math.inf
    assert transit_ratio(second, first) == -math.inf  # in the order of time


def test_the_place_of_a_walker_is_known_as_well_as_the_disc_within_reach_is_small() -> None:
    tracks = Tracks()
    walk(tracks, 0.0, RED, 0.0, 0.0)
    walk(tracks, 33.75, RED, 8.0, 3.0)  # too late to say anything of the direction
    first, second = tracks.tracks
    assert first.walks
    assert second.walks
    # Each walks with 0.95, 0.6 of all do, and one of twenty changes; where he stood it is too far away to have stayed.
    # The disc within reach is larger than the park.
    share = 0.95**2 / 0.6 + 2.0 * 0.05 * 0.95 * 0.05 + 0.05**2 / 0.4 * 0.05
    assert transit_ratio(first, second) == pytest.approx(math.log(share), abs=1e-6)


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
    far = Sighting("person", (4.2, 0.0, 0.9), np.eye(2) * 25.0, RED)
    other = Sighting("person", (4.5, 0.3, 0.9), np.eye(2) * SIGMA_M**2, np.array([50.0, 60.0, 20.0] * 2))
    tracks.add(round(3.0 * SECOND), [other])  # almost the same clothes
    tracks.add(round(6.0 * SECOND), [far])
    (found,) = Objects().found(tracks.tracks)
    assert (found.sightings, found.t_ns) == (14, round(2.75 * SECOND))
    assert found.p_W[0] == pytest.approx(3.3, abs=0.3)


def test_a_person_with_another_look_for_a_moment_is_the_same_track() -> None:
    tracks = Tracks()
    for k in range(24):  # the box shows the coat, then what is beside it, in turn
        tracks.add(k * SECOND // 2, [seen_at(0.5 * k, 0.0, BLUE if k % 5 == 4 else RED)])
    assert [track.sightings for track in tracks.tracks] == [24]
    tracks = Tracks()
    for k in range(24):  # somebody else comes when the first one is away, not where that one is expected
        seen = seen_at(0.5 * k, 0.0, RED) if k < 12 else seen_at(0.5 * k, 4.0, BLUE)
        tracks.add(k * SECOND // 2, [seen])
    assert [track.sightings for track in tracks.tracks] == [12, 12]


def test_a_rucksack_is_seen_from_behind_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    front, back = lit(1.0), lit(1.0)
    back[:3] = lit(1.0)[3:]
    sides = [Appearance.of_track(look, 8) for look in (front, back) * 3]
    apart = appearance_ratio(sides[::2]) + appearance_ratio(sides[1::2])
    two_sides = appearance_ratio(sides)
    assert two_sides > apart - 5.0  # the other side costs little, and its next sightings agree with it
    monkeypatch.setattr("hil_companion.locate.appearance._SIDES", 1)
    assert appearance_ratio(sides) < two_sides - 3.0


def test_the_chains_are_the_best_path_cover() -> None:
    rng = np.random.default_rng(5)
    for _ in range(6):
        tracks = Tracks()
        for k, start_s in enumerate(sorted(rng.uniform(0.0, 60.0, 5))):
            walk(tracks, start_s + 6.0 * k, RED if rng.random() < 0.5 else BLUE, *rng.uniform(-12.0, 12.0, 2))
        partition = Partition()
        partition.groups(tracks.tracks)
        chains = partition._chains()
        ordered = sorted(tracks.tracks, key=lambda t: (t.first_ns, t.number))

        def gain(groups: Any, partition: Partition = partition, ordered: Any = ordered) -> float:
            total = 0.0
            for group in groups:
                members = [t for t in ordered if t.number in group]
                total += sum(max(0.0, partition._link(a, b)) for a, b in pairwise(members))
            return total

        best = max(gain(groups) for groups in partitions([t.number for t in ordered]))
        assert gain(chains) == pytest.approx(best)


@pytest.mark.parametrize("taken_apart", [0, 1])
def test_an_object_of_two_halves_is_taken_apart(taken_apart: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tracks 0, 1 and 4, 5 are of a walker, 2, 3 and 6, 7 of a sitter; the search begins with 0 to 3 as one object."""
    walker, sitter = {0, 1, 4, 5}, {2, 3, 6, 7}
    tracks = Tracks()
    for k in range(8):
        walk(tracks, 20.0 * k, None, 0.0, 0.0)
    order = {t.number: k for k, t in zip((0, 2, 4, 6, 1, 3, 5, 7), tracks.tracks, strict=True)}

    def bond(a: int, b: int) -> float:
        if {a, b} <= walker or {a, b} <= sitter:
            return 3.0 if (a < 4) == (b < 4) else 1.0
        if a < 4 and b < 4:
            return 0.5  # both halves fit together somehow
        return -math.inf if max(a, b) >= 4 > min(a, b) and min(a, b) % 2 else -5.0

    def score(_: Partition, group: Any) -> float:
        members = sorted(order[n] for n in group)
        return sum(bond(a, b) for i, a in enumerate(members) for b in members[i + 1 :])

    monkeypatch.setattr(Partition, "score", score)
    monkeypatch.setattr(Partition, "_possible", lambda _, m, n: bond(*sorted((order[m], order[n]))) > -math.inf)
    number = {k: n for n, k in order.items()}
    halves = [frozenset(number[k] for k in half) for half in ((0, 1, 2, 3), (4, 5), (6, 7))]
    monkeypatch.setattr(Partition, "_chains", lambda _: halves)
    monkeypatch.setattr("hil_companion.locate.partition._TAKEN_APART", 3 * taken_apart)
    partition = Partition()
    partition._best = halves
    groups = partition.groups(tracks.tracks)
    found = sorted(sorted(order[t.number] for t in group) for group in groups)
    assert found == ([[0, 1, 4, 5], [2, 3, 6, 7]] if taken_apart else [[0, 1, 2, 3], [4, 5], [6, 7]])


def test_a_survey_that_comes_round_has_a_rhythm() -> None:
    rhythm = Rhythm([8.0] * 20)
    assert rhythm.known
    assert rhythm.revisit_s == 8.0
    usual = rhythm.odds(8.0)
    assert rhythm.odds(3.0) < usual - 3.0  # sooner than anybody comes again: two people
    assert rhythm.odds(40.0) == pytest.approx(usual - 0.3 * (5.0 - 1.5))  # three times missed
    slower = Rhythm([16.0] * 20)
    assert slower.odds(80.0) == pytest.approx(rhythm.odds(40.0))  # the same in revisit times
    assert not Rhythm([8.0] * 7).known
    assert not Rhythm([-1.0] * 20).known  # two boxes on one person at a time have no gap


@pytest.mark.parametrize("rounds", [0, 12])
def test_two_tracks_with_little_in_common_are_one_object_only_where_people_are_seldom_seen(rounds: int) -> None:
    tracks = Tracks()
    for k in range(rounds):  # somebody whom the survey sees again and again
        walk(tracks, 8.0 * k, RED, 9.6 * k, 200.0)
    walk(tracks, 104.0, None, 0.0, 0.0)
    walk(tracks, 112.0, None, 11.0, -7.0)  # about 10 m off his line
    a, b = (track for track in tracks.tracks if track.state[1] < 100.0)
    partition = Partition()
    groups = [[track.number for track in group] for group in partition.groups(tracks.tracks)]
    assert ([a.number, b.number] in groups) == (rounds == 0)
    assert len(groups) == (3 if rounds else 1)
    prior = Rhythm([5.25] * 8).odds(5.25) - 6.0 if rounds else 1.0
    assert partition.score(frozenset((a.number, b.number))) == pytest.approx(transit_ratio(a, b) + prior)


def test_who_was_at_two_places_does_not_sit() -> None:
    def sits(tracks: Tracks, x_m: float, begin: int) -> None:
        for k in range(begin, begin + 5):
            tracks.add(k * SECOND // 2, [replace(seen_at(x_m, 0.0, RED), evidence=Evidence(-1.0, 2.0, on_seat=True))])

    one, two = Tracks(), Tracks()
    for x_m, tracks in ((0.0, one), (20.0, two)):
        sits(tracks, 0.0, 0)
        sits(tracks, x_m, 60)
    totals = []
    for tracks in (one, two):
        partition = Partition()
        assert len(tracks.tracks) == 2
        partition.groups(tracks.tracks)
        both = frozenset(t.number for t in tracks.tracks)
        totals.append(partition.score(both) - sum(partition._link(a, b) for a, b in pairwise(tracks.tracks)))
    assert totals[0] == pytest.approx(0.0)
    assert totals[1] == pytest.approx(-10 * 3.0 / (1.0 + 0.1 * 9))  # ten boxes say 3 more for a sitter each


def partitions(numbers: list[int]) -> list[list[list[int]]]:
    """Return all partitions of a set."""
    if not numbers:
        return [[]]
    first, rest = numbers[0], partitions(numbers[1:])
    return [
        new
        for groups in rest
        for new in (
            [[first], *groups],
            *([*groups[:i], [first, *group], *groups[i + 1 :]] for i, group in enumerate(groups)),
        )
    ]


def test_who_sits_does_not_come_from_another_bench() -> None:
    def sat(tracks: Tracks, from_s: float, x: float, *, on_seat: bool) -> None:
        for k in range(4):
            evidence = Evidence(1.0, 2.0, 0.5, on_seat)
            seen = Sighting("person", (x, 0.0, 0.5), np.eye(2) * 0.04, RED, evidence)
            tracks.add(round((from_s + 0.5 * k) * SECOND), [seen])

    ratios = []
    for on_seat in (True, False):
        tracks = Tracks()
        sat(tracks, 0.0, 0.0, on_seat=on_seat)
        sat(tracks, 20.0, 15.0, on_seat=on_seat)
        ratios.append(transit_ratio(*tracks.tracks))
    assert ratios[0] < ratios[1] - 1.0


def test_a_faint_box_of_a_sitter_says_less_than_a_clear_one() -> None:
    faint, clear = (sighting_evidence(over, None, 1.7, 0.55, on_seat=True) for over in (-0.22, -0.12))
    assert clear.seated == pytest.approx(2.73)
    assert faint.seated == pytest.approx(2.73 - 5.0 * 0.10)
