"""Makes the links to autopilots: transport + capabilities + what to start. A new link is a new function here."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from firmware_bridge.codecs.mavlink_frame import FrameParser
from firmware_bridge.links.autopilot_link import AutopilotLink, LinkCaps
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.free_running import FreeRunningLink
from firmware_bridge.links.ground_channel import GroundChannel
from firmware_bridge.links.hitl_setup import HitlSetup
from firmware_bridge.links.lockstep import LockstepLink
from firmware_bridge.mock_pixhawk.faults import Died
from firmware_bridge.transports.loopback import LoopbackTransport, Peer
from firmware_bridge.transports.pty import PtyTransport
from firmware_bridge.transports.serial import DEFAULT_BAUD, SerialTransport
from firmware_bridge.transports.tcp import TcpServer
from firmware_bridge.transports.transport import Transport

MOCK_BOOT_SENSORS = 20
PX4_SITL_PORT = 4560  # where PX4 looks for its simulator; instances count up from it
PX4_GROUND_PORT = 18570  # where PX4 SITL listens for ground stations

# Puts something between a link and its wire: declared faults.
Wrap = Callable[[Transport], Transport]


def _plain(transport: Transport) -> Transport:
    return transport


def mock_command(port: str, *, boot_sensors: int, arguments: Sequence[str] = ()) -> list[str]:
    """Command line of the mocked flight controller on serial port `port`."""
    return [
        sys.executable,
        "-m",
        "firmware_bridge.mock_pixhawk",
        "--port",
        port,
        "--boot-sensors",
        str(boot_sensors),
        *arguments,
    ]


def _mock(transport: Transport, boot_sensors: int, wrap: Wrap, settings: dict[str, Any]) -> AutopilotLink:
    return LockstepLink(
        wrap(transport),
        LinkCaps("mock", lockstep=True, deterministic=True, boot_sensors=boot_sensors),
        **settings,
    )


def mock_over_pty(
    *,
    boot_sensors: int = MOCK_BOOT_SENSORS,
    arguments: Sequence[str] = (),
    stderr_path: Path | None = None,
    wrap: Wrap = _plain,
    **settings: Any,
) -> AutopilotLink:
    """The mock in its own process on a real serial device. Other settings as `LockstepLink`."""
    transport = PtyTransport()

    def start() -> ChildProcess:
        argv = mock_command(transport.far_path, boot_sensors=boot_sensors, arguments=arguments)
        return ChildProcess(argv, stderr_path=stderr_path)

    return _mock(transport, boot_sensors, wrap, {"start_process": start, **settings})


def mock_in_memory(
    *, peer: Peer, boot_sensors: int = MOCK_BOOT_SENSORS, wrap: Wrap = _plain, **settings: Any
) -> AutopilotLink:
    """The mock (`peer`) in this process: the same bytes without a kernel between."""
    return _mock(LoopbackTransport(peer, deaths=(Died,)), boot_sensors, wrap, settings)


def mock_over_serial(
    *,
    port: str,
    baud: int = DEFAULT_BAUD,
    boot_sensors: int = MOCK_BOOT_SENSORS,
    wrap: Wrap = _plain,
    **settings: Any,
) -> AutopilotLink:
    """A mock, or another lockstep autopilot of known boot, that somebody else started on serial port `port`."""
    return _mock(SerialTransport(port, baud=baud), boot_sensors, wrap, settings)


def px4_sitl(
    *,
    instance: int = 0,
    heartbeat_limit_s: float = 60.0,
    wrap: Wrap = _plain,
    **settings: Any,
) -> AutopilotLink:
    """PX4 SITL, which connects to us: started by `start_process`, or by somebody else.

    Its boot time is unknown and its threads run on wall-clock time, so a run is not repeatable bit by bit.
    """
    return LockstepLink(
        wrap(TcpServer(PX4_SITL_PORT + instance)),
        LinkCaps(
            "px4_sitl",
            lockstep=True,
            deterministic=False,
            boot_sensors=None,
            busy_processors=2,
        ),
        ground=GroundChannel(PX4_GROUND_PORT + instance),
        heartbeat_limit_s=heartbeat_limit_s,
        **settings,
    )


def hitl(
    *,
    kind: str,
    transport: Transport,
    motors: int,
    params: Mapping[str, float] | None = None,
    **settings: Any,
) -> AutopilotLink:
    """A PX4 board in HITL, real or mocked, over `transport`: checked for its set-up, `params` set before it flies.

    `settings`: those of `FreeRunningLink`.
    """

    def prepare(line: Transport, parser: FrameParser, sysid: int) -> None:
        setup = HitlSetup(line, parser, motors=motors, sysid=sysid)
        if params:
            setup.set(params)
        setup.require()

    return FreeRunningLink(
        transport,
        LinkCaps(kind, lockstep=False, deterministic=False, boot_sensors=0),
        prepare=prepare,
        **settings,
    )
