"""`hil run --follow` on the mock: a log of closed form, the bench's own recording, replay, limits, refused logs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.cli.app import run_command_line
from hil.run.recorder.reading import Recording
from tests.worlds.followed_log import line, write_log

Array = NDArray[np.float64]

DURATION_S = 40.0
WAY = line(5.0, 15.0, DURATION_S)
OFF_M = np.array([0.6, -0.3, 0.2])
LIGHT = ["--set", "record.tlog=false", "-q"]


def run_of(folder: Path) -> dict[str, Any]:
    run: dict[str, Any] = json.loads((folder / "run.json").read_text())
    return run


@pytest.fixture(scope="module")
def followed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Follow a log whose vehicle flew `OFF_M` beside its set-points."""
    folder = tmp_path_factory.mktemp("follow")
    log, columns = write_log(folder, WAY, DURATION_S, measured_m=OFF_M, heading_rad=0.4, velocities=True)
    arguments = ["run", "--follow", str(log), "--set", f"follow.columns={columns}", "--out", str(folder / "run")]
    status = run_command_line([*arguments, *LIGHT])
    assert status == 0, (folder / "run" / "run.json").read_text()
    return folder / "run"


@pytest.mark.slow
def test_a_real_flight_beside_its_set_points_differs_by_that_much(followed: Path) -> None:
    run = run_of(followed)
    follow = run["follow"]
    assert run["status"] == "PASS"
    assert follow["completed"]
    assert follow["set_points"] == "sx, sy, sz, svx, svy, svz, syaw"
    assert follow["shift_m"][:2] == pytest.approx([-100.0, 50.0])
    # The simulated vehicle is where its estimator, with GPS, sees the set-points: 0.25 m.
    assert follow["position_mean_m"] == pytest.approx(-OFF_M, abs=0.25)
    assert follow["position_rms_m"] == pytest.approx(float(np.linalg.norm(OFF_M)), abs=0.25)
    assert follow["velocity_rms_mps"] < 0.3
    # A level vehicle against one that tilts and wobbles a little, with the heading of the log.
    assert follow["attitude_rms_deg"] < 4.0
    rows = {row["name"]: row for row in run["verdict"]["rows"]}
    assert rows["follow_position_rms_m"]["limit"] is None
    assert run["deterministic"]


@pytest.mark.slow
def test_both_flights_are_recorded_at_the_same_instants(followed: Path) -> None:
    follow = run_of(followed)["follow"]
    topics = ("/truth/pose", "/followed/pose", "/followed/set_point")
    poses: dict[str, dict[int, Any]] = {topic: {} for topic in topics}
    for message in Recording(followed / "run.mcap").messages():
        if message.topic in poses:
            poses[message.topic][message.log_time_ns] = message.decode()
    real = poses["/followed/pose"]
    assert len(real) == round(50 * follow["followed_s"]) + 1
    t_ns = min(real)
    assert t_ns / 1e9 == pytest.approx(follow["log_from_s"] + follow["time_offset_s"], abs=0.005)
    apart, errors = [], []
    for t_ns, pose in real.items():
        true, told = poses["/truth/pose"][t_ns], poses["/followed/set_point"][t_ns]
        place = np.array([pose[f"pose.position.{axis}"] for axis in "xyz"])
        apart.append(place - np.array([told[f"vector.{axis}"] for axis in "xyz"]))
        errors.append(np.array([true[f"pose.position.{axis}"] for axis in "xyz"]) - place)
    np.testing.assert_allclose(apart, np.tile(OFF_M, (len(apart), 1)), atol=3e-4)
    assert np.sqrt(np.mean(np.sum(np.square(errors), axis=1))) == pytest.approx(follow["position_rms_m"], rel=1e-6)


@pytest.mark.slow
def test_report_shows_both_flights(followed: Path) -> None:
    page = (followed / "report.html").read_text()
    assert "Followed flight" in page
    for name in ("path", "motion", "difference"):
        assert (followed / f"follow_{name}.png").stat().st_size > 10_000


@pytest.mark.slow
def test_replay_of_a_followed_flight_is_identical(followed: Path) -> None:
    assert run_command_line(["replay", str(followed)]) == 0


@pytest.mark.slow
def test_own_recording_is_followed_closely_and_again_the_same(followed: Path, tmp_path: Path) -> None:
    """The set-points of the first flight, from its own MAVLink, on the same vehicle."""
    digests = []
    for name in ("a", "b"):
        arguments = ["run", "--follow", str(followed), "--out", str(tmp_path / name), "--set", "record.report=false"]
        assert run_command_line([*arguments, *LIGHT, "--set", "follow.position_rms_m=0.2"]) == 0
        run = run_of(tmp_path / name)
        assert run["follow"]["set_points"] == "SET_POSITION_TARGET_LOCAL_NED"
        assert run["follow"]["position_rms_m"] < 0.2
        assert run["follow"]["attitude_rms_deg"] < 3.0
        digests.append(run["digest"])
    assert digests[0] == digests[1]


@pytest.mark.slow
def test_missed_limit_fails_the_flight(followed: Path, tmp_path: Path) -> None:
    arguments = ["run", "--follow", str(followed), "--out", str(tmp_path / "run"), *LIGHT]
    settings = ["record.report=false", "follow.position_rms_m=0.001", "follow.set_points=measured"]
    assert run_command_line([*arguments, *(word for text in settings for word in ("--set", text))]) == 1
    run = run_of(tmp_path / "run")
    assert run["follow"]["set_points"] == "measured trajectory"
    (reason,) = run["verdict"]["reasons"]
    assert reason.startswith("position differs by 0.")
    assert reason.endswith(" m rms from the followed flight, more than 0.001 m")


def below_ground(columns: Array) -> Array:
    columns[:, 14] -= np.where((columns[:, 0] > 20.0) & (columns[:, 0] < 24.0), 6.0, 0.0)
    return columns


def test_set_points_below_the_ground_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, columns = write_log(tmp_path, WAY, DURATION_S, change=below_ground)
    arguments = ["run", "--follow", str(log), "--set", f"follow.columns={columns}", "--out", str(tmp_path / "run")]
    assert run_command_line([*arguments, *LIGHT]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "sx, sy, sz, syaw: leads through the ground or an obstacle at 20." in said
    assert "start elsewhere (start.p_W)" in said


def test_set_points_into_a_wall_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, columns = write_log(tmp_path, line(2.0, 60.0, DURATION_S), DURATION_S)
    arguments = ["run", "--follow", str(log), "--set", f"follow.columns={columns}", "--out", str(tmp_path / "run")]
    assert run_command_line([*arguments, "--scene", "training_village", *LIGHT]) == 2
    assert "the ground or an obstacle at" in " ".join(capsys.readouterr().err.split())


def test_mission_and_follow_exclude_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["run", "--follow", "flight.ulg", "--mission", "rectangle.plan"]) == 2
    assert "--mission: cannot go with --follow" in capsys.readouterr().err
    assert run_command_line(["run", "--flight", "2"]) == 2
    assert "--flight: chooses one of a log's flights (name the log: --follow LOG)" in capsys.readouterr().err
