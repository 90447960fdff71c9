"""Flights of a standard VTOL on the mock: all mission items, transitions that fail, rotors and a pitot lost."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from tests.e2e.test_plane_flights import Item, mission_file
from tests.worlds.bench_files import flown

ROOT = Path(__file__).resolve().parents[2]
BENCH = (ROOT / "rigs/vtol.yaml").read_text().replace("record: {mcap: true, tlog: true, report: true}", "")
FLAT = (0.0, 0.0, 0.0, 0.0)
TO_HOVER, TO_WINGS = (3.0, 0.0, 0.0, 0.0), (4.0, 0.0, 0.0, 0.0)


def fly(tmp_path: Path, more: str = "", *, autopilot: str = "", items: list[Item] | None = None) -> RunResult:
    """Fly rigs/vtol.yaml with more sections."""
    text = BENCH + f"autopilot: {{transport: loopback, {autopilot}}}\n"
    text += "record: {mcap: false, tlog: false, report: false}\n" + more
    if items is not None:
        mission = mission_file(tmp_path / "flown.waypoints", items)
        text = text.replace("mission: rigs/missions/vtol_circuit.waypoints", f"mission: {mission}")
    return flown(tmp_path, text)


def reasons(result: RunResult) -> str:
    return " ".join(result.run["verdict"]["reasons"])


@pytest.mark.slow
def test_loiters_and_a_waypoint_in_hover_between_two_flights_on_the_wings(tmp_path: Path) -> None:
    items: list[Item] = [
        (84, FLAT, (0.0, 0.0), 30.0),
        (16, FLAT, (300.0, 0.0), 40.0),
        (18, (1.0, 0.0, 80.0, 0.0), (300.0, 250.0), 40.0),  # a turn
        (19, (10.0, 0.0, -80.0, 0.0), (0.0, 250.0), 40.0),  # 10 s, to the left
        (3000, TO_HOVER, None, 0.0),
        (16, FLAT, (-60.0, 330.0), 35.0),
        (16, FLAT, (-60.0, 300.0), 35.0),
        (19, (5.0, 0.0, 0.0, 0.0), (-60.0, 300.0), 35.0),  # 5 s on the spot
        (3000, TO_WINGS, None, 0.0),
        (16, FLAT, (-250.0, 150.0), 40.0),
        (20, FLAT, None, 0.0),
    ]
    result = fly(tmp_path, "plane_limits: {max_cross_track_m: 40}\n", items=items)
    assert result.status == "PASS", result.run["verdict"]
    mission = result.run["mission"]
    assert mission["reached"] == 7
    assert mission["loiter_error_m"] < 15.0
    assert mission["transition_loss_m"] < 3.0
    assert mission["hover_cross_track_m"] < 1.0
    assert mission["final_error_m"] < 0.7


def test_a_delivery_in_the_middle_of_a_plan(tmp_path: Path) -> None:
    """The way to the landing counted as cross-track, of 200 m; of one that was left out nothing was told."""
    items: list[Item] = [
        (84, FLAT, (0.0, 0.0), 30.0),
        (16, FLAT, (350.0, 0.0), 40.0),
        (85, FLAT, (350.0, 200.0), 0.0),
        (84, FLAT, (350.0, 200.0), 30.0),
        (16, FLAT, (0.0, 200.0), 40.0),
        (85, FLAT, (0.0, 0.0), 0.0),
    ]
    result = fly(tmp_path, items=items)
    assert result.status == "PASS", result.run["verdict"]
    script = tmp_path / "skips.yaml"
    script.write_text("plan: flown.waypoints\nactions:\n  - {after: waypoint 1, command: {id: 224, params: [4]}}\n")
    bench = load_bench(tmp_path / "bench.yaml", mission=str(script))
    skipped = run_bench(bench, tmp_path / "skipped", quiet=True)
    assert "the plan lands before waypoint 2, and the vehicle did not" in reasons(skipped)


def test_return_from_hover(tmp_path: Path) -> None:
    items: list[Item] = [
        (22, FLAT, (0.0, 0.0), 20.0),
        (16, FLAT, (30.0, 0.0), 20.0),
        (16, FLAT, (30.0, 20.0), 20.0),
        (20, FLAT, None, 0.0),
    ]
    (tmp_path / "hover.params").write_text("NAV_FORCE_VT 0\n")
    result = fly(tmp_path, autopilot="params_file: hover.params", items=items)
    assert result.run["error"] is None
    mission = result.run["mission"]
    assert mission["reached"] == 2
    assert mission["completed"]
    assert mission["final_error_m"] < 0.7
    assert result.status == "PASS", result.run["verdict"]  # nothing of a plane is asked for
    assert mission["airspeed_margin"] is None


def test_a_pusher_that_fails_in_the_transition_ends_as_a_multirotor(tmp_path: Path) -> None:
    result = fly(tmp_path, "faults: {rotors: [{kind: efficiency, rotor: 4, at_s: 31, factor: 0}]}\n")
    assert result.status == "FAIL"
    assert "quad-chute, airspeed too low" in reasons(result)
    mission = result.run["mission"]
    assert mission["landed"]
    assert mission["landing_speed_mps"] < 1.0
    assert mission["landed_tilt_deg"] < 5.0
    assert mission["final_error_m"] < 1.0  # at home


@pytest.mark.slow
def test_a_pusher_that_fails_on_the_wings_ends_as_a_multirotor(tmp_path: Path) -> None:
    result = fly(tmp_path, "faults: {rotors: [{kind: efficiency, rotor: 4, at_s: 60, factor: 0}]}\n")
    assert result.status == "FAIL"
    assert "quad-chute, pusher failure" in reasons(result)
    mission = result.run["mission"]
    assert mission["landed"]
    assert mission["landing_speed_mps"] < 1.0
    assert mission["final_error_m"] < 1.0


@pytest.mark.slow
def test_a_minimum_altitude_on_the_wings(tmp_path: Path) -> None:
    items: list[Item] = [
        (84, FLAT, (0.0, 0.0), 30.0),
        (16, FLAT, (300.0, 0.0), 40.0),
        (16, FLAT, (300.0, 250.0), 15.0),
        (85, FLAT, (0.0, 0.0), 0.0),
    ]
    result = fly(tmp_path, autopilot="params: {VT_FW_MIN_ALT: 25}", items=items)
    assert "quad-chute, minimum altitude" in reasons(result)
    assert result.run["mission"]["landed"]
    assert result.run["mission"]["landed_tilt_deg"] < 5.0


@pytest.mark.slow
def test_a_lifter_that_fails_on_the_wings_is_met_in_hover(tmp_path: Path) -> None:
    result = fly(tmp_path, "faults: {rotors: [{kind: efficiency, rotor: 0, at_s: 60, factor: 0}]}\n")
    assert result.status == "FAIL"
    assert result.run["error"] is None
    assert "crashed" in reasons(result)
    assert result.run["mission"]["reached"] == 4  # the wings carried it all the way


@pytest.mark.slow
def test_a_pitot_that_is_blocked_on_the_wings(tmp_path: Path) -> None:
    result = fly(tmp_path, "faults: {sensors: [{kind: blocked, sensor: pitot, at_s: 55, port: both}]}\n")
    assert result.run["error"] is None
    mission = result.run["mission"]
    assert mission["landed"]
    assert mission["airspeed_margin"] > 1.1


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_gusty_wind(tmp_path: Path, seed: int) -> None:
    wind = "wind: {steady_W_mps: [3, -4, 0], turbulence: {wind_20ft_mps: 5}}\n"
    text = BENCH.replace("seed: 1\n", f"seed: {seed}\n")
    text += "autopilot: {transport: loopback}\nrecord: {mcap: false, tlog: false, report: false}\n"
    result = flown(tmp_path, text + wind)
    assert result.status == "PASS", result.run["verdict"]
    assert result.run["mission"]["transition_loss_m"] < 4.0
