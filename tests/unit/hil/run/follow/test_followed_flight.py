"""A log's flight is found, aligned with the bench, and complete; what cannot be followed is refused in words."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.config import Bench, load_bench
from hil.run.follow.flight import FollowedFlight, followed_flight
from hil.run.parts.catalog import check_parts, settled
from signals.errors import ConfigError
from tests.worlds.flight_files import dataflash, motion_of, ulog
from tests.worlds.flown_log import GROUND_M, flown_log
from tests.worlds.followed_log import STAND_S, line, write_log

Array = NDArray[np.float64]
Change = Callable[[Array], Array]

DURATION_S = 40.0
WAY = line(5.0, 10.0, DURATION_S)
STAND_HEIGHT_M = 0.228863  # of the x500


def bench_of(files: tuple[Path, Path], *settings: str) -> Bench:
    log, columns = files
    return load_bench(settings=["mission=null", f"follow.log={log}", f"follow.columns={columns}", *settings])


def flight_of(files: tuple[Path, Path], *settings: str) -> FollowedFlight:
    return followed_flight(bench_of(files, *settings))


def changed(rows: Callable[[Array], Array], **values: float) -> Change:
    """Return a change that sets columns where `rows(t)` holds."""
    places = {"z": 7, "x": 5, "qw": 8, "sx": 12, "sy": 13, "sz": 14, "syaw": 15}

    def change(columns: Array) -> Array:
        at = rows(columns[:, 0])
        for name, value in values.items():
            columns[at, places[name]] = value
        return columns

    return change


LOST = changed(lambda t: (t > 20.0) & (t < 22.5), x=float("nan"))


def test_place_of_take_off_becomes_the_start_of_the_bench_and_east_stays_east(tmp_path: Path) -> None:
    files = write_log(tmp_path, WAY, DURATION_S, measured_m=np.array([0.5, 0.0, 0.0]))
    flight = flight_of(files, "start.p_W=[3, 4, 0]")
    assert flight.home_L_m == pytest.approx((100.0, -50.0, 7.0))
    assert flight.shift_m == pytest.approx((-97.0, 54.0, STAND_HEIGHT_M - 7.0), abs=1e-5)
    assert flight.takeoff_height_m == pytest.approx(2.0)
    assert flight.yaw_rad == pytest.approx(0.4, abs=2e-6)
    # It climbs to 5 m in 5 s, at 1 m/s: slow at the top, 5 s after the motors began.
    assert flight.begin_s == pytest.approx(STAND_S + 5.0, abs=0.1)
    # Two metres are left 4 s before the end of a descent of 10 s from 5 m.
    assert flight.end_s == pytest.approx(STAND_S + DURATION_S - 4.0, abs=0.05)
    course = flight.course
    s = flight.begin_s + course.t_s - STAND_S
    expected = WAY(s) + np.array([3.0, 4.0, STAND_HEIGHT_M])
    np.testing.assert_allclose(course.p_W, expected, atol=2e-4)
    assert course.measured == {"position": 0.0, "yaw": 0.0}
    assert course.words == "set-points of sx, sy, sz, syaw"
    assert not course.v_W.any()


def test_settled_bench_starts_with_the_heading_of_the_log(tmp_path: Path) -> None:
    bench = settled(bench_of(write_log(tmp_path, WAY, DURATION_S, heading_rad=-2.0)))
    assert bench.config.start.yaw_deg == pytest.approx(np.degrees(-2.0), abs=1e-4)
    assert settled(bench) == bench  # as when a saved bench is replayed


def test_log_without_set_points_is_followed_by_its_measured_trajectory(tmp_path: Path) -> None:
    flight = flight_of(write_log(tmp_path, WAY, DURATION_S, set_points=False))
    course = flight.course
    assert course.words == "the log has no set-points: the measured trajectory itself is followed"
    assert course.measured == {"position": 1.0, "yaw": 1.0}
    middle = int(np.argmin(np.abs(flight.begin_s + course.t_s - STAND_S - 17.5)))
    # The line is 10 m in 19 s, x = 10 u^2 (3 - 2 u); at u = 1/2 its speed is 15/19 m/s and its acceleration 0.
    assert course.v_W[middle] == pytest.approx([15.0 / 19.0, 0.0, 0.0], abs=2e-3)
    assert course.a_W[middle] == pytest.approx([0.0, 0.0, 0.0], abs=2e-3)
    asked = flight_of(write_log(tmp_path, WAY, DURATION_S), "follow.set_points=measured").course
    assert asked.topic == ""
    assert asked.words == "the measured trajectory itself is followed, as asked"


def test_axis_and_time_without_a_set_point_take_the_measured_place(tmp_path: Path) -> None:
    off = np.array([0.5, 0.25, 0.0])
    change = changed(lambda t: (t > 20.0) & (t < 25.0), sx=float("nan"))
    flight = flight_of(write_log(tmp_path, WAY, DURATION_S, measured_m=off, change=change))
    course = flight.course
    s = flight.begin_s + course.t_s - STAND_S
    apart = course.p_W - WAY(s) - np.array([0.0, 0.0, STAND_HEIGHT_M])
    inside = (s + STAND_S > 20.1) & (s + STAND_S < 24.9)
    np.testing.assert_allclose(apart[inside], np.tile([0.5, 0.0, 0.0], (inside.sum(), 1)), atol=2e-4)
    outside = (s + STAND_S < 19.9) | (s + STAND_S > 25.1)
    np.testing.assert_allclose(apart[outside], 0.0, atol=2e-4)
    assert course.words.startswith("set-points of sx, sy, sz, syaw; measured where it has none: ")


@pytest.mark.parametrize(("write", "name"), [(ulog, "a.ulg"), (dataflash, "a.bin")])
def test_px4_and_ardupilot_logs_are_followed(tmp_path: Path, write: Callable[..., Path], name: str) -> None:
    log = write(tmp_path / name, motion_of(flown_log()))
    flight = followed_flight(load_bench(settings=["mission=null", f"follow.log={log}"]))
    assert flight.shift_m == pytest.approx((0.0, 0.0, STAND_HEIGHT_M - GROUND_M), abs=1e-3)
    assert flight.duration_s > 25.0
    assert flight.course.measured["position"] == 1.0


@pytest.mark.parametrize(("write", "name"), [(ulog, "a.ulg"), (dataflash, "a.bin")])
def test_set_points_and_wind_of_px4_and_ardupilot_are_flown(
    tmp_path: Path, write: Callable[..., Path], name: str
) -> None:
    truth = flown_log()
    log = write(tmp_path / name, motion_of(truth), set_points=True)
    bench = load_bench(settings=["mission=null", f"follow.log={log}", "follow.wind=log"])
    flight = followed_flight(bench)
    assert flight.course.measured == {"position": 0.0, "yaw": 0.0}
    assert truth.pose is not None
    at_s = flight.begin_s + flight.course.t_s - 5.0  # the log's clock begins 5 s later
    place = np.stack([np.interp(at_s, truth.pose.t_s, truth.pose.values[:, k]) for k in range(3)], axis=1)
    # Between two set-points 0.1 s apart the line is off by a dt^2 / 8 at most, with a up to 5 m/s2.
    np.testing.assert_allclose(flight.course.p_W, place + np.array(flight.shift_m), atol=7e-3)
    assert flight.course.yaw_rad == pytest.approx(0.5 * np.pi - 0.25, abs=1e-4)
    wind = settled(bench).config.wind
    assert wind is not None
    assert wind.steady_W_mps == pytest.approx((-1.5, 3.0, 0.0))


def test_log_that_begins_in_the_air_says_what_stands_for_the_ground(tmp_path: Path) -> None:
    flight = flight_of(write_log(tmp_path, WAY, DURATION_S, change=lambda columns: columns[columns[:, 0] > 6.0]))
    (note,) = flight.notes
    assert note.startswith("the log begins in the air at 6.02 s: the place of take-off is taken below")
    assert flight.home_L_m == pytest.approx((100.0, -50.0, 7.0), abs=0.1)


@pytest.mark.parametrize(
    ("settings", "change", "message"),
    [
        (
            (),
            changed(lambda t: (t > 20.0) & (t < 22.5), x=float("nan")),
            r"x, y, z: has a gap from 20\.\d+ to 22\.\d+ s",
        ),
        ((), changed(lambda t: t > 30.0, x=400.0), r"x, y, z: jumps by 29\d\.\d m at 30\.\d+ s \(an estimator"),
        (
            ("duration_s=80",),
            None,
            r"sx, sy, sz, syaw: flies for 31 s, .* after duration_s: 80 \(--set duration_s=91\)",
        ),
        (("fly_away_m=8",), None, r"leads 8 m away at \d+\.\d+ s, .* fly_away_m: 8 \(--set fly_away_m=13\)"),
        (("follow.flight=2",), None, r"holds no flight 2, but these: 1: 3\.\d+ to 43\.\d+ s"),
        (("follow.wind=log",), None, r"wind: has no estimate of the wind from"),
        (
            ("vehicle_settings.mass_kg=0.4",),
            None,
            r"m4: lifts 5\.\d times the weight of 'x500' from 8\.\d+ s",
        ),
    ],
)
def test_what_cannot_be_followed_is_refused_with_topic_time_and_remedy(
    tmp_path: Path, settings: tuple[str, ...], change: Change | None, message: str
) -> None:
    files = write_log(tmp_path, WAY, DURATION_S, change=change)
    bench = bench_of(files, *settings)
    with pytest.raises(ConfigError, match=message):
        check_parts(bench)


def test_log_with_no_flight_or_too_low_a_flight_is_refused(tmp_path: Path) -> None:
    files = write_log(tmp_path, lambda s: np.zeros((len(s), 3)), DURATION_S)
    with pytest.raises(ConfigError, match=r"contains no flight from 0.00 to 45.98 s \(a flight rises 0.3 m"):
        flight_of(files)


def test_log_of_two_flights_asks_which(tmp_path: Path) -> None:
    def twice(s: Array) -> Array:
        return WAY(np.where(s > 40.0, s - 50.0, s)) * np.where((s > 40.0) & (s < 50.0), 0.0, 1.0)[:, None]

    def rest(columns: Array) -> Array:
        between = (columns[:, 0] > 43.0) & (columns[:, 0] < 53.0)
        columns[between, 1:5] = 0.0
        return columns

    def way(s: Array) -> Array:
        return np.where((s < 0.0)[:, None], 0.0, twice(np.maximum(s, 0.0)))

    files = write_log(tmp_path, lambda s: np.nan_to_num(way(s)), 90.0, change=rest)
    with pytest.raises(ConfigError, match=r"holds 2 flights \(1: 3\.\d+ to 4\d\.\d+ s, 2: 5\d\.\d+ to 9\d\.\d+ s\)"):
        flight_of(files)
    assert flight_of(files, "follow.flight=2").begin_s > 53.0


def test_log_without_a_place_is_refused(tmp_path: Path) -> None:
    log, columns = write_log(tmp_path, WAY, DURATION_S)
    columns.write_text("\n".join(row for row in columns.read_text().splitlines() if not row.startswith("position")))
    with pytest.raises(ConfigError, match=r"has set-points, but no position with an attitude from 0.00 to"):
        flight_of((log, columns))


def test_follow_beside_another_pilot_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"follow.log: is set, and so is mission: both would command the vehicle"):
        load_bench(settings=["follow.log=hil.yaml"])


def test_file_that_does_not_exist_is_named() -> None:
    with pytest.raises(ConfigError, match=r"--set follow.log: names a file that does not exist: nowhere.ulg"):
        load_bench(settings=["mission=null", "follow.log=nowhere.ulg"])
