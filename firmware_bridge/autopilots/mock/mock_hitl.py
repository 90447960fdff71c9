"""The mock Pixhawk in HITL, free-running, on a serial port or a pseudo-terminal; its link is that of PX4 on a board."""

from __future__ import annotations

from dataclasses import replace

from firmware_bridge.autopilots.installation import Installation, Surroundings
from firmware_bridge.autopilots.mock import mock
from firmware_bridge.autopilots.mock.sensors import FAULTS_HITL
from firmware_bridge.autopilots.px4.px4_hitl import hitl_link, serial_line
from firmware_bridge.autopilots.px4.vehicle_parameters import HIL_OUTPUTS, vehicle_functions
from firmware_bridge.links.autopilot_link import AutopilotLink


def make_link(installation: Installation, around: Surroundings) -> AutopilotLink:
    """Make the link. With `autopilot.port` the user has started the mock there."""
    if installation.settings.port is not None:
        return hitl_link(installation, around, serial_line(installation.settings), params=None)
    rotors = vehicle_functions(installation.vehicle, HIL_OUTPUTS)
    transport, start = mock.mock_on_a_pty(installation, around, 0, "--hitl", rotors=rotors)
    return hitl_link(installation, around, transport, params=None, start=start)


PROFILE = replace(
    mock.PROFILE,
    make_link=make_link,
    lockstep=False,
    repeatable=False,
    own_faults=FAULTS_HITL,
    keys=mock.PROFILE.keys - {"transport"},
    expects_station=True,
    needs_estimator=True,
)
