"""Engine on a Ray cluster: every flight is a task with the processors, memory and resources that it declares.

A node needs the same version of hil-bench and no file of the campaign. Ray places the tasks; a flight whose worker or
node is lost comes back as lost, and the campaign makes it again.
"""

from __future__ import annotations

import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from hil.apps.campaign.engines.engine import Done
from hil.apps.campaign.engines.packer import Packer
from hil.apps.campaign.engines.program import source_digest
from hil.apps.campaign.engines.ray_node import Order, OtherProgram, fly_task
from hil.apps.campaign.flight import Job, Outcome
from hil.apps.campaign.spec.campaign_file import CampaignSpec
from hil.config import load_bench
from signals.errors import ConfigError, HilError, Problem, RecordingError

_CONNECT_S = 10.0  # to a port of the cluster
_JOIN_S = 60.0  # of Ray itself, to join a cluster
_NODES_PERIOD_S = 2.0  # the nodes are counted this often
_NO_NODE_S = 60.0  # without a node that could fly, then the campaign ends
_STORE_BYTES = 500 * 2**20  # of a cluster on this machine, for firmware, maps and recordings on their way


class RayEngine:
    """Tasks on the nodes of a Ray cluster."""

    def __init__(self, spec: CampaignSpec, *, address: str | None, workers: int | None, processors: int) -> None:
        """`address` None: a cluster of `workers` flights on this machine, by default as many as `processors` allow.

        Otherwise `workers` limits the flights at a time. Raises ConfigError, RecordingError.
        """
        self._ray = _installed_ray(alone=address is None)
        at_once = workers or max(1, processors // spec.cores)
        _join(self._ray, address, at_once * spec.cores)
        self._most = workers
        self._order = Order(source_digest(), 0, spec.cores, spec.flight_timeout_s)
        self._needs = {"CPU": float(spec.cores), **spec.resources}
        if spec.memory_mb is not None:
            self._needs["memory"] = spec.memory_mb * 2.0**20
        options: dict[str, Any] = {"num_cpus": spec.cores, "resources": spec.resources, "max_retries": 0}
        if spec.memory_mb is not None:
            options["memory"] = spec.memory_mb * 2**20
        self._options = options
        self._task = self._ray.remote(fly_task)
        self._packer = Packer()
        self._archives: dict[str, Any] = {}  # references by name of tree
        self._running: dict[Any, Job] = {}
        self._ended: list[Done] = []  # jobs that ended before they began
        self._places: dict[str, int] = {}  # flights that fit on each node
        self._counted_s, self._last_place_s = -_NODES_PERIOD_S, time.monotonic()
        self._count_nodes()
        if not self._places:
            self.close()
            raise ConfigError(
                [Problem("--engine ray", f"no node of the cluster has {self._shown_needs()}", _NEEDS_HINT)]
            )

    @property
    def capacity(self) -> int:
        """Number of flights that fit on the cluster, and some more so that no node waits for its next one."""
        self._count_nodes()
        fit = sum(self._places.values())
        return min(self._most or fit + 1 + fit // 4, fit + 1 + fit // 4)

    @property
    def busy(self) -> int:
        return len(self._running) + len(self._ended)

    def submit(self, job: Job) -> None:
        """Begin a job as a task of Ray."""
        try:
            parcel = self._packer.pack(job, load_bench(job.bench, settings=job.texts))
        except HilError as error:
            self._ended.append(Done(job, Outcome("ERROR", error_type=type(error).__name__, error=str(error))))
            return
        with self._cluster():
            for name in parcel.trees:
                if name not in self._archives:
                    self._archives[name] = self._ray.put(self._packer.archives[name])
            archives = {name: self._archives[name] for name in parcel.trees}
            reference = self._task.options(**self._options, **self._affinity(job)).remote(parcel, archives, self._order)
        self._running[reference] = job

    def wait(self, timeout_s: float) -> list[Done]:
        """Return the jobs that have ended, waiting for the first of them at most `timeout_s`."""
        ended, self._ended = self._ended, []
        if not self._running:
            if not ended:
                time.sleep(timeout_s)
            return ended
        with self._cluster():
            ready, _ = self._ray.wait(list(self._running), timeout=0.0 if ended else timeout_s, fetch_local=False)
            if ready:
                ready, _ = self._ray.wait(
                    list(self._running), num_returns=len(self._running), timeout=0.0, fetch_local=False
                )
        return ended + [self._taken(reference) for reference in ready]

    def renew(self) -> None:
        """Make the next flights in other processes, without those of a campaign that a rule has stopped."""
        with self._cluster():
            for reference in self._running:
                self._ray.cancel(reference, force=True)
        self._running.clear()
        order = self._order
        self._order = Order(order.sources, order.generation + 1, order.cores, order.timeout_s)

    def close(self) -> None:
        """Leave the cluster, which ends the tasks that still run."""
        with suppress(Exception):
            self._ray.shutdown()

    def _taken(self, reference: Any) -> Done:
        """Return the end of a task: its outcome, or how it was lost."""
        job = self._running.pop(reference)
        try:
            reply = self._ray.get(reference)
        except self._ray.exceptions.RayTaskError as error:
            if isinstance(error.cause, OtherProgram | ImportError):
                raise ConfigError([_other_program(error.cause)]) from None
            return Done(job, None, f"{type(error.cause).__name__} on a node: {error.cause}")
        except self._ray.exceptions.RayError as error:
            return Done(job, None, str(error).strip().partition("\n")[0])
        if reply.recording:
            self._packer.unpack_recording(reply.recording, Path(job.folder))
        return Done(job, reply.outcome, reply.lost)

    def _affinity(self, job: Job) -> dict[str, Any]:
        """Return the option that sends a second flight to another node than the first, if there is one."""
        others = [node for node in sorted(self._places) if node[:12] not in job.flown_at]
        if not job.flown_at or not others:
            return {}
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        node = others[int(job.case[:8], 16) % len(others)]
        return {"scheduling_strategy": NodeAffinitySchedulingStrategy(node, soft=True)}

    def _count_nodes(self) -> None:
        """Count the flights that fit on each node. Raises RecordingError if there was none for a long time."""
        now_s = time.monotonic()
        if now_s - self._counted_s < _NODES_PERIOD_S:
            return
        self._counted_s = now_s
        with self._cluster():
            nodes = [node for node in self._ray.nodes() if node["Alive"]]
        fits = {
            node["NodeID"]: int(min(node["Resources"].get(name, 0.0) / need for name, need in self._needs.items()))
            for node in nodes
        }
        self._places = {node: fit for node, fit in fits.items() if fit}
        if self._places:
            self._last_place_s = now_s
        elif now_s - self._last_place_s > _NO_NODE_S:
            raise RecordingError(
                f"no node of the cluster has {self._shown_needs()} since {_NO_NODE_S:g} s. Everything stored so far is "
                "kept; continue with --resume"
            )

    def _shown_needs(self) -> str:
        return ", ".join(f"{name}: {need:g}" for name, need in self._needs.items())

    @contextmanager
    def _cluster(self) -> Iterator[None]:
        try:
            yield
        except (self._ray.exceptions.RayError, ConnectionError, RuntimeError, TimeoutError) as error:
            text = str(error).strip().partition("\n")[0]
            raise RecordingError(
                f"the Ray cluster is lost ({text}). Everything stored so far is kept; continue with --resume"
            ) from error


_NEEDS_HINT = (
    "cores, memory_mb and resources of the campaign's file; start nodes with them, as in "
    "`ray start --address HOST:6379 --resources '{\"px4_board\": 1}'`, and name the cluster with --address"
)


def _installed_ray(*, alone: bool) -> Any:
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


def _join(ray: Any, address: str | None, cpus: int) -> None:
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
    trial = [sys.executable, "-c", f"import ray; ray.init(address={address!r}, logging_level='ERROR')"]
    try:
        tried = subprocess.run(trial, capture_output=True, timeout=_JOIN_S, check=False, text=True)
    except subprocess.TimeoutExpired:
        raise RecordingError(f"--engine ray: no Ray cluster answers at {address} within {_JOIN_S:g} s") from None
    if tried.returncode:
        text = (tried.stderr.strip().splitlines() or ["it gives no reason"])[-1]
        raise RecordingError(f"--engine ray: the cluster at {address} cannot be joined ({text})")


def _other_program(cause: BaseException) -> Problem:
    hint = "install this version there"
    if isinstance(cause, ImportError):
        return Problem(
            "--engine ray", f"a node has no hil-bench, or not all of it: {cause}", "install this version there"
        )
    return Problem("--engine ray", "a node has another version of hil-bench", hint)
