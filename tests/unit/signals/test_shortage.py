"""Errors that mean that a resource ran out, and the guard for libraries that end the process when one does."""

from __future__ import annotations

import errno
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import zmq

from signals.errors import DiskFull, HilError, OutOfFiles, OutOfMemory, RecordingError
from signals.shortage import named, shortage


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (MemoryError(), OutOfMemory),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), OutOfMemory),
        (ImportError("libopenblas.so: failed to map segment from shared object"), OutOfMemory),
        (ValueError("Error: engine error: Could not allocate memory"), OutOfMemory),
        (ValueError("error decoding PNG file 'grass.png': memory allocation failed"), OutOfMemory),
        (RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory: you tried 99 bytes"), OutOfMemory),
        (RuntimeError("OpenCV(5.0) error: (-4:Insufficient memory) Failed to allocate 12 bytes"), OutOfMemory),
        (RuntimeError("can't start new thread"), OutOfMemory),
        (RuntimeError("std::bad_alloc"), OutOfMemory),
        (OSError(errno.EMFILE, "Too many open files", "autopilot.log"), OutOfFiles),
        (zmq.ZMQError(errno.EMFILE), OutOfFiles),
        (OSError(errno.ENOSPC, "No space left on device", "a.png"), DiskFull),
        (OSError(errno.EFBIG, "File too large"), DiskFull),
    ],
)
def test_what_ran_out_is_named(error: Exception, kind: type[HilError]) -> None:
    told = shortage(error)
    assert type(told) is kind
    assert str(error) in str(told)


@pytest.mark.parametrize("error", [ValueError("no member in memory"), KeyError("x"), OSError(errno.ENOENT, "No file")])
def test_other_errors_are_not(error: Exception) -> None:
    assert named(error) is None
    bench = RecordingError("x: no memory allocated")
    assert named(bench) is bench


def test_numpy_says_it_with_an_error_of_its_own() -> None:
    with pytest.raises(MemoryError) as caught:
        np.empty(1 << 62, np.uint8)
    assert "Unable to allocate" in str(shortage(caught.value))


GUARDED = """
import ctypes, os, resource, signal, sys
from signals._kernel import guard_crashes, guard_end, guard_file, unguard_crashes
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
guard_crashes(3, "crashed\\n", "no memory\\n")
guard_file(sys.argv[1], '{"error": "crashed"}', '{"error": "no memory"}')
guard_file(sys.argv[1] + ".not", "x", "x")
guard_file(sys.argv[1] + ".not", "", "")
exec(sys.argv[2])
"""


@pytest.mark.parametrize(
    ("end", "status", "said"),
    [
        ("os.abort()", 3, "crashed\n"),
        ("ctypes.string_at(0)", 3, "crashed\n"),
        ("ctypes.CDLL(None).exit(1)", 3, "crashed\n"),
        ("resource.setrlimit(resource.RLIMIT_AS, (64 << 20,) * 2); os.abort()", 3, "no memory\n"),
        ("unguard_crashes(); os.abort()", -6, ""),
        ("unguard_crashes(); ctypes.CDLL(None).exit(1)", 1, ""),
        ("guard_end(0); os.abort()", 0, ""),
        ("guard_end(0)", 0, ""),
    ],
)
def test_a_library_that_ends_the_process_leaves_last_words(tmp_path: Path, end: str, status: int, said: str) -> None:
    path = tmp_path / "out" / "run.json"
    process = subprocess.run([sys.executable, "-c", GUARDED, path, end], capture_output=True, text=True, check=False)
    assert (process.returncode, process.stderr) == (status, said)
    if said:
        assert json.loads(path.read_text()) == {"error": said.strip()}
        assert [file.name for file in path.parent.iterdir()] == ["run.json"]
    else:
        assert not path.exists()
