"""ArduPilot fed by an External AHRS: a board on two serial ports, or the user's SITL on pseudo-terminals."""

from __future__ import annotations

from firmware_bridge.codecs.ardupilot_json import PwmRange
from firmware_bridge.links.ardupilot.eahrs_sitl import HeldPty, arducopter_on_ptys, sitl_parameters
from firmware_bridge.links.ardupilot.external_ahrs import ExternalAhrsLink
from firmware_bridge.links.ardupilot.vectornav_stream import InsErrors
from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.transports.serial import SerialTransport
from firmware_bridge.transports.transport import Transport
from hil.config import Bench
from hil.run.autopilots.ardupilot_sitl import frame_parameters
from hil.run.autopilots.surroundings import Surroundings, firmware_build, free_running_settings, serial_path
from signals.errors import PortNotFound
from signals.geodesy import LocalFrame
from sim.physics import multirotor


def make_link(bench: Bench, around: Surroundings) -> AutopilotLink:
    """Make the link, to `autopilot.binary` on pseudo-terminals or to the board on `autopilot.port`."""
    config, vehicle = bench.config, bench.vehicle
    autopilot = config.autopilot
    sensor: Transport
    mavlink: Transport
    start = None
    if autopilot.binary is not None:
        sensor, mavlink = near, far = HeldPty(), HeldPty()
        start = arducopter_on_ptys(
            firmware_build(bench, around),
            near,
            far,
            home=around.home,
            instance=autopilot.instance,
            parameters=sitl_parameters(
                hover_control=multirotor.hover_control(vehicle),
                thrust_model_factor=vehicle.rotor_constants.thrust_model_factor,
                tick_hz=config.tick_hz,
                more=frame_parameters(vehicle) | autopilot.params,
            ),
        )
    else:
        if autopilot.port is None:
            raise PortNotFound(
                "autopilot.port",
                "names no serial port for the External AHRS: --set autopilot.port=/dev/ttyUSB0 (at the board's SERIALn "
                "with protocol 36), and autopilot.mavlink_port for its MAVLink; or --set autopilot.binary=PATH of your "
                "own SITL build",
            )
        sensor = SerialTransport(serial_path(autopilot.port), baud=autopilot.baud, follow=True)
        mavlink = SerialTransport(serial_path(autopilot.mavlink_port), baud=autopilot.baud, follow=True)
    params = autopilot.params
    return ExternalAhrsLink(
        sensor,
        around.wrap(mavlink),  # declared link faults apply to MAVLink only
        geodetic=LocalFrame(bench.scene.site).geodetic_from_enu,
        errors=InsErrors(seed=config.noise_seed),
        pwm=PwmRange(round(params.get("MOT_PWM_MIN", 1000)), round(params.get("MOT_PWM_MAX", 2000))),
        baud=None if start is not None else autopilot.baud,
        start_process=start,
        **free_running_settings(bench, around),
    )
