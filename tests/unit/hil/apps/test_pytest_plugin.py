"""The pytest plugin in test projects: its flights, its refusals, and the files it leaves."""

from __future__ import annotations

import shutil
import struct
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from textwrap import dedent
from typing import Any

import pytest

import hil.run.bench_run
import hil.run.report.page  # noqa: F401 (both: the projects run in this process, which imports numpy only once)
from firmware_bridge.codecs.mavlink_frame import FrameEncoder
from firmware_bridge.codecs.messages import message_class, pack
from hil.apps.pytest_plugin import Run, health

pytest_plugins = "pytester"

ROOT = Path(__file__).resolve().parents[4]
# Two simulated seconds on the ground, in a tenth of a second. The verdict is FAIL.
SHORT = """
rig: mock
tick_hz: 100
autopilot: {transport: loopback}
record: {mcap: false}
duration_s: 2
"""


@pytest.fixture
def project(pytester: pytest.Pytester) -> pytest.Pytester:
    """A project with a bench file, a mission and an empty set of options."""
    pytester.makefile(".yaml", hil=SHORT)
    shutil.copy(ROOT / "rigs/missions/square.waypoints", pytester.path)
    return pytester


def fly(project: pytest.Pytester, test: str, *options: str) -> pytest.RunResult:
    project.makepyfile(test_it="import pytest\n" + test)
    return project.runpytest_inprocess("-p", "hil.apps.pytest_plugin", "-p", "no:cacheprovider", *options)


def kept(project: pytest.Pytester) -> list[str]:
    return sorted(path.parent.name for path in project.path.glob("hil-artifacts/**/run.json"))


def test_it_loads_nothing_of_the_bench() -> None:
    program = "import sys, hil.apps.pytest_plugin; print([m for m in %r if m in sys.modules])"
    heavy = ["numpy", "mujoco", "pydantic", "pymavlink", "hil.run.bench_run", "hil.config", "matplotlib"]
    done = subprocess.run([sys.executable, "-c", program % heavy], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_tests_that_do_not_use_it_are_untouched(project: pytest.Pytester) -> None:
    project.makefile(".yaml", hil="not: a bench")
    result = fly(project, "def test_a(): pass\ndef test_b(): assert 0\n", "--strict-markers", "--hil-rig", "nonsense")
    result.assert_outcomes(passed=1, failed=1)
    assert "hil runs" not in result.stdout.str()
    assert kept(project) == []


def test_a_clean_flight_passes_and_leaves_nothing_behind(project: pytest.Pytester) -> None:
    test = """
    def test_ground(rig, mission):
        run = rig.fly(mission("square.waypoints"), seed=3)
        assert (run.status, run.passed, run.seed, run.reached) == ("FAIL", False, 3, 0)
        assert run.reasons[0] == "reached 0 of 5 waypoints"
        assert (run.out / "flight.tlog").is_file()
        assert run.measurements["max_cross_track_m"] is None
        with pytest.raises(AssertionError, match="never measured: reached 0 of 5"):
            run.max_cross_track_m
        with pytest.raises(AttributeError, match="'nonsense'; it has: .*completed"):
            run.nonsense
        assert rig.name == "mock" and {"gps", "imu", "barometer"} <= rig.features
    """
    result = fly(project, dedent(test))
    result.assert_outcomes(passed=1)
    assert not (project.path / "hil-artifacts").exists()
    result = fly(project, dedent(test), "--hil-keep", "--hil-artifacts", "hil-artifacts/nightly")
    result.assert_outcomes(passed=1)
    assert kept(project) == ["run-1"]
    assert list(project.path.glob("hil-artifacts/nightly/test_it.py/test_ground/run-1/report.html"))


def test_a_failed_test_keeps_its_runs_and_says_where(project: pytest.Pytester) -> None:
    test = """
    @pytest.mark.parametrize("seed", [4, 5])
    def test_two(rig, mission, seed):
        first = rig.fly(mission("square.waypoints"), seed=seed)
        second = rig.fly(mission("square.waypoints"), seed=seed)
        assert first.digest == second.digest and not first.passed and not second.passed
        assert seed == 4
    """
    result = fly(project, dedent(test), "--junitxml=junit.xml")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(
        ["*- hil runs -*", "FAIL  digest *test_two-5-/run-1", "again, with a report: hil run *"]
    )
    assert kept(project) == ["run-1", "run-2"]
    cases = ET.parse(project.path / "junit.xml").getroot().iter("testcase")
    properties = [{p.get("name"): p.get("value") for p in case.iter("property")} for case in cases]
    assert [p["hil_seed"] for p in properties] == ["4", "5"]
    for found in properties:
        assert (found["hil_rig"], found["hil_verdict"], len(found["hil_digest"] or "")) == ("mock", "FAIL", 64)
        assert found["hil_digest_2"] == found["hil_digest"]
    assert properties[0]["hil_digest"] != properties[1]["hil_digest"]
    # A later session that passes clears away what this one left.
    fly(project, dedent(test).replace("seed == 4", "True")).assert_outcomes(passed=2)
    assert kept(project) == []


def test_a_flight_that_is_not_clean_fails_unless_that_is_declared(project: pytest.Pytester) -> None:
    test = """
    def noisy(rig, mission):
        rig.fly(mission("square.waypoints"), settings=["autopilot.faults.noise_at_s=1"])

    def test_noise(rig, mission):
        noisy(rig, mission)

    @pytest.mark.hil_allow("late", "garbage", "fail")
    def test_allowed(rig, mission):
        noisy(rig, mission)

    @pytest.mark.hil_allow("garbag")
    def test_unknown(rig):
        pass

    def test_own_failure_comes_first(rig, mission):
        noisy(rig, mission)
        assert 0, "mine"
    """
    result = fly(project, dedent(test))
    result.assert_outcomes(passed=1, failed=2, errors=1)
    # On a CI machine pytest repeats every message whole in its summary.
    text = result.stdout.str().partition("short test summary info")[0]
    assert text.count("\n  garbage: ") == 1
    assert "hil_allow: 'garbag' is none of crc_errors, garbage," in text
    assert kept(project) == ["run-1", "run-1"]


def test_a_verdict_that_the_test_does_not_read_fails_it(project: pytest.Pytester) -> None:
    test = """
    def fly(rig): return rig.fly("square.waypoints", seed=3)

    def test_measurements_are_no_verdict(rig):
        assert fly(rig).reached == 0

    def test_second_of_two(rig):
        assert fly(rig).status == "FAIL"
        fly(rig)

    def test_read(rig):
        assert not fly(rig).passed

    @pytest.mark.hil_allow("fail")
    def test_allowed(rig):
        fly(rig)

    @pytest.fixture
    def flown(rig): return fly(rig)

    def test_flown_before_it_began(flown): pass
    """
    result = fly(project, dedent(test))
    result.assert_outcomes(passed=2, failed=3)
    text = result.stdout.str().partition("short test summary info")[0]
    assert text.count("  fail: 1 (a FAIL whose verdict the test did not read") == 2
    assert text.count("  run 2: fail: 1 (") == 1
    result.stdout.fnmatch_lines(
        [
            "    reached 0 of 5 waypoints",
            "    the run is in */hil-artifacts/test_it.py/test_measurements_are_no_verdict/run-1",
            'to judge a verdict: assert run.passed, run.reasons*assert run.status == "FAIL"',
            'to accept a finding: @pytest.mark.hil_allow("fail", "late", ...)',
        ]
    )


def test_a_flight_in_the_teardown_of_a_fixture_is_checked(project: pytest.Pytester) -> None:
    """It was a FAIL that nobody read, and the test passed; its files were removed."""
    test = """
    @pytest.fixture
    def afterwards(rig, mission):
        yield
        run = rig.fly(mission("square.waypoints"))
        READ

    def test_before(rig, mission, afterwards):
        assert not rig.fly(mission("square.waypoints")).passed
    """
    result = fly(project, dedent(test).replace("READ", "pass"), "--junitxml=junit.xml")
    result.assert_outcomes(passed=1, errors=1)
    result.stdout.fnmatch_lines(["*the flight was not clean:*", "*run 2: fail: 1*", "*reached 0 of 5 waypoints*"])
    assert kept(project) == ["run-1", "run-2"]
    names = [p.get("name") for p in ET.parse(project.path / "junit.xml").getroot().iter("property")]
    assert [name for name in names if str(name).startswith("hil_digest")] == ["hil_digest", "hil_digest_2"]
    fly(project, dedent(test).replace("READ", "assert not run.passed")).assert_outcomes(passed=1)
    assert kept(project) == []


def test_a_pass_of_nothing_fails_the_test(project: pytest.Pytester) -> None:
    """A bench without a mission passes on the ground, with a warning that no passed test shows."""
    test = """
    def test_on_the_ground(rig):
        assert rig.fly().passed

    @pytest.mark.hil_allow("unflown")
    def test_allowed(rig):
        assert rig.fly().passed

    def test_skipped_after_a_flight(rig, mission):
        rig.fly(mission("square.waypoints"))
        pytest.skip("nothing to see")

    def test_skipped_in_peace(rig, mission):
        assert rig.fly(mission("square.waypoints")).status == "FAIL"
        pytest.skip("nothing to see")

    def test_skipped_by_unittest(rig, mission):
        rig.fly(mission("square.waypoints"))
        raise unittest.SkipTest("nothing to see")

    @pytest.fixture
    def flown(rig, mission):
        rig.fly(mission("square.waypoints"))
        pytest.skip("nothing to see")

    def test_skipped_by_its_fixture(flown):
        pass

    @pytest.fixture
    def flies_late(rig, mission):
        yield
        rig.fly(mission("square.waypoints"))
        pytest.skip("nothing to see")

    def test_skipped_by_the_end_of_its_fixture(flies_late):
        pass

    def test_expected_to_fail_after_a_flight(rig, mission):
        rig.fly(mission("square.waypoints"))
        pytest.xfail("nothing to see")

    def test_expected_to_fail_in_peace(rig, mission):
        assert rig.fly(mission("square.waypoints")).status == "FAIL"
        pytest.xfail("nothing to see")

    @pytest.mark.xfail
    def test_marked_as_one_that_fails(rig, mission):
        rig.fly(mission("square.waypoints"))
    """
    result = fly(project, "import unittest\n" + dedent(test))
    result.assert_outcomes(passed=2, failed=4, skipped=1, errors=2, xfailed=2)
    result.stdout.fnmatch_lines(
        [
            "*unflown: 1 (a PASS of a vehicle that never left its start)",
            "*fail: 1 (a FAIL whose verdict the test did not read*",
        ]
    )


def test_a_crash_that_the_test_does_not_look_at_fails_it(project: pytest.Pytester) -> None:
    test = """
    def fall(rig):
        stops = "faults.rotors=[{kind: stuck, rotor: 0, at_s: 8, speed_radps: 0}]"
        return rig.fly("square.waypoints", settings=["duration_s=20", "tick_hz=250", stops])

    def test_not_looked_at(rig):
        assert fall(rig).json["sim_s"] > 1.0

    def test_looked_at(rig):
        assert fall(rig).reasons[0].startswith("crashed: ")

    @pytest.mark.hil_allow("crash")
    def test_allowed(rig):
        fall(rig)
    """
    result = fly(project, dedent(test))
    result.assert_outcomes(passed=2, failed=1)
    result.stdout.fnmatch_lines(
        ["*crash: 1 (a FAIL with a crash whose verdict the test did not read*", "*  crashed: *"]
    )


def test_a_run_that_breaks_is_an_error_of_the_bench(project: pytest.Pytester) -> None:
    test = """
    from hil.apps.pytest_plugin import BenchError
    STALL = ["autopilot.faults.stall_at_s=1", "autopilot.reply_timeout_s=0.05"]

    def test_stall(rig, mission):
        rig.fly(mission("square.waypoints"), settings=STALL)
        raise SystemExit("not reached")

    @pytest.mark.hil_allow("error")
    def test_allowed(rig, mission):
        assert rig.fly(mission("square.waypoints"), settings=STALL).json["error"]["type"] == "LockstepLost"
    """
    result = fly(project, dedent(test))
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*BenchError: LockstepLost: *", "*the run is in *"])


def test_features_decide_what_is_skipped(project: pytest.Pytester) -> None:
    test = """
    @pytest.mark.hil_feature("gps", "magnetometer")
    def test_has(): pass

    @pytest.mark.hil_feature("gps")
    @pytest.mark.hil_feature("jtag", "optical_flow")
    def test_has_not(): raise AssertionError

    @pytest.mark.hil_feature("barro")
    def test_misspelt(): raise AssertionError
    """
    result = fly(project, dedent(test), "-rs", "--strict-markers")
    result.assert_outcomes(passed=1, skipped=2)
    result.stdout.fnmatch_lines(["*rig 'mock' has no barro (did you mean 'baro'?); it has: *"])
    result.stdout.fnmatch_lines(["*rig 'mock' has no jtag and no optical_flow; it has: baro, *"])
    result = fly(project, dedent(test), "--hil-set", "features=[jtag, optical_flow]")
    result.assert_outcomes(passed=1, failed=1, skipped=1)


def test_the_command_line_wins(project: pytest.Pytester) -> None:
    test = """
    @pytest.mark.rig("no_such_rig")
    def test_it(rig, mission):
        assert rig.fly(mission("square.waypoints"), seed=1, settings=["duration_s=1"]).seed == 99
        assert not rig.runs[0].passed
        assert rig.runs[0].json["sim_s"] == 0.5
    """
    options = ("--hil-rig", "mock", "--hil-seed", "99", "--hil-set", "duration_s=0.5")
    fly(project, dedent(test), *options).assert_outcomes(passed=1)
    result = fly(project, dedent(test))
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*is unknown: 'no_such_rig'*"])
    result = fly(project, dedent(test), *options, "--hil-config", "missing.yaml")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*missing.yaml: no such file*"])


def test_invalid_files_fail_with_every_problem(project: pytest.Pytester) -> None:
    test = """
    def test_it(rig, mission):
        rig.fly(mission("square.waypoints"), settings=["tick_hz=300", "sede=1"])
    """
    result = fly(project, dedent(test))
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*the bench cannot be flown:*", "*tick_hz*300 Hz*", "*did you mean 'seed'?*"])


def test_missions_are_found_near_the_test_and_in_the_bench(project: pytest.Pytester) -> None:
    deep = project.mkpydir("deep")
    (deep / "missions").mkdir()
    (deep / "missions" / "near.plan").write_text("{}")
    (project.path / "up.plan").write_text("{}")
    (deep / "test_deep.py").write_text(
        "import pytest\n"
        "def test_found(mission):\n"
        "    assert mission('near.plan').parent.name == 'missions'\n"
        "    assert mission('up.plan').is_file()\n"
        "    assert mission('rectangle.plan').is_file()\n"
        "def test_missing(mission):\n"
        "    mission('nowhere.plan')\n"
    )
    result = project.runpytest_inprocess("-p", "hil.apps.pytest_plugin", "deep")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*there is no mission 'nowhere.plan' beside test_deep.py*"])


def test_buses_to_plug_into(project: pytest.Pytester) -> None:
    test = """
    def test_desk(hil_desk, hil_usb_bus, hil_serial_ports, hil_hid):
        board = hil_desk.plug_board(0x3162, 0x0053, product="PX4 Pixhawk6C")
        assert len(hil_usb_bus.devices()) == 1 and len(hil_serial_ports.ports()) >= 1
        assert hil_desk.find().autopilots[0].port.startswith("/dev/tty")
        hil_desk.unplug(board)
        assert not hil_usb_bus.devices() and not hil_hid.interfaces()

    def test_a_desk_is_a_tests_own(hil_usb_bus):
        assert not hil_usb_bus.devices()
    """
    fly(project, dedent(test)).assert_outcomes(passed=2)


def test_the_worked_example_of_the_documentation_flies(pytester: pytest.Pytester) -> None:
    shutil.copytree(ROOT / "docs/examples/firmware_team", pytester.path, dirs_exist_ok=True)
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider", "--hil-set", "autopilot.transport=loopback")
    result.assert_outcomes(passed=3, skipped=1)
    assert not (pytester.path / "hil-artifacts").exists()


@pytest.fixture(autouse=True)
def bench_on_the_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the test projects, which run in their own process, import the bench."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))


def test_the_log_that_shows_resets_is_recorded_whatever_the_bench_says(project: pytest.Pytester) -> None:
    project.makefile(".yaml", hil=SHORT.replace("mcap: false", "mcap: false, tlog: false"))
    test = """
    def test_ground(rig, mission):
        run = rig.fly(mission("square.waypoints"))
        assert run.status == "FAIL" and (run.out / "flight.tlog").is_file()
    """
    fly(project, dedent(test)).assert_outcomes(passed=1)


def test_a_reset_of_the_estimator_in_the_air_is_seen(tmp_path: Path) -> None:
    heartbeat, odometry = message_class("HEARTBEAT"), message_class("ODOMETRY")
    statustext = message_class("STATUSTEXT")
    vehicle, station = FrameEncoder(1, 1), FrameEncoder(255, 190)
    cov = (0.0,) * 21

    def odo(counter: int) -> Any:
        return odometry(0, 1, 8, 0, 0, 0, (1, 0, 0, 0), 0, 0, 0, 0, 0, 0, cov, cov, counter)

    ground, armed = heartbeat(2, 12, 1, 0, 3, 3), heartbeat(2, 12, 129, 0, 4, 3)
    said = [odo(0), ground, odo(1), statustext(6, "EKF2 heading reset"), armed, odo(1), odo(1)]
    in_the_air = [odo(2), statustext(4, "EKF3 IMU0 yaw reset"), odo(2), statustext(4, "mission reset"), ground, odo(3)]

    def resets(messages: list[Any]) -> int:
        frames = b""
        for message in messages:
            frames += struct.pack(">Q", 0xFD_FE_00_FD_FD) + vehicle.frame(message.MSGID, pack(message))
            own = heartbeat(6, 8, 0, 0, 4, 3)  # the bench's own, which is never armed
            frames += struct.pack(">Q", 7) + station.frame(own.MSGID, pack(own))
        (tmp_path / "flight.tlog").write_bytes(frames)
        return health(run_of(tmp_path))["estimator_reset"]

    assert resets(said) == 0
    assert resets(said + in_the_air) == 2


def run_of(out: Path, **link: int) -> Run:
    counts = {"bad_crc": 0, "garbage_bytes": 0, "lost_frames": 0} | {k: v for k, v in link.items() if k != "late"}
    autopilot = {"late": link.get("late", 0), "link": counts}
    json = {"status": "PASS", "autopilot": autopilot, "timing": {"paced_ticks_late": 0}, "error": None, "seed": 1}
    return Run(json | {"digest": "0", "verdict": {"rows": [], "reasons": []}, "mission": {}}, out)


@pytest.mark.parametrize(
    ("counter", "word"),
    [("bad_crc", "crc_errors"), ("garbage_bytes", "garbage"), ("lost_frames", "lost_frames"), ("late", "late")],
)
def test_every_link_counter_is_checked(tmp_path: Path, counter: str, word: str) -> None:
    assert set(health(run_of(tmp_path)).values()) == {0}
    found = health(run_of(tmp_path, **{counter: 3}))
    assert {name: count for name, count in found.items() if count} == {word: 3}


VEHICLES = """
vehicles:
  lead: {}
  wing:
    sensors:
      imu: {preset: icm20689}
      gps: {preset: here_plus, rate_hz: 10}
      baro: {preset: ms5611, rate_hz: 50}
      mag: {preset: ist8310, rate_hz: 50}
      front: {kind: camera, resolution: [32, 24], fov_deg: 90, rate_hz: 10, channels: [rgb]}
formation: {shape: line, spacing_m: 4}
"""


def test_each_vehicle_of_a_flight_has_its_own_run(project: pytest.Pytester) -> None:
    project.makefile(".yaml", hil=SHORT + VEHICLES)
    test = """
    @pytest.mark.hil_feature("camera")
    def test_ground(rig, mission):
        run = rig.fly(mission("square.waypoints"))
        assert list(run.vehicles) == ["lead", "wing"]
        assert (run.contacts, run.formation_error_m if run.completed else None) == (0, None)
        lead, wing = run.vehicles.values()
        assert lead.digest != wing.digest and wing.digest == run.json["vehicles"]["wing"]["digest"]
        assert (wing.status, wing.reached) == ("FAIL", 0) and (wing.out / "flight.tlog").is_file()
        assert lead.vehicles == {}
        assert "lead: reached 0 of 5 waypoints" in run.reasons
        assert run.vehicles["third"].passed
    """
    result = fly(project, dedent(test))
    result.stdout.fnmatch_lines(["*KeyError: 'third'*"])


def test_the_verdict_of_one_vehicle_is_none_of_the_others(project: pytest.Pytester) -> None:
    project.makefile(".yaml", hil=SHORT + "vehicles: {lead: {}, wing: {}}\nformation: {shape: line, spacing_m: 4}\n")
    test = """
    def test_one(rig):
        assert not rig.fly("square.waypoints").vehicles["wing"].passed

    def test_the_flight(rig):
        assert not rig.fly("square.waypoints").passed
    """
    result = fly(project, dedent(test))
    result.assert_outcomes(passed=1, failed=1)
    text = result.stdout.str()
    assert "\n    lead: reached 0 of 5 waypoints\n" in text
    assert "wing: reached" not in text


def test_a_link_fault_names_its_vehicle(project: pytest.Pytester) -> None:
    faulty = "vehicles: {lead: {}, wing: {autopilot: {faults: {noise_at_s: 1}}}}\n"
    project.makefile(".yaml", hil=SHORT + faulty + "formation: {shape: line, spacing_m: 4}\n")
    result = fly(project, 'def test_ground(rig): assert not rig.fly("square.waypoints").passed')
    result.assert_outcomes(failed=1)
    result.stdout.re_match_lines(["the flight was not clean:", r"  wing: garbage: \d+"])
    assert "lead: " not in result.stdout.str()
