"""Tasks on a Ray cluster. Each has the processors, memory and resources that it declares, and Ray places it.

A node needs the same version of hil-bench and no file of this machine. A task whose worker or node is lost comes back
as lost, and the caller makes it again.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from hil.cluster.join import join_ray
from hil.cluster.program import OtherProgram
from hil.cluster.waiting import AGAIN_S, Say
from signals.errors import ConfigError, Problem, RecordingError

_NODES_PERIOD_S = 2.0  # the nodes are counted this often
_NO_NODE_S = 60.0  # without a node on which a task fits, then the work ends
_NO_HEAD_S = 20.0  # without the head of the cluster; Ray itself would end the whole process after 60 s
_CONNECT_S = 5.0


@dataclass(frozen=True)
class Needs:
    """Resources of one task; `hint` says how a cluster gets them."""

    cores: int = 1
    memory_mb: float | None = None
    resources: Mapping[str, float] = field(default_factory=dict)
    hint: str = "start nodes with `ray start --address HOST:6379`, and name the cluster with --address"

    @property
    def by_name(self) -> dict[str, float]:
        """All resources, as Ray counts them for a node."""
        memory = {} if self.memory_mb is None else {"memory": self.memory_mb * 2.0**20}
        return {"CPU": float(self.cores), **self.resources, **memory}

    @property
    def options(self) -> dict[str, Any]:
        """Options of a task."""
        memory = {} if self.memory_mb is None else {"memory": self.memory_mb * 2**20}
        return {"num_cpus": self.cores, "resources": dict(self.resources), **memory}

    def __str__(self) -> str:
        return ", ".join(f"{name}: {need:g}" for name, need in self.by_name.items())


class Ended(NamedTuple):
    """A task that has ended, by the key it was submitted with. `reply` None: it was lost."""

    key: Any
    reply: Any
    lost: str = ""  # how it was lost


class RayTasks:
    """Calls of one function, each a task on a node of the cluster."""

    def __init__(
        self, function: Callable[..., Any], needs: Needs, *, address: str | None, at_once: int | None, say: Say
    ) -> None:
        """`at_once` limits the tasks at a time on the cluster at `address`; None: as many as fit.

        `address` None: a cluster of `at_once` tasks on this machine. `say` is called with what is waited for, until the
        first task has ended. Raises ConfigError, RecordingError.
        """
        self._ray = join_ray(address, (at_once or 1) * needs.cores, say)
        self._say: Say | None = say  # None: a task has ended
        self._at_once = None if address is None else at_once
        self._needs = needs
        self._task = self._ray.remote(function)
        self._objects: dict[str, Any] = {}  # references by name
        self._running: dict[Any, Any] = {}  # keys by reference
        self._places: dict[str, int] = {}  # tasks that fit on each node
        self._head = self._ray.get_runtime_context().gcs_address.rsplit(":", 1)
        self._counted_s, self._last_place_s = -_NODES_PERIOD_S, time.monotonic()
        self._last_head_s = self._last_place_s
        self._count_nodes()
        if not self._places:
            self.close()
            raise ConfigError.at("--engine ray", f"no node of the cluster has {needs}", needs.hint)
        say(f"Ray: {len(self._places)} node(s) with room for {sum(self._places.values())} task(s) at a time")
        self._begun_s = self._said_s = time.monotonic()

    @property
    def capacity(self) -> int:
        """Number of tasks that fit on the cluster, and some more so that no node waits for its next one."""
        self._count_nodes()
        fit = sum(self._places.values())
        most = fit + 1 + fit // 4
        return most if self._at_once is None else min(self._at_once, most)

    @property
    def busy(self) -> int:
        """Number of tasks that have begun and were not returned by `wait`."""
        return len(self._running)

    @property
    def nodes(self) -> list[str]:
        """Nodes on which a task fits, sorted."""
        return sorted(self._places)

    def put(self, name: str, content: Callable[[], bytes]) -> Any:
        """Return the reference of an object for tasks. Its content is sent to a node once, when a task asks for it."""
        if name not in self._objects:
            with self._cluster():
                self._objects[name] = self._ray.put(content())
        return self._objects[name]

    def submit(self, key: Any, *arguments: Any, node: str | None = None) -> None:
        """Begin a task, on `node` if it is still there."""
        options = self._needs.options | {"max_retries": 0}
        if node is not None:
            from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

            options["scheduling_strategy"] = NodeAffinitySchedulingStrategy(node, soft=True)
        with self._cluster():
            self._running[self._task.options(**options).remote(*arguments)] = key

    def wait(self, timeout_s: float) -> list[Ended]:
        """Return the tasks that have ended, waiting for the first of them at most `timeout_s`."""
        self._count_nodes()
        if not self._running:
            return []
        with self._cluster():
            ready, _ = self._ray.wait(list(self._running), timeout=timeout_s, fetch_local=False)
            if ready:
                ready, _ = self._ray.wait(
                    list(self._running), num_returns=len(self._running), timeout=0.0, fetch_local=False
                )
        self._tell_first(bool(ready))
        return [self._ended(reference) for reference in ready]

    def _tell_first(self, ended: bool) -> None:
        """Say again and again that no task has ended yet."""
        now_s = time.monotonic()
        if ended:
            self._say = None
        elif self._say is not None and now_s - self._said_s >= AGAIN_S:
            self._said_s = now_s
            self._say(
                f"Ray: waiting for the first of {len(self._running)} task(s), for {now_s - self._begun_s:.0f} s now; "
                "each node starts processes first, which load hil-bench"
            )

    def cancel(self) -> None:
        """Forget all tasks and end their processes."""
        with self._cluster():
            for reference in self._running:
                self._ray.cancel(reference, force=True)
        self._running.clear()

    def close(self) -> None:
        """Leave the cluster, which ends the tasks that still run. Idempotent."""
        with suppress(Exception):
            self._ray.shutdown()

    def _ended(self, reference: Any) -> Ended:
        key = self._running.pop(reference)
        try:
            return Ended(key, self._ray.get(reference))
        except self._ray.exceptions.RayTaskError as error:
            if isinstance(error.cause, OtherProgram | ImportError):
                raise ConfigError([_other_program(error.cause)]) from None
            return Ended(key, None, f"{type(error.cause).__name__} on a node: {error.cause}")
        except self._ray.exceptions.RayError as error:
            return Ended(key, None, str(error).strip().partition("\n")[0])

    def _count_nodes(self) -> None:
        """Count the tasks that fit on each node. Raises RecordingError if there was none for a long time."""
        now_s = time.monotonic()
        if now_s - self._counted_s < _NODES_PERIOD_S:
            return
        self._counted_s = now_s
        if not self._head_answers(now_s):
            return
        with self._cluster():
            nodes = [node for node in self._ray.nodes() if node["Alive"]]
        needs = self._needs.by_name
        fits = {
            node["NodeID"]: int(min(node["Resources"].get(name, 0.0) / need for name, need in needs.items()))
            for node in nodes
        }
        self._places = {node: fit for node, fit in fits.items() if fit}
        if self._places:
            self._last_place_s = now_s
        elif now_s - self._last_place_s > _NO_NODE_S:
            raise RecordingError(
                f"no node of the cluster has {self._needs} since {_NO_NODE_S:g} s. Everything stored so far is kept; "
                "continue with --resume"
            )

    def _head_answers(self, now_s: float) -> bool:
        """Return True if something listens at the head's address. Raises RecordingError after a long time without."""
        host, port = self._head
        try:
            socket.create_connection((host.strip("[]"), int(port)), _CONNECT_S).close()
        except OSError as error:
            if now_s - self._last_head_s > _NO_HEAD_S:
                raise _lost(f"its head at {host}:{port} does not answer: {error.strerror or error}") from error
            return False
        self._last_head_s = now_s
        return True

    @contextmanager
    def _cluster(self) -> Iterator[None]:
        try:
            yield
        except (self._ray.exceptions.RayError, ConnectionError, RuntimeError, TimeoutError) as error:
            raise _lost(str(error).strip().partition("\n")[0]) from error


def _lost(text: str) -> RecordingError:
    return RecordingError(f"the Ray cluster is lost ({text}). Everything stored so far is kept; continue with --resume")


def this_node() -> str:
    """Return the name of the node on which a task runs."""
    import ray

    return f"node {short_name(ray.get_runtime_context().get_node_id())} ({socket.gethostname()})"


def short_name(node: str) -> str:
    """Return the part of a node's identity that names it for people."""
    return node[:12]


def _other_program(cause: BaseException) -> Problem:
    if isinstance(cause, ImportError):
        return Problem(
            "--engine ray", f"a node has no hil-bench, or not all of it: {cause}", "install this version there"
        )
    return Problem("--engine ray", f"a node has {cause}", "install the versions of this machine there")
