"""Mission scripts: read with every problem at its line, merged over the bench, flown and replayed."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from hil.config import Bench, load_bench, save_bench
from hil.config.missions.script import GustSpec, parse_event
from hil.config.missions.script_file import read_script
from hil.run.bench_run import RunResult, run_bench
from hil.run.recorder.reading import read_messages
from signals.errors import ConfigError

ROOT = Path(__file__).resolve().parents[5]
BENCH = """
rig: mock
autopilot: {transport: loopback}
record: {report: false, tlog: false}
duration_s: 60
"""
# Take off by modes alone, hover, land: some twenty seconds.
HOP = """
actions:
  - {at_s: 3, param: {MIS_TAKEOFF_ALT: 3.0}}
  - {at_s: 4.4, set_mode: TAKEOFF}
  - {at_s: 4.5, arm: true}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "rigs/missions/square.waypoints", tmp_path)
    return tmp_path


def load(script: str, bench: str = BENCH, **options: Any) -> Bench:
    Path("flight.yaml").write_text(script, encoding="utf-8")
    Path("b.yaml").write_text(bench, encoding="utf-8")
    return load_bench("b.yaml", mission="flight.yaml", **options)


def refused(script: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load(script)
    return [str(problem) for problem in caught.value.problems]


def fly(script: str) -> RunResult:
    return run_bench(load(script), Path("out"), quiet=True)


def events(result: RunResult) -> list[tuple[float, str]]:
    return [
        (m.log_time_ns * 1e-9, m.decode()["msg"])
        for m in read_messages(result.out / "run.mcap")
        if m.topic == "/events"
    ]


def test_the_scripts_that_come_with_the_bench_can_be_loaded() -> None:
    for name in ("rectangle_gust", "hold_and_resume"):
        bench = load_bench("b.yaml" if Path("b.yaml").exists() else None, mission=f"rigs/missions/{name}.yaml")
        assert bench.script is not None
        assert bench.mission is not None
        assert bench.files["plan"].parent.name == "missions"


def test_timed_faults_and_gusts_become_settings_of_the_bench() -> None:
    script = """
plan: square.waypoints
actions:
  - {at_s: 30, gust: {speed_mps: 8, direction_deg: 270, for_s: 3}}
  - {at_s: 40, fault: {sensor: gps, kind: dropout, for_s: 5}}
  - {at_s: 41, fault: {rotor: 2, kind: efficiency, factor: 0.9}}
  - {at_s: 42, fault: {autopilot: noise}}
  - {after: waypoint 2, fault: {sensor: baro, kind: freeze}}
limits: {max_cross_track_m: 3.5, final_error_m: null}
"""
    own = "faults: {rotors: [{kind: stuck, rotor: 1, at_s: 59}]}\nlimits: {max_cross_track_m: 2, altitude_error_m: 4}\n"
    config = load(script, BENCH + own).config
    assert config.wind is not None
    (gust,) = config.wind.gusts
    assert (gust.at_s, gust.velocity_W_mps, gust.hold_s, gust.end_s) == (30.0, (8.0, 0.0, 0.0), 3.0, 34.0)
    assert [(f.rotor, f.at_s) for f in config.faults.rotors] == [(1, 59.0), (2, 41.0)]
    assert [(f.sensor, f.at_s, f.until_s) for f in config.faults.sensors] == [("gps", 40.0, 45.0)]
    assert config.autopilot.faults.noise_at_s == 42.0
    limits = config.limits
    assert (limits.max_cross_track_m, limits.final_error_m, limits.altitude_error_m) == (3.5, None, 4.0)
    # The command line wins.
    assert load(script, settings=["limits.max_cross_track_m=0.25"]).config.limits.max_cross_track_m == 0.25


def test_gusts_come_on_top_of_the_scenes_steady_wind() -> None:
    scene = (ROOT / "rigs/scenes/airfield.yaml").read_text()
    kept = [line for line in scene.splitlines() if not line.startswith("wind_W_mps")]
    Path("windy.yaml").write_text("\n".join([*kept, "wind_W_mps: [1, 2, 0]"]))
    script = "actions:\n  - {at_s: 1, gust: {speed_mps: 4, direction_deg: 180, for_s: 1}}\n"
    wind = load(script, BENCH + "scene: ./windy.yaml\n").config.wind
    assert wind is not None
    assert wind.steady_W_mps == (1.0, 2.0, 0.0)
    assert wind.gusts[0].velocity_W_mps == (0.0, 4.0, 0.0)


@pytest.mark.parametrize(
    ("direction", "blows"), [(0, (0, -5, 0)), (90, (-5, 0, 0)), (180, (0, 5, 0)), (270, (5, 0, 0))]
)
def test_a_gust_comes_from_its_direction(direction: float, blows: tuple[float, float, float]) -> None:
    assert GustSpec(speed_mps=5, direction_deg=direction, for_s=1).event(3.0).velocity_W_mps == blows


def test_a_saved_run_contains_every_fault_once(folder: Path) -> None:
    (folder / "deep").mkdir()
    shutil.move("square.waypoints", "deep/square.waypoints")
    script = """
plan: deep/square.waypoints
actions:
  - {at_s: 30, gust: {speed_mps: 8, direction_deg: 200, for_s: 3}}
  - {at_s: 40, fault: {sensor: gps, kind: dropout, for_s: 5}}
limits: {max_cross_track_m: 3.5}
"""
    bench = load(script)
    saved = load_bench(save_bench(bench, Path("run")))
    assert saved.config == bench.config.model_copy(update={"mission": "mission.yaml", **named(saved)})
    assert saved.script is not None
    assert bench.script is not None
    assert saved.script.script == bench.script.script
    assert saved.mission is not None
    assert bench.mission is not None
    assert saved.mission.items == bench.mission.items


def named(bench: Bench) -> dict[str, str]:
    return {"vehicle": bench.config.vehicle, "scene": bench.config.scene}


def test_every_problem_at_once_each_at_its_line() -> None:
    wrong = {
        4: ("{at_s: 1, after: takeoff, arm: true}", "either at_s or after"),
        5: ("{at_s: 1, arm: true, set_mode: HOLD}", "exactly one of"),
        6: ("{at_s: 1}", "has none"),
        7: ("{after: waypoint 0, arm: true}", "'waypoint 0'"),
        8: ("{at_s: 1, set_mode: HOLDD}", "did you mean 'HOLD'?"),
        9: ("{at_s: -1, set_mode: HOLD}", "at least 0 s"),
        10: ("{at_s: 1, comand: {id: 3}}", "did you mean 'command'?"),
        11: ("{at_s: 1, command: {id: 3, params: [1, 2, 3, 4, 5, 6, 7, 8]}}", "at most 7"),
        12: ("{at_s: 1, fault: {rotor: 1, kind: stucked}}", "did you mean 'stuck'?"),
        13: ("{at_s: 1, fault: {sensor: gps, kind: drop}}", "did you mean 'dropout'?"),
        14: ("{at_s: 1, fault: {kind: stuck}}", "exactly one rotor, surface, sensor, link or autopilot"),
        15: ("{after: takeoff, fault: {autopilot: stall}}", "needs at_s"),
        16: ("{at_s: 1, fault: {autopilot: stal}}", "did you mean 'stall'?"),
        17: ("{at_s: 1, fault: {sensor: gps, kind: dropout, until_s: 4}}", "for_s inside it"),
        18: ("{at_s: 1, fault: {sensor: gps, kind: dropout, for_s: 0}}", "above 0 s"),
        19: ("{at_s: 1, param: {lower: 1}}", "cannot be a parameter"),
    }
    text = "plan: missing.plan\n# nothing is right here\nactions:\n"
    found = refused(text + "".join(f"  - {line}\n" for line, _ in wrong.values()))
    for number, (line, words) in wrong.items():
        assert any(f"flight.yaml:{number}: " in p and words in p for p in found), (line, found)
    assert any("flight.yaml:1: plan names a file that does not exist" in p for p in found)
    assert len(found) == len(wrong) + 1


def test_problems_with_the_bench_have_the_line_of_the_script() -> None:
    found = refused(
        "plan: square.waypoints\n"
        "actions:\n"
        "  - {after: waypoint 6, set_mode: HOLD}\n"
        "  - {after: item 8, set_mode: HOLD}\n"
        "  - {at_s: 1, fault: {sensor: lidar, kind: freeze}}\n"
        "  - {after: takeoff, fault: {sensor: lidar, kind: freeze}}\n"
        "  - {at_s: 1, fault: {rotor: 6, kind: stuck}}\n"
        "  - {after: takeoff, fault: {rotor: 6, kind: stuck}}\n"
        "limits: {max_crosstrack_m: 3}\n"
    )
    assert [p.split(": ")[0] for p in found] == [f"flight.yaml:{n}" for n in range(3, 10)]


def test_an_empty_script_or_one_that_waits_for_a_plan_it_lacks_is_refused() -> None:
    assert refused("description: nothing\n") == ["flight.yaml:1: has neither a plan nor actions"]
    (problem,) = refused("actions:\n  - {after: waypoint 1, set_mode: LAND}\n")
    assert problem == "flight.yaml:2: actions[0].after waits for waypoint 1, but the script has no plan"
    Path("x.yaml").write_text("actions:\n  - {at_s: 1, arm: true}\n")
    assert read_script(Path("x.yaml")).name_of(0) == "x.yaml:2: arm"


@pytest.mark.parametrize(
    ("script", "problem"),
    [
        (
            "outcome: crashed\nlimits: {landing_speed_mps: 9}\n",
            "flight.yaml:4: limits.landing_speed_mps is not judged with",
        ),
        ("expect:\n  - {measure: max_tilt_deg, name: final_error_m}\n", "as a limit of every flight"),
        ("expect:\n  - {measure: max_tilt_deg, at_most: 180}\n", "at_most 180 deg is met by any flight"),
        ("expect:\n  - {measure: max_altitude_m, at_least: -1e9}\n", "at_least -1e+09 m is met by any flight"),
        ("expect:\n  - {measure: max_speed_mps, at_least: 0}\n", "max_speed_mps is at least 0 in any flight"),
    ],
)
def test_what_would_not_be_judged_is_refused(script: str, problem: str) -> None:
    (found,) = refused("plan: square.waypoints\nactions: []\n" + script)
    assert problem in found


def test_a_script_cannot_expect_a_crash_that_the_bench_does_not_judge() -> None:
    with pytest.raises(ConfigError, match=r"flight.yaml:2: outcome expects a crash.*crash: null"):
        load("plan: square.waypoints\noutcome: crashed\n", settings=["crash=null"])


# A rotor stops in the air. Nothing but the crash is judged.
FALL = """plan: square.waypoints
outcome: {outcome}
actions:
  - {{at_s: {at_s}, fault: {{rotor: 0, kind: stuck, speed_radps: 0}}}}
"""
NO_LIMITS = """limits: {max_cross_track_m: null, final_error_m: null, altitude_error_m: null,
  landing_speed_mps: null, landed_tilt_deg: null}
"""


@pytest.mark.parametrize(
    ("outcome", "at_s", "status"),
    [("any", 14, "FAIL"), ("aborted", 14, "FAIL"), ("complete", 14, "FAIL"), ("crashed", 14, "PASS")],
)
def test_a_crash_fails_the_flight_unless_its_script_wants_it(outcome: str, at_s: float, status: str) -> None:
    result = fly(FALL.format(outcome=outcome, at_s=at_s) + ("" if outcome == "crashed" else NO_LIMITS))
    assert result.status == status, result.run["verdict"]
    reasons = result.run["verdict"]["reasons"]
    if outcome == "crashed":
        assert reasons == []
        assert next(row["value"] for row in result.run["verdict"]["rows"] if row["name"] == "crashed_after_s") > 14.0
    else:
        assert reasons[0].startswith("crashed: ")


def test_a_crash_that_the_script_wants_and_that_does_not_come_is_a_fail() -> None:
    result = fly(HOP + "  - {after: takeoff, delay_s: 1, set_mode: LAND}\noutcome: crashed\n")
    assert result.status == "FAIL"
    assert result.run["verdict"]["reasons"] == ["the flight ended without the crash that its script expects"]


def test_events_of_a_flight() -> None:
    assert parse_event("waypoint 3") == ("waypoint", 3, "")
    assert parse_event("mode AUTO") == ("mode", 0, "MISSION")
    for text in ("", "waypoint", "waypoint x", "takeoff 3", "mode", "mode auto", "landing"):
        with pytest.raises(ValueError, match="no event is called"):
            parse_event(text)


def test_a_flight_by_modes_alone_is_disturbed_by_its_script() -> None:
    calm = fly(HOP + "  - {after: takeoff, delay_s: 8, set_mode: LAND}\nexpect:\n  - {measure: max_tilt_deg}\n")
    assert calm.status == "PASS", calm.run
    result = fly(
        HOP
        + "  - {after: takeoff, delay_s: 4, gust: {speed_mps: 9, direction_deg: 270, for_s: 1}}\n"
        + "  - {after: takeoff, delay_s: 5, fault: {sensor: baro, kind: freeze, for_s: 1}}\n"
        + "  - {at_s: 6, command: {id: 31999}, required: false}\n"
        + "  - {after: takeoff, delay_s: 8, set_mode: LAND}\n"
        + "expect:\n"
        + "  - {measure: max_tilt_deg}\n"
        + "  - {measure: max_altitude_m, at_least: 2.5, at_most: 3.5}\n"
        + "  - {measure: flight_time_s, at_most: 40}\n"
    )
    assert result.status == "PASS", result.run
    # The vehicle leans into the gust; its first part is the same flight.
    assert tilt_deg(result) > tilt_deg(calm) + 2.0
    told = {text: t for t, text in events(result)}
    began = told["gust of (9, 0, 0) m/s (east, north, up) rises for 0.5 s, over at " + over(told) + " s"]
    assert told["gust is over"] == pytest.approx(began + 2.0)
    assert told["baro: freeze ended"] == pytest.approx(told["baro: freeze began"] + 1.0, abs=0.021)
    assert any("MAV_RESULT_UNSUPPORTED" in text for text in told)
    outcomes = [action["outcome"] for action in result.run["actions"]]
    assert outcomes == ["done", "done", "done", "done", "done", "refused", "done"]


def test_a_fault_at_a_time_that_never_comes_fails_unless_it_is_not_required() -> None:
    late = "{at_s: 50, fault: {rotor: 1, kind: efficiency, factor: 0.9}"
    gust = "  - {at_s: 6, gust: {speed_mps: 3, direction_deg: 10, for_s: 1}}\n"
    land = "  - {after: takeoff, delay_s: 4, set_mode: LAND}\n"
    result = fly(HOP + land + gust + f"  - {late}}}\n")
    (reason,) = result.run["verdict"]["reasons"]
    assert reason == "flight.yaml:8: fault rotor 1, kind efficiency, factor 0.9: never ran, its condition was never met"
    assert result.status == "FAIL"
    assert [row["outcome"] for row in result.run["actions"][-2:]] == ["done", "waiting"]
    assert [row["t_s"] for row in result.run["actions"][-2:]] == [6.0, None]
    assert len(result.run["unmet"]) == 1
    assert fly(HOP + land + f"  - {late}, required: false}}\n").status == "PASS"


@pytest.mark.parametrize("required", [True, False])
def test_a_fault_at_an_event_that_meets_no_sample_fails_unless_it_is_not_required(required: bool) -> None:
    """It was silent: only faults at a time were looked after."""
    fault = "fault: {sensor: gps, kind: dropout, for_s: 0.001}"
    result = fly(
        HOP
        + f"  - {{after: takeoff, delay_s: 1.002, {fault}, required: {str(required).lower()}}}\n"
        + "  - {after: takeoff, delay_s: 4, set_mode: LAND}\n"
    )
    texts = [*result.run["verdict"]["reasons"], *(row["text"] for row in result.run["warnings"])]
    (text,) = [text for text in texts if "had no effect" in text]
    assert text.startswith("fault of gps: dropout at ")
    assert text.endswith(" s had no effect: no sample fell into its time")
    assert result.status == ("FAIL" if required else "PASS")


def tilt_deg(result: RunResult) -> float:
    values = {row["name"]: row["value"] for row in result.run["verdict"]["rows"]}
    return float(values["max_tilt_deg"])


def over(told: dict[str, float]) -> str:
    (text,) = [text for text in told if text.startswith("gust of")]
    return text.rpartition("over at ")[2].removesuffix(" s")


def test_the_same_script_is_the_same_flight_also_from_the_saved_run() -> None:
    script = HOP + "  - {after: takeoff, delay_s: 2, fault: {rotor: 1, kind: efficiency, factor: 0.9}}\n"
    script += "  - {at_s: 7, gust: {speed_mps: 5, direction_deg: 10, for_s: 1}}\n"
    script += "  - {after: takeoff, delay_s: 4, set_mode: LAND}\n"
    first = fly(script)
    assert first.status == "PASS", first.run
    again = run_bench(load_bench(first.out / "bench.yaml"), Path("again"), quiet=True)
    assert again.run["digest"] == first.run["digest"]


def test_a_refused_action_ends_the_run_in_its_own_name() -> None:
    result = fly("actions:\n  - {at_s: 3, command: {id: 31999}}\n")
    assert result.status == "ERROR"
    assert result.run["error"]["type"] == "HandshakeError"
    assert "flight.yaml:2: command 31999: the autopilot answered" in result.run["error"]["message"]
