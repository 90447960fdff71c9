"""Standard streams: nothing is lost while somebody reads, and nothing is raised once nobody does."""

from __future__ import annotations

import fcntl
import os
import threading

import pytest

from hil.cli.streams import _Output


def test_a_pipe_that_its_other_end_made_non_blocking_gets_every_byte() -> None:
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETFL, fcntl.fcntl(writer, fcntl.F_GETFL) | os.O_NONBLOCK)
    data, got = os.urandom(300_000), bytearray()

    def read() -> None:
        while piece := os.read(reader, 65_536):
            got.extend(piece)

    thread = threading.Thread(target=read)
    thread.start()
    with _Output(writer, "w") as output:
        assert output.write(data) == len(data)
    thread.join()
    os.close(reader)
    assert got == data


def test_a_stream_without_a_reader_leads_nowhere_for_everybody() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with _Output(writer, "w") as output:
        assert [output.write(b"lost"), output.write(b"lost, too")] == [4, 9]
        assert os.write(writer, b"of a library or a program started later") == 39


def test_a_stream_that_fails_without_a_descriptor_left_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_more(*_: object) -> int:
        raise OSError(24, "Too many open files")

    with open("/dev/full", "wb") as full, _Output(os.dup(full.fileno()), "w") as output:
        monkeypatch.setattr(os, "open", no_more)
        assert [output.write(b"lost"), output.write(b"lost, too")] == [4, 9]
