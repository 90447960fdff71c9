"""Starting a user's own ArduCopter SITL: command line, parameters for the bench's vehicles, working folder."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from firmware_bridge.codecs.ardupilot_json import hover_throttle, thrust_expo
from firmware_bridge.links.ardupilot_json import ArduPilotJsonLink
from firmware_bridge.links.ardupilot_mavlink import MavlinkSide
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.transports.tcp import TcpClient
from firmware_bridge.transports.udp import UdpInbox, UdpTransport
from hil.signals.errors import LinkError, PortNotFound

SERVO_PORT = 9002  # + 10 * instance
TCP_PORT = 5760  # + 10 * instance
DEFAULTS_PATH = Path(__file__).resolve().parent / "ardupilot" / "copter_x.parm"
# As in copter_x.parm.
SPIN_MIN, SPIN_MAX = 0.15, 0.95

_UNUSED = (1, 2, 5, 6, 7, 8)  # serial ports; 3 and 4 are its GPS
_LOOP_HZ = (50, 400)
_GYRO_PER_LOOP = 1.8  # ArduCopter does not arm with fewer gyro samples a loop, and a tick gives one
_HOVER_RANGE = (0.125, 0.6875)  # what ArduPilot allows for MOT_THST_HOVER


def copter_parameters(
    *, hover_control: float, thrust_model_factor: float, tick_hz: float, more: Mapping[str, float] | None = None
) -> dict[str, float]:
    """The parameters that depend on vehicle and tick; `more` comes last and wins.

    SCHED_LOOP_RATE comes from the tick: every second tick, or more seldom where that is above 400 Hz. 800 Hz and
    1200 Hz give ArduCopter its usual 400, a tick of 400 Hz gives 200.
    """
    ticks = math.ceil(max(_GYRO_PER_LOOP, tick_hz / _LOOP_HZ[1]))
    if tick_hz / ticks < _LOOP_HZ[0]:
        raise LinkError(
            "ardupilot", f"a tick of {tick_hz:g} Hz is too slow: its main loop needs {_LOOP_HZ[0] * ticks} Hz or more"
        )
    spin = {"spin_min": SPIN_MIN, "spin_max": SPIN_MAX}
    hover = hover_throttle(hover_control, thrust_model_factor, **spin)
    parameters: dict[str, float] = {
        "MOT_THST_EXPO": round(thrust_expo(thrust_model_factor, **spin), 6),
        "MOT_THST_HOVER": round(min(max(hover, _HOVER_RANGE[0]), _HOVER_RANGE[1]), 6),
        "SIM_RATE_HZ": round(tick_hz),
        "SCHED_LOOP_RATE": round(tick_hz / ticks),
    }
    return parameters | dict(more or {})


def write_defaults(path: Path, parameters: Mapping[str, float]) -> Path:
    """A defaults file: copter_x.parm, then `parameters`, which win."""
    lines = [f"{name} {value!r}" for name, value in parameters.items()]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(DEFAULTS_PATH.read_text() + "\n# This vehicle, this bench, this run.\n" + "\n".join(lines) + "\n")
    return path


def home_text(binary: Path, home: tuple[float, float, float, float]) -> str:
    """`home` as --home wants it: latitude and longitude [deg], altitude [m MSL], heading [deg from north]."""
    latitude, longitude, altitude, heading = home
    if latitude == 0.0 and longitude == 0.0:
        raise LinkError(str(binary), "home 0, 0: ArduPilot takes that for 'none given' and starts in Canberra")
    return f"{latitude:.9f},{longitude:.9f},{altitude:.4f},{heading:.4f}"


def program_at(binary: Path) -> Path:
    """The user's build. PortNotFound if there is none."""
    program = binary.expanduser().resolve()
    if not program.is_file():
        raise PortNotFound(str(binary), "no such program; build it with `./waf configure --board sitl && ./waf copter`")
    return program


def arducopter_command(
    program: Path,
    *,
    model: str,
    home: tuple[float, float, float, float],
    defaults: Path,
    more: Sequence[str] = (),
    speedup: int = 1000,
    serials: Mapping[int, str],
    arguments: Sequence[str] = (),
) -> list[str]:
    """Command line of an ArduCopter that flies `model`; `serials` names what its SERIALn is."""
    command = [str(program), "-w"]  # no parameters of an earlier run; not repeated when it reboots itself
    command += ["--model", model, *more, "--speedup", str(speedup)]
    command += ["--home", home_text(program, home), "--defaults", str(defaults)]
    for number, where in sorted(serials.items()):
        command += [f"--serial{number}", where]
    return command + list(arguments)


def ardupilot_sitl(
    *,
    binary: Path | None = None,
    folder: Path | None = None,
    home: tuple[float, float, float, float] | None = None,
    parameters: Mapping[str, float] | None = None,
    arguments: Sequence[str] = (),
    instance: int = 0,
    mavlink: str = "udp:0",
    **settings: Any,
) -> ArduPilotJsonLink:
    """The link, and with `binary` the firmware too, started in `folder` (its logs stay there).

    Without `binary` somebody else starts it: it asks at port 9002 + 10 * instance, and `mavlink` says where its
    MAVLink is, 'udp:14550' (it sends there), 'tcp:5760' (it listens there) or 'none' (another program speaks with it,
    as ArduPilot's own autotest does). Other settings as `ArduPilotJsonLink`.
    """
    side = _mavlink_side(mavlink)
    if binary is None:
        inbox = UdpInbox(SERVO_PORT + 10 * instance)
        return ArduPilotJsonLink(inbox, side, **settings)
    if home is None or folder is None:
        raise LinkError(str(binary), "to be started it needs `home` and a `folder` to run in")
    program, where, place, inbox = program_at(binary), folder.resolve(), home, UdpInbox()

    def start() -> ChildProcess:
        port = None if side is None else side.udp_port
        command = arducopter_command(
            program,
            model="JSON:127.0.0.1",
            home=place,
            defaults=write_defaults(where / "bench.parm", parameters or {}),
            more=["--sim-port-out", str(inbox.port), "--instance", str(instance)],
            # Without a port of ours SITL has its own TCP ports, where it waits for a client before it starts.
            serials={} if port is None else {0: f"udpclient:127.0.0.1:{port}", **dict.fromkeys(_UNUSED, "none")},
            arguments=arguments,
        )
        return ChildProcess(command, stderr_path=where / "arducopter.log", cwd=where, log_output=True)

    return ArduPilotJsonLink(inbox, side, start_process=start, **settings)


def _mavlink_side(text: str) -> MavlinkSide | None:
    if text == "none":
        return None
    kind, _, port = text.partition(":")
    if kind not in ("udp", "tcp") or not port.isdigit():
        raise LinkError(text, "not an address of ArduPilot's MAVLink; write udp:PORT, tcp:PORT or none")
    return MavlinkSide(UdpTransport(int(port)) if kind == "udp" else TcpClient(int(port), connect_limit_s=1.0))
