"""Series of data sets: one whose flight fails is flown over what is in its way, and no failure ends the others."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from hil.apps.detect.data_sets import DataSetSeries, make_data_sets
from hil.data_set_files import MANIFEST
from signals.errors import RecordingError

CLEAR = "dataset.trajectory.clear=true"
SERIES = DataSetSeries(sets=3, frames=2, first_seed=1)


def made(monkeypatch: pytest.MonkeyPatch, out: Path, status: Any) -> list[list[str]]:
    """Make the series with `status(folder, command)` in place of `hil dataset`, and return its commands."""
    commands: list[list[str]] = []

    def run(command: list[str], **_: object) -> Any:
        folder = Path(command[command.index("--out") + 1])
        folder.mkdir(exist_ok=True)
        assert not (folder / MANIFEST).exists(), "begun anew"
        (folder / MANIFEST).write_text('{"complete": false}')
        commands.append(command)
        return SimpleNamespace(returncode=status(folder.name, command), stderr=f"error: {folder.name}", stdout="")

    monkeypatch.setattr(subprocess, "run", run)
    make_data_sets(out, Console(quiet=True), SERIES, jobs=1, quiet=True)
    return commands


def test_a_flight_that_fails_is_flown_over_what_is_in_its_way(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def status(name: str, command: list[str]) -> int:
        return 3 if name.startswith("001") and CLEAR not in command else 0

    commands = made(monkeypatch, tmp_path, status)
    assert [CLEAR in command for command in commands] == [False, False, True, False]


def test_a_set_that_cannot_be_made_does_not_end_the_others(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"2 of 3 data sets made\n.*000-city_park.*with status 2: error"):
        made(monkeypatch, tmp_path, lambda name, _: 2 if name.startswith("000") else 0)
    assert sorted(path.name[:3] for path in tmp_path.iterdir()) == ["000", "001", "002"]
