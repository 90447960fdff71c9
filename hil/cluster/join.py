"""Joins a Ray cluster, or begins one on this machine. Ray is imported here, and only if it is asked for."""

from __future__ import annotations

import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from importlib.util import find_spec
from typing import Any

from hil.cluster.token import is_refused, refusal, use_token
from hil.cluster.waiting import Say, waiting_for
from signals.errors import ConfigError, RecordingError

_CONNECT_S = 10.0  # to a port of the cluster
_JOIN_S = 120.0  # of Ray itself, to join a cluster from a loaded machine
_STORE_BYTES = 500 * 2**20  # of a cluster on this machine, for what goes to its tasks and comes back


def uses_ray(engine: str, address: str | None) -> bool:
    """Return True for the engine `ray`, False for `local`. Raises ConfigError."""
    if engine not in ("local", "ray"):
        raise ConfigError.at("--engine", f"is unknown: {engine!r}", "local or ray")
    if engine == "local" and address is not None:
        raise ConfigError.at("--address", "belongs to --engine ray")
    return engine == "ray"


def join_ray(address: str | None, cpus: int, say: Say) -> Any:
    """Begin a cluster on this machine, or join the one at `address`, and return the module `ray`, quiet.

    `say` is called with what is waited for. Raises ConfigError, RecordingError.
    """
    if find_spec("ray") is None:
        hint = 'pip install "hil-bench[ray]", or leave --engine out'
        raise ConfigError.at("--engine ray", "needs Ray, which is not installed", hint)
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # Ray sends nothing about its use
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    settings: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR", "configure_logging": False}
    if address is None:
        os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"  # 127.0.0.1 stays that address, on Linux too
        where, what = "a cluster on this machine", "Ray: waiting for a cluster on this machine to begin"
        settings |= {"address": "local", "num_cpus": cpus, "include_dashboard": False}
        settings |= {"object_store_memory": _STORE_BYTES, "_node_ip_address": "127.0.0.1"}
    else:
        where, what = f"the cluster at {address}", f"Ray: waiting for the cluster at {address} to let this process in"
        _check_address(address, say)
        settings["address"] = address
    import ray  # it reads RAY_AUTH_MODE now

    logging.getLogger("ray").setLevel(logging.ERROR)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with waiting_for(what, say):
            ray.init(**settings)
    except Exception as error:
        text = str(error).strip().partition("\n")[0]
        raise RecordingError(f"--engine ray: {where} cannot be used ({text})") from error
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    return ray


def _check_address(address: str, say: Say) -> None:
    """Check that the cluster at `address` can be joined, with the token of this machine if it asks for one.

    Raises ConfigError, RecordingError.
    """
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ConfigError.at("--address", f"is not HOST:PORT: {address!r}", "`ray start --head` prints it")
    try:
        socket.create_connection((host.strip("[]"), int(port)), _CONNECT_S).close()
    except OSError as error:
        text = f"no Ray cluster answers at {address} ({error.strerror or error}); `ray start --head` prints the address"
        raise RecordingError(f"--engine ray: {text}") from None
    why = _why_not(address, say)
    if is_refused(why) and use_token():
        why = _why_not(address, say)
    if why:
        last = f"{why.splitlines()[-1]}; it needs the same versions of Python and Ray and, if it has one, its token"
        raise RecordingError(f"--engine ray: the cluster at {address} cannot be joined: {refusal(why) or last}")


def _why_not(address: str, say: Say) -> str:
    """Return what Ray says when it cannot join, empty if it can. Raises RecordingError after a long time.

    Ray ends the whole process where it cannot join, so another process tries. It is ended at the first word about the
    token: Ray tries again for 20 s.
    """
    trial = [sys.executable, "-P", "-c", f"import ray; ray.init(address={address!r}, logging_level='ERROR')"]
    said, end_s = "", time.monotonic() + _JOIN_S
    with (
        waiting_for(f"Ray: waiting for the cluster at {address} to let a first process in", say),
        subprocess.Popen(trial, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as tried,
    ):
        limit = threading.Timer(_JOIN_S, tried.kill)
        limit.start()
        try:
            assert tried.stderr is not None
            for line in tried.stderr:
                said += line
                if is_refused(line):
                    break
            else:
                tried.wait()
        finally:
            limit.cancel()
            tried.kill()
    if time.monotonic() >= end_s:
        raise RecordingError(f"--engine ray: no Ray cluster answers at {address} within {_JOIN_S:g} s")
    return "" if tried.returncode == 0 else said.strip() or "it gives no reason"
