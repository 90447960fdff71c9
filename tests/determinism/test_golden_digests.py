"""Every flight of tests/golden/digests.yaml gives the digest that stands there.

The default flight is compared in tests/e2e/test_rectangle.py, which flies it anyway.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.golden.digests import FLIGHTS
from tests.worlds.bench_process import hil


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in FLIGHTS if name != "default"])
def test_digest(name: str, tmp_path: Path) -> None:
    flight = FLIGHTS[name]
    done = hil("run", *flight["arguments"], "--set", "record.report=false", "--out", str(tmp_path / "out"), timeout=600)
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    assert run["status"] == flight["verdict"], done.stdout + done.stderr
    assert run["digest"] == flight["digest"]


def test_a_digest_has_a_reason() -> None:
    assert all(flight["changed"] and len(flight["digest"]) == 64 for flight in FLIGHTS.values())
