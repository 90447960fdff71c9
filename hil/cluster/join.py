"""Joins a Ray cluster, or begins one on this machine. Ray is imported here, and only if it is asked for."""

from __future__ import annotations

import logging
import os
import signal
import socket
import subprocess
import sys
from typing import Any

from signals.errors import ConfigError, Problem, RecordingError

_CONNECT_S = 10.0  # to a port of the cluster
_JOIN_S = 60.0  # of Ray itself, to join a cluster
_STORE_BYTES = 500 * 2**20  # of a cluster on this machine, for what goes to its tasks and comes back


def uses_ray(engine: str, address: str | None) -> bool:
    """Return True for the engine `ray`, False for `local`. Raises ConfigError."""
    if engine not in ("local", "ray"):
        raise ConfigError([Problem("--engine", f"is unknown: {engine!r}", "local or ray")])
    if engine == "local" and address is not None:
        raise ConfigError([Problem("--address", "belongs to --engine ray")])
    return engine == "ray"


def installed_ray(*, alone: bool) -> Any:
    """Return the module `ray`, quiet; `alone`: its cluster is reached from this machine only. Raises ConfigError."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # Ray sends nothing about its use
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    if alone:
        os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"  # 127.0.0.1 stays that address, on Linux too
    try:
        import ray
    except ImportError:
        hint = 'pip install "hil-bench[ray]", or leave --engine out'
        raise ConfigError([Problem("--engine ray", "needs Ray, which is not installed", hint)]) from None
    logging.getLogger("ray").setLevel(logging.ERROR)
    return ray


def join_cluster(ray: Any, address: str | None, cpus: int) -> None:
    """Begin a cluster on this machine, or join the one at `address`. Raises ConfigError, RecordingError."""
    settings: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR", "configure_logging": False}
    if address is None:
        where = "a cluster on this machine"
        settings |= {"address": "local", "num_cpus": cpus, "include_dashboard": False}
        settings |= {"object_store_memory": _STORE_BYTES, "_node_ip_address": "127.0.0.1"}
    else:
        where = f"the cluster at {address}"
        _check_address(address)
        settings["address"] = address
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        ray.init(**settings)
    except Exception as error:
        text = str(error).strip().partition("\n")[0]
        raise RecordingError(f"--engine ray: {where} cannot be used ({text})") from error
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _check_address(address: str) -> None:
    """Check that something listens at `address`. Raises ConfigError, RecordingError."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ConfigError([Problem("--address", f"is not HOST:PORT: {address!r}", "`ray start --head` prints it")])
    try:
        socket.create_connection((host.strip("[]"), int(port)), _CONNECT_S).close()
    except OSError as error:
        text = f"no Ray cluster answers at {address} ({error.strerror or error}); `ray start --head` prints the address"
        raise RecordingError(f"--engine ray: {text}") from None
    # Ray ends the whole process where it cannot join, so another process tries first.
    trial = [sys.executable, "-P", "-c", f"import ray; ray.init(address={address!r}, logging_level='ERROR')"]
    try:
        tried = subprocess.run(trial, capture_output=True, timeout=_JOIN_S, check=False, text=True)
    except subprocess.TimeoutExpired:
        raise RecordingError(f"--engine ray: no Ray cluster answers at {address} within {_JOIN_S:g} s") from None
    if tried.returncode:
        text = (tried.stderr.strip().splitlines() or ["it gives no reason"])[-1]
        raise RecordingError(f"--engine ray: the cluster at {address} cannot be joined ({text})")
