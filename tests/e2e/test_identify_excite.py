"""The mission of `hil identify --excite` flies on the mock within its limits, and its recording shows everything."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hil.apps.identify.preparation import prepare
from hil.cli.app import run_command_line
from hil.run.flight_logs.log_format import LogFile, read_log
from sim.physics.vehicle import load_vehicle

X500 = load_vehicle("x500")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("excite")
    mission = folder / "mission"
    assert run_command_line(["identify", "--excite", "--vehicle", "x500", "--out", str(mission)]) == 0
    arguments = ["--mission", str(mission / "excite.yaml"), "--out", str(folder / "run"), "-q"]
    status = run_command_line(["run", *arguments, "--set", "record.report=false", "--set", "record.tlog=false"])
    assert status == 0, (folder / "run" / "run.json").read_text()
    return folder / "run"


@pytest.mark.slow
def test_excitation_passes_on_the_mock_and_shows_every_parameter(flown: Path) -> None:
    run = json.loads((flown / "run.json").read_text())
    assert run["status"] == "PASS"
    assert run["mission"]["reached"] == run["mission"]["waypoints"]
    prepared = prepare([flown], X500, columns=None, of="", progress=lambda share, what: None)
    assert len(prepared.flights) == 1
    assert not prepared.notes
    assert [item.parameter.name for item in prepared.excitation.parameters if not item.excited] == []
    (delays,) = prepared.delays
    assert delays.motors_to_gyro_s == pytest.approx(0.020, abs=0.005)  # lags of 12.5 and 25 ms, and a tick
    assert delays.gyro_to_pose_s == pytest.approx(-0.002, abs=0.001)  # the gyro's mean over a tick of 4 ms


@pytest.mark.slow
def test_recording_is_read_as_it_was_flown(flown: Path) -> None:
    log = read_log(LogFile(flown / "run.mcap", X500))
    assert log.motors_kind == "command"
    assert not log.estimated
    assert log.pose is not None and log.accel is not None and log.rate is not None  # noqa: PT018
    assert log.pose.values[0, :3] == pytest.approx([0.0, 0.0, X500.standing_height_m], abs=0.02)
    assert log.pose.values[:, 2].max() < 15.0
    still = log.accel.between(1.0, 3.0).values.mean(axis=0)
    assert still == pytest.approx([0.0, 0.0, 9.80665], abs=0.1)
    cut = flown / "cut.mcap"
    cut.write_bytes((flown / "run.mcap").read_bytes()[: (flown / "run.mcap").stat().st_size // 2])
    file = LogFile(cut, X500)
    assert 30.0 < read_log(file).end_s < log.end_s - 30.0
    assert "is cut off; its data end at" in str(file.notes[0])
