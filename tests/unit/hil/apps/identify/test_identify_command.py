"""`hil identify` around its estimator: files that it writes, its judgement, and logs that no fit can use."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from hil.apps.identify.command import IdentifyOptions, identify
from hil.apps.identify.fixed_values import read_fixed, with_fixed
from hil.cli.app import run_command_line
from hil.run.flight_logs.column_map import ColumnMap
from hil.run.flight_logs.flight_log import FlightLog
from signals.documents.validate import load_model, validate
from signals.documents.yaml_lines import parse_yaml
from signals.errors import ConfigError
from sim.physics.vehicle import load_vehicle
from tests.worlds.docs_blocks import ROOT, blocks
from tests.worlds.estimate_stand_in import THRUST, StandIn
from tests.worlds.flight_files import dataflash, motion_of, ulog
from tests.worlds.flown_log import flown_log, scaled
from tests.worlds.ulog_file import ULogFile

X500 = load_vehicle("x500")
LOG = flown_log()
CONSOLE = Console(quiet=True)


@pytest.fixture(scope="module")
def flown_ulog(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ulog(tmp_path_factory.mktemp("logs") / "flown.ulg", motion_of(LOG))


def options(out: Path, **changes: object) -> IdentifyOptions:
    return replace(IdentifyOptions("x500", out=out, quiet=True), **changes)


def test_vehicle_file_names_deviation_and_log_of_each_number(flown_ulog: Path, tmp_path: Path) -> None:
    estimator = StandIn()
    found = identify([flown_ulog], options(tmp_path / "out"), CONSOLE, estimate=estimator)
    assert not found.worse
    assert len(estimator.flights) == 1
    text = (tmp_path / "out" / "vehicle.yaml").read_text()
    read = load_vehicle(tmp_path / "out" / "vehicle.yaml")
    fitted = found.fit.vehicle
    assert read.inertia_kgm2 == pytest.approx(fitted.inertia_kgm2, rel=1e-7)
    thrust = read.rotor_constants.thrust_coefficient_n_per_radps2
    assert thrust == pytest.approx(fitted.rotor_constants.thrust_coefficient_n_per_radps2, rel=1e-7)
    same = {"inertia_kgm2": fitted.inertia_kgm2, "rotor_constants": fitted.rotor_constants}
    assert read.model_copy(update=same) == fitted  # whatever was not fitted is as it was
    lines = {line.strip().split(":")[0]: line for line in text.splitlines()}
    assert "+- 9.4e-08 N/(rad/s)2 (1 sigma), from flown.ulg" in lines["thrust_coefficient_n_per_radps2"]
    assert "- 0.02508555  # +- 0.0003 kg m2 (1 sigma), from flown.ulg" in text
    assert "- 0.044  # not identified, kept: no turns about z" in text
    assert "#" not in lines["max_speed_radps"]


def test_results_are_the_estimators(flown_ulog: Path, tmp_path: Path) -> None:
    identify([flown_ulog], options(tmp_path, fix=["mass_kg=2.0"]), CONSOLE, estimate=StandIn())
    facts = json.loads((tmp_path / "identify.json").read_text())
    assert facts["vehicle"]["fixed"] == {"mass_kg": 2.0}
    assert facts["parameters"][0]["key"] == THRUST
    rows = facts["predictions"]
    assert [row["horizon_s"] for row in rows] == [0.1, 0.5]
    assert rows[1]["before"] == {
        "position_m": 0.05, "velocity_mps": 0.25, "rotation_rad": None, "rate_radps": pytest.approx(0.15)
    }  # fmt: skip
    # Of three quantities two are halved and one stays: (1/4)^(1/3).
    assert facts["error_ratio"] == pytest.approx(0.25 ** (1.0 / 3.0))
    page = (tmp_path / "report.html").read_text()
    assert "BETTER" in page
    assert "no turns about z" in page
    assert page.count("data:image/png;base64,") == 3
    assert "<code>--fix mass_kg=...</code>" in page


def test_worse_prediction_is_told_by_the_exit_status(
    flown_ulog: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = identify([flown_ulog], options(tmp_path), CONSOLE, estimate=StandIn(error_factor=1.2))
    assert found.worse
    for factor, status in ((1.2, 1), (0.5, 0)):
        monkeypatch.setattr("hil.apps.identify.command._estimator", lambda f=factor: StandIn(error_factor=f))
        arguments = ["identify", str(flown_ulog), "--vehicle", "x500", "--out", str(tmp_path / "out"), "-q"]
        assert run_command_line(arguments) == status
    nan = StandIn(error_factor=math.nan)
    assert identify([flown_ulog], options(tmp_path), CONSOLE, estimate=nan).worse  # a prediction that failed


def test_fixed_values_reach_vehicle_and_estimator(flown_ulog: Path, tmp_path: Path) -> None:
    estimator = StandIn()
    found = identify([flown_ulog], options(tmp_path, fix=["mass_kg=2.0"]), CONSOLE, estimate=estimator)
    assert estimator.fixed == {"mass_kg": 2.0}
    assert found.fit.vehicle.mass_kg == 2.0
    assert "mass_kg: 2.0  # as given by --fix" in (tmp_path / "vehicle.yaml").read_text()
    changed = with_fixed(X500, {"inertia_kgm2.1": 0.03, "rotor_constants.axial_drag_kg_per_rad": 1e-5})
    assert changed.inertia_kgm2 == (0.023891, 0.03, 0.044)
    assert changed.rotor_constants.axial_drag_kg_per_rad == 1e-5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mass=2", "mass is no number of the vehicle 'x500' (did you mean 'mass_kg'?)"),
        ("mass_kg", "must be KEY=NUMBER"),
        ("mass_kg=heavy", "must be KEY=NUMBER"),
        ("mass_kg=nan", "must be KEY=NUMBER"),
        ("name=3", "is no number"),
    ],
)
def test_wrong_fixed_value_is_refused(text: str, message: str) -> None:
    with pytest.raises(ConfigError) as error:
        read_fixed([text], X500)
    assert message in str(error.value)


def no_motors(path: Path) -> Path:
    log = ULogFile()
    log.topic("sensor_combined", [("float", "gyro_rad[3]"), ("float", "accelerometer_m_s2[3]")])
    for i in range(100):
        log.add("sensor_combined", 10_000 * i, *[0.0] * 3, 0.0, 0.0, -9.8)
    return log.write(path)


def hover(path: Path) -> Path:
    """Write three seconds of hover with take-off and landing."""
    return ulog(path, motion_of(flown_log(11.7, motion=0.0)))


def six_motors(path: Path) -> Path:
    log = ULogFile()
    log.topic("actuator_motors", [("uint64_t", "timestamp_sample"), ("float", "control[12]")])
    for i in range(100):
        log.add("actuator_motors", 10_000 * i, 10_000 * i, *[0.6] * 6, *[float("nan")] * 6)
    return log.write(path)


def bytes_of(data: bytes) -> Callable[[Path], Path]:
    def write(path: Path) -> Path:
        path.write_bytes(data)
        return path

    return write


BAD: list[tuple[str, Callable[[Path], Path], list[str]]] = [
    ("a.ulg", no_motors, ["has no motor outputs of 4 rotors", "actuator_motors", "SDLOG_PROFILE"]),
    ("a.ulg", hover, ["s of free flight (9.", "and a fit needs 20 s", "roll and pitch rates of 0.3", "(here "]),
    ("a.ulg", six_motors, ["actuator_motors: commands motor 5", "'x500' has 4 rotors"]),
    ("a.ulg", bytes_of(b""), ["is empty"]),
    ("a.ulg", bytes_of(b"ULog\x01\x12\x35\x01"), ["is no readable ULog", "copy it"]),
    ("a.bin", bytes_of(b"\x00\x01\x02" * 100), ["is no DataFlash log"]),
    ("a.bin", bytes_of(b"\xa3\x95\x80" + b"\x00" * 40), ["has no motor outputs"]),
    ("a.tlog", bytes_of(b"\x00" * 64), ["is no log of a known format", "the vehicle's own card"]),
    ("a.log", bytes_of(b"FMT, 128, 89, FMT"), ["DataFlash as text", "take the .bin"]),
    ("a.csv", bytes_of(b"t,x\n0,1\n"), ["is a table", "--columns MAP"]),
    ("a.png", bytes_of(b"\x89PNG\r\n\x1a\n"), ["is no log of a known format", "PX4 ULog"]),
    ("run.mcap", bytes_of(b"\x89MCAP0\r\n" + b"\x01" * 30), ["has no motor outputs"]),
]


@pytest.mark.parametrize(("name", "write", "messages"), BAD)
def test_unusable_log_ends_with_status_2(
    name: str, write: Callable[[Path], Path], messages: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / name)
    arguments = ["identify", str(path), "--vehicle", "x500", "--out", str(tmp_path / "out"), "-q"]
    assert run_command_line(arguments) == 2
    told = capsys.readouterr().err
    assert f"error: {path}" in told
    assert "Traceback" not in told
    for message in messages:
        assert message in told
    assert not (tmp_path / "out").exists()


def test_missing_log_and_missing_arguments(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["identify", str(tmp_path / "no.ulg"), "--vehicle", "x500"]) == 2
    assert "cannot be read (No such file" in capsys.readouterr().err
    assert run_command_line(["identify", "--vehicle", "x500"]) == 2
    assert "name one or more flight logs" in capsys.readouterr().err
    assert run_command_line(["identify", "a.ulg"]) == 2


def test_truncated_ulog_is_used_up_to_its_end(
    flown_ulog: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = flown_ulog.read_bytes()
    cut = tmp_path / "cut.ulg"
    cut.write_bytes(data[: round(0.8 * len(data))])
    estimator = StandIn()
    identify([cut], options(tmp_path / "out"), CONSOLE, estimate=estimator)
    assert not capsys.readouterr().out  # of pyulog
    # 80 % of 40 s, on a clock that begins at 5 s
    assert estimator.flights[-1].end_s == pytest.approx(37.0, abs=0.5)


def test_two_boots_in_one_dataflash_log_are_refused(tmp_path: Path) -> None:
    whole = dataflash(tmp_path / "a.bin", motion_of(LOG)).read_bytes()
    (tmp_path / "b.bin").write_bytes(whole + whole)
    with pytest.raises(ConfigError, match="the file holds two boots"):
        identify([tmp_path / "b.bin"], options(tmp_path / "out"), CONSOLE, estimate=StandIn())


def test_logs_of_two_vehicles_are_refused(flown_ulog: Path, tmp_path: Path) -> None:
    other = ulog(tmp_path / "other.ulg", motion_of(scaled(LOG, "motors", 0.8)))
    with pytest.raises(ConfigError, match="two vehicles are mixed"):
        identify([flown_ulog, other], options(tmp_path / "out"), CONSOLE, estimate=StandIn())


def test_problems_of_all_logs_are_told_at_once(tmp_path: Path) -> None:
    logs = [no_motors(tmp_path / "a.ulg"), six_motors(tmp_path / "b.ulg")]
    with pytest.raises(ConfigError) as error:
        identify(logs, options(tmp_path / "out"), CONSOLE, estimate=StandIn())
    assert [problem.where.split(":")[0] for problem in error.value.problems] == [str(log) for log in logs]


def test_same_log_twice_is_refused(flown_ulog: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="named twice"):
        identify([flown_ulog, flown_ulog], options(tmp_path / "out"), CONSOLE, estimate=StandIn())


def test_column_map_tells_its_mistakes(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,m1,m2,m3,m4\n0,1,1,1,1\n")
    text = "time: {column: t, unit: s}\nworld: enu\nbody: flu\nestimated: false\n"
    for motors, message in (
        ("{columns: [m1, m2, m3, m4], kind: command}", "commands need their range"),
        ("{columns: [m1, m2, m3, m4], kind: speed}", "speeds need their unit"),
        ("{columns: [m1, m2, m3], kind: command, range: [0, 1]}", "has 4 rotors, one column for each"),
        ("{columns: [m1, m2, m3, m5], kind: command, range: [0, 1]}", "has no column 'm5' (known: t, m1, m2, m3, m4)"),
        ("{columns: [m1, m2, m3, m4], kind: command, range: [0, 0.5]}", "outside the range 0 to 0.5"),
    ):
        (tmp_path / "map.yaml").write_text(f"{text}motors: {motors}\n")
        with pytest.raises(ConfigError) as error:
            identify(
                [tmp_path / "a.csv"],
                options(tmp_path / "out", columns=tmp_path / "map.yaml"),
                CONSOLE,
                estimate=StandIn(),
            )
        assert message in str(error.value)


def test_the_documents_maps_are_maps() -> None:
    examples = ROOT / "docs/examples/identify"
    for path in sorted(examples.glob("*.columns.yaml")):
        load_model(path, ColumnMap)
    (block,) = blocks(ROOT / "docs/identify.md", "yaml")
    document = parse_yaml(block.text, "identify.md")
    built, problems = validate(ColumnMap, document.data, document)
    assert built is not None
    assert not problems
    for name in ("crazyflie", "crazyflie_brushless"):
        assert load_vehicle(examples / f"{name}.yaml").name == name


def test_excitation_flies_what_is_missing(flown_ulog: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = [
        "identify",
        "--excite",
        "--vehicle",
        "x500",
        "--room",
        "15",
        "--ceiling",
        "12",
        "--out",
        str(tmp_path / "a"),
    ]
    assert run_command_line(whole) == 0
    told = capsys.readouterr().out
    assert "acceleration 4.6 m/s2: 25 degrees of tilt" in told
    plan = json.loads((tmp_path / "a" / "excite.plan").read_text())["mission"]["items"]
    assert all(item["params"][6] <= 12.0 for item in plan if item["command"] == 16)
    assert (
        max(math.radians(abs(item["params"][4] - 47.397742)) * 6378137.0 for item in plan if item["command"] == 16)
        <= 15.0
    )
    script = parse_yaml((tmp_path / "a" / "excite.yaml").read_text(), "excite.yaml").data
    assert script["plan"] == "excite.plan"
    other = json.loads((tmp_path / "a" / "excite_ardupilot.plan").read_text())["mission"]["items"]
    assert not [item for item in plan if item["command"] == 115]  # PX4 refuses CONDITION_YAW
    assert [item["params"][0] for item in other if item["command"] == 115][:3] == [0.0, 0.0, 120.0]
    assert min(item["params"][0] for item in other if item["command"] == 16) == 1.0  # ArduCopter holds whole seconds
    script = parse_yaml((tmp_path / "a" / "excite_ardupilot.yaml").read_text(), "excite_ardupilot.yaml").data
    assert script["plan"] == "excite_ardupilot.plan"
    quiet = ulog(tmp_path / "quiet.ulg", motion_of(flown_log(motion=0.3)))
    some = ["identify", str(quiet), "--excite", "--vehicle", "x500", "--out", str(tmp_path / "b"), "-q"]
    assert run_command_line(some) == 0
    assert "rotor drag: relative sigma" in capsys.readouterr().out
    fewer = json.loads((tmp_path / "b" / "excite.plan").read_text())["mission"]["items"]
    assert len(fewer) < len(plan)


def test_home_must_be_a_place(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["identify", "--excite", "--vehicle", "x500", "--home", "here"]) == 2
    assert "must be LAT,LON" in capsys.readouterr().err


def test_series_refuse_what_is_no_series() -> None:
    assert isinstance(LOG, FlightLog)
    t, x = LOG.motors.t_s, LOG.motors.values
    for times, values in ((t[::-1].copy(), x), (t, x[:, 0]), (t, np.where(x > 0.7, np.nan, x)), (t[:5], x)):
        with pytest.raises(ValueError, match="must"):
            type(LOG.motors)(times, values)
