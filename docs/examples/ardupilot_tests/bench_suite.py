"""Runs tests of ArduPilot's `Tools/autotest` with the bench as their simulator.

The part `test_suite` of a bench starts the script that uses this, and sets HIL_MODEL and HIL_DEFAULTS.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from pathlib import Path
from typing import Any


def fly(root: Path, module: str, suite_name: str, program: str, frame: str, names: list[str]) -> int:
    """Run these tests of a suite; return the exit status, 0 if all pass.

    `root`: ArduPilot's folder. `program`: the name of its build. `frame`: whose default parameters the tests take.
    """
    sys.path.insert(0, str(root / "Tools" / "autotest"))
    os.chdir(root)
    of_ardupilot: type = getattr(import_module(module), suite_name)

    class Suite(of_ardupilot):  # type: ignore[misc]
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
    suite = Suite(str(root / "build/sitl/bin" / program), frame=frame, logs_dir=str(logs))
    known = {getattr(test, "name", getattr(test, "__name__", "")): test for test in suite.tests()}
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        sys.stderr.write(f"no test of {suite_name}: {', '.join(unknown) or 'none was named'}\n")
        return 2
    passed = suite.autotest(tests=[known[name] for name in names], allow_skips=False)
    return 0 if passed else 1
