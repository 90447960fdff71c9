"""The profiles of all autopilots, by the value of `autopilot.kind` in a bench file."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_bridge.autopilots.ardupilot import sensors as ardupilot
from firmware_bridge.autopilots.intake import Profile
from firmware_bridge.autopilots.mock import sensors as mock
from firmware_bridge.autopilots.px4 import sensors as px4

PROFILES: Mapping[str, Profile] = {
    "mock": Profile(mock.SENSORS),
    "mock_hitl": Profile(mock.SENSORS),
    "px4_sitl": Profile(px4.SENSORS),
    "px4_hitl": Profile(px4.SENSORS),
    "ardupilot_sitl": Profile(ardupilot.SITL, link_faults=False),  # of its link only MAVLink has frames
    "ardupilot_eahrs": Profile(ardupilot.EXTERNAL_AHRS),
}
