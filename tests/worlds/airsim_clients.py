"""Virtual environments with the real clients `airsim` and `cosysairsim`, as docs/airsim.md has them installed.

They are made once and kept in `airsim_clients` of `HIL_CACHE`, else of `hil-bench` in `XDG_CACHE_HOME`, else in
`~/.cache/hil-bench`.
"""

from __future__ import annotations

import fcntl
import os
import re
import shlex
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest

_PAGE = Path(__file__).resolve().parents[2] / "docs/airsim.md"
PYTHONS = ("3.10", "3.11")  # what the page promises for all three
_LIMIT_S = 240.0


@cache
def documented_clients() -> dict[str, tuple[str, ...]]:
    """Return the lines of `pip install` in each code block of the page, by the client that they install."""
    blocks = re.findall(r"```sh\n((?:pip install .*\n)+)```", _PAGE.read_text())
    names = ("airsim", "airsim over rpc-msgpack", "cosysairsim")
    return {name: tuple(block.splitlines()) for name, block in zip(names, blocks, strict=True)}


def package_of(client: str) -> str:
    """Return the Python package of a client."""
    return client.split()[0]


@cache
def client_python(client: str, version: str = PYTHONS[-1]) -> Path:
    """Return the Python of the environment of a client. Skips the test where it cannot be made."""
    base = _interpreter(version)
    if base is None:
        pytest.skip(f"the client {client} needs Python {version}, which was not found")
    folder = _cache_folder() / f"{client.replace(' ', '-')}-py{version}"
    lines = documented_clients()[client]
    stamp, wanted = folder / "installed.txt", "\n".join(lines)
    python = folder / "bin" / "python"
    folder.parent.mkdir(parents=True, exist_ok=True)
    with folder.with_suffix(".lock").open("w") as lock:  # the workers of one test run share the environment
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (stamp.is_file() and stamp.read_text() == wanted and python.exists()):
            shutil.rmtree(folder, ignore_errors=True)
            _run(client, [base, "-m", "venv", str(folder)])
            for line in lines:
                pip, install, *words = shlex.split(line)
                options = ["-q", "--disable-pip-version-check", "--retries", "1"]
                _run(client, [str(python), "-m", pip, install, *options, *words])
            stamp.write_text(wanted)
    return python


def _interpreter(version: str) -> str | None:
    """Return an interpreter of a version: that of the path, or one of pyenv, whose own command may be switched off."""
    root = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    own = sorted(str(path) for path in root.glob(f"versions/{version}.*/bin/python{version}"))
    for found in (shutil.which(f"python{version}"), *own):
        if found is not None and not subprocess.run([found, "--version"], capture_output=True).returncode:
            return found
    return None


def _run(client: str, command: list[str]) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        pytest.skip(f"the client {client} cannot be installed: {error}")
    if "(from versions: none)" in done.stderr:
        pytest.skip(f"the client {client} cannot be installed, because there is no package index")
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stderr[-3000:]}"


def _cache_folder() -> Path:
    own, common = os.environ.get("HIL_CACHE"), os.environ.get("XDG_CACHE_HOME")
    base = Path(own) if own else (Path(common) if common else Path.home() / ".cache") / "hil-bench"
    return base / "airsim_clients"
