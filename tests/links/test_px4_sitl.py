"""Start, flight and loss of PX4 SITL, with a stand-in on PX4's own ports (`fake_px4_sitl`)."""

from __future__ import annotations

import json
import shlex
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from firmware_bridge.links import child_process
from firmware_bridge.links.autopilot_link import LinkTimeouts, TickSamples
from firmware_bridge.links.px4 import ground_channel, lockstep
from firmware_bridge.links.px4.sitl import px4_hand_start, px4_sitl_link, px4_sitl_process
from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from signals.errors import ConfigError, HandshakeError, LinkClosed, LinkError, LockstepLost, PortNotFound
from tests.worlds.bench_process import free_instance
from tests.worlds.fake_px4_sitl import FakePx4
from tests.worlds.patience import PATIENCE_S, PATIENT, expect_silence, until
from tests.worlds.resting_vehicle import Drive

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="PX4 SITL does not run there")

FAKE = Path(__file__).parents[1] / "worlds" / "fake_px4_sitl.py"
TICK_NS = 4_000_000
ARM, SET_MODE, TERMINATE = 400, 176, 185
OFFBOARD = 6.0

Flights = Callable[..., RunResult]
Drives = Callable[..., "Px4Drive"]

# Up, ten metres north, down.
HOP = """QGC WPL 110
0	1	0	16	0	0	0	0	47.39774200	8.54559400	488.0	1
1	0	3	22	0	0	0	0	47.39774200	8.54559400	4.0	1
2	0	3	16	0	0	0	0	47.39774200	8.54559400	4.0	1
3	0	3	16	0	0	0	0	47.39783200	8.54559400	4.0	1
4	0	3	21	0	0	0	0	47.39783200	8.54559400	0.0	1
"""


@pytest.fixture
def instance() -> int:
    """Return an instance number whose ports are free."""
    return free_instance()


@pytest.fixture
def build(tmp_path: Path) -> Path:
    """Return PX4's program in a build tree."""
    tree = tmp_path / "build of px4"
    airframes = tree / "etc/init.d-posix/airframes"
    airframes.mkdir(parents=True)
    (tree / "etc/init.d-posix/rcS").write_text("#!/bin/sh\n")
    names = ("10016_none_iris", "10040_sihsim_quadx", "1030_gazebo-classic_plane", "4001_gz_x500", "CMakeLists.txt")
    for name in names:
        (airframes / name).write_text("")
    binary = tree / "bin/px4"
    binary.parent.mkdir()
    binary.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {shlex.quote(str(FAKE))} "$@"\n')
    binary.chmod(0o755)
    return binary


@pytest.fixture
def fly(tmp_path: Path, build: Path, instance: int) -> Flights:
    """Run the rig px4_sitl with the stand-in."""

    def run(*settings: str, mission: str | None = HOP, out: str = "out") -> RunResult:
        path = None
        if mission is not None:
            path = tmp_path / "hop.waypoints"
            path.write_text(mission)
        bench = tmp_path / "bench.yaml"
        bench.write_text("")
        keep = ("record.mcap=false", "record.tlog=false", "record.report=false")
        chosen = (f"autopilot.binary='{build}'", f"autopilot.instance={instance}", *keep, *settings)
        loaded = load_bench(bench, rig="px4_sitl", mission=None if path is None else str(path), settings=chosen)
        return run_bench(loaded, tmp_path / out, quiet=True)

    return run


def state(pid: int | None) -> str:
    """Return the state of a process as /proc names it; Z, a zombie, if there is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (ProcessLookupError, FileNotFoundError):
        return "Z"


def gone(pid: int) -> bool:
    """Return True once no running process is left of it."""
    return bool(until(lambda: state(pid) == "Z", "the end of the process"))


# -- started by the bench -------------------------------------------------------------------------------------------


def test_a_mission_with_a_px4_that_the_bench_starts(fly: Flights, tmp_path: Path) -> None:
    left = tmp_path / "out/autopilot"
    left.mkdir(parents=True)
    (left / "parameters.bson").write_text("of an earlier run")
    (left / "dataman").write_text("")  # marks a working folder of PX4
    result = fly(
        "autopilot.params.MPC_XY_P=0.9", "autopilot.params.COM_RC_IN_MODE=4", "autopilot.env={FAKE_PX4_CHILD: '1'}"
    )
    assert (result.status, result.run["error"]) == ("PASS", None)
    assert result.run["mission"]["reached"] == result.run["mission"]["waypoints"]
    assert result.run["deterministic"] is False
    started = json.loads((left / "started.json").read_text())
    assert started["found"] == []  # a clean folder
    assert started["data"] == [str(tmp_path / "build of px4/etc")]
    env = started["env"]
    assert (env["PX4_SIM_MODEL"], env["PX4_SYS_AUTOSTART"]) == ("none_iris", "10016")
    assert {name: value for name, value in env.items() if name.startswith("PX4_PARAM_")} == {
        "PX4_PARAM_EKF2_GPS_DELAY": "100",  # latency of the here_plus; PX4's script for simulators has 10 ms
        "PX4_PARAM_SENS_GPS0_DELAY": "100",  # its name since 2026, which is unknown to older ones
        "PX4_PARAM_SENS_GPS1_DELAY": "100",
        "PX4_PARAM_SENS_GNSS0_DELAY": "100",  # and that after it
        "PX4_PARAM_SENS_GNSS1_DELAY": "100",
        "PX4_PARAM_EKF2_BARO_DELAY": "0",
        "PX4_PARAM_EKF2_MAG_DELAY": "0",
        "PX4_PARAM_MPC_XY_P": "0.9",
        "PX4_PARAM_COM_RC_IN_MODE": "4",
    }
    log = (tmp_path / "out/autopilot.log").read_text()
    assert "INFO  [fake] airframe 10016" in log
    assert all(f"Parameter SENS_{kind}0_DELAY not found" in log for kind in ("GPS", "GNSS"))  # and it flies
    assert gone(started["pid"])
    assert gone(started["child"])  # the whole group
    assert result.run["autopilot"]["link"]["bad_crc"] == 0


def test_a_misspelt_parameter_ends_the_run_before_take_off_and_the_nearest_is_named(fly: Flights) -> None:
    result = fly("autopilot.params.MPC_XY_CRUSE=2", "autopilot.params.MPC_XY_P=0.9")
    assert (result.status, result.exit_status) == ("ERROR", 2)
    assert result.run["error"]["type"] == "ConfigError"
    assert result.run["error"]["message"] == (
        "autopilot.params.MPC_XY_CRUSE: is unknown to PX4 (did you mean 'MPC_XY_CRUISE'?)"
    )
    assert result.run["mission"]["reached"] == 0
    assert result.run["sim_s"] < 30.0


def test_a_value_that_px4_does_not_take_ends_the_run_too(fly: Flights) -> None:
    result = fly("autopilot.params.MPC_XY_CRUISE=2000", mission=None)
    assert result.exit_status == 2
    assert "autopilot.params.MPC_XY_CRUISE: is 5 on PX4, not 2000" in result.run["error"]["message"]


def test_a_run_that_ends_before_the_parameters_are_read_does_not_pass(fly: Flights) -> None:
    result = fly("autopilot.params.MPC_XY_CRUSE=2", "duration_s=2", mission=None)
    assert (result.status, result.run["error"]["type"]) == ("ERROR", "HandshakeError")
    assert "MPC_XY_CRUSE" in result.run["error"]["message"]


def test_a_parameter_at_its_default_outlasts_the_start_scripts(build: Path) -> None:
    """PX4's script sets a variable's lines in turn, and stores only what changes a value."""
    data = build.parent.parent / "etc"
    (data / "init.d-posix/airframes/1030_gazebo-classic_plane").write_text("param set-default FW_THR_MAX 0.6\n")
    (data / "init.d").mkdir()
    (data / "init.d/rc.fw_defaults").write_text("param set-default -s RTL_TYPE 1\n")
    (data / "init.d-posix/px4-rc.mavlinksim").write_text("param set-default EKF2_GPS_DELAY 10\n")
    params = {"FW_THR_MAX": 1.0, "RTL_TYPE": 0.0, "FW_PSP_OFF": 1.5, "EKF2_GPS_DELAY": 110.0}
    env, _ = px4_hand_start(build, airframe="1030", tick_hz=250, params=params, instance=0)
    lines = [line for key, value in env.items() for line in f"{key}={value}".splitlines() if "PARAM" in line]
    assert lines == [
        "PX4_PARAM_FW_THR_MAX=2",
        "PX4_PARAM_FW_THR_MAX=1",
        "PX4_PARAM_RTL_TYPE=1",
        "PX4_PARAM_RTL_TYPE=0",
        "PX4_PARAM_FW_PSP_OFF=1.5",
        "PX4_PARAM_EKF2_GPS_DELAY=111",
        "PX4_PARAM_EKF2_GPS_DELAY=110",
    ]


def test_an_unknown_airframe_is_told_by_the_check(build: Path, tmp_path: Path) -> None:
    (tmp_path / "bench.yaml").write_text("")

    def check(airframe: str) -> None:
        settings = [f"autopilot.binary='{build}'", f"autopilot.airframe='{airframe}'"]
        load_bench(tmp_path / "bench.yaml", rig="px4_sitl", settings=settings)

    check("none_iris")
    check("gazebo-classic_plane")
    check("4001")
    with pytest.raises(
        ConfigError, match=r"airframe: is unknown to this PX4: 'none_irsi' \(did you mean 'none_iris'\?"
    ):
        check("none_irsi")
    with pytest.raises(ConfigError, match="is unknown to this PX4: '9999'"):
        check("9999")


def test_a_px4_that_the_user_starts(fly: Flights, instance: int, tmp_path: Path) -> None:
    px4 = FakePx4(instance)
    thread = threading.Thread(target=px4.serve, daemon=True)
    thread.start()
    result = fly("autopilot.start=false", "duration_s=3", mission=None)
    assert (result.run["error"], result.run["sim_s"]) == (None, 3.0)
    assert px4.ended.wait(PATIENCE_S)
    assert not (tmp_path / "out/autopilot.log").exists()
    times = [time_us for what, time_us in px4.order if what == "sensor"]
    assert times == [tick * 4000 for tick in range(750)]


@pytest.mark.parametrize(("how", "status"), [("exit", "exit status 7"), ("kill", "signal SIGKILL")])
def test_a_crash_is_reported_with_its_last_output(fly: Flights, how: str, status: str) -> None:
    result = fly(f"autopilot.env={{FAKE_PX4: {how}@500}}", "duration_s=10", mission=None)
    error = result.run["error"]
    assert (result.status, error["type"]) == ("ERROR", "LinkClosed")
    assert error["cause"] == "crashed"
    assert status in json.dumps(error)
    assert "airframe 10016" in json.dumps(error)
    assert result.run["sim_s"] == pytest.approx(499 * 0.004, abs=0.01)


def process(binary: Path, folder: Path, *, env: dict[str, str] | None = None, **more: Any) -> Any:
    settings: dict[str, Any] = {"airframe": "none_iris", "tick_hz": 250, "params": {}} | more
    build = child_process.FirmwareBuild(binary, folder, folder.parent / "log", env=env or {})
    return px4_sitl_process(build, **settings)


@pytest.mark.parametrize("airframe", ["none_iris", "10016"])
def test_the_airframe_is_set_by_name_or_number(build: Path, tmp_path: Path, airframe: str) -> None:
    env = process(build, tmp_path / "w", airframe=airframe)._env
    assert env == {"PX4_SIM_MODEL": "none_iris", "PX4_SYS_AUTOSTART": "10016"}
    assert process(build, tmp_path / "w", airframe="gz_x500")._env["PX4_SYS_AUTOSTART"] == "4001"


def test_a_fast_tick_raises_the_rate_at_which_px4_integrates(build: Path, tmp_path: Path) -> None:
    slow = process(build, tmp_path / "w", tick_hz=250)._env
    assert not [name for name in slow if name.startswith("PX4_PARAM")]
    fast = process(build, tmp_path / "w", tick_hz=500, params={"SDLOG_MODE": 1.0}, env={"PX4_PARAM_X": "y"})._env
    assert fast["PX4_PARAM_IMU_INTEG_RATE"] == "500"
    assert fast["PX4_PARAM_SDLOG_MODE"] == "1"  # the user's value is kept
    assert fast["PX4_PARAM_X"] == "y"


def test_an_invalid_build_is_refused_before_the_start(build: Path, tmp_path: Path) -> None:
    with pytest.raises(PortNotFound, match=r"does not exist; set autopilot\.binary"):
        process(tmp_path / "nothing", tmp_path / "w")
    with pytest.raises(ConfigError, match=r"is unknown to this PX4: 'none_hexa' .*it has: 10016 none_iris\)$"):
        process(build, tmp_path / "w", airframe="none_hexa")
    lone = tmp_path / "px4"
    lone.write_text("")
    with pytest.raises(PortNotFound, match=r"has no start scripts: .*SITL build"):
        process(lone, tmp_path / "w")
    installed = tmp_path / "usr/bin/px4"
    installed.parent.mkdir(parents=True)
    installed.write_text("")
    (build.parent.parent / "etc").rename(tmp_path / "etc")
    (tmp_path / "usr/share/px4").mkdir(parents=True)
    (tmp_path / "etc").rename(tmp_path / "usr/share/px4/etc")
    assert process(installed, tmp_path / "w").argv[-1].endswith("usr/share/px4/etc")


def test_a_program_that_ends_before_it_connects(fly: Flights) -> None:
    result = fly("autopilot.arguments=['--nonsense']", mission=None)
    assert result.run["error"]["cause"] == "crashed"
    assert "ended before its first heartbeat" in json.dumps(result.run["error"])
    assert "--nonsense" in json.dumps(result.run["error"])


def test_a_folder_that_is_not_px4_s_is_left_alone(fly: Flights, tmp_path: Path) -> None:
    mine = tmp_path / "out/autopilot/thesis.tex"
    mine.parent.mkdir(parents=True)
    mine.write_text("years of work")
    result = fly(mission=None)
    assert result.run["error"]["type"] == "PortNotFound"
    assert "choose another --out" in result.run["error"]["message"]
    assert mine.read_text() == "years of work"


def test_a_port_that_is_taken_is_named(fly: Flights, instance: int) -> None:
    with socket.socket() as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("127.0.0.1", 4560 + instance))
        other.listen()
        result = fly(mission=None)
    assert "PortBusy" in json.dumps(result.run["error"])


# -- the link -------------------------------------------------------------------------------------------------------


class Px4Drive(Drive):
    """A link to a stand-in in this process."""

    def __init__(self, instance: int, *, script: str = "", start: Any = None) -> None:
        self.px4 = None
        if start is None:
            self.px4 = FakePx4(instance, script=script)
            threading.Thread(target=self.px4.serve, daemon=True).start()
        super().__init__(px4_sitl_link(instance, start_process=start, timeouts=PATIENT), TICK_NS)
        self.link.open()

    def step(self, extra: bytes = b"") -> bytes:
        return super().step(extra + (self.words("HEARTBEAT", 6, 8, 0, 0, 4, 3) if self.tick == 0 else b""))

    def handled(self) -> bool:
        """Return True if the stand-in has done all that it does with the newest sensor message."""
        return self.px4 is not None and self.px4.handled > self.tick

    def lose(self, extra: bytes = b"", *, after: Callable[[], bool] | None = None) -> LinkError:
        """Do a tick to which no answer comes in time and return the error. It is awaited only `after` this is true."""
        wait = self.link.wait

        def wait_in_vain(tick: int, t_ns: int) -> None:
            until(after or self.handled, "what the far side does at this tick")
            expect_silence(self.link)
            wait(tick, t_ns)

        self.link.wait = wait_in_vain
        with pytest.raises(LinkError) as caught:
            self.step(extra)
        return caught.value


@pytest.fixture
def drive(instance: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Drives]:
    made: list[Px4Drive] = []
    monkeypatch.setattr(lockstep, "_LINGER_S", 0.2)
    # The far side reads in the end, even on a busy machine.
    monkeypatch.setattr(ground_channel, "_READ_LIMIT_S", PATIENCE_S)

    def make(**settings: Any) -> Px4Drive:
        made.append(Px4Drive(instance, **settings))
        return made[-1]

    yield make
    for one in made:
        one.link.close()
        assert one.px4 is None or one.px4.ended.wait(PATIENCE_S)


def test_the_boot_is_detected_and_then_each_sensor_message_is_answered(drive: Drives) -> None:
    driven = drive()
    driven.run(200)
    assert 1 <= len(driven.seen) <= 200 - 17
    answered = len(driven.seen)
    driven.run(50)
    assert len(driven.seen) == answered + 50
    assert [frame.t_ns for frame in driven.seen[-50:]] == [tick * TICK_NS for tick in range(200, 250)]


@pytest.mark.skipif(not Path("/proc/net/udp").exists(), reason="the system does not tell what has been read")
def test_commands_reach_it_before_the_sensor_of_their_tick(drive: Drives) -> None:
    driven = drive()
    driven.run(60)
    for number in range(40):
        driven.run(1)
        driven.step(driven.command(1000 + number))
    assert driven.px4 is not None
    order = driven.px4.order
    for number in range(40):
        tick = 60 + 2 * number + 1
        assert order[order.index(("command", 1000 + number)) + 1] == ("sensor", tick * 4000)


SCRIPTED = 99  # the tick of a script's "@100"


@pytest.mark.parametrize(
    ("script", "cause", "says"),
    [
        ("heartbeat@100", "terminated", "terminated: PX4 does not answer afterwards"),
        ("late_heartbeat@100", "terminated", "terminated"),
        ("text@100", "terminated", "it last said: Flight termination active"),
        ("lost@100", "lost", "it answers later messages"),
        ("silent@100", "silent", "no answer to time_usec 396000"),
    ],
)
def test_the_cause_of_silence_is_named(
    drive: Drives, monkeypatch: pytest.MonkeyPatch, script: str, cause: str, says: str
) -> None:
    if cause == "lost":
        monkeypatch.setattr(lockstep, "_PROBE_WAIT_S", PATIENCE_S)  # the first is answered
    elif script.startswith("late"):
        monkeypatch.setattr(lockstep, "_PROBE_WAIT_S", 0.02)  # it takes 250 probes until it says something
    driven = drive(script=script)
    driven.run(SCRIPTED)
    error = driven.lose()
    assert isinstance(error, LockstepLost)
    assert error.cause == cause
    assert "396000" in str(error)
    assert says in str(error)


def test_silent_after_it_was_told_to_terminate(drive: Drives) -> None:
    driven = drive()
    driven.run(60)
    error = driven.lose(driven.command(TERMINATE, 1.0))
    assert isinstance(error, LockstepLost)
    assert error.cause == "terminated"


def test_silent_in_offboard_without_set_points(drive: Drives) -> None:
    driven = drive()
    driven.run(60)
    error = driven.lose(driven.command(SET_MODE, 1.0, OFFBOARD))
    assert isinstance(error, LockstepLost)
    assert error.cause == "offboard_without_setpoints"
    assert "send set-points first" in str(error)


def test_offboard_that_has_been_left_is_not_named_as_the_cause(drive: Drives) -> None:
    """Only the last mode commanded counts, as in flight."""
    driven = drive(script="silent@100")
    driven.run(60)
    driven.link._vehicle.sent(driven.command(SET_MODE, 1.0, OFFBOARD) + driven.command(SET_MODE, 1.0, 4.0, 6.0))
    driven.run(SCRIPTED - driven.tick)
    assert driven.lose().cause == "silent"


def test_slow_is_distinguished_from_silent(drive: Drives, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lockstep, "_LINGER_S", PATIENCE_S)
    driven = drive(script="slow@100")
    driven.run(SCRIPTED)
    error = driven.lose(after=lambda: True)
    assert error.cause == "slow"
    assert "reply_timeout_s" in str(error)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the system does not tell")
def test_a_stopped_process_is_reported_and_ended(
    drive: Drives, build: Path, tmp_path: Path, instance: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(child_process, "_TERMINATE_S", 0.2)  # a stopped process does not handle SIGTERM
    child = process(build, tmp_path / "w", env={"FAKE_PX4": "stop@100"}, instance=instance)
    driven = drive(start=lambda: child)
    driven.run(SCRIPTED)
    error = driven.lose(after=lambda: state(child.pid) == "T")
    assert error.cause == "stopped"
    pid = child.pid
    driven.link.close()
    assert gone(pid)


def test_a_wire_that_hangs_up_is_a_crash(drive: Drives) -> None:
    driven = drive(script="hang_up@100")
    with pytest.raises(LinkClosed) as caught:
        driven.run(200)
    assert caught.value.cause == "crashed"


def test_another_px4_answers_in_place_of_the_one_that_was_started(instance: int) -> None:
    other = FakePx4(instance)
    threading.Thread(target=other.serve, daemon=True).start()
    ended = child_process.ChildProcess(["/bin/sh", "-c", "echo port is taken >&2; exit 3"])
    link = px4_sitl_link(instance, start_process=lambda: ended, timeouts=PATIENT)

    def fly() -> None:
        link.open()
        for tick in range(100):
            link.send(tick, tick * TICK_NS, TickSamples(), b"")
            link.wait(tick, tick * TICK_NS)

    with pytest.raises(LinkClosed, match=r"(?s)another program answers.*exit status 3.*port is taken") as caught:
        fly()
    link.close()
    assert caught.value.cause == "second_autopilot"
    assert other.ended.wait(PATIENCE_S)


@pytest.mark.skipif(not Path("/proc/net/udp").exists(), reason="the system does not tell who listens")
def test_a_px4_that_has_lost_its_simulator_before(instance: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as left_over:
        left_over.bind(("127.0.0.1", 18570 + instance))
        with pytest.raises(HandshakeError, match="never connects again; start PX4 anew"):
            px4_sitl_link(instance, timeouts=LinkTimeouts(connect_s=0.2)).open()


def test_a_px4_that_never_connects_is_named(instance: int) -> None:
    link = px4_sitl_link(instance, timeouts=LinkTimeouts(connect_s=0.2))
    with pytest.raises(HandshakeError, match="no program connected; start PX4 with PX4_SIM_MODEL=none_iris"):
        link.open()
    # The port is free again.
    with pytest.raises(HandshakeError):
        link.open()
