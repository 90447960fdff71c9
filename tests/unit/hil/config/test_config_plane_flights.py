"""Checks of a plane's start and mission, each with its figure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from firmware_bridge.autopilots.catalog import PROFILES
from hil.config import load_bench
from signals.errors import ConfigError

ROOT = Path(__file__).resolve().parents[4]
PLANE = (ROOT / "rigs/plane.yaml").read_text()
LAUNCH = "start: {launch: {kind: catapult, length_m: 4, speed_mps: 16}}\n"


def problems(tmp_path: Path, text: str) -> str:
    file = tmp_path / "bench.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_bench(file)
    return "\n".join(str(problem) for problem in caught.value.problems)


def test_the_shipped_bench_is_fine(tmp_path: Path) -> None:
    file = tmp_path / "bench.yaml"
    file.write_text(PLANE)
    assert load_bench(file).config.vehicle == "skywalker_x8"


def test_a_belly_that_thrust_cannot_move(tmp_path: Path) -> None:
    told = problems(tmp_path, PLANE.replace(LAUNCH, "").replace("scene: meadow", "scene: airfield"))
    assert "lying on its belly: its 20.6 N of thrust do not overcome the friction of 26.4 N" in told
    assert "launch" in told


def test_a_copter_mission_on_a_plane(tmp_path: Path) -> None:
    told = problems(tmp_path, PLANE.replace("circuit.waypoints", "rectangle.plan"))
    assert "rectangle.plan:69: item 4 lies 40 m from the one before, within one turn of 47 m radius" in told
    assert "'skywalker_x8' is a plane" in told
    assert "rectangle.plan:164: item 9 (landing) lies 0 m from the waypoint before and 10 m below it" in told
    assert "a plane needs 94 m or more" in told


def test_items_of_a_plane_on_a_copter(tmp_path: Path) -> None:
    rows = (ROOT / "rigs/missions/short.waypoints").read_text().splitlines()
    rows[4] = rows[4].replace("\t16\t", "\t18\t", 1)
    mission = tmp_path / "turns.waypoints"
    mission.write_text("\n".join(rows) + "\n")
    told = problems(tmp_path, f"rig: mock\nmission: {mission}\n")
    assert f"{mission}:5: item 3 (loiter turns) is flown by planes alone" in told
    assert "the vehicle 'x500' is a multirotor" in told


@pytest.mark.parametrize(
    ("column", "value", "told"),
    [
        (2, "10", "is refused by the autopilot 'mock': frame 10 is not supported (use 3: altitude above home)"),
        (3, "82", "is refused by the autopilot 'mock': command 82 is not supported"),
    ],
)
def test_items_that_the_mock_would_refuse_at_the_upload(tmp_path: Path, column: int, value: str, told: str) -> None:
    rows = [row.split("\t") for row in (ROOT / "rigs/missions/short.waypoints").read_text().splitlines()]
    rows[4][column] = value
    mission = tmp_path / "m.waypoints"
    mission.write_text("\n".join("\t".join(row) for row in rows) + "\n")
    assert f"{mission}:5: item 3 {told}" in problems(tmp_path, f"rig: mock\nmission: {mission}\n")
    bench = tmp_path / "px4.yaml"
    bench.write_text(f"rig: px4_sitl\nautopilot: {{start: false}}\nmission: {mission}\n")
    assert load_bench(bench).mission is not None, "firmware that is not known here decides for itself"
    companion = ROOT / "rigs/benches/companion_waypoints.yaml"
    assert load_bench(companion, mission=str(mission)).mission is not None, "nothing is uploaded to it"
    each = f"mission: {mission}\nvehicles: {{one: {{companion: {{clients: 1, control: true}}}}, two: {{TWO}}}}\n"
    bench.write_text(each.replace("TWO", "start: {p_W: [5, 0, 0]}, mission: rigs/missions/short.waypoints"))
    assert load_bench(bench).vehicles["one"].mission is not None
    assert f"{mission}:5: item 3 {told}" in problems(tmp_path, each.replace("TWO", "start: {p_W: [5, 0, 0]}"))


def test_an_autopilot_that_flies_no_planes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PROFILES, "ardupilot_eahrs", replace(PROFILES["ardupilot_eahrs"], flies_planes=False))
    told = problems(tmp_path, PLANE.replace("rig: mock", "rig: ardupilot_eahrs"))
    assert "'skywalker_x8' is a plane, which an autopilot of kind 'ardupilot_eahrs' cannot fly here" in told


def test_the_other_program_of_ardupilot_is_told_by_its_name(tmp_path: Path) -> None:
    copter, plane = tmp_path / "arducopter", tmp_path / "arduplane"
    copter.write_bytes(b"program: ArduCopter V4.7.0-dev")
    plane.write_bytes(b"program: ArduPlane V4.7.0-dev, ArduCopter")
    for program in (copter, plane):
        program.chmod(0o755)
    flown = PLANE.replace("rig: mock", "rig: ardupilot_sitl\nautopilot: {binary: PROGRAM}")
    told = problems(tmp_path, flown.replace("PROGRAM", str(copter)))
    assert "autopilot.binary names ArduCopter, and this vehicle needs ArduPlane" in told
    assert "./waf plane" in told
    told = problems(tmp_path, f"rig: ardupilot_sitl\nautopilot: {{binary: {plane}}}\n")
    assert "autopilot.binary names ArduPlane, and this vehicle needs ArduCopter" in told
    (tmp_path / "bench.yaml").write_text(flown.replace("PROGRAM", str(plane)))
    assert load_bench(tmp_path / "bench.yaml").firmware.program == "ArduPlane"


def test_set_points_that_arduplane_does_not_take(tmp_path: Path) -> None:
    text = PLANE.replace(
        "rig: mock", "rig: ardupilot_sitl\nautopilot: {start: false}\ncompanion: {control: true, clients: 1}"
    )
    told = problems(tmp_path, text.replace("mission: rigs/missions/circuit.waypoints", "mission: null"))
    assert "companion.control flies by set-points, which ArduPlane does not take" in told


def test_a_script_with_the_modes_of_arduplane(tmp_path: Path) -> None:
    """ArduCopter has no mode TAKEOFF."""
    script = tmp_path / "script.yaml"
    script.write_text("actions:\n  - {at_s: 1, set_mode: TAKEOFF}\n")
    bench = tmp_path / "bench.yaml"
    bench.write_text(f"rig: ardupilot_sitl\nautopilot: {{start: false}}\nmission: {script}\nvehicle: skywalker_x8\n")
    assert load_bench(bench).script is not None
    told = problems(tmp_path, bench.read_text().replace("skywalker_x8", "x500"))
    assert "names the mode TAKEOFF, which ArduPilot does not have" in told


def test_parameters_of_a_plane_on_a_copter(tmp_path: Path) -> None:
    told = problems(tmp_path, "rig: mock\nautopilot: {params: {FW_AIRSPD_TRIM: 15}}\n")
    assert "is a parameter of a plane, and the vehicle 'x500' is a multirotor" in told


RUNWAY = (ROOT / "rigs/benches/runway.yaml").read_text()


def test_the_bench_on_a_runway_is_fine(tmp_path: Path) -> None:
    file = tmp_path / "bench.yaml"
    file.write_text(RUNWAY)
    bench = load_bench(file)
    assert [command.name for command in bench.vehicle.commands][-2:] == ["steering", "brake"]


def test_wheels_without_a_runway(tmp_path: Path) -> None:
    told = problems(tmp_path, RUNWAY.replace("scene: airstrip", "scene: airfield"))
    line = RUNWAY.splitlines().index("scene: airstrip") + 1
    assert f"bench.yaml:{line}" in told
    assert "scene has no runway for the take-off roll of about 21 m, to 12.1 m/s, of the plane 'trainer'" in told


def test_a_runway_too_short(tmp_path: Path) -> None:
    told = problems(tmp_path, RUNWAY + "start: {p_W: [375, 0, 0]}\n")
    assert "start leaves 15 m of runway, and the take-off roll of 'trainer' needs about 21 m" in told
    assert "start nearer to the threshold" in told


@pytest.mark.parametrize("start", ["{p_W: [40, 30, 0]}", "{p_W: [40, 0, 0], yaw_deg: 60}"])
def test_a_start_off_the_runway_or_across_it(tmp_path: Path, start: str) -> None:
    told = problems(tmp_path, RUNWAY + f"start: {start}\n")
    assert "start is not on the runway of the scene along its heading of 90 deg" in told


def test_wheels_in_deep_grass(tmp_path: Path) -> None:
    trainer = (ROOT / "rigs/vehicles/trainer.yaml").read_text().replace("rolling: 0.02", "rolling: 0.95")
    (tmp_path / "stuck.yaml").write_text(trainer)
    told = problems(tmp_path, RUNWAY.replace("vehicle: trainer", f"vehicle: {tmp_path / 'stuck.yaml'}"))
    assert "on its wheels: drag and rolling resistance (0.95 of its weight) take all its thrust" in told


def test_a_belly_that_slides_too_far(tmp_path: Path) -> None:
    text = PLANE.replace(LAUNCH, "").replace("scene: meadow", "scene: airfield")
    text += "vehicle_settings: {mass_kg: 2.5}\n"
    told = problems(tmp_path, text)
    assert "which has no wheels, to slide on its belly" in told
    assert "start" in told
    assert "kind: catapult" in told


WAITS = "autopilot: {params: {FW_LAUN_DETCN_ON: 1}}\n"


def test_a_launch_too_weak_to_be_seen(tmp_path: Path) -> None:
    weak = "start: {launch: {kind: hand, speed_mps: 4, at_s: 12}}\n"
    told = problems(tmp_path, PLANE.replace(LAUNCH, weak) + WAITS)
    assert "launch pulls with 8.0 m/s2 at most, and FW_LAUN_AC_THLD takes 12 m/s2 for a launch" in told


@pytest.mark.parametrize("waits", [WAITS, "autopilot: {params_file: waits.params}\n"])
def test_a_launch_that_waits_for_the_engine_that_waits_for_it(tmp_path: Path, waits: str) -> None:
    (tmp_path / "waits.params").write_text("FW_LAUN_DETCN_ON 1\n")
    told = problems(tmp_path, PLANE + waits)
    assert "launch is released by the engine at throttle 0.5, and with FW_LAUN_DETCN_ON the engine waits" in told
    assert "at_s: 12" in told


def test_a_launch_strong_enough_is_fine(tmp_path: Path) -> None:
    file = tmp_path / "bench.yaml"
    file.write_text(PLANE.replace("speed_mps: 16}", "speed_mps: 16, at_s: 12}") + WAITS)
    assert load_bench(file).config.start.launch is not None


def test_a_rail_that_leads_into_the_ground(tmp_path: Path) -> None:
    told = problems(tmp_path, PLANE.replace("speed_mps: 16}", "speed_mps: 16, elevation_deg: -30}"))
    assert "start.launch leads from 1.2 to -0.80 m over the ground, and 'skywalker_x8' needs 0.12 m" in told
    told = problems(tmp_path, PLANE.replace("speed_mps: 16}", "speed_mps: 16, height_m: 0}"))
    assert "leads from 0 to 0.69 m" in told
