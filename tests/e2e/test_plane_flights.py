"""Flights of a plane on the mock: every kind of mission item, an engine that fails, surfaces that stick."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from hil.run.bench_run import RunResult
from hil.run.recorder.reading import read_messages
from tests.worlds.bench_files import flown

ROOT = Path(__file__).resolve().parents[2]
BENCH = (ROOT / "rigs/plane.yaml").read_text().replace("record: {mcap: true, tlog: true, report: true}", "")
LAT, LON = 47.397742, 8.545594
M_PER_DEG_N, M_PER_DEG_E = 111_174.0, 75_437.0

Item = tuple[int, tuple[float, ...], tuple[float, float] | None, float]


def mission_file(path: Path, items: list[Item]) -> Path:
    """Write items (command, params 1 to 4, east and north of home, height) in QGroundControl's text format."""
    rows = ["QGC WPL 110", f"0\t1\t0\t16\t0\t0\t0\t0\t{LAT}\t{LON}\t488\t1"]
    for seq, (command, params, place, height) in enumerate(items, start=1):
        east, north = place or (0.0, 0.0)
        where = (f"{LAT + north / M_PER_DEG_N:.8f}", f"{LON + east / M_PER_DEG_E:.8f}") if place else ("0", "0")
        frame = 3 if command < 100 else 2
        rows.append("\t".join([f"{seq}", "0", f"{frame}", f"{command}", *map(str, params), *where, f"{height}", "1"]))
    path.write_text("\n".join(rows) + "\n")
    return path


def fly(tmp_path: Path, more: str = "", *, mission: Path | None = None) -> RunResult:
    """Fly rigs/plane.yaml with more sections."""
    text = BENCH + "autopilot: {transport: loopback}\nrecord: {mcap: false, tlog: false, report: false}\n" + more
    if mission is not None:
        text = text.replace("mission: rigs/missions/circuit.waypoints", f"mission: {mission}")
    return flown(tmp_path, text)


@pytest.mark.slow
def test_loiters_speeds_jumps_and_the_way_home(tmp_path: Path) -> None:
    flat = (0.0, 0.0, 0.0, 0.0)
    items: list[Item] = [
        (22, flat, (200.0, 0.0), 40.0),
        (16, flat, (400.0, 0.0), 50.0),
        (18, (2.0, 0.0, 80.0, 0.0), (400.0, 300.0), 50.0),  # two turns
        (178, (0.0, 15.0, -1.0, 0.0), None, 0.0),
        (16, flat, (0.0, 400.0), 50.0),
        (178, (0.0, 21.0, -1.0, 0.0), None, 0.0),
        (16, flat, (-300.0, 300.0), 60.0),
        (177, (5.0, 1.0, 0.0, 0.0), None, 0.0),  # once more to the waypoint before
        (19, (20.0, 0.0, -60.0, 0.0), (-300.0, 0.0), 60.0),  # 20 s, to the left
        (31, (0.0, 70.0, 0.0, 0.0), (0.0, 200.0), 80.0),
        (20, flat, None, 0.0),
    ]
    more = "autopilot: {transport: loopback, params: {RTL_LAND_DELAY: 5, RTL_DESCEND_ALT: 30, RTL_RETURN_ALT: 60}}\n"
    more += "plane_limits: {max_cross_track_m: 40, touchdown_error_m: null}\nduration_s: 500\n"
    text = BENCH.replace("duration_s: 400\n", "")
    mission = mission_file(tmp_path / "variety.waypoints", items)
    text = text.replace("mission: rigs/missions/circuit.waypoints", f"mission: {mission}")
    result = flown(tmp_path, text + "record: {mcap: false, tlog: false, report: false}\n" + more)
    assert result.status == "PASS", result.run["verdict"]
    assert result.run["mission"]["reached"] == 8
    assert result.run["mission"]["loiter_error_m"] < 15.0
    assert result.run["mission"]["airspeed_margin"] > 1.2


def test_an_engine_that_fails_ends_in_a_glide_and_the_verdict_names_it(tmp_path: Path) -> None:
    result = fly(tmp_path, "faults: {rotors: [{kind: efficiency, rotor: 0, at_s: 60, factor: 0}]}\n")
    assert result.status == "FAIL"
    reasons = " ".join(result.run["verdict"]["reasons"])
    assert "engine failure, gliding" in reasons
    assert "rotor 0 efficiency falls to 0 %" in reasons
    mission = result.run["mission"]
    assert mission["landed"]
    assert mission["touchdown_sink_mps"] < 2.5
    assert mission["touchdown_bank_deg"] < 10.0
    assert mission["airspeed_margin"] > 1.1


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["angle_deg: -30", "angle_deg: 0", "angle_deg: 35"])
def test_a_stuck_surface_fails_the_flight_and_not_the_bench(tmp_path: Path, fault: str) -> None:
    stuck = f"faults: {{surfaces: [{{kind: stuck, surface: elevon_left, at_s: 60, {fault}}}]}}\nduration_s: 120\n"
    text = BENCH.replace("duration_s: 400\n", "") + "autopilot: {transport: loopback}\n"
    result = flown(tmp_path, text + "record: {mcap: false, tlog: false, report: false}\n" + stuck)
    assert result.status in ("PASS", "FAIL")
    assert result.run["error"] is None


def test_gusty_wind_across_the_circuit(tmp_path: Path) -> None:
    result = fly(tmp_path, "wind: {steady_W_mps: [-3, 3, 0], turbulence: {wind_20ft_mps: 5}}\n")
    assert result.status == "PASS", result.run["verdict"]


def test_a_short_flight_records_deflections_and_air_data_and_names_the_fault(tmp_path: Path) -> None:
    fault = "faults: {surfaces: [{kind: stuck, surface: elevon_left, at_s: 8, angle_deg: 2}]}\n"
    text = BENCH.replace("duration_s: 400", "duration_s: 12") + "record: {mcap: true, tlog: false, report: true}\n"
    result = flown(tmp_path, text + "autopilot: {transport: loopback}\nwind: {steady_W_mps: [-2, 0, 0]}\n" + fault)
    assert result.run["verdict"]["reasons"][-1] == "fault: surface elevon_left stuck at 2 degrees at 8 s"
    topics: dict[str, list[dict[str, Any]]] = {"/truth/surfaces": [], "/truth/air": [], "/truth/velocity": []}
    for message in read_messages(tmp_path / "out/run.mcap"):
        if message.topic in topics:
            topics[message.topic].append(message.decode())
    assert len(topics["/truth/surfaces"]) == 3000
    left, right = (topics["/truth/surfaces"][-1][f"angle_rad[{i}]"] for i in (0, 1))
    assert left == pytest.approx(math.radians(2.0))
    assert left != right
    assert len(topics["/truth/air"]) == 600
    air, v = topics["/truth/air"][-1], topics["/truth/velocity"][-5]
    speed = math.hypot(v["vector.x"] + 2.0, v["vector.y"], v["vector.z"])
    assert air["airspeed_mps"] == pytest.approx(speed, abs=1e-9)
    assert 0.0 < air["angle_of_attack_rad"] < 0.2
    assert (tmp_path / "out/plane.png").stat().st_size > 10_000


WINDS = ("[3, 2, 0]", "[0, 5, 0]", "[-4, 0, 0]")


@pytest.mark.slow
@pytest.mark.parametrize("gusts", ["", ", turbulence: {wind_20ft_mps: 4}"], ids=["steady", "turbulent"])
@pytest.mark.parametrize("wind", WINDS)
def test_wind_from_every_side_ends_landed_and_disarmed(tmp_path: Path, wind: str, gusts: str) -> None:
    """A strike of the belly clips the accelerometer; GPS keeps the estimate, and the plane stays where it landed."""
    result = fly(tmp_path, f"wind: {{steady_W_mps: {wind}{gusts}}}\n")
    assert result.status == "PASS", result.run["verdict"]
    assert result.run["sim_s"] < 250.0
    assert result.run["mission"]["max_cross_track_m"] < 20.0


@pytest.mark.slow
def test_more_wind_than_the_land_detector_takes_is_named(tmp_path: Path) -> None:
    """12 m/s across: at rest the airspeed stays above LNDFW_AIRSPD_MAX, and the plane stays down."""
    result = fly(tmp_path, "wind: {steady_W_mps: [0, 12, 0]}\n")
    assert result.status == "FAIL"
    assert "it rests, armed" in " ".join(result.run["verdict"]["reasons"])
    assert "Landing not detected: airspeed at rest above LNDFW_AIRSPD_MAX" in str(result.run["warnings"])
