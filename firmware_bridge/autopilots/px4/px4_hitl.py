"""PX4 in HITL on a board at a serial port."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from firmware_bridge.autopilots.installation import Installation, Multirotor, Surroundings
from firmware_bridge.autopilots.profile import Misfit, Profile
from firmware_bridge.autopilots.px4.firmware import PX4
from firmware_bridge.autopilots.px4.sensors import SENSORS
from firmware_bridge.autopilots.px4.vehicle_parameters import HIL_OUTPUTS, command_count, vehicle_parameters
from firmware_bridge.autopilots.settings import AutopilotSettings
from firmware_bridge.links.autopilot_link import AutopilotLink, LinkCaps
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.transports.transport import Transport


def make_link(installation: Installation, around: Surroundings) -> AutopilotLink:
    """Make the link, to the board on `autopilot.port` or the only one on USB."""
    settings, vehicle = installation.settings, installation.vehicle
    # A board has its own airframe; PX4's for HITL are quadrotors.
    boards_own = isinstance(vehicle, Multirotor) and len(vehicle.rotors) == 4
    given = {} if boards_own else vehicle_parameters(vehicle, HIL_OUTPUTS)
    return hitl_link(installation, around, serial_line(settings), params=given | settings.params)


def serial_line(settings: AutopilotSettings) -> Transport:
    """Return the line to the board on `autopilot.port`, or to the only one on USB. PortNotFound if there is none."""
    from firmware_bridge.devices.serial_path import serial_path  # with the serial port, loads USB
    from firmware_bridge.transports.serial import SerialTransport

    return SerialTransport(serial_path(settings.port), baud=settings.baud, follow=True)


def hitl_link(
    installation: Installation,
    around: Surroundings,
    transport: Transport,
    *,
    params: Mapping[str, float] | None,
    start: Callable[[], ChildProcess] | None = None,
) -> AutopilotLink:
    """Return the link to PX4 in HITL, or to what behaves as it does, on a serial line."""
    from firmware_bridge.links.px4.free_running import FreeRunningLink  # loads multiprocessing

    return FreeRunningLink(
        around.wrap(transport),
        LinkCaps(installation.settings.kind, lockstep=False, deterministic=False, boot_sensors=0, air_temperature=True),
        motors=command_count(installation.vehicle),
        params=params,
        start_process=start,
        own_sender=not installation.link_faults,
        **around.free_running(installation),
    )


def misfits(settings: AutopilotSettings) -> Sequence[Misfit]:
    """Report an airframe that is not a number: a board tells no more of it."""
    if settings.airframe is None or settings.airframe.isdigit():
        return ()
    message = f"must be a number, not {settings.airframe!r}: it is compared with the board's SYS_AUTOSTART"
    return (Misfit(("autopilot", "airframe"), message, "choose the airframe in the ground station"),)


PROFILE = Profile(
    firmware=PX4,
    sensors=SENSORS,
    make_link=make_link,
    lockstep=False,
    keys=frozenset({"port", "airframe"}),
    board_ports=("port",),
    usb_port="port",
    misfits=misfits,
    heading_wait="MIS_YAW_TMT",
    needs_estimator=True,
    flies_planes=True,
)
