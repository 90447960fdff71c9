"""Which pages of a data set are given back, and when."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hil.dataset.page_release import LATER, LEAST_BYTES, PageRelease
from hil.dataset.tree import TreeWriter, Written


def test_each_batch_is_sent_at_once_and_dropped_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tree = TreeWriter(tmp_path)
    asked: list[tuple[str, int, int]] = []

    def advise(file: int, offset: int, size: int, _: int) -> None:
        asked.append((Path(os.readlink(f"/proc/self/fd/{file}")).name, offset, size))

    monkeypatch.setattr(os, "posix_fadvise", advise, raising=False)
    pages = PageRelease(tmp_path)
    with open(tmp_path / "recording", "wb") as recording:
        for i in range(LATER + 2):
            large, small = tree.write(f"{i}.bin", bytes(LEAST_BYTES)), tree.write(f"{i}.txt", b"x")
            asked.clear()
            pages.batch((large, small), recording.fileno(), 100 * i, 100 * i + 100)
            old = i - LATER
            dropped = [(f"{old}.bin", 0, 0)] if old >= 0 else []
            from_ = 100 * max(old, 0) if old >= 0 else 100 * i
            assert asked == [(f"{i}.bin", 0, 0), *dropped, ("recording", from_, 100 * i + 100 - from_)]


def test_it_is_only_advice(tmp_path: Path) -> None:
    gone = Written("gone.bin", LEAST_BYTES, 0)
    pages = PageRelease(tmp_path)
    for i in range(2 * LATER):
        pages.batch((gone,), -1, i, i + 1)
