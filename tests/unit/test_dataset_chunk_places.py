"""Memory through which pieces of a data set's recording go."""

from __future__ import annotations

import os

import pytest

import hil.dataset.chunk_places as module
from hil.dataset.chunk_places import ChunkPlaces


def test_a_piece_put_by_a_forked_process_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PLACE_BYTES", 1 << 16)
    places = ChunkPlaces(2)
    assert places.put(0, (b"first",))
    child = os.fork()
    if child == 0:
        os._exit(0 if places.put(1, (b"ab", b"", b"cde")) and places.put(0, (b"F",)) else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    with places.piece(1, 5) as piece:
        assert bytes(piece) == b"abcde"
    with places.piece(0, 5) as piece:
        assert bytes(piece) == b"First"


def test_what_does_not_fit_or_has_no_place_is_not_put(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PLACE_BYTES", 1 << 12)
    places = ChunkPlaces(1)
    assert places.put(0, (bytes(4096),))
    assert not places.put(0, (bytes(4096), b"x"))
    assert not places.put(1, (b"x",))
    assert not places.put(-1, (b"x",))


def test_without_such_memory_nothing_is_put(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError("no memory")

    monkeypatch.setattr(module.mmap, "mmap", refuse)
    assert not ChunkPlaces(3).put(0, (b"x",))
