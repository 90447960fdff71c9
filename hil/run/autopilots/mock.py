"""The mock Pixhawk in lockstep: on a serial port, in this process, or on a pseudo-terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from firmware_bridge.links.autopilot_link import AutopilotLink, LinkCaps
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.px4.lockstep import LockstepLink
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.mock_pixhawk.faults import Died, parse_fault
from firmware_bridge.transports.loopback import LoopbackTransport
from firmware_bridge.transports.pty import PtyTransport
from firmware_bridge.transports.serial import SerialTransport
from firmware_bridge.transports.transport import Transport
from hil.config import Bench
from hil.run.autopilots.rotor_parameters import BASE_AIRFRAME, matching_airframe, mock_parameters, motor_functions
from hil.run.autopilots.surroundings import LOG_NAME, Surroundings, serial_path, timeouts

MOCK_BOOT_SENSORS = 20


def make_link(bench: Bench, around: Surroundings) -> AutopilotLink:
    """Make the link. With `autopilot.port` the user has started the mock there."""
    autopilot = bench.config.autopilot
    # The mock is started with this number, so null (unknown) means its default.
    boot_sensors = MOCK_BOOT_SENSORS if autopilot.boot_sensors is None else autopilot.boot_sensors
    start = None
    transport: Transport
    if autopilot.port is not None:
        transport = SerialTransport(serial_path(autopilot.port), baud=autopilot.baud)
    elif autopilot.transport == "loopback":
        airframe, params = airframe_and_params(bench)
        peer = MockPixhawk(
            airframe=airframe,
            boot_sensors=boot_sensors,
            params=params,
            sysid=_system_id(bench),
            faults=[parse_fault(text) for text in autopilot.faults.texts()],
        )
        transport = LoopbackTransport(peer, crashes=(Died,))
    else:
        transport, start = mock_on_a_pty(bench, around, boot_sensors)
    return LockstepLink(
        around.wrap(transport),
        LinkCaps("mock", lockstep=True, deterministic=True, boot_sensors=boot_sensors),
        start_process=start,
        timeouts=timeouts(bench),
    )


def mock_command(port: str, *, boot_sensors: int, arguments: Sequence[str] = ()) -> list[str]:
    """Return the command line of the mock Pixhawk on serial port `port`."""
    module = [sys.executable, "-P", "-m", "firmware_bridge.mock_pixhawk"]
    return [*module, "--port", port, "--boot-sensors", str(boot_sensors), *arguments]


def mock_on_a_pty(
    bench: Bench, around: Surroundings, boot_sensors: int, *more: str
) -> tuple[Transport, Callable[[], ChildProcess]]:
    """Return the near end of a pseudo-terminal, and a function that starts the mock on its far end."""
    pty = PtyTransport()
    airframe, params = airframe_and_params(bench)
    arguments = [*more, "--airframe", airframe]
    if (system_id := _system_id(bench)) is not None:
        arguments += ["--sysid", str(system_id)]
    for text in params:
        arguments += ["--param", text]
    for text in bench.config.autopilot.faults.texts():
        arguments += ["--fault", text]

    def start() -> ChildProcess:
        argv = mock_command(pty.far_path, boot_sensors=boot_sensors, arguments=arguments)
        return ChildProcess(argv, stderr_path=around.out / LOG_NAME)

    return pty, start


def airframe_and_params(bench: Bench) -> tuple[str, list[str]]:
    """Return the mock's airframe and NAME=VALUE parameters: those of the bench over those of the vehicle.

    Without `autopilot.airframe` the vehicle decides: an airframe with its rotors, else parameters from its geometry.
    """
    autopilot = bench.config.autopilot
    airframe = autopilot.airframe or matching_airframe(bench.vehicle)
    params = autopilot.params
    if airframe is None:
        rotors = mock_parameters(bench.vehicle)
        if autopilot.kind == "mock_hitl":
            rotors |= motor_functions(bench.vehicle, "HIL_ACT_FUNC")
        airframe, params = BASE_AIRFRAME, rotors | params
    return airframe, [f"{name}={value!r}" for name, value in params.items()]


def _system_id(bench: Bench) -> int | None:
    """Return the MAVLink system id of an instance above 0; None: the mock's parameter MAV_SYS_ID, by default 1."""
    return bench.config.autopilot.system_id if bench.config.autopilot.instance else None
