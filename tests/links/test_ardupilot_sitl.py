"""The start of ArduCopter's SITL by the bench: command line, parameters, and a program that ends at once."""

import pytest

from firmware_bridge.codecs.ardupilot_json import hover_throttle
from firmware_bridge.links.ardupilot.sitl import (
    DEFAULTS_PATH,
    SPIN_MAX,
    SPIN_MIN,
    ardupilot_sitl,
    loop_parameters,
    thrust_parameters,
    write_defaults,
)
from firmware_bridge.links.autopilot_link import LinkTimeouts
from firmware_bridge.links.child_process import FirmwareBuild
from signals.errors import LinkClosed, LinkError, PortNotFound


def test_command_line(tmp_path):
    (tmp_path / "arducopter").touch()
    build = FirmwareBuild(tmp_path / "arducopter", tmp_path, tmp_path / "log", arguments=["--rate", "400"])
    settings = {"build": build, "instance": 2}
    link = ardupilot_sitl(home=(47.397742, 8.545594, 488.0, 90.0), **settings)
    link._inbox.open()
    link._mavlink.open()
    argv = link._start_process().argv
    link.close()
    pairs = dict(zip(argv[2::2], argv[3::2], strict=False))
    assert pairs["--model"] == "JSON:127.0.0.1"
    assert pairs["--sim-port-out"] == str(link._inbox.port)
    assert pairs["--instance"] == "2"
    assert pairs["--sysid"] == "3"
    assert pairs["--home"] == "47.397742000,8.545594000,488.0000,90.0000"
    assert pairs["--defaults"] == str(tmp_path / "bench.parm")
    assert pairs["--serial0"] == f"udpclient:127.0.0.1:{link._mavlink.udp_port}"
    assert pairs["--serial1"] == "none"
    assert "--serial3" not in pairs
    assert pairs["--rc-in-port"] == "0"  # any free one
    assert argv[-2:] == ["--rate", "400"]
    with pytest.raises(LinkError, match="home 0, 0"):
        ardupilot_sitl(home=(0.0, 0.0, 0.0, 0.0), **settings)._start_process()


@pytest.mark.parametrize(
    ("tick_hz", "loop_hz"), [(250, 125), (333, 166), (400, 200), (500, 250), (800, 400), (1000, 333), (1200, 400)]
)
def test_loop_rate_leaves_enough_gyro_samples_for_arming(tick_hz, loop_hz):
    parameters = loop_parameters(tick_hz)
    assert parameters["SCHED_LOOP_RATE"] == loop_hz
    assert parameters["SIM_RATE_HZ"] == tick_hz
    assert tick_hz >= 1.8 * loop_hz


def test_parameters_fit_the_vehicle(tmp_path):
    parameters = thrust_parameters(0.598, 1.0) | {"LOG_DISARMED": 1, "MOT_SPIN_ARM": 0.05}
    # d / (d + 2 SPIN_MIN) with d = SPIN_MAX - SPIN_MIN (`thrust_expo` with a factor of 1)
    assert parameters["MOT_THST_EXPO"] == pytest.approx(8 / 11, abs=1e-6)
    assert parameters["MOT_THST_HOVER"] == pytest.approx(
        hover_throttle(0.598, 1.0, spin_min=SPIN_MIN, spin_max=SPIN_MAX), abs=1e-6
    )
    text = write_defaults(tmp_path / "run" / "bench.parm", parameters).read_text()
    assert text.startswith(DEFAULTS_PATH.read_text())
    read = {}
    for line in text.splitlines():
        if line and not line.startswith("#"):
            name, number = line.split()
            read[name] = float(number)
    assert (read["MOT_SPIN_MIN"], read["MOT_SPIN_MAX"]) == (SPIN_MIN, SPIN_MAX)
    assert (read["LOG_DISARMED"], read["MOT_SPIN_ARM"]) == (1, 0.05)
    # Hover throttle is limited to ArduPilot's range.
    assert thrust_parameters(0.9, 1.0)["MOT_THST_HOVER"] == 0.6875
    with pytest.raises(LinkError, match="too slow"):
        loop_parameters(90)


def test_wrong_settings_are_named(tmp_path):
    build = FirmwareBuild(tmp_path / "arducopter", tmp_path, tmp_path / "log")
    with pytest.raises(PortNotFound, match="no such program"):
        ardupilot_sitl(build=build, home=(47.0, 8.0, 488.0, 0.0))
    with pytest.raises(LinkError, match="`home`"):
        ardupilot_sitl(build=build)
    for text in ("serial:1", "udp:", "udp:x", "tcp"):
        with pytest.raises(LinkError, match="udp:PORT, tcp:PORT or none"):
            ardupilot_sitl(mavlink=text)
    assert ardupilot_sitl(mavlink="none", instance=3)._inbox.port == 9032


def test_a_program_that_ends_at_once_is_reported_with_its_last_output(tmp_path):
    program = tmp_path / "arducopter"
    program.write_text("#!/bin/sh\necho PANIC: no such frame\nexit 3\n")
    program.chmod(0o755)
    build = FirmwareBuild(program, tmp_path / "run", tmp_path / "run" / "log")
    link = ardupilot_sitl(build=build, home=(47.0, 8.0, 488.0, 0.0), timeouts=LinkTimeouts(connect_s=20.0))
    with pytest.raises(LinkClosed, match=r"(?s)before its first.*exit status 3.*PANIC: no such frame") as caught:
        link.open()
    assert caught.value.cause == "crashed"
    assert (tmp_path / "run" / "bench.parm").is_file()
