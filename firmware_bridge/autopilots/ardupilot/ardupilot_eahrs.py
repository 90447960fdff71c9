"""ArduPilot fed by an External AHRS: a board on two serial ports, or the user's SITL on pseudo-terminals."""

from __future__ import annotations

from dataclasses import replace

from firmware_bridge.autopilots.ardupilot import plane
from firmware_bridge.autopilots.ardupilot.copter import PROGRAM, frame_misfits
from firmware_bridge.autopilots.ardupilot.firmware import ARDUPILOT
from firmware_bridge.autopilots.ardupilot.sensors import EXTERNAL_AHRS
from firmware_bridge.autopilots.ardupilot.vehicle_parameters import base_file, vehicle_parameters
from firmware_bridge.autopilots.installation import Installation, Surroundings
from firmware_bridge.autopilots.line import Line
from firmware_bridge.autopilots.profile import Profile
from firmware_bridge.codecs.ardupilot_json import PwmRange
from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.transports.transport import Transport
from signals.errors import PortNotFound

# A VectorNav has no airspeed: a plane flies by its speed over ground and the wind that it estimates.
_NO_AIRSPEED = {"ARSPD_TYPE": 0.0, "ARSPD_USE": 0.0}


def make_link(installation: Installation, around: Surroundings) -> AutopilotLink:
    """Make the link, to `autopilot.binary` on pseudo-terminals or to the board on `autopilot.port`."""
    from firmware_bridge.links.ardupilot.eahrs_sitl import HeldPty, arducopter_on_ptys, sitl_parameters
    from firmware_bridge.links.ardupilot.external_ahrs import ExternalAhrsLink  # loads multiprocessing
    from firmware_bridge.links.ardupilot.vectornav_stream import InsErrors

    settings, vehicle = installation.settings, installation.vehicle
    sensor: Transport
    mavlink: Transport
    start = None
    if settings.binary is not None:
        sensor, mavlink = near, far = HeldPty(), HeldPty()
        start = arducopter_on_ptys(
            around.build(settings),
            near,
            far,
            home=installation.home,
            instance=settings.instance,
            parameters=sitl_parameters(
                vehicle_parameters(vehicle), tick_hz=installation.tick_hz, more=_NO_AIRSPEED | settings.params
            ),
            base=base_file(vehicle),
        )
    else:
        if settings.port is None:
            raise PortNotFound(
                "autopilot.port",
                "names no serial port for the External AHRS: --set autopilot.port=/dev/ttyUSB0 (at the board's SERIALn "
                "with protocol 36), and autopilot.mavlink_port for its MAVLink; or --set autopilot.binary=PATH of your "
                "own SITL build",
            )
        from firmware_bridge.devices.serial_path import serial_path  # with the serial ports, loads USB
        from firmware_bridge.transports.serial import SerialTransport

        sensor = SerialTransport(serial_path(settings.port), baud=settings.baud, follow=True)
        mavlink = SerialTransport(serial_path(settings.mavlink_port), baud=settings.baud, follow=True)
    params = settings.params
    return ExternalAhrsLink(
        sensor,
        around.wrap(mavlink),  # declared link faults apply to MAVLink only
        geodetic=installation.geodetic,
        errors=InsErrors(seed=installation.noise_seed),
        pwm=PwmRange(
            round(params.get("MOT_PWM_MIN", 1000)), round(params.get("MOT_PWM_MAX", 2000)), installation.signed_controls
        ),
        baud=None if start is not None else settings.baud,
        start_process=start,
        **around.free_running(installation),
    )


PROFILE = Profile(
    firmware=ARDUPILOT,
    sensors=EXTERNAL_AHRS,
    line=Line(),
    make_link=make_link,
    lockstep=False,
    keys=frozenset({"binary", "arguments", "port", "mavlink_port"}),
    program=replace(PROGRAM, always=False),
    plane_program=replace(plane.PROGRAM, always=False),
    flies_planes=True,
    board_ports=("port", "mavlink_port"),
    usb_port="mavlink_port",  # its sensor data comes on a second port
    # A board tells its own frame.
    vehicle_misfits=lambda settings, vehicle: frame_misfits(vehicle) if settings.binary is not None else (),
)
