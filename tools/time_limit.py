"""A plugin of pytest for `make check`: no test begins after `HIL_CHECK_END_S` (seconds since 1970); the files left out
are printed.
"""

from __future__ import annotations

import os
import time

import pytest

_END_S = float(os.environ.get("HIL_CHECK_END_S", "inf"))
_LEFT_OUT = "left to `make test`: the time of `make check` is over"


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Skip what would begin too late, before its fixtures are made."""
    if time.time() > _END_S:
        pytest.skip(_LEFT_OUT)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name the files of which tests were left out."""
    skipped = [report for report in terminalreporter.stats.get("skipped", []) if _LEFT_OUT in str(report.longrepr)]
    if skipped:
        files = sorted({report.nodeid.split("::")[0] for report in skipped})
        terminalreporter.write_line(f"{len(skipped)} tests {_LEFT_OUT}; they are of {', '.join(files)}")
