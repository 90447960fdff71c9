"""From a rig's `autopilot` section to the link that speaks to it. What is started, and with what, is decided here."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.codecs.ardupilot_json import PwmRange
from firmware_bridge.devices.inventory import find_devices
from firmware_bridge.ground_station.projections import GeodeticFromW, Place, ardupilot_sitl_world
from firmware_bridge.links.ardupilot_eahrs import HeldPty, arducopter_on_ptys, sitl_parameters
from firmware_bridge.links.ardupilot_sitl import TCP_PORT, ardupilot_sitl, copter_parameters
from firmware_bridge.links.autopilot_link import AutopilotLink, LinkCaps
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.external_ahrs import ExternalAhrsLink
from firmware_bridge.links.free_running import FreeRunningLink
from firmware_bridge.links.lockstep import LockstepLink
from firmware_bridge.links.px4_process import px4_sitl_link, px4_sitl_process
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.mock_pixhawk.faults import Died, parse_fault
from firmware_bridge.transports.loopback import LoopbackTransport
from firmware_bridge.transports.pty import PtyTransport
from firmware_bridge.transports.serial import SerialTransport
from firmware_bridge.transports.transport import Transport
from hil.config import Bench, BenchConfig
from hil.signals.errors import PortNotFound
from hil.signals.geodesy import LocalFrame
from hil.signals.rotation import yaw_of
from sim.scene.scene import Site

LOG_NAME = "autopilot.log"
State = NDArray[np.float64]  # of the vehicle: p_W [m], q_WB (w, x, y, z), and what else there is
MOCK_BOOT_SENSORS = 20
WORK_FOLDER = "autopilot"  # of firmware that the bench starts: parameters, missions, its own logs


@dataclass(frozen=True)
class Surroundings:
    """What a link is told of the run that it is part of."""

    out: Path  # what it starts logs here
    wrap: Callable[[Transport], Transport]  # goes round the wire: declared faults
    on_event: Callable[[str, str], None]  # (kind, text), at the simulated time of now
    # Where the vehicle starts: latitude, longitude [deg], altitude above mean sea level [m], heading [deg from north].
    home: tuple[float, float, float, float]


def make_autopilot(bench: Bench, around: Surroundings) -> AutopilotLink:
    """The link of this bench's autopilot, not yet open. LinkError where something it needs is not there."""
    return _MAKERS[bench.config.autopilot.kind](bench, around)


def _mock(bench: Bench, around: Surroundings) -> AutopilotLink:
    """The mock in lockstep: on a serial port, where somebody else started it, in this process, or on a pty."""
    autopilot = bench.config.autopilot
    # Unknown (null) cannot be for the mock: it is told the number.
    boot_sensors = MOCK_BOOT_SENSORS if autopilot.boot_sensors is None else autopilot.boot_sensors
    start = None
    transport: Transport
    if autopilot.port is not None:
        transport = SerialTransport(autopilot.port, baud=autopilot.baud)
    elif autopilot.transport == "loopback":
        peer = MockPixhawk(
            airframe=autopilot.airframe,
            boot_sensors=boot_sensors,
            params=_param_texts(bench.config),
            faults=[parse_fault(text) for text in autopilot.faults.texts()],
        )
        transport = LoopbackTransport(peer, deaths=(Died,))
    else:
        transport, start = _mock_on_a_pty(bench.config, around, boot_sensors)
    return LockstepLink(
        around.wrap(transport),
        LinkCaps("mock", lockstep=True, deterministic=True, boot_sensors=boot_sensors),
        start_process=start,
        reply_limit_s=autopilot.reply_timeout_s,
        heartbeat_limit_s=autopilot.connect_timeout_s,
    )


def mock_command(port: str, *, boot_sensors: int, arguments: Sequence[str] = ()) -> list[str]:
    """Command line of the mocked flight controller on serial port `port`."""
    module = [sys.executable, "-m", "firmware_bridge.mock_pixhawk"]
    return [*module, "--port", port, "--boot-sensors", str(boot_sensors), *arguments]


def _mock_on_a_pty(
    config: BenchConfig, around: Surroundings, boot_sensors: int, *more: str
) -> tuple[Transport, Callable[[], ChildProcess]]:
    """The near end of a pseudo-terminal, and what starts the mock on its far end."""
    pty = PtyTransport()
    arguments = [*more, "--airframe", config.autopilot.airframe]
    for text in _param_texts(config):
        arguments += ["--param", text]
    for text in config.autopilot.faults.texts():
        arguments += ["--fault", text]

    def start() -> ChildProcess:
        argv = mock_command(pty.far_path, boot_sensors=boot_sensors, arguments=arguments)
        return ChildProcess(argv, stderr_path=around.out / LOG_NAME)

    return pty, start


def _param_texts(config: BenchConfig) -> list[str]:
    return [f"{name}={value!r}" for name, value in config.autopilot.params.items()]


def _hitl(bench: Bench, around: Surroundings) -> AutopilotLink:
    """PX4 in HITL: the mock on a pty, or a board on a serial port."""
    config = bench.config
    autopilot = config.autopilot
    start = None
    transport: Transport
    if autopilot.kind == "mock_hitl" and autopilot.port is None:
        transport, start = _mock_on_a_pty(config, around, 0, "--hitl")
    else:
        transport = SerialTransport(autopilot.port or _only_board(), baud=autopilot.baud, follow=True)
    return FreeRunningLink(
        around.wrap(transport),
        LinkCaps(autopilot.kind, lockstep=False, deterministic=False, boot_sensors=0),
        motors=len(bench.vehicle.rotors),
        params=None if autopilot.is_mock else autopilot.params,
        start_process=start,
        own_sender=not config.faults.links,
        **_by_the_clock(bench, around),
    )


def _by_the_clock(bench: Bench, around: Surroundings) -> dict[str, Any]:
    """The settings of links to autopilots that wait for nobody."""
    autopilot = bench.config.autopilot
    return {
        "period_ns": bench.config.tick_ns,
        "on_event": around.on_event,
        "silence_limit_s": autopilot.reply_timeout_s,
        "heartbeat_limit_s": autopilot.connect_timeout_s,
        "reconnect_s": autopilot.reconnect_s,
    }


def _only_board() -> str:
    """Serial port of the one autopilot on USB."""
    boards = find_devices().autopilots
    ports = [board.port for board in boards if board.port]
    if len(ports) == 1:
        return str(ports[0])
    found = f"{len(ports)} are there ({', '.join(map(str, ports))})" if ports else "none is there"
    raise PortNotFound(
        "autopilot.port", f"names no serial port, and of autopilots on USB {found}; see `hil devices`, then "
        "--set autopilot.port=/dev/ttyACM0"
    )  # fmt: skip


def _px4_sitl(bench: Bench, around: Surroundings) -> AutopilotLink:
    config, out = bench.config, around.out
    autopilot = config.autopilot
    process = None
    if autopilot.start:
        process = px4_sitl_process(
            Path(str(autopilot.binary)),
            folder=out / WORK_FOLDER,
            log=out / LOG_NAME,
            airframe=autopilot.airframe,
            tick_hz=config.tick_hz,
            params=autopilot.params,
            env=autopilot.env,
            arguments=autopilot.arguments,
            instance=autopilot.instance,
        )
    return px4_sitl_link(
        autopilot.instance,
        start_process=None if process is None else lambda: process,
        reply_limit_s=autopilot.reply_timeout_s,
        heartbeat_limit_s=autopilot.connect_timeout_s,
        wrap=around.wrap,
    )


def _windy(bench: Bench) -> bool:
    """Whether there can be any wind: its direction costs time to tell."""
    return bench.config.wind is not None or bench.scene.wind_W_mps != (0.0, 0.0, 0.0)


def _ardupilot_sitl(bench: Bench, around: Surroundings) -> AutopilotLink:
    config = bench.config
    autopilot, vehicle = config.autopilot, bench.vehicle
    settings: dict[str, Any] = {
        "instance": autopilot.instance,
        "on_restart": autopilot.on_restart,
        "gravity_mps2": bench.scene.gravity_mps2,
        "tells_wind": _windy(bench),
        "on_event": around.on_event,
        "reply_limit_s": autopilot.reply_timeout_s if autopilot.on_restart == "error" else math.inf,
        "boot_limit_s": autopilot.connect_timeout_s,
    }
    if not autopilot.start:
        return ardupilot_sitl(mavlink=autopilot.mavlink_port or f"tcp:{TCP_PORT + 10 * autopilot.instance}", **settings)
    return ardupilot_sitl(
        binary=Path(str(autopilot.binary)),
        folder=around.out / WORK_FOLDER,
        home=around.home,
        parameters=copter_parameters(
            hover_control=vehicle.hover_control,
            thrust_model_factor=vehicle.rotor_constants.thrust_model_factor,
            tick_hz=config.tick_hz,
            more=autopilot.params,
        ),
        arguments=autopilot.arguments,
        **settings,
    )


def home_of(site: Site, state: State) -> tuple[float, float, float, float]:
    """Latitude and longitude [deg], altitude [m MSL], heading [deg from north] of a vehicle in this state."""
    x, y, z, *q_WB = state[:7].tolist()
    yaw_deg = math.degrees(yaw_of(q_WB))
    return *LocalFrame(site).geodetic_from_enu((x, y, z)), (90.0 - yaw_deg) % 360.0


def geodetic_from_W(autopilot_kind: str, site: Site, state: State) -> GeodeticFromW:
    """Where on Earth the autopilot has a point of the world, once it has been flown there from this state."""
    if autopilot_kind != "ardupilot_sitl":
        return LocalFrame(site).geodetic_from_enu
    x, y, z = state[:3].tolist()
    return ardupilot_sitl_world(Place(*home_of(site, state)[:3]), (x, y, z))


def unknown_parameters(bench: Bench, out: Path) -> list[str]:
    """Names in `autopilot.params` of which PX4's log says that it does not have them."""
    autopilot = bench.config.autopilot
    log = out / LOG_NAME
    if autopilot.kind != "px4_sitl" or not autopilot.params or not log.is_file():
        return []
    text = log.read_text(errors="replace")
    return [name for name in autopilot.params if f"Parameter {name} not found" in text]


def _ardupilot_eahrs(bench: Bench, around: Surroundings) -> AutopilotLink:
    """ArduPilot fed by an External AHRS: a board on two serial ports, or the user's SITL on two pseudo-terminals."""
    config, vehicle = bench.config, bench.vehicle
    autopilot = config.autopilot
    sensor: Transport
    mavlink: Transport
    start = None
    if autopilot.binary is not None:
        sensor, mavlink = near, far = HeldPty(), HeldPty()
        start = arducopter_on_ptys(
            Path(autopilot.binary),
            near,
            far,
            folder=around.out / WORK_FOLDER,
            log=around.out / LOG_NAME,
            home=around.home,
            parameters=sitl_parameters(
                hover_control=vehicle.hover_control,
                thrust_model_factor=vehicle.rotor_constants.thrust_model_factor,
                tick_hz=config.tick_hz,
                more=autopilot.params,
            ),
            arguments=autopilot.arguments,
            env=autopilot.env,
        )
    else:
        if autopilot.port is None:
            raise PortNotFound(
                "autopilot.port",
                "names no serial port for the External AHRS: --set autopilot.port=/dev/ttyUSB0 (at the board's SERIALn "
                "with protocol 36), and autopilot.mavlink_port for its MAVLink; or --set autopilot.binary=PATH of your "
                "own SITL build",
            )
        sensor = SerialTransport(autopilot.port, baud=autopilot.baud, follow=True)
        mavlink = SerialTransport(autopilot.mavlink_port or _only_board(), baud=autopilot.baud, follow=True)
    params = autopilot.params
    return ExternalAhrsLink(
        sensor,
        around.wrap(mavlink),  # declared faults know frames of MAVLink
        geodetic=LocalFrame(bench.scene.site).geodetic_from_enu,
        seed=config.seed,
        pwm=PwmRange(round(params.get("MOT_PWM_MIN", 1000)), round(params.get("MOT_PWM_MAX", 2000))),
        baud=None if start is not None else autopilot.baud,
        start_process=start,
        **_by_the_clock(bench, around),
    )


_MAKERS: dict[str, Callable[[Bench, Surroundings], AutopilotLink]] = {
    "mock": _mock,
    "mock_hitl": _hitl,
    "px4_sitl": _px4_sitl,
    "px4_hitl": _hitl,
    "ardupilot_sitl": _ardupilot_sitl,
    "ardupilot_eahrs": _ardupilot_eahrs,
}
