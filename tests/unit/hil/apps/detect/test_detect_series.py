"""Series of data sets: one whose flight fails is flown over what is in its way, and no failure ends the others."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from hil.apps.detect import data_sets
from hil.apps.detect.data_sets import BENCH, DataSetSeries, make_data_sets
from hil.config import load_bench
from hil.config.saved import resolved_yaml
from hil.data_set_files import MANIFEST
from hil.run_files import BENCH_NAME
from signals.documents.yaml_lines import dump_yaml, read_yaml
from signals.errors import ConfigError, RecordingError
from tests.worlds.patience import PATIENCE_S, until

CLEAR = "dataset.trajectory.clear=true"
SERIES = DataSetSeries(sets=3, frames=2, first_seed=1)


def made(monkeypatch: pytest.MonkeyPatch, out: Path, status: Any) -> list[list[str]]:
    """Make the series with `status(folder, command)` in place of `hil dataset`, and return its commands."""
    commands: list[list[str]] = []

    def run(_: object, command: list[str]) -> Any:
        folder = Path(command[command.index("--out") + 1])
        folder.mkdir(exist_ok=True)
        assert not (folder / MANIFEST).exists(), "begun anew"
        (folder / MANIFEST).write_text('{"complete": false}')
        commands.append(command)
        return SimpleNamespace(returncode=status(folder.name, command), stderr=f"error: {folder.name}", stdout="")

    monkeypatch.setattr(data_sets._Commands, "run", run)
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


# In place of `hil dataset`: notes its start, and ends as that does at a signal. It does not outlive the command.
DATASET = """
import os, signal, sys, time
def stop(*_):
    sys.exit(3)
signal.signal(signal.SIGINT, stop)
signal.signal(signal.SIGTERM, stop)
with open(sys.argv[1], "a") as starts:
    print("start", file=starts)
parent = os.getppid()
while os.getppid() == parent:
    time.sleep(0.02)
"""
SERIES_COMMAND = """
import subprocess, sys
from pathlib import Path
from rich.console import Console
from hil.apps.detect.data_sets import DataSetSeries, make_data_sets
from hil.cli import app, entry

starts, out, program = sys.argv[1:]
begin = subprocess.Popen
subprocess.Popen = lambda command, **options: begin([sys.executable, "-c", program, starts], **options)
series = DataSetSeries(sets=3, frames=2, first_seed=1)
app.run_command_line = lambda _: make_data_sets(Path(out), Console(quiet=True), series, jobs=1, quiet=True)
entry.main()
"""


@pytest.mark.parametrize("by_terminal", [True, False])
def test_a_signal_ends_the_sets_under_way_and_begins_none(by_terminal: bool, tmp_path: Path) -> None:
    starts = tmp_path / "starts"
    command = [sys.executable, "-c", SERIES_COMMAND, str(starts), str(tmp_path / "out"), DATASET]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as making:
        try:
            until(lambda: starts.exists() and starts.read_text())
            if by_terminal:  # Ctrl-C reaches all programs of the terminal
                os.killpg(making.pid, signal.SIGINT)
            else:
                making.terminate()
            _, told = making.communicate(timeout=PATIENCE_S)
        finally:
            making.kill()
    assert (making.returncode, told) == (3, f"error: stopped by {'SIGINT' if by_terminal else 'SIGTERM'}\n")
    assert starts.read_text() == "start\n"


def complete(series: DataSetSeries, out: Path) -> list[Path]:
    """Write what a data set of a series is known by, for each of them, and return their folders."""
    folders = [out / plan.name for plan in series.plans()]
    for plan, folder in zip(series.plans(), folders, strict=True):
        folder.mkdir()
        (folder / MANIFEST).write_text(json.dumps({"complete": True, "made_from": {"frames": series.frames}}))
        settings = (*plan.settings(), f"quality={plan.quality}")
        bench = load_bench(BENCH, seed=plan.seed, settings=settings, flown=False)
        (folder / BENCH_NAME).write_text(resolved_yaml(bench.config))
    return folders


def test_complete_sets_are_compared_without_a_bench_for_each(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Two hundred complete sets were three minutes of silence."""
    folders = complete(SERIES, tmp_path)
    loaded: list[object] = []

    def load(*arguments: Any, **named: Any) -> Any:
        loaded.append(arguments)
        return load_bench(*arguments, **named)

    monkeypatch.setattr(data_sets, "load_bench", load)
    assert make_data_sets(tmp_path, Console(quiet=True), SERIES, quiet=True) == folders
    assert len(loaded) == 1


def test_what_an_older_set_does_not_tell_is_no_difference(tmp_path: Path) -> None:
    series = replace(SERIES, sets=1)
    (folder,) = complete(series, tmp_path)
    (folder / MANIFEST).write_text('{"complete": true}')
    data = read_yaml(folder / BENCH_NAME).data
    del data["randomize"]["people"]["count"], data["dataset"]["trajectory"]["side_m"]
    (folder / BENCH_NAME).write_text(dump_yaml(data))
    assert make_data_sets(tmp_path, Console(quiet=True), series, quiet=True) == [folder]
    del data["randomize"], data["sensors"]
    (folder / BENCH_NAME).write_text(dump_yaml(data))
    assert make_data_sets(tmp_path, Console(quiet=True), series, quiet=True) == [folder]


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ({}, ""),
        ({"first_seed": 2}, "another seed: 1, not 2"),
        ({"frames": 3}, "another frames: 2, not 3"),
        ({"quality": "epic"}, "another quality: "),
        ({"objects": (1, 2)}, "another randomize.objects.count: None, not [1, 2]"),
        ({"size_px": (64, 48)}, "another sensors.front.resolution: [320, 240], not [64, 48]"),
    ],
)
def test_complete_sets_of_another_series_are_no_result(other: dict[str, Any], words: str, tmp_path: Path) -> None:
    """A test of seeds that were never used was made of the pictures of a training in the same folder."""
    series = replace(SERIES, sets=1)
    (folder,) = complete(series, tmp_path)
    if not words:
        assert make_data_sets(tmp_path, Console(quiet=True), series, quiet=True) == [folder]
        return
    with pytest.raises(ConfigError) as refused:
        make_data_sets(tmp_path, Console(quiet=True), replace(series, **other), quiet=True)
    assert words in str(refused.value)
