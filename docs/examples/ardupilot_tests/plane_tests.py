"""Run tests of ArduPilot's `Tools/autotest/arduplane.py` or `quadplane.py` with the bench as their simulator.

    plane_tests.py ARDUPILOT plane|quadplane TEST...

The exit status is 0 if all tests pass. plane.yaml and quadplane.yaml start it.
"""

from __future__ import annotations

import sys
from pathlib import Path

from bench_suite import fly

SUITES = {
    "plane": ("arduplane", "AutoTestPlane", "arduplane", "plane-elevrev"),
    "quadplane": ("quadplane", "AutoTestQuadPlane", "arduplane", "quadplane"),
}

if __name__ == "__main__":
    sys.exit(fly(Path(sys.argv[1]).resolve(), *SUITES[sys.argv[2]], sys.argv[3:]))
