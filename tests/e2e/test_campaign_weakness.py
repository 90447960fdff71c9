"""The planted weakness of rigs/campaigns/weak_gain.yaml is found by `search` and reduced to its causes by `shrink`."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from rich.console import Console

from hil.apps.campaign.find.command import SearchOptions, ShrinkOptions, search_failures, shrink_case

FILE = Path("rigs/campaigns/weak_gain.yaml")


pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


def test_a_valley_of_small_margins_does_not_hold_the_search(tmp_path: Path) -> None:
    """With seed 3, TPE by itself stayed for 200 trials with another list of faults in a strong east wind."""
    pytest.importorskip("optuna")
    options = SearchOptions(trials=120, seed=3, out=tmp_path, quiet=True)
    assert search_failures(FILE, options, Console(quiet=True)) == 1


def test_the_planted_weakness_is_found_and_shrunk_to_its_two_causes(tmp_path: Path) -> None:
    pytest.importorskip("optuna")
    assert search_failures(FILE, SearchOptions(trials=200, out=tmp_path, quiet=True), Console(quiet=True)) == 1
    found = json.loads((tmp_path / "campaign.json").read_text())["search"]
    assert found["first_failure"]["trial"] <= 200
    with (tmp_path / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    fails = [row for row in rows if row["status"] == "FAIL"]
    assert fails
    for row in fails:
        assert float(row["wind.steady_W_mps.0"]) > 5.0
        assert '"until_s": 15' in row["faults.sensors"]

    shrunk = shrink_case(found["first_failure"]["case"], ShrinkOptions(tmp_path, quiet=True), Console(quiet=True))
    assert len(shrunk.remains) == 2, shrunk.remains
    fault, wind = sorted(shrunk.remains)
    assert fault == 'faults.sensors[0] = {"sensor": "gps", "kind": "dropout", "at_s": 11, "until_s": 15}'
    key, _, speed = wind.partition(" = ")
    assert key == "wind.steady_W_mps[0]"
    assert 5.0 < float(speed) <= 8.0
