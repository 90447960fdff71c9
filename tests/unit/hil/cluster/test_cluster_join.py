"""Joining a Ray cluster: the lines about what it waits for, and the token; with a module in the place of Ray."""

from __future__ import annotations

import importlib
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hil.cluster import tasks, waiting
from hil.cluster.join import join_ray
from hil.cluster.tasks import Needs, RayTasks
from hil.cluster.token import token_place, use_token
from hil.cluster.waiting import waiting_for
from signals.errors import RecordingError

# Lets those in who send the token "secret" and, as Ray, tries for long. As in Ray, the mode is that of the import.
RAY = """
import os, pathlib, sys, time

MODE = os.environ.get("RAY_AUTH_MODE")

def token():
    if MODE != "token":
        return None
    if "RAY_AUTH_TOKEN" in os.environ:
        return os.environ["RAY_AUTH_TOKEN"]
    path = os.environ.get("RAY_AUTH_TOKEN_PATH") or pathlib.Path.home() / ".ray" / "auth_token"
    return pathlib.Path(path).read_text()

def init(address, **_):
    if address != "local" and token() != "secret":
        print("Unauthenticated: RPC error: InvalidAuthToken: missing or incorrect", file=sys.stderr, flush=True)
        time.sleep(600.0)
"""


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home directory without a token."""
    for name in ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH", "RAY_USAGE_STATS_ENABLED"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    monkeypatch.setenv("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return tmp_path / "home"


@pytest.fixture
def address(home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Address of a cluster, whose Ray is the module above here and in child processes."""
    (tmp_path / "ray.py").write_text(RAY)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "ray", raising=False)
    importlib.invalidate_caches()
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield f"127.0.0.1:{listening.getsockname()[1]}"
    sys.modules.pop("ray", None)


def keep(home: Path, token: str) -> None:
    """Write a token where `ray get-auth-token --generate` does."""
    (home / ".ray").mkdir(parents=True)
    (home / ".ray" / "auth_token").write_text(token)


def joined(address: str) -> list[str]:
    """Join and return what was said."""
    said: list[str] = []
    join_ray(address, 1, said.append)
    return said


@pytest.mark.parametrize("place", ["RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH", "~/.ray/auth_token"])
def test_the_token_is_taken_where_ray_keeps_it(
    address: str, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    (tmp_path / "token").write_text("secret")
    keep(home, "secret" if place.startswith("~") else "another")
    if place == "RAY_AUTH_TOKEN":
        monkeypatch.setenv(place, "secret")
    elif place == "RAY_AUTH_TOKEN_PATH":
        monkeypatch.setenv(place, str(tmp_path / "token"))
    assert token_place() == place
    assert joined(address) == [
        *[f"Ray: waiting for the cluster at {address} to let a first process in"] * 2,
        f"Ray: waiting for the cluster at {address} to let this process in",
    ]


def test_a_failed_join_names_the_token(address: str, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    where = f"--engine ray: the cluster at {address} cannot be joined: it "
    with pytest.raises(RecordingError) as caught:
        joined(address)
    assert str(caught.value).startswith(f"{where}asks for its token, and this machine has none; `ray get-auth-token`")
    assert "~/.ray/auth_token here, or set RAY_AUTH_TOKEN" in str(caught.value)
    keep(home, "another")
    with pytest.raises(RecordingError) as caught:
        joined(address)
    monkeypatch.delenv("RAY_AUTH_MODE")
    assert str(caught.value).startswith(f"{where}does not take the token of ~/.ray/auth_token")
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    with pytest.raises(RecordingError) as caught:
        joined(address)
    assert str(caught.value).startswith(f"{where}asks for its token, and RAY_AUTH_MODE is 'disabled' here")


def test_a_mode_that_the_user_has_set_stays(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import os

    assert not use_token()  # there is none
    assert "RAY_AUTH_MODE" not in os.environ
    keep(home, "secret")
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    assert not use_token()
    assert os.environ["RAY_AUTH_MODE"] == "disabled"


def test_a_cluster_that_asks_for_no_token_is_sent_none(
    address: str, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a token for such a cluster, the nodes could not fetch this process's objects."""
    import os

    (tmp_path / "ray.py").write_text(RAY.replace('address != "local"', "False"))
    keep(home, "secret")
    assert len(joined(address)) == 2
    assert "RAY_AUTH_MODE" not in os.environ


def test_what_is_waited_for_is_said_again_until_it_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(waiting, "AGAIN_S", 0.01)
    said: list[str] = []
    with waiting_for("waiting for Godot", said.append):
        while len(said) < 3:
            time.sleep(0.005)
    count = len(said)
    assert said[0] == "waiting for Godot"
    assert said[2].startswith("waiting for Godot, for ")
    time.sleep(0.03)
    assert len(said) == count


class Ray:
    """A cluster of two nodes that ends tasks when it is told to."""

    def __init__(self) -> None:
        self.ready: list[Any] = []
        self.exceptions = type("Exceptions", (), {"RayError": OSError, "RayTaskError": KeyError})

    def remote(self, function: Any) -> Any:
        del function
        options = lambda **_: type("Options", (), {"remote": staticmethod(lambda *a: a)})  # noqa: E731
        return type("Task", (), {"options": staticmethod(options)})

    def get_runtime_context(self) -> Any:
        return type("Context", (), {"gcs_address": "127.0.0.1:1"})

    def nodes(self) -> list[dict[str, Any]]:
        return [{"Alive": True, "NodeID": name, "Resources": {"CPU": 1.0}} for name in "ab"]

    def wait(self, running: list[Any], **_: Any) -> tuple[list[Any], list[Any]]:
        return [each for each in running if each in self.ready], []

    def get(self, reference: Any) -> Any:
        return reference


def test_a_cluster_whose_first_task_takes_long_says_so_until_it_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    ray, now_s, said = Ray(), [100.0], []
    monkeypatch.setattr(tasks, "join_ray", lambda *_: ray)
    monkeypatch.setattr(RayTasks, "_head_answers", lambda *_: True)
    monkeypatch.setattr(tasks.time, "monotonic", lambda: now_s[0])
    made = RayTasks(print, Needs(), address="a:1", at_once=None, say=said.append)
    assert said == ["Ray: 2 node(s) with room for 2 task(s) at a time"]
    for key in "xy":
        made.submit(key, key)
    for _ in range(100):  # of half a second
        assert made.wait(0.5) == []
        now_s[0] += 0.5
    assert len(said) == 1 + 3
    assert said[-1].startswith("Ray: waiting for the first of 2 task(s), for 45 s now; each node starts processes")
    ray.ready = [("x",)]
    assert [ended.key for ended in made.wait(0.5)] == ["x"]
    now_s[0] += 100.0
    made.wait(0.5)
    assert len(said) == 4
