"""`make check` runs the tests near a change, and no others."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "tools"))

from check import imports_of, near_tests

TREE = {
    "sim/sensors/gps.py": "from signals.noise import NoiseStream",
    "signals/noise.py": "",
    "sim/sensors/imu.py": "",
    "hil/run/use.py": "def f():\n    from sim.sensors import gps",
    "hil/far.py": "import hil.run.use",
    "tests/unit/sim/sensors/test_imu.py": "import sim.sensors.imu",
    "tests/unit/hil/test_use.py": "from hil.run import use",
    "tests/unit/hil/test_far.py": "from hil import far",
    "tests/unit/hil/test_process.py": "import subprocess\nimport sim.sensors.gps",
    "tests/e2e/test_gps.py": "import sim.sensors.gps",
}
IMPORTS = {Path(path): imports_of(source) for path, source in TREE.items()}


def near(*changed: str) -> set[str]:
    return {path.name for path in near_tests(map(Path, changed), IMPORTS)}


def test_the_room_and_what_imports_it() -> None:
    assert near("sim/sensors/gps.py") == {"test_imu.py", "test_use.py"}


def test_a_changed_test_is_near() -> None:
    assert near("tests/unit/hil/test_far.py") == {"test_far.py"}


def test_other_files_have_no_tests() -> None:
    assert near("docs/start.md", "sim/deleted.py") == set()
