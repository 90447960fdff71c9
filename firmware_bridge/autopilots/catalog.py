"""The profiles of all autopilots, by the value of `autopilot.kind` in a bench file."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_bridge.autopilots.ardupilot import sensors as ardupilot
from firmware_bridge.autopilots.ardupilot.firmware import ARDUPILOT
from firmware_bridge.autopilots.intake import HIL_LINE, Line, Profile
from firmware_bridge.autopilots.mock import sensors as mock
from firmware_bridge.autopilots.mock.firmware import MOCK
from firmware_bridge.autopilots.px4 import sensors as px4
from firmware_bridge.autopilots.px4.firmware import PX4

PROFILES: Mapping[str, Profile] = {
    "mock": Profile(MOCK, mock.SENSORS, own_faults=mock.FAULTS),
    "mock_hitl": Profile(MOCK, mock.SENSORS, own_faults=mock.FAULTS_HITL),
    "px4_sitl": Profile(PX4, px4.SENSORS, HIL_LINE),
    "px4_hitl": Profile(PX4, px4.SENSORS),
    "ardupilot_sitl": Profile(ARDUPILOT, ardupilot.SITL, line=None),  # of its link only MAVLink has frames
    "ardupilot_eahrs": Profile(ARDUPILOT, ardupilot.EXTERNAL_AHRS, Line()),
}
