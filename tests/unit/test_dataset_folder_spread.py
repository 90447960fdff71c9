"""Folders of a data set are put apart where the file system can do that, and nothing else changes."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from hil.dataset import folder_spread
from hil.dataset.folder_spread import make_apart, spread_folders
from hil.signals.errors import RecordingError


def test_what_is_in_the_folder_stays_and_files_go_on_being_made(tmp_path: Path) -> None:
    (tmp_path / "before").write_text("here")
    first = spread_folders(tmp_path)
    assert spread_folders(tmp_path) is first  # once marked it stays so
    (tmp_path / "after").mkdir()
    (tmp_path / "after" / "file").write_text("there")
    assert (tmp_path / "before").read_text() == "here"
    assert (tmp_path / "after" / "file").read_text() == "there"


def test_where_it_cannot_be_done_it_is_left(tmp_path: Path) -> None:
    assert spread_folders(tmp_path / "nowhere") is False
    assert not (tmp_path / "nowhere").exists()


def test_other_systems_are_not_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folder_spread.platform, "machine", lambda: "riscv64")
    assert spread_folders(tmp_path) is False
    monkeypatch.setattr(folder_spread.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(sys, "platform", "darwin")
    assert spread_folders(tmp_path) is False


@pytest.mark.parametrize("can", [True, False])
def test_folders_made_apart_are_like_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, can: bool) -> None:
    if not can:
        monkeypatch.setattr(folder_spread, "spread_folders", lambda _: False)
    (tmp_path / "plain").mkdir()
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "file").write_text("here")
    wanted = [tmp_path / "a" / "deep" / "one", tmp_path / "other", kept]
    for _ in range(2):  # as with --resume
        make_apart(wanted, tmp_path / "nursery")
    assert (kept / "file").read_text() == "here"
    assert not list((tmp_path / "nursery").iterdir())
    for folder in wanted[:2]:
        assert folder.stat().st_mode == (tmp_path / "plain").stat().st_mode
        (folder / "file").write_text("there")


def test_a_file_in_a_folders_place_is_told(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(RecordingError, match="taken"):
        make_apart([tmp_path / "taken"], tmp_path / "nursery")


@pytest.mark.skipif(sys.platform != "linux", reason="tells groups of inodes apart")
def test_folders_of_one_name_go_to_different_places(tmp_path: Path) -> None:
    """An earlier data set's folders were called alike, and its files may have been deleted a moment ago."""
    places = []
    for i in range(4):
        make_apart([tmp_path / f"{i}" / "data"], tmp_path / f"{i}" / "nursery")
        places.append((tmp_path / f"{i}" / "data").stat().st_ino)
    if not spread_folders(tmp_path) or not _is_ext4(tmp_path) or os.statvfs(tmp_path).f_files < 4_000_000:
        pytest.skip("not on a large ext4: folders lie where they lie")
    assert max(places) - min(places) > 8192  # inodes of a group, as file systems are made by default


def _is_ext4(folder: Path) -> bool:
    mounts = [line.split() for line in Path("/proc/mounts").read_text().splitlines()]
    around = [(len(where), kind) for _, where, kind, *_ in mounts if folder.is_relative_to(where)]
    return max(around)[1] == "ext4"
