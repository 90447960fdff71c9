"""Run tests of ArduPilot's `Tools/autotest/arducopter.py` with the bench as their simulator.

    copter_tests.py ARDUPILOT TEST...

The exit status is 0 if all tests pass. bench.yaml starts it.
"""

from __future__ import annotations

import sys
from pathlib import Path

from bench_suite import fly

if __name__ == "__main__":
    sys.exit(fly(Path(sys.argv[1]).resolve(), "arducopter", "AutoTestCopter", "arducopter", "X", sys.argv[2:]))
