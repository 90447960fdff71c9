"""Faults that do not reach the autopilot are refused with their line; each remedy works; untaken sensors are told."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.config import load_bench
from hil.config.checks.intake_checks import intake_notes
from tests.worlds.bench_files import elsewhere, load, refused  # noqa: F401 (the fixture is for every test)

HEAD = """rig: {rig}
autopilot: {{{start}}}
sensors:
  imu: {{preset: icm20689}}
  gps: {{preset: here_plus, rate_hz: 10}}
  baro: {{preset: ms5611, rate_hz: 50}}
  mag: {{preset: ist8310, rate_hz: 50}}
  flow: {{preset: pmw3901, rate_hz: 50}}
  spare: {{kind: gps, preset: here_plus, rate_hz: 5, autopilot: false}}
faults:
  sensors:
"""
STARTED_BY_USER = {"px4_sitl": "start: false", "ardupilot_sitl": "start: false"}
GPS_HERE = "'gps' can have here: dropout; offset, drift of latitude_deg, longitude_deg, altitude_m"
ALL = "ardupilot_eahrs, mock, mock_hitl, px4_hitl, px4_sitl"


def bench_text(rig: str, fault: str) -> str:
    """Return the text of a bench with the fault in line 12."""
    return HEAD.format(rig=rig, start=STARTED_BY_USER.get(rig, "")) + f"    - {{at_s: 3, {fault}}}\n"


@pytest.mark.parametrize(
    ("rig", "fault", "says"),
    [
        ("ardupilot_sitl", "sensor: gps, kind: freeze",
         "kind cannot be freeze: it would not reach ardupilot_sitl, which simulates its gps itself "
         f"({GPS_HERE}; this one reaches {ALL})"),
        ("ardupilot_sitl", "sensor: gps, kind: offset, field: v_W, value: 1",
         "field cannot be offset of v_W: it would not reach ardupilot_sitl, which simulates its gps itself "
         f"({GPS_HERE}; this one reaches {ALL})"),
        ("ardupilot_sitl", "sensor: baro, kind: stuck_bit, bit: 3, level: 1",
         "kind cannot be stuck_bit of pressure_pa: it would not reach ardupilot_sitl, which simulates its barometer "
         f"itself ('baro' can have here: dropout; freeze; offset, drift of pressure_pa; this one reaches {ALL})"),
        ("ardupilot_sitl", "sensor: mag, kind: freeze",
         "kind cannot be freeze: it would not reach ardupilot_sitl, which simulates its magnetometer itself "
         f"('mag' can have here: dropout; offset, drift of field_tesla; this one reaches {ALL})"),
        ("ardupilot_sitl", "sensor: imu, kind: dropout",
         "kind cannot be dropout: it would not reach ardupilot_sitl ('imu' can have here: freeze; offset, drift, "
         f"stuck_bit of accel_mps2, gyro_radps; this one reaches {ALL})"),
        ("ardupilot_sitl", "sensor: flow, kind: dropout",
         "sensor is 'flow', and ardupilot_sitl takes no optical_flow "
         "(with autopilot: false beside 'flow' it is for companions and the recording; this one reaches px4_hitl, "
         "px4_sitl)"),
        ("ardupilot_eahrs", "sensor: mag, kind: dropout",
         "kind cannot be dropout: it would not reach ardupilot_eahrs ('mag' can have here: freeze; offset, drift, "
         "stuck_bit of field_tesla; this one reaches ardupilot_sitl, mock, mock_hitl, px4_hitl, px4_sitl)"),
        ("px4_sitl", "sensor: imu, kind: drift, field: temperature_degc, rate_per_s: 1",
         "field cannot be drift of temperature_degc: it would not reach px4_sitl ('imu' can have here: dropout, "
         "freeze; offset, drift, stuck_bit of accel_mps2, gyro_radps; this one reaches ardupilot_eahrs)"),
        ("mock", "sensor: flow, kind: freeze",
         "sensor is 'flow', and mock takes no optical_flow "
         "(with autopilot: false beside 'flow' it is for companions and the recording; this one reaches px4_hitl, "
         "px4_sitl)"),
    ],
)  # fmt: skip
def test_a_fault_that_would_not_reach_the_autopilot_is_refused(rig: str, fault: str, says: str) -> None:
    assert refused(bench_text(rig, fault)) == [f"b.yaml:12: faults.sensors[0].{says}"]


@pytest.mark.parametrize(
    ("rig", "fault"),
    [
        ("ardupilot_sitl", "sensor: gps, kind: dropout"),
        ("ardupilot_sitl", "sensor: gps, kind: drift, rate_per_s: 1"),
        ("ardupilot_sitl", "sensor: baro, kind: freeze"),
        ("ardupilot_sitl", "sensor: mag, kind: offset, axis: z, value: 1.0e-5"),
        ("ardupilot_sitl", "sensor: imu, kind: stuck_bit, bit: 4, level: 0"),
        ("ardupilot_sitl", "sensor: spare, kind: stuck_bit, bit: 4, level: 0"),  # for companions
        ("ardupilot_eahrs", "sensor: gps, kind: freeze"),
        ("px4_sitl", "sensor: gps, kind: freeze"),
        ("px4_sitl", "sensor: flow, kind: dropout"),
        ("mock", "sensor: mag, kind: dropout"),
    ],
)
def test_faults_that_reach_it_and_the_remedies_are_accepted(rig: str, fault: str) -> None:
    assert load(bench_text(rig, fault)).config.faults.sensors


def test_a_sensor_for_companions_only_may_have_any_fault() -> None:
    text = bench_text("ardupilot_sitl", "sensor: flow, kind: dropout")
    assert load(text.replace("rate_hz: 50}", "rate_hz: 50, autopilot: false}")).config.faults.sensors


def test_without_mavlink_no_fault_reaches_a_sensor_that_the_firmware_simulates() -> None:
    text = bench_text("ardupilot_sitl", "sensor: gps, kind: dropout") + "mission: null\n"
    (said,) = refused(text.replace("start: false", "start: false, mavlink_port: none"))
    assert said.startswith("b.yaml:12: faults.sensors[0].kind cannot be dropout: ardupilot_sitl simulates its gps")
    assert "autopilot.mavlink_port is none" in said
    assert load(text.replace("start: false", "start: false, mavlink_port: 'tcp:5762'"))


@pytest.mark.parametrize("when", ["at_s: 5", "after: takeoff"])
def test_faults_of_a_script_are_refused_with_their_line_in_it(when: str) -> None:
    Path("script.yaml").write_text(
        f"actions:\n  - {{{when}, fault: {{sensor: gps, kind: dropout, for_s: 2}}}}\n"
        f"  - {{{when}, fault: {{sensor: gps, kind: freeze, for_s: 2}}}}\n"
    )
    (said,) = refused("rig: ardupilot_sitl\nautopilot: {start: false}\nmission: script.yaml\n")
    assert said.startswith("script.yaml:3: ")
    assert "cannot be freeze: it would not reach ardupilot_sitl" in said


def test_the_shipped_script_with_a_dropout_is_accepted_on_every_rig() -> None:
    for rig in ("mock", "mock_hitl", "px4_sitl", "px4_hitl", "ardupilot_sitl", "ardupilot_eahrs"):
        settings = [f"autopilot.{STARTED_BY_USER[rig].replace(': ', '=')}"] if rig in STARTED_BY_USER else []
        mission = str(Path(__file__).resolve().parents[4] / "rigs/missions/rectangle_gust.yaml")
        assert load_bench(rig=rig, mission=mission, settings=settings).config.faults.sensors


@pytest.mark.parametrize(
    ("rig", "told"), [("mock", True), ("ardupilot_sitl", True), ("ardupilot_eahrs", True), ("px4_sitl", False)]
)
def test_hil_check_tells_of_a_sensor_that_nothing_takes(rig: str, told: bool) -> None:
    text = HEAD.format(rig=rig, start=STARTED_BY_USER.get(rig, "")).partition("faults:")[0]

    def check(text: str) -> str:
        Path("b.yaml").write_text(text)
        done = CliRunner().invoke(app, ["check", "b.yaml"])
        assert done.exit_code == 0, done.output
        return " ".join(done.output.split())

    assert (f"note: sensor flow: {rig} takes no optical_flow" in check(text)) == told
    assert "optical_flow" not in check(text.replace("rate_hz: 50}", "rate_hz: 50, autopilot: false}"))
    assert ("simulates gps, baro, mag itself" in check(text)) == (rig == "ardupilot_sitl")


@pytest.mark.parametrize(("latency_s", "told"), [(0.3, False), (0.4, True)])
def test_hil_check_tells_of_a_sensor_that_is_later_than_px4_documents(latency_s: float, told: bool) -> None:
    def notes(rig: str, more: str = "") -> str:
        text = f"rig: {rig}\nsensors: {{gps: {{latency_s: {latency_s}{more}}}}}\n"
        start = STARTED_BY_USER.get(rig)
        config = load(text + (f"autopilot: {{{start}}}\n" if start else "")).config
        return "\n".join(intake_notes(config))

    note = "sensor gps: its latency_s is 0.4, and px4_sitl documents EKF2_GPS_DELAY up to 300 ms"
    assert notes("px4_sitl") == (note if told else "")
    assert "latency" not in notes("px4_sitl", ", autopilot: false") + notes("mock") + notes("ardupilot_sitl")
