"""Clusters of Ray on this machine, and the processes of a command that a test kills."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.worlds.bench_process import free_port

WAIT_S = 600.0
ON_LOOPBACK = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}  # 127.0.0.1 stays that address, on Linux too


def require_ray() -> None:
    """Skip the test where Ray is not installed."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    pytest.importorskip("ray", reason='needs Ray: pip install "hil-bench[ray]"')


@contextmanager
def two_nodes() -> Iterator[Any]:
    """Run a cluster of two nodes with a processor each."""
    require_ray()
    from ray.cluster_utils import Cluster

    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    made.add_node(num_cpus=1)
    yield made
    made.shutdown()


@contextmanager
def head_with_token(home: Path) -> Iterator[str]:
    """Run a cluster of one node with two processors that asks for the token in `home`; its address."""
    require_ray()
    folder = tempfile.mkdtemp(prefix="ray-")  # a short path, for sockets
    port = free_port()
    (home / ".ray").mkdir(parents=True)
    (home / ".ray" / "auth_token").write_text("7e" * 32)
    options = ["--head", "--block", "--node-ip-address=127.0.0.1", f"--port={port}", "--num-cpus=2"]
    options += ["--include-dashboard=false", f"--temp-dir={folder}", "--object-store-memory=200000000"]
    head = subprocess.Popen(
        [sys.executable, "-m", "ray.scripts.scripts", "start", *options],
        env=os.environ | {"HOME": str(home), **ON_LOOPBACK},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert head.stdout is not None
    lines = []
    while not lines or "Ray runtime started" not in lines[-1]:
        lines.append(head.stdout.readline())
        assert lines[-1], "".join(lines)
    yield f"127.0.0.1:{port}"
    head.terminate()
    head.communicate(timeout=WAIT_S)
    shutil.rmtree(folder, ignore_errors=True)


def raylet_of(node: Any) -> int:
    """Return the process that is a node: without it the node is lost."""
    (raylet,) = [info.process.pid for info in node.all_processes["raylet"]]
    return int(raylet)


def until(process: subprocess.Popen[str], holds: Callable[[], Any]) -> Any:
    """Return what `holds` returns as soon as it is true, while the process goes on."""
    deadline_s = time.monotonic() + WAIT_S
    while not (value := holds()):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    return value


def processes(word: str, under: int | None = None) -> list[int]:
    """Return processes with a word in their command line, `under`: descendants of this process only."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if word.encode() in (entry / "cmdline").read_bytes() and (
                    under is None or under in _parents(entry.name)
                ):
                    found.append(int(entry.name))
            except OSError:
                continue
    return found


def _parents(pid: str) -> list[int]:
    line = []
    while pid not in ("0", "1"):
        pid = (Path("/proc") / pid / "stat").read_text().rpartition(")")[2].split()[1]
        line.append(int(pid))
    return line
