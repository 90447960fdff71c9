"""Errors of the path tracer's process: no LLVM, a broken installation, an abort, an end in mid-picture."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.frame.path_traced import llvm, process
from sim.frame.path_traced.errors import PathTracerError
from sim.frame.path_traced.process import TracerProcess
from sim.frame.path_traced.protocol import Exposure, RenderRequest
from sim.frame.path_traced.sky_request import sky_request
from sim.scene.light import Light

# A worker that answers every request with ("ok", None), until a request of the given name.
FAKE = """
import os, signal, sys
from multiprocessing.connection import Connection
connection = Connection(int(sys.argv[1]))
while True:
    try:
        name = connection.recv()[0]
    except EOFError:
        sys.exit(0)
    if name == {last!r}:
        {then}
    connection.send(("ok", None))
"""


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "libLLVM.so.19.1"
    path.touch()
    monkeypatch.setenv(llvm.VARIABLE, str(path))
    return path


def start(monkeypatch: pytest.MonkeyPatch, last: str, then: str) -> TracerProcess:
    monkeypatch.setattr(process, "WORKER", (sys.executable, "-c", FAKE.format(last=last, then=then)))
    return TracerProcess(sky_request(Light(), 0.0), {})


def request() -> RenderRequest:
    exposure = Exposure(np.zeros((1, 3)), np.eye(3).reshape(1, 9), 1, 1, 4)
    moving: Any = (np.zeros(0, np.int32), np.zeros((0, 3), np.float32), np.zeros((0, 3, 3), np.float32))
    return RenderRequest(0, exposure, moving, 1, 0)


def test_an_llvm_that_aborts_is_named(library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    abort = "print('LLVM ERROR: Cannot select', file=sys.stderr, flush=True); os.abort()"
    with pytest.raises(PathTracerError, match=r"no LLVM that works: .*libLLVM.so.19.1 was ended by SIGABRT.*Cannot"):
        start(monkeypatch, "start", abort)


def test_the_end_of_the_process_in_a_picture_is_an_error(library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tracer = start(monkeypatch, "render", "os.kill(os.getpid(), signal.SIGKILL)")
    assert tracer.usable
    with pytest.raises(PathTracerError, match="was ended by SIGKILL, as the system does when memory runs out"):
        tracer.render(request())
    assert not tracer.usable
    with pytest.raises(PathTracerError, match="has ended"):
        tracer.render(request())


def test_a_missing_package_is_named_with_its_command(library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = "connection.send(('missing', \"No module named 'mitsuba'\")); continue"
    with pytest.raises(PathTracerError, match=r"No module named 'mitsuba'.*pip install 'hil-bench\[photo\]'"):
        start(monkeypatch, "start", answer)


def test_an_error_in_the_tracer_is_reported(library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tracer = start(monkeypatch, "render", "connection.send(('error', 'it has no memory left')); continue")
    with pytest.raises(PathTracerError, match="cannot do 'render': it has no memory left"):
        tracer.render(request())


def test_closing_ends_the_process(library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tracer = start(monkeypatch, "none", "pass")
    assert tracer._process is not None
    pid = tracer._process.pid
    tracer.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_libraries_are_tried_from_the_newest_and_old_ones_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    for name in ("libLLVM-14.so.1", "libLLVM-17.so.1", "libLLVM.so.19.1", "libLLVM-16.so"):
        (tmp_path / name).write_text(name)
    (tmp_path / "libLLVM-19.so").symlink_to(tmp_path / "libLLVM.so.19.1")
    found = llvm.find_libraries((str(tmp_path / "libLLVM*.so*"),))
    assert [path.resolve().name for path in found.usable] == ["libLLVM.so.19.1", "libLLVM-17.so.1"]
    assert [text.rpartition("/")[2] for text in found.refused] == [
        "libLLVM-16.so is version 16",
        "libLLVM-14.so.1 is version 14",
    ]


def test_without_an_llvm_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(llvm.VARIABLE, "/nowhere/libLLVM.so")
    with pytest.raises(PathTracerError, match=r"names no file: /nowhere/libLLVM.so: install LLVM 17 or newer"):
        TracerProcess(sky_request(Light(), 0.0), {})
