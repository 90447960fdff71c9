"""Declared faults of sensors that ArduPilot simulates, in whole runs with a stand-in for ArduCopter."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from hil.run.bench_run import run_bench
from tests.worlds import fake_arducopter
from tests.worlds.bench_files import elsewhere, load

__all__ = ["elsewhere"]

BENCH = """rig: ardupilot_sitl
mission: {mission}
duration_s: {duration_s}
autopilot: {{binary: arducopter}}
sensors:
  imu: {{preset: icm20689}}
  gps: {{preset: here_plus, rate_hz: 10}}
  baro: {{preset: ms5611, rate_hz: 50}}
  mag: {{preset: ist8310, rate_hz: 50}}
  flow: {{preset: pmw3901, rate_hz: 50}}
record: {{mcap: false, tlog: false, report: false}}
faults: {{sensors: [{faults}]}}
"""
DROPOUT = "{kind: dropout, sensor: gps, at_s: 1, until_s: 2}"


def fly(
    folder: Path, faults: str = DROPOUT, *, duration_s: float = 2.5, mission: str = "null", **firmware: str
) -> tuple[dict[str, Any], list[list[Any]]]:
    """Return run.json, and what the firmware was asked."""
    fake_arducopter.install(folder, **firmware)
    bench = load(BENCH.format(faults=faults, duration_s=duration_s, mission=mission))
    run = run_bench(bench, folder / "out", quiet=False).run
    return run, json.loads((folder / "out" / "autopilot" / "parameters.json").read_text())


def was_set(asked: list[list[Any]]) -> list[tuple[str, float, int]]:
    return [(name, value, steps) for what, name, value, steps in asked if what == "set"]


def test_every_fault_reaches_the_firmware_in_its_tick_and_ends_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    faults = [
        "{kind: drift, sensor: gps, field: latitude_deg, at_s: 1, until_s: 1.5, rate_per_s: 1.0e-4}",
        "{kind: dropout, sensor: baro, at_s: 1, until_s: 1.5}",
        "{kind: freeze, sensor: baro, at_s: 1, until_s: 1.5}",
        "{kind: offset, sensor: baro, at_s: 1, until_s: 1.5, value: -120}",
        "{kind: dropout, sensor: mag, at_s: 1, until_s: 1.5}",
        "{kind: drift, sensor: mag, axis: x, at_s: 1, until_s: 1.5, rate_per_s: 1.0e-6}",
    ]
    run, asked = fly(tmp_path, ", ".join([DROPOUT, *faults]))
    assert (run["status"], run["error"]) == ("PASS", None)
    # 400 steps a second; the state of tick 400 is answer 400, before which the firmware has made 401 packets.
    gps = [(value, steps) for name, value, steps in was_set(asked) if name == "SIM_GPS1_ENABLE"]
    assert gps == [(0.0, 401), (1.0, 801)]
    assert len(run["firmware_faults"]) == 7
    assert run["firmware_faults"][0] == {
        "fault": "gps: dropout", "began_s": 1.0, "ended_s": 2.0, "parameters": {"SIM_GPS1_ENABLE": 0.0}
    }  # fmt: skip
    last = {name: value for name, value, _ in was_set(asked)}
    assert last == {name: pytest.approx(fake_arducopter.KNOWN[name][0], abs=1e-6) for name in last}
    during = {name: value for name, value, steps in was_set(asked) if steps < 601}
    assert during["SIM_BAR2_DISABLE"] == during["SIM_BARO_FREEZE"] == 1.0
    assert during["SIM_MAG3_FAIL"] == 1.0
    assert during["SIM_BARO_GLITCH"] == pytest.approx(10.4, abs=0.3)  # 11.5 Pa a metre at the site's 490 m
    assert during["SIM_GPS1_GLTCH_X"] == pytest.approx(4e-5, rel=1e-4)
    assert during["SIM_MAG1_OFS_X"] == pytest.approx(5.0 - 4.0, abs=1e-4)  # 1e-6 T/s is 10 mG/s
    assert "warning: sensor flow: ardupilot_sitl takes no optical_flow" in capsys.readouterr().out


def test_firmware_without_the_parameter_ends_the_run_as_an_error_that_names_it(tmp_path: Path) -> None:
    run, _ = fly(tmp_path, DROPOUT.replace("at_s: 1, until_s: 2", "at_s: 20"), duration_s=9.0, lacks="SIM_GPS")
    assert run["status"] == "ERROR"
    assert run["error"]["type"] == "HandshakeError"
    assert run["error"]["message"].startswith(
        "gps: dropout: the firmware has no parameter SIM_GPS1_ENABLE or SIM_GPS_DISABLE"
    )


def test_a_fault_of_a_script_after_an_event(tmp_path: Path) -> None:
    """The parameter is read before the event, for which the stand-in arms at 1 s."""
    (tmp_path / "script.yaml").write_text(
        "outcome: any\nactions:\n  - {after: armed, delay_s: 0.25, fault: {sensor: gps, kind: dropout, for_s: 0.5}}\n"
    )
    run, asked = fly(tmp_path, "", duration_s=3.0, mission="script.yaml", arms="2")
    assert run["error"] is None
    assert [what for what, *_ in asked[:2]] == ["read", "read"]
    assert asked[0][3] < 200
    (began, ended) = was_set(asked)
    assert (began[:2], ended[:2]) == (("SIM_GPS1_ENABLE", 0.0), ("SIM_GPS1_ENABLE", 1.0))
    assert ended[2] - began[2] == 200
