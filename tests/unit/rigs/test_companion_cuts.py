"""The shipped CUTs `record` and `waypoints`: recorded files, and flights."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.worlds.scripted_bench import array, frame, sample, together, welcome

from hil_companion.cuts.record import Record  # isort: skip
from hil_companion.cuts.waypoints import State, Waypoints, came_within_s  # isort: skip
from hil_companion.errors import CutError, OptionError  # isort: skip
from hil_companion.frame import Frame, read_samples  # isort: skip
from hil_companion.link.protocol import read_welcome  # isort: skip

DT_NS = 20_000_000
SQUARE = [[0.0, 0.0, 3.0], [6.0, 0.0, 3.0], [6.0, 6.0, 3.0]]


def made(header: dict[str, Any], *arrays: np.ndarray) -> Frame:
    parts = [b"", together(*arrays)]
    return Frame(header, read_samples(header, parts), in_ring=False, t_received_ns=0)


def truth_frame(n: int, p_W: Any, v_W: Any) -> Frame:
    values = {"p_WB": list(p_W), "v_WB_W": list(v_W), "q_WB": [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]}
    return made(frame(n, [sample("truth", values=values)], t_ns=n * DT_NS))


def picture(n: int) -> Frame:
    values = np.full((20, 30), n, "<f4")
    return made(frame(n, [sample("../../front/depth", arrays=[array("depth", values)])]), values)


def test_a_recording_holds_what_was_sent_and_no_more_than_it_may(tmp_path: Path) -> None:
    cut = Record(out=str(tmp_path / "r"), keep_frames=3, stop=True)
    cut.start(read_welcome(welcome()))
    for n in range(6):
        cut(picture(n))
        assert cut.finished == (n >= 2)
    cut.stop()
    lines = [json.loads(line) for line in (tmp_path / "r" / "frames.jsonl").read_text().splitlines()]
    assert [line["frame"] for line in lines] == [0, 1, 2]
    for n, line in enumerate(lines):
        kept = np.load(tmp_path / "r" / line["samples"][0]["arrays"]["depth"])
        np.testing.assert_array_equal(kept, np.full((20, 30), n, "<f4"))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r"]  # a topic's name cannot lead out of the folder
    assert len(list((tmp_path / "r" / "arrays").iterdir())) == 3
    with pytest.raises(CutError, match="is there already"):
        Record(out=str(tmp_path / "r")).start(read_welcome(welcome()))


def test_a_recording_stays_below_its_size(tmp_path: Path) -> None:
    cut = Record(out=str(tmp_path / "r"), keep_mb=0.012)
    cut.start(read_welcome(welcome()))
    for n in range(10):
        cut(picture(n))
    cut.stop()
    size = sum(p.stat().st_size for p in (tmp_path / "r").rglob("*") if p.is_file() and p.name != "welcome.json")
    assert 2 * 2400 < size <= 12_000
    assert cut.full


def fly(
    cut: Waypoints, *, lag: float = 0.0, ground_m: float = 0.1, every: Callable[[int], bool] = lambda _: True
) -> list[tuple[float, dict[str, Any], np.ndarray]]:
    """Fly a vehicle that jumps to each commanded position, or a share of the way; it sinks on a landing command.

    `ground_m`: below the last waypoint. `every`: which of the frames there are; between them it goes on as told.
    """
    cut.start(read_welcome(welcome(waypoints_W=SQUARE)))
    p_W, v_W = np.array([1.0, 0.5, 0.1]), np.zeros(3)
    flown = []
    desired = None
    for n in range(6000):
        if every(n):
            desired = cut(truth_frame(n, p_W, v_W))
        assert desired is not None
        flown.append((n * DT_NS * 1e-9, desired.as_map(), p_W.copy()))
        if cut.finished:
            return flown
        if desired.land:
            v_W = np.array([0.0, 0.0, -0.5])
            p_W = p_W + v_W * DT_NS * 1e-9
        else:
            assert desired.p_W is not None
            assert desired.v_W is not None
            p_W = np.array(desired.p_W) * (1 - lag) + p_W * lag
            v_W = np.array(desired.v_W)
        floor_m = ground_m if np.linalg.norm(p_W[:2] - np.array(SQUARE[-1][:2])) < 0.5 else 0.1
        if p_W[2] < floor_m:
            p_W[2], v_W = floor_m, np.zeros(3)
    raise AssertionError("it never finished")


def test_a_flight_takes_off_straight_up_passes_every_waypoint_lands_and_says_so() -> None:
    flown = fly(Waypoints())
    commanded = np.array([m["p_W"] for _, m, _ in flown if "p_W" in m])
    top = int(np.argmax(commanded[:, 2] >= 2.999))
    np.testing.assert_allclose(commanded[:top, :2], [[1.0, 0.5]] * top, atol=1e-9)
    assert np.all(np.diff(commanded[:top, 2]) >= -1e-12)
    for point in SQUARE:
        assert np.linalg.norm(commanded - point, axis=1).min() < 0.06
    assert np.linalg.norm(np.diff(commanded, axis=0), axis=1).max() <= 4.0 * DT_NS * 1e-9 + 1e-9
    lands = [m.get("land", False) for _, m, _ in flown]
    assert lands == sorted(lands)
    # It descends on its own path and commands the landing on the ground.
    np.testing.assert_allclose(flown[lands.index(True)][2], [*SQUARE[-1][:2], 0.1], atol=1e-6)
    assert np.diff([p_W[2] for _, _, p_W in flown]).min() > -1.1 * DT_NS * 1e-9
    yaws = np.array([m["yaw_rad"] for _, m, _ in flown])
    assert yaws[0] == pytest.approx(math.pi / 2)  # its heading on the ground
    steps = np.abs([math.remainder(d, 2 * math.pi) for d in np.diff(yaws)])
    assert steps.max() <= DT_NS * 1e-9 + 1e-9


def test_a_phase_begins_when_the_one_before_is_over_and_not_when_a_frame_shows_it() -> None:
    whole, some = fly(Waypoints()), fly(Waypoints(), every=lambda n: n % 10 == 7 or n == 0)
    told = {t_s: m["p_W"] for t_s, m, _ in whole if "p_W" in m}
    compared = [(m["p_W"], told[t_s]) for t_s, m, _ in some[7::10] if "p_W" in m and t_s in told]
    assert len(compared) > 50
    np.testing.assert_allclose(*zip(*compared, strict=True), atol=1e-6)


def test_without_truth_it_flies_by_its_clock_and_ends_by_it() -> None:
    cut = Waypoints(land_s=2.0)
    cut.start(read_welcome(welcome(waypoints_W=SQUARE)))
    landing = []
    for n in range(6000):
        given = made(frame(n, t_ns=n * DT_NS))
        desired = cut(given)
        assert desired is not None
        if desired.land:
            landing.append(given.t_ns)
        if cut.finished:
            break
    assert cut.finished
    assert (landing[-1] - landing[0]) * 1e-9 == pytest.approx(2.0, abs=0.03)


def test_one_that_never_comes_down_is_given_up_after_a_time() -> None:
    flown = fly(Waypoints(land_s=3.0), ground_m=2.0)  # it stands on a roof
    assert flown[-1][2][2] == 2.0
    lands = [t_s for t_s, m, _ in flown if m.get("land")]
    assert lands[-1] - lands[0] == pytest.approx(3.0, abs=0.03)


def test_looking_ahead_commands_what_would_come_later() -> None:
    plain, ahead = Waypoints(), Waypoints(lookahead_s=0.1)
    for cut in (plain, ahead):
        cut.start(read_welcome(welcome(waypoints_W=SQUARE)))
    here = (0.0, 0.0, 0.0)
    now = [plain(truth_frame(n, here, here)) for n in range(60)]
    later = [ahead(truth_frame(n, here, here)) for n in range(55)]
    for n in range(1, 55):
        first, second = now[n + 5], later[n]
        assert first is not None
        assert second is not None
        assert first.p_W == pytest.approx(second.p_W)


def test_what_cannot_be_flown_is_reported() -> None:
    with pytest.raises(CutError, match="has none to fly"):
        Waypoints().start(read_welcome(welcome(waypoints_W=[])))
    wrong: list[dict[str, Any]] = [{"speed_mps": 0}, {"corridor_m": math.nan}, {"yaw": "north"}, {"lookahead_s": "all"}]
    for options in wrong:
        with pytest.raises(OptionError, match=next(iter(options))):
            Waypoints(**options)


def test_when_it_came_is_seen_between_two_frames() -> None:
    """Constant acceleration makes the cubic exact: p = 4 - 3 t + t^2 / 2 reaches 1 at 3 - sqrt 3."""

    def seen(t_s: float) -> State:
        zero = np.zeros(2)
        return State(round(t_s * 1e9), np.array([*zero, 4 - 3 * t_s + 0.5 * t_s**2]), np.array([*zero, t_s - 3]))

    for before_s, now_s in ((1.0, 1.4), (1.2, 1.3), (0.5, 2.5)):
        ago_s = came_within_s(seen(before_s), seen(now_s), np.zeros(3), 1.0)
        assert now_s - ago_s == pytest.approx(3 - math.sqrt(3), abs=1e-8)
