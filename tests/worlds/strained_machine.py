"""A machine that is short of something: processors that others use, a file system that fills."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def busy_processors(count: int) -> Iterator[None]:
    """Keep this many processors busy."""
    spinners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for spinner in spinners:
            spinner.kill()
            spinner.wait()


@contextmanager
def small_disk(folder: Path, size_kb: int) -> Iterator[Callable[[], None]]:
    """Mount a file system of this size, and return what makes it larger; skip the test where that is not allowed."""
    folder.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size_kb}k", "tmpfs", folder]
    if os.getuid() != 0 or subprocess.run(mount, check=False, capture_output=True).returncode != 0:
        pytest.skip("only root mounts file systems")
    try:
        yield lambda: subprocess.run(["mount", "-o", "remount,size=500M", folder], check=True) and None
    finally:
        subprocess.run(["umount", "-l", folder], check=True)
