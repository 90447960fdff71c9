"""Facts of the connected firmware are at hand in a tick: asking for them loads nothing."""

from __future__ import annotations

import subprocess
import sys

ASKED = """
import sys
from firmware_bridge.autopilots.catalog import PROFILES
from firmware_bridge.ground_station.procedure import start_steps

kinds = [profile for profile in PROFILES.values() if profile.mavlink]
before = set(sys.modules)
for profile in kinds:
    start_steps(profile.firmware.mav_autopilot)
print(len(kinds), *sorted(set(sys.modules) - before))
"""


def test_the_steps_of_a_start_load_no_module() -> None:
    """The dialect takes 0.2 s to load: so long a tick spoils a flight in real time."""
    child = subprocess.run([sys.executable, "-P", "-c", ASKED], capture_output=True, text=True, check=True)
    count, *loaded = child.stdout.split()
    assert int(count) > 4
    assert loaded == []
