"""Run tests of ArduPilot's `Tools/autotest/arducopter.py` with the bench as their simulator.

    copter_tests.py ARDUPILOT TEST...

The part `test_suite` of a bench starts it (bench.yaml) and sets HIL_MODEL and HIL_DEFAULTS. The exit status is 0 if all
tests pass.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any


def main(root: Path, names: list[str]) -> int:
    """Return the exit status of these tests."""
    sys.path.insert(0, str(root / "Tools" / "autotest"))
    os.chdir(root)
    import arducopter

    class Copter(arducopter.AutoTestCopter):  # type: ignore[misc]
        """The tests, whose SITL is started for the bench and with the parameters of its vehicle."""

        def start_SITL(self, **options: Any) -> None:
            defaults = options.get("defaults_filepath") or self.defaults_filepath() or []
            defaults = [defaults] if isinstance(defaults, str) else list(defaults)
            options |= {
                "model": os.environ["HIL_MODEL"],
                "defaults_filepath": [*defaults, os.environ["HIL_DEFAULTS"]],
            }
            super().start_SITL(**options)

    logs = Path(os.environ.setdefault("BUILDLOGS", str(root.parent / "buildlogs")))
    logs.mkdir(parents=True, exist_ok=True)
    suite = Copter(str(root / "build/sitl/bin/arducopter"), frame="X", logs_dir=str(logs))
    known = {getattr(test, "name", getattr(test, "__name__", "")): test for test in suite.tests()}
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        sys.stderr.write(f"no test of ArduCopter: {', '.join(unknown) or 'none was named'}\n")
        return 2
    passed = suite.autotest(tests=[known[name] for name in names], allow_skips=False)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), sys.argv[2:]))
