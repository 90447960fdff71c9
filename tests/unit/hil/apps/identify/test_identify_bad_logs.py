"""Damaged logs and wrong maps: `hil identify` and `hil bench flights` name topic, time and remedy."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from hil.cli.app import run_command_line
from hil.run.flight_logs.flight_log import FlightLog
from hil.run.flight_logs.log_format import LogFile, read_log
from lab import flights as bench
from signals.errors import ConfigError
from sim.physics.vehicle import load_vehicle
from tests.worlds.dataflash_file import DataFlashFile
from tests.worlds.flight_files import dataflash, motion_of
from tests.worlds.flight_table import COLUMN_MAP, csv_file, table
from tests.worlds.flown_log import flown_log
from tests.worlds.known_motion import Motion
from tests.worlds.ulog_file import ULogFile

X500 = load_vehicle("x500")
FLOWN = motion_of(flown_log(22.0))


def refused(path: Path, capsys: pytest.CaptureFixture[str], *more: str) -> str:
    """Return what `hil identify` says of a log that it refuses."""
    out = path.parent / "out"
    assert run_command_line(["identify", str(path), "--vehicle", "x500", "--out", str(out), "-q", *more]) == 2
    told = capsys.readouterr().err
    assert f"error: {path}" in told
    assert not out.exists()
    return told


@pytest.mark.parametrize(
    ("was", "taken_for", "messages"),
    [
        ("unit: deg/s", "unit: mrad/s", ["p, q, r: turns 0.0574 times", "check its unit and scale"]),
        ("unit: ms", "unit: s", ["t: has 2", "check the map's unit of time, s"]),
        ("unit: ms", "unit: ns", ["t: has 2", "check the map's unit of time, ns"]),
        ("unit: cm", "unit: mm", ["vx, vy, vz and x, y, z: does not follow", "check the units of both"]),
    ],
)
def test_wrong_unit_of_the_map_is_named(
    was: str, taken_for: str, messages: Sequence[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, columns = csv_file(tmp_path / "a.csv", FLOWN), tmp_path / "map.yaml"
    assert was in COLUMN_MAP
    columns.write_text(COLUMN_MAP.replace(was, taken_for))
    told = refused(log, capsys, "--columns", str(columns))
    for message in messages:
        assert message in told


def with_column(path: Path, name: str, value: float | None = None, *, factor: float = 1.0) -> Path:
    """Write the flown log as a table with one column changed."""
    header, values = table(FLOWN)
    column = values[:, header.index(name)]
    column[:] = column * factor if value is None else value
    lines = [",".join(header), *(",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) for row in values)]
    path.write_text("\n".join(lines))
    return path


def test_rates_in_rad_that_the_map_calls_degrees(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    header, values = table(FLOWN)
    for name in "pqr":
        values[:, header.index(name)] *= np.pi / 180.0
    path, columns = tmp_path / "a.csv", tmp_path / "map.yaml"
    path.write_text("\n".join([",".join(header), *(",".join(f"{x:.9g}" for x in row) for row in values)]))
    columns.write_text(COLUMN_MAP)
    told = refused(path, capsys, "--columns", str(columns))
    assert "rad/s were taken for deg/s (say so: unit rad/s)" in told
    assert "from 4." in told


def test_height_that_no_flight_has_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, columns = with_column(tmp_path / "a.csv", "z", factor=0.01), tmp_path / "map.yaml"
    columns.write_text(COLUMN_MAP)
    told = refused(path, capsys, "--columns", str(columns))
    assert "x, y, z: rises 0.0" in told
    assert "check the unit of the height" in told


def test_series_without_a_number_is_noted(tmp_path: Path) -> None:
    columns = tmp_path / "map.yaml"
    columns.write_text(COLUMN_MAP)
    file = LogFile(with_column(tmp_path / "a.csv", "vy", float("nan")), X500, columns)
    assert read_log(file).velocity is None
    assert "vx, vy, vz: has no row with a number in each" in str(file.notes[-1])


def test_stretch_without_values_of_a_series_does_not_have_it() -> None:
    log = flown_log(22.0)
    part: FlightLog = log.between(5.0, 10.0, "part")
    assert part.velocity is not None
    assert log.between(5.0, 5.005, "short").velocity is None


def damaged(path: Path, motion: Motion) -> Path:
    """Write a DataFlash log with zeros in the middle, where a card lost a block."""
    data = bytearray(dataflash(path, motion).read_bytes())
    data[100_000:100_512] = bytes(512)
    path.write_bytes(data)
    return path


def test_damage_of_a_dataflash_log_is_a_note_and_nothing_is_printed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = LogFile(damaged(tmp_path / "a.bin", FLOWN), X500)
    whole = len(read_log(LogFile(dataflash(tmp_path / "b.bin", FLOWN), X500)).motors)
    assert whole - 12 < len(read_log(file).motors) < whole
    assert "damaged bytes (copy it from the vehicle again" in str(file.notes[0])
    told = capfd.readouterr()
    assert told.out + told.err == ""


def test_field_that_a_message_lacks_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = DataFlashFile({f"SERVO{i + 1}_FUNCTION": 33.0 + i for i in range(4)})
    log.message("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    log.message("IMU", "QBfffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccZ")
    for i in range(200):
        log.add("RCOU", 10_000 * i, 1500, 1500, 1500, 1500)
        log.add("IMU", 10_000 * i, 0, 0.0, 0.0, 0.0, 0.0, -9.8)
    assert "IMU: has no field 'AccY' (the log is damaged" in refused(log.write(tmp_path / "a.bin"), capsys)


def test_message_declared_with_too_few_names_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = DataFlashFile({f"SERVO{i + 1}_FUNCTION": 33.0 + i for i in range(4)})
    log.message("RCOU", "QHHHH", "TimeUS,C1,C2,C3")
    for i in range(200):
        log.add("RCOU", 10_000 * i, 1500, 1500, 1500, 1500)
    assert "has no motor outputs of 4 rotors" in refused(log.write(tmp_path / "a.bin"), capsys)


def test_field_that_a_topic_lacks_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = ULogFile()
    log.topic("actuator_motors", [("uint64_t", "timestamp_sample"), ("float", "control[12]")])
    log.topic("vehicle_local_position", [("float", "x"), ("float", "y")])
    for i in range(200):
        log.add("actuator_motors", 10_000 * i, 10_000 * i, *[0.6] * 4, *[float("nan")] * 8)
        log.add("vehicle_local_position", 10_000 * i, 0.0, 0.0)
    assert "vehicle_local_position: has no field 'z'" in refused(log.write(tmp_path / "a.ulg"), capsys)


def benched(folder: Path, **more: str) -> dict[str, str]:
    return {"logs": str(folder), "vehicle": "x500", "columns": str(folder / "map.yaml"), **more}


def judged(folder: Path, **more: str) -> bench.BenchmarkResult:
    return bench.measure(quick=False, status=lambda text: None, options=benched(folder, **more))


def test_flights_leaves_out_what_it_cannot_judge_and_says_why(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(COLUMN_MAP)
    with_column(tmp_path / "good.csv", "bat", 15200.0)
    with_column(tmp_path / "no_pose.csv", "x", float("nan"))
    (tmp_path / "empty.csv").write_text("")
    result = judged(tmp_path, every="200")
    assert {row.case for row in result.rows if "@" in row.method} == {"good"}
    left_out = "\n".join(result.left_out)
    assert "no_pose.csv: x, y, z: has no attitude with a position" in left_out
    assert "empty.csv: is empty" in left_out
    assert any("stays at 15.20 V" in cell for row in result.tables[0].rows for cell in row)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("qw", float("nan"), "has no attitude with a position (predictions begin from both"),
        ("ax", 90.0, "ax, ay, az: has a median of 882.7 in flight from 3.00 s: it looks like mg"),
        ("z", 0.0, "x, y, z rises 0 m with the motors up from 3.00 to 19.00 s"),
    ],
)
def test_flights_refuses_a_folder_without_a_log_to_judge(
    column: str, value: float, message: str, tmp_path: Path
) -> None:
    (tmp_path / "map.yaml").write_text(COLUMN_MAP)
    with_column(tmp_path / "a.csv", column, value)
    with pytest.raises(ConfigError) as error:
        judged(tmp_path)
    assert message in str(error.value)


def test_flights_refuses_three_seconds_and_wrong_options(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(COLUMN_MAP)
    short = flown_log(14.2)
    csv_file(tmp_path / "a.csv", motion_of(short.between(6.0, 7.2, "short")))
    with pytest.raises(ConfigError, match=r"has no free flight of more than 1.5 s \(found: 6.00 to 7.20 s\)"):
        judged(tmp_path)
    with pytest.raises(ConfigError, match="vehicle 'tiltrotor': tilts turns rotors by servos"):
        judged(tmp_path, vehicle="tiltrotor")
    for every in ("0", "x", "1.5", ""):
        with pytest.raises(ConfigError, match="--set every: must be a whole number from 1"):
            judged(tmp_path, every=every)
