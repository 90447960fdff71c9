"""The figures of `hil bench lockstep` are those of flights that passed."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hil.apps.bench_suite.link import lockstep
from signals.errors import HilError


def test_a_flight_that_failed_has_no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    run = {"error": None, "verdict": {"reasons": ["reached 2 of 6 waypoints"]}}

    def failed(bench: Any, out: Path, **_: Any) -> Any:
        return SimpleNamespace(status="FAIL", run=run)

    monkeypatch.setattr(lockstep, "run_bench", failed)
    with pytest.raises(HilError, match="reached 2 of 6 waypoints"):
        lockstep.measure(quick=True, status=lambda _: None)
