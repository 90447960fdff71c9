"""A bench in a process of its own, for real clients to connect to."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


class BenchProcess:
    """`with BenchProcess(out, "pace=4", ...) as bench:`; killed at the end if it still runs."""

    def __init__(self, out: Path, *settings: str) -> None:
        self.out = out
        self._command = [sys.executable, "-m", "hil.cli", "run", "--quiet", "--out", str(out)]
        self._command += [word for setting in settings for word in ("--set", setting)]

    def __enter__(self) -> BenchProcess:
        log = (self.out / "stderr.txt").open("w")
        self._process = subprocess.Popen(self._command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=log)
        log.close()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()

    def finish(self, limit_s: float = 60.0) -> dict[str, Any]:
        """Wait for its end and return its run.json."""
        self._process.wait(limit_s)
        assert (self.out / "run.json").exists(), (self.out / "stderr.txt").read_text()
        return json.loads((self.out / "run.json").read_text())


def until(condition: Callable[[], Any], what: str, limit_s: float = 60.0) -> Any:
    """Wait for `condition` and return its first true value."""
    deadline = time.monotonic() + limit_s
    while not (found := condition()):
        assert time.monotonic() < deadline, f"{what} did not come within {limit_s} s"
        time.sleep(0.02)
    return found


def free_port(kind: int = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
