"""The worked example of docs/gym-training.md reaches its stated success rate."""

from __future__ import annotations

import csv
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "docs/examples/gym/train_hover.py"


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_hover_is_learned(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    command = [sys.executable, str(SCRIPT), "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    with (tmp_path / "curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert float(rows[0]["success"]) == 0.0
    assert float(rows[-1]["cpu_s"]) < 900.0  # of processor time, one core
    assert (tmp_path / "curve.png").stat().st_size > 5_000
    flown_again = subprocess.run([*command, "--fly"], capture_output=True, text=True, check=False)
    assert flown_again.stdout.splitlines()[-1] == done.stdout.splitlines()[-1]
