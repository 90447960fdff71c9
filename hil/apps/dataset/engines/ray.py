"""Workers of a data set on a Ray cluster: every batch is a task, and this machine writes the files that come back.

A batch whose worker or node is lost is made again on what is left.
"""

from __future__ import annotations

from collections import Counter

from hil.apps.dataset.batch_maker import BatchMakerFactory
from hil.apps.dataset.engines.jobs import Job, JobResult
from hil.apps.dataset.engines.ray_node import Order, make_batch
from hil.apps.dataset.plan import DatasetPlan
from hil.apps.dataset.storage.manifest import LIBRARIES, saved_bench
from hil.apps.dataset.storage.recording import is_complete
from hil.cluster.program import Program
from hil.cluster.tasks import Ended, Needs, RayTasks
from hil.cluster.trees import packed_files, tree_name
from hil.cluster.waiting import Say
from signals.errors import RecordingError

ATTEMPTS = 3  # tasks of a batch whose worker is lost
_WAIT_S = 0.5


def batch_tasks(*, address: str | None, at_once: int | None, say: Say) -> RayTasks:
    """Join the cluster at `address`, where `at_once` limits the tasks at a time; None: one of `at_once` tasks here.

    `say` is called with what is waited for at the begin.

    Raises ConfigError, RecordingError.
    """
    return RayTasks(make_batch, Needs(), address=address, at_once=at_once, say=say)


class RayWorkers:
    """Tasks that make batches."""

    def __init__(self, tasks: RayTasks, plan: DatasetPlan, factory: BatchMakerFactory) -> None:
        """`tasks` are those of `batch_tasks`; `close` closes them. Raises RecordingError."""
        self._tasks, self._tree = tasks, factory.tree
        archive = packed_files(saved_bench(plan))
        name = tree_name(archive)
        self._order = Order(Program.here(packages=("hil.apps.dataset",), libraries=LIBRARIES), name, factory)
        self._archives = {name: tasks.put(name, lambda: archive)}
        self._complete: list[JobResult] = []  # batches that need no task
        self._lost: Counter[int] = Counter()

    @property
    def capacity(self) -> int:
        """Number of batches that fit on the cluster, and some more so that no node waits for its next one."""
        return self._tasks.capacity

    @property
    def busy(self) -> int:
        return self._tasks.busy + len(self._complete)

    def submit(self, job: Job) -> None:
        """Begin a batch, unless an earlier attempt left it complete: its files are on this machine."""
        if job.expected is not None and is_complete(self._tree, job.expected, job.offset):
            self._complete.append(JobResult(job.batch.index, was_complete=True))
            return
        self._begin(job._replace(expected=None))

    def _begin(self, job: Job) -> None:
        self._tasks.submit(job, job, self._order, self._archives)

    def collect(self, *, block: bool) -> list[JobResult]:
        """Return finished batches, their files written; with `block`, wait for at least one unless none is pending.

        Raises RecordingError if a batch cannot be made or written.
        """
        results, self._complete = self._complete, []
        while True:
            wait_s = _WAIT_S if block and not results else 0.0
            results += [result for ended in self._tasks.wait(wait_s) if (result := self._finished(ended)) is not None]
            if results or not block or not self._tasks.busy:
                return results

    def _finished(self, ended: Ended) -> JobResult | None:
        """Write the files of a batch; None: it was lost and begins again."""
        job: Job = ended.key
        number = job.batch.index
        if ended.reply is None:
            self._lost[number] += 1
            if self._lost[number] >= ATTEMPTS:
                raise RecordingError(
                    f"batch {number} was lost {ATTEMPTS} times, at last: {ended.lost}. Everything written so far is "
                    "kept; continue with --resume"
                )
            self._begin(job)
            return None
        if ended.reply.error:
            raise RecordingError(ended.reply.error)
        for path, data in ended.reply.files.items():
            self._tree.write(path, data)
        return JobResult(number, was_complete=False)

    def close(self) -> None:
        """Leave the cluster, which ends the tasks that still run."""
        self._tasks.close()
