"""An engine of campaigns whose flights are answered by a function of the bench, in any order of their ends."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from hil.apps.campaign.engines.engine import Done
from hil.apps.campaign.flight import Job, Limit, Outcome
from hil.config import Bench, load_bench

PASS = Outcome("PASS", limits=(Limit("max_cross_track_m", 0.4, 1.0, "m", True),), digest="p", repeatable=True)


def failure(value_m: float = 1.5, *, repeatable: bool = True) -> Outcome:
    """Return the outcome of a flight that left its leg by `value_m`."""
    reason = f"max_cross_track_m is {value_m:.3g} m, more than the 1 m allowed"
    limits = (Limit("max_cross_track_m", value_m, 1.0, "m", False),)
    return Outcome("FAIL", (reason,), limits=limits, digest=f"f{value_m}", repeatable=repeatable)


class OracleEngine:
    """Engine without flights. `lost`: numbers of the jobs whose worker is lost."""

    def __init__(
        self, oracle: Callable[[Bench], Outcome], capacity: int = 1, *, order: int = 0, lost: tuple[int, ...] = ()
    ) -> None:
        self._oracle, self.capacity, self._random, self._lost = oracle, capacity, Random(order), lost
        self._jobs: list[Job] = []
        self.flown: list[str] = []

    @property
    def busy(self) -> int:
        return len(self._jobs)

    def submit(self, job: Job) -> None:
        assert self.busy < self.capacity
        self._jobs.append(job)

    def wait(self, timeout_s: float) -> list[Done]:
        job = self._jobs.pop(self._random.randrange(len(self._jobs)))
        self.flown.append(job.case)
        if len(self.flown) in self._lost:
            return [Done(job, None, "worker 0 was ended by SIGKILL")]
        return [Done(job, self._oracle(load_bench(job.bench, settings=job.texts)))]

    def renew(self) -> None:
        self._jobs.clear()

    def close(self) -> None:
        self._jobs.clear()
