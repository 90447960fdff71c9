"""Virtual environments with the real clients `airsim` and `cosysairsim`, made once and kept in the user's cache.

Their folder is `airsim_clients` in `HIL_CACHE`, else in `hil-bench` of `XDG_CACHE_HOME`, else in `~/.cache/hil-bench`.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

# What must be there before the client is built, and the client. Its setup.py imports the package, so it sees no
# environment of its own. OpenCV, which airsim 1.8.1 lists, is needed by `write_png` alone.
_TOOLS = ("setuptools<66", "wheel<0.45")
REQUIREMENTS: dict[str, tuple[tuple[str, ...], str]] = {
    "airsim": (("numpy<2", "msgpack-rpc-python", *_TOOLS), "airsim==1.8.1"),
    "cosysairsim": (("numpy<2", "rpc-msgpack", *_TOOLS), "cosysairsim==3.5.*"),
}
_VERSIONS = ((3, 8), (3, 9), (3, 10), (3, 11))  # numpy below 2 and msgpack-python have no others
_LIMIT_S = 240.0


@cache
def client_python(name: str) -> Path:
    """Return the Python of the environment of a client. Skips the test where it cannot be made."""
    base = _base_python()
    if base is None:
        pytest.skip(f"the client {name} needs Python 3.8 to 3.11, and none was found")
    version = subprocess.run([base, "-c", "import sys; print(*sys.version_info[:2])"], capture_output=True, text=True)
    folder = _cache_folder() / f"{name}-py{version.stdout.strip().replace(' ', '.')}"
    first, package = REQUIREMENTS[name]
    stamp, wanted = folder / "installed.txt", "\n".join((*first, package))
    python = folder / "bin" / "python"
    folder.parent.mkdir(parents=True, exist_ok=True)
    with (folder.parent / f"{name}.lock").open("w") as lock:  # the workers of one test run share the environment
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (stamp.is_file() and stamp.read_text() == wanted and python.exists()):
            shutil.rmtree(folder, ignore_errors=True)
            install = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check", "--retries", "1"]
            for command in (
                [base, "-m", "venv", str(folder)],
                [*install, *first],
                [*install, "--no-build-isolation", "--no-deps", package],
                [str(python), "-c", f"import {name}"],
            ):
                _run(name, command)
            stamp.write_text(wanted)
    return python


def _run(name: str, command: list[str]) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        pytest.skip(f"the client {name} cannot be installed: {error}")
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no output"])[-1]
        pytest.skip(f"the client {name} cannot be installed, is there a package index? {' '.join(command)}: {last}")


def _base_python() -> str | None:
    if sys.version_info[:2] in _VERSIONS:
        return sys.executable
    names = (f"python{major}.{minor}" for major, minor in reversed(_VERSIONS))
    return next((found for name in names if (found := shutil.which(name))), None)


def _cache_folder() -> Path:
    own, common = os.environ.get("HIL_CACHE"), os.environ.get("XDG_CACHE_HOME")
    base = Path(own) if own else (Path(common) if common else Path.home() / ".cache") / "hil-bench"
    return base / "airsim_clients"
