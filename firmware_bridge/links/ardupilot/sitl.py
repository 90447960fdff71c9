"""Starts a user's own ArduCopter SITL: command line, parameters for the bench's vehicles, working folder."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from firmware_bridge.codecs.ardupilot_json import hover_throttle, thrust_expo
from firmware_bridge.links.ardupilot.home_check import Home, home_text
from firmware_bridge.links.ardupilot.json_link import ArduPilotJsonLink
from firmware_bridge.links.ardupilot.mavlink_channel import MavlinkChannel
from firmware_bridge.links.child_process import ChildProcess, FirmwareBuild
from firmware_bridge.transports.tcp import TcpClient
from firmware_bridge.transports.udp import UdpInbox, UdpTransport
from signals.errors import LinkError, PortNotFound

SERVO_PORT = 9002  # + 10 * instance
TCP_PORT = 5760  # + 10 * instance
# Any free port for RC input: on 5501 + 10 * instance, sticks meant for another SITL would steer this one.
OWN_RC = ("--rc-in-port", "0")
DEFAULTS_PATH = Path(__file__).with_name("copter_x.parm")
PLANE_DEFAULTS_PATH = Path(__file__).with_name("plane.parm")
# As in copter_x.parm.
SPIN_MIN, SPIN_MAX = 0.15, 0.95

_UNUSED = (1, 2, 5, 6, 7, 8)  # serial ports; 3 and 4 are its GPS
_LOOP_HZ = (50, 400)
_GYRO_PER_LOOP = 1.8  # ArduCopter does not arm with fewer gyro samples a loop, and a tick gives one
_HOVER_RANGE = (0.125, 0.6875)  # what ArduPilot allows for MOT_THST_HOVER


def thrust_parameters(hover_control: float, thrust_model_factor: float) -> dict[str, float]:
    """Return the thrust curve of the rotors."""
    spin = {"spin_min": SPIN_MIN, "spin_max": SPIN_MAX}
    hover = hover_throttle(hover_control, thrust_model_factor, **spin)
    return {
        "MOT_THST_EXPO": round(thrust_expo(thrust_model_factor, **spin), 6),
        "MOT_THST_HOVER": round(min(max(hover, _HOVER_RANGE[0]), _HOVER_RANGE[1]), 6),
    }


def loop_parameters(tick_hz: float) -> dict[str, float]:
    """Return the parameters that depend on the tick. LinkError if it is too slow.

    SCHED_LOOP_RATE: every second tick, or more seldom where that is above 400 Hz. 800 Hz and 1200 Hz give ArduCopter
    its usual 400, a tick of 400 Hz gives 200.
    """
    ticks = math.ceil(max(_GYRO_PER_LOOP, tick_hz / _LOOP_HZ[1]))
    if tick_hz / ticks < _LOOP_HZ[0]:
        raise LinkError(
            "ardupilot", f"a tick of {tick_hz:g} Hz is too slow: set tick_hz to {_LOOP_HZ[0] * ticks} or more"
        )
    return {"SIM_RATE_HZ": round(tick_hz), "SCHED_LOOP_RATE": round(tick_hz / ticks)}


def write_defaults(path: Path, parameters: Mapping[str, float], base: Path = DEFAULTS_PATH) -> Path:
    """Write a defaults file: `base`, then `parameters`, which override it. Return its path."""
    lines = [f"{name} {value!r}" for name, value in parameters.items()]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(base.read_text() + "\n# This vehicle, this bench, this run.\n" + "\n".join(lines) + "\n")
    return path


def checked_home(binary: str | Path, home: Home) -> str:
    """Format `home` for --home. LinkError for a place that ArduPilot takes as not given."""
    if home[0] == 0.0 and home[1] == 0.0:
        raise LinkError(
            str(binary), "home 0, 0: ArduPilot takes that as not given and starts in Canberra; move the scene's site"
        )
    return home_text(home)


def program_at(binary: Path) -> Path:
    """Return the path of the user's build. PortNotFound if there is none."""
    program = binary.expanduser().resolve()
    if not program.is_file():
        raise PortNotFound(str(binary), "no such program; build it with `./waf configure --board sitl && ./waf copter`")
    return program


def arducopter_command(
    program: str | Path,
    *,
    model: str,
    home: Home,
    defaults: Path,
    instance: int = 0,
    speedup: int = 1000,
    serials: Mapping[int, str],
    arguments: Sequence[str] = (),
) -> list[str]:
    """Return the command line of an ArduCopter that flies `model`; `serials` gives the address of each SERIALn.

    An instance above 0 has the MAVLink system id instance + 1: a parameter whose name depends on the version.
    """
    command = [str(program), "-w"]  # no parameters of an earlier run; not repeated when it reboots itself
    command += ["--model", model, "--speedup", str(speedup)]
    if instance:
        command += ["--instance", str(instance), "--sysid", str(instance + 1)]
    command += ["--home", checked_home(program, home), "--defaults", str(defaults)]
    for number, where in sorted(serials.items()):
        command += [f"--serial{number}", where]
    return command + list(arguments)


def serials_for(mavlink: str) -> dict[int, str]:
    """Return the serial ports of a SITL whose MAVLink is at `mavlink`: its own TCP ports unless it is udp:PORT."""
    kind, _, port = mavlink.partition(":")
    if kind != "udp":
        return {}  # it listens on its own TCP ports, and waits for a client before it starts
    return {0: f"udpclient:127.0.0.1:{port}", **dict.fromkeys(_UNUSED, "none")}


def hand_start_command(
    program: str | Path,
    *,
    home: Home,
    defaults: Path,
    instance: int,
    mavlink: str,
    arguments: Sequence[str] = (),
) -> list[str]:
    """Return the command line with which the user starts SITL for a bench that waits for it."""
    return arducopter_command(
        program,
        model="JSON:127.0.0.1",
        home=home,
        defaults=defaults,
        instance=instance,
        serials=serials_for(mavlink),
        arguments=arguments,
    )


def ardupilot_sitl(
    *,
    build: FirmwareBuild | None = None,
    home: Home | None = None,
    parameters: Mapping[str, float] | None = None,
    base: Path = DEFAULTS_PATH,
    instance: int = 0,
    mavlink: str = "udp:0",
    **settings: Any,
) -> ArduPilotJsonLink:
    """Return the link to SITL, which the link starts at `home` if there is a `build` of it.

    `parameters` are written over those of the file `base`. Without a `build` the user starts SITL: it sends its servo
    packets to port 9002 + 10 * instance, and `mavlink` says where its MAVLink is, 'udp:14550' (it sends there),
    'tcp:5760' (it listens there) or 'none' (another program speaks with it, as ArduPilot's own autotest does). Its home
    is compared with `home` before take-off. Other settings as `ArduPilotJsonLink`.
    """
    channel = _mavlink_channel(mavlink)
    if build is None:
        inbox = UdpInbox(SERVO_PORT + 10 * instance)
        link = ArduPilotJsonLink(inbox, channel, **settings)
        if home is not None:
            link.expect_home(home)
        return link
    if home is None:
        raise LinkError(str(build.binary), "cannot be started without a place for the vehicle: give `home`")
    program, where, place, inbox = program_at(build.binary), build.folder.resolve(), home, UdpInbox()

    def start() -> ChildProcess:
        port = None if channel is None else channel.udp_port
        command = arducopter_command(
            program,
            model="JSON:127.0.0.1",
            home=place,
            defaults=write_defaults(where / "bench.parm", parameters or {}, base),
            instance=instance,
            serials={} if port is None else serials_for(f"udp:{port}"),
            arguments=["--sim-port-out", str(inbox.port), *OWN_RC, *build.arguments],
        )
        return ChildProcess(command, stderr_path=build.log.resolve(), cwd=where, env=build.env, log_output=True)

    return ArduPilotJsonLink(inbox, channel, start_process=start, **settings)


def _mavlink_channel(text: str) -> MavlinkChannel | None:
    if text == "none":
        return None
    kind, _, port = text.partition(":")
    if kind not in ("udp", "tcp") or not port.isdigit():
        raise LinkError(text, "not an address of ArduPilot's MAVLink; write udp:PORT, tcp:PORT or none")
    return MavlinkChannel(UdpTransport(int(port)) if kind == "udp" else TcpClient(int(port), connect_limit_s=1.0))
