"""A program on the far side of a link: its folder, environment and output, and the end of all its processes."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_bridge.links.child_process import ChildProcess
from signals.errors import PortNotFound

TELL = """
import json, os, sys
print("on the output"); print("on the error", file=sys.stderr)
here = {"cwd": os.getcwd(), "env": dict(os.environ), "group": os.getpgrp(), "session": os.getsid(0)}
open(os.environ["TELL_IN"], "w").write(json.dumps(here))
"""
# Starts a grandchild, prints its process id, and waits.
PARENT = """
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
open("pids", "w").write(str(child.pid)); print("ready", flush=True)
time.sleep(600)
"""


def told(tmp_path: Path, **settings: object) -> dict:
    child = ChildProcess(
        [sys.executable, "-c", TELL],
        env={"TELL_IN": str(tmp_path / "told.json"), "PATH_OF_MINE": "1"},
        stderr_path=tmp_path / "logs/log",
        **settings,  # type: ignore[arg-type]
    )
    child.start()
    assert "exit status 0" in wait_and_describe(child)
    child.close()
    return json.loads((tmp_path / "told.json").read_text())


def wait_and_describe(child: ChildProcess) -> str:
    for _ in range(3000):
        if not child.running():
            return child.describe_end()
        time.sleep(0.01)
    raise AssertionError("it did not end")


def alive(pid: int) -> bool:
    """Return True if it runs and is not a zombie."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


def becomes_dead(pid: int) -> bool:
    for _ in range(1000):
        if not alive(pid):
            return True
        time.sleep(0.01)
    return False


def test_it_runs_in_its_folder_which_is_created(tmp_path: Path) -> None:
    folder = tmp_path / "a/b c"
    assert told(tmp_path, cwd=folder)["cwd"] == str(folder)
    assert told(tmp_path)["cwd"] == os.getcwd()


def test_its_environment_extends_ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH_OF_MINE", "0")
    monkeypatch.setenv("ALSO_MINE", "2")
    env = told(tmp_path)["env"]
    assert (env["PATH_OF_MINE"], env["ALSO_MINE"]) == ("1", "2")
    assert os.environ["PATH_OF_MINE"] == "0"
    assert str(Path(__file__).resolve().parents[4]) in env["PYTHONPATH"].split(os.pathsep)


def test_its_output_is_kept_only_in_a_log(tmp_path: Path) -> None:
    told(tmp_path)
    assert (tmp_path / "logs/log").read_text() == "on the error\n"
    told(tmp_path, log_output=True)
    assert sorted((tmp_path / "logs/log").read_text().splitlines()) == ["on the error", "on the output"]


def test_a_group_of_its_own_is_out_of_reach_of_ctrl_c(tmp_path: Path) -> None:
    assert told(tmp_path)["group"] == os.getpgrp()
    own = told(tmp_path, own_group=True)
    assert own["group"] == own["session"] != os.getpgrp()


@pytest.fixture
def parent(tmp_path: Path) -> Iterator[tuple[ChildProcess, int]]:
    """Return a program with a child in its process group."""
    child = ChildProcess(
        [sys.executable, "-c", PARENT], stderr_path=tmp_path / "log", cwd=tmp_path, log_output=True, own_group=True
    )
    child.start()
    for _ in range(3000):
        if "ready" in child.stderr_tail():
            break
        time.sleep(0.01)
    yield child, int((tmp_path / "pids").read_text())
    child.close()


def test_its_children_are_ended_with_it(parent: tuple[ChildProcess, int]) -> None:
    child, grandchild = parent
    pid = child.pid
    assert pid is not None
    assert alive(pid)
    assert alive(grandchild)
    child.close()
    assert child.pid is None
    assert becomes_dead(pid)
    assert becomes_dead(grandchild)
    child.close()  # any number of times


def test_its_children_are_ended_even_if_it_ended_first(parent: tuple[ChildProcess, int]) -> None:
    child, grandchild = parent
    assert child.pid is not None
    os.kill(child.pid, signal.SIGKILL)
    assert "signal SIGKILL; it last said:\nready" in wait_and_describe(child)
    assert alive(grandchild)
    child.close()
    assert becomes_dead(grandchild)


def test_a_stopped_program_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("firmware_bridge.links.child_process._TERMINATE_S", 0.1)
    child = ChildProcess([sys.executable, "-c", "import time; time.sleep(600)"])
    child.start()
    pid = child.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    child.close()
    assert becomes_dead(pid)


def test_missing_programs_and_folders_are_named(tmp_path: Path) -> None:
    with pytest.raises(PortNotFound, match="cannot be started"):
        ChildProcess([str(tmp_path / "nothing")], cwd=tmp_path / "w").start()
    (tmp_path / "file").write_text("")
    with pytest.raises(PortNotFound, match="cannot be started"):
        ChildProcess([sys.executable], cwd=tmp_path / "file/w").start()
    child = ChildProcess([sys.executable])
    assert (child.pid, child.running(), child.stderr_tail()) == (None, False, "")
    assert child.describe_end() == "its process was never started"
    child.close()
