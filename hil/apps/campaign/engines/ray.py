"""Engine on a Ray cluster: every flight is a task with the processors, memory and resources that it declares."""

from __future__ import annotations

import time
from pathlib import Path

from hil.apps.campaign.cases.campaign_file import CampaignSpec
from hil.apps.campaign.engines.engine import Done
from hil.apps.campaign.engines.packer import Packer
from hil.apps.campaign.engines.ray_node import Order, fly_task
from hil.apps.campaign.flight import Job, Outcome
from hil.cluster.program import Program
from hil.cluster.tasks import Ended, Needs, RayTasks, short_name
from hil.cluster.waiting import Say
from hil.config import load_bench
from signals.errors import HilError


class RayEngine:
    """Flights as tasks on the nodes of a Ray cluster."""

    def __init__(
        self, spec: CampaignSpec, *, address: str | None, workers: int | None, processors: int, say: Say
    ) -> None:
        """`address` None: a cluster of `workers` flights on this machine, by default as many as `processors` allow.

        Otherwise `workers` limits the flights at a time. `say` is called with what is waited for at the begin.
        Raises ConfigError, RecordingError.
        """
        if address is None:
            workers = workers or max(1, processors // spec.cores)
        needs = Needs(spec.cores, spec.memory_mb, spec.resources, _NEEDS_HINT)
        self._tasks = RayTasks(fly_task, needs, address=address, at_once=workers, say=say)
        self._order = Order(Program.here(), 0, spec.cores, spec.flight_timeout_s)
        self._packer = Packer()
        self._unflown: list[Done] = []  # jobs that ended before they began

    @property
    def capacity(self) -> int:
        """Number of flights that fit on the cluster, and some more so that no node waits for its next one."""
        return self._tasks.capacity

    @property
    def busy(self) -> int:
        return self._tasks.busy + len(self._unflown)

    def submit(self, job: Job) -> None:
        """Begin a job as a task of Ray."""
        try:
            parcel = self._packer.pack(job, load_bench(job.bench, settings=job.texts))
        except HilError as error:
            self._unflown.append(Done(job, Outcome("ERROR", error_type=type(error).__name__, error=str(error))))
            return
        archives = {
            name: self._tasks.put(name, lambda name=name: self._packer.archives[name])  # type: ignore[misc]
            for name in parcel.trees
        }
        self._tasks.submit(job, parcel, archives, self._order, node=self._other_node(job))

    def wait(self, timeout_s: float) -> list[Done]:
        """Return the jobs that have ended, waiting for the first of them at most `timeout_s`."""
        ended, self._unflown = self._unflown, []
        if not self._tasks.busy and not ended:
            time.sleep(timeout_s)
        return ended + [self._done(task) for task in self._tasks.wait(0.0 if ended else timeout_s)]

    def renew(self) -> None:
        """Make the next flights in other processes, without those of a campaign that a rule has stopped."""
        self._tasks.cancel()
        order = self._order
        self._order = Order(order.program, order.generation + 1, order.cores, order.timeout_s)

    def close(self) -> None:
        """Leave the cluster, which ends the flights that still run."""
        self._tasks.close()

    def _done(self, task: Ended) -> Done:
        job, reply = task.key, task.reply
        if reply is None:
            return Done(job, None, task.lost)
        if reply.recording:
            self._packer.unpack_recording(reply.recording, Path(job.folder))
        return Done(job, reply.outcome, reply.lost)

    def _other_node(self, job: Job) -> str | None:
        """Return another node than that of the first flight, if this is the second and there is one."""
        others = [node for node in self._tasks.nodes if short_name(node) not in job.flown_at]
        return others[int(job.case[:8], 16) % len(others)] if job.flown_at and others else None


_NEEDS_HINT = (
    "cores, memory_mb and resources of the campaign's file; start nodes with them, as in "
    "`ray start --address HOST:6379 --resources '{\"px4_board\": 1}'`, and name the cluster with --address"
)
