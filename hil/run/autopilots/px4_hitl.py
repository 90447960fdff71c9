"""PX4 in HITL on a board at a serial port, or the mock in its place on a pseudo-terminal."""

from __future__ import annotations

from firmware_bridge.links.autopilot_link import AutopilotLink, LinkCaps
from firmware_bridge.links.px4.free_running import FreeRunningLink
from firmware_bridge.transports.serial import SerialTransport
from firmware_bridge.transports.transport import Transport
from hil.config import Bench
from hil.run.autopilots.mock import mock_on_a_pty
from hil.run.autopilots.rotor_parameters import px4_parameters
from hil.run.autopilots.surroundings import Surroundings, free_running_settings, serial_path


def make_link(bench: Bench, around: Surroundings) -> AutopilotLink:
    """Make the link, to the board on `autopilot.port` or the only one on USB, or to the mock on a pseudo-terminal."""
    config = bench.config
    autopilot = config.autopilot
    start = None
    # A board has its own airframe; PX4's for HITL are quadrotors.
    rotors = {} if len(bench.vehicle.rotors) == 4 else px4_parameters(bench.vehicle, outputs="HIL_ACT_FUNC")
    transport: Transport
    if autopilot.kind == "mock_hitl" and autopilot.port is None:
        transport, start = mock_on_a_pty(bench, around, 0, "--hitl")
    else:
        transport = SerialTransport(serial_path(autopilot.port), baud=autopilot.baud, follow=True)
    return FreeRunningLink(
        around.wrap(transport),
        LinkCaps(autopilot.kind, lockstep=False, deterministic=False, boot_sensors=0),
        motors=len(bench.vehicle.rotors),
        params=None if autopilot.is_mock else rotors | autopilot.params,
        start_process=start,
        own_sender=not config.faults.links,
        **free_running_settings(bench, around),
    )
