"""run.json from the begin of a run to its end, on disks of every size."""

from __future__ import annotations

import copy
import json
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from hil.run.runs.run_file import RunFile
from signals.errors import DiskFull, RecordingError
from tests.worlds.run_json_schema import RUN, problems_of
from tests.worlds.strained_machine import small_disk


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def read(folder: Path) -> dict[str, object]:
    run: dict[str, object] = json.loads((folder / "run.json").read_text())
    return run


def test_a_run_that_begins_is_killed_until_it_ends(tmp_path: Path) -> None:
    file, run = RunFile(tmp_path), copy.deepcopy(RUN)
    assert file.begin(run)["error"]["type"] == "Killed"
    file.reserve()
    assert read(tmp_path)["status"] == "ERROR"
    assert os.listdir(tmp_path) == ["run.json"], "the reserve has no name"
    assert file.end(run) == run
    assert read(tmp_path) == run


@pytest.mark.parametrize(("size_kb", "whole"), [(4, False), (8, False), (100, True)])
def test_a_full_disk_has_room_for_the_end(tmp_path: Path, size_kb: int, whole: bool) -> None:
    """A recording takes all that it can get; the result is written into the reserve, or in place of the first one."""
    file, run = RunFile(tmp_path), {**copy.deepcopy(RUN), "more": ["x" * 100] * 100}
    with small_disk(tmp_path, size_kb):
        file.begin(RUN)
        try:
            file.reserve()
        except DiskFull as error:
            run |= {"status": "ERROR", "error": {"type": "DiskFull", "message": str(error)}}
        with (tmp_path / "run.mcap").open("wb", buffering=0) as mcap, suppress(OSError):
            while mcap.write(bytes(1024)):
                pass
        ended, written = file.end(run), read(tmp_path)
        assert problems_of(written) == []
        assert (written == run) == whole
        assert ended["status"] == written["status"] == (run["status"] if whole else "ERROR")
        if not whole:
            assert "No space left" in str(written["error"])


def test_a_limit_on_the_size_of_files_is_told(tmp_path: Path) -> None:
    file, run = RunFile(tmp_path), {**copy.deepcopy(RUN), "more": "x" * 5000}
    file.begin(RUN)
    with files_up_to(5000):
        assert file.end(run)["status"] == "ERROR"
    assert "File too large" in str(read(tmp_path)["error"])


def test_the_first_error_stays_the_one_that_is_told(tmp_path: Path) -> None:
    first = {"type": "LinkClosed", "message": "gone"}
    file, run = RunFile(tmp_path), {**copy.deepcopy(RUN), "status": "ERROR", "error": first, "more": "x" * 5000}
    file.begin(RUN)
    with files_up_to(5000):
        assert file.end(run)["error"] == first
    assert read(tmp_path)["error"] == first


def test_nothing_can_be_written(tmp_path: Path) -> None:
    file = RunFile(tmp_path)
    file.begin(RUN)
    with files_up_to(10), pytest.raises(RecordingError, match=r"run\.json: cannot be written \(File too large\)"):
        file.end(copy.deepcopy(RUN))
