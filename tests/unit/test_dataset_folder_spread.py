"""Folders of a data set are marked to lie apart where the file system can do that, and nothing else changes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from hil.dataset import folder_spread
from hil.dataset.folder_spread import spread_folders


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
