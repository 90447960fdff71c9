"""One flight of a campaign, made in a worker: the job, and its outcome as plain data."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

from signals.errors import ConfigError
from signals.shortage import named

# none: no recording. messages: run.mcap without pictures, for the comparison of two flights. all: also pictures, tlog
# and report. The choice changes no digest, except that `all` draws pictures which nobody else may have asked for.
Recording = Literal["none", "messages", "all"]

_RECORD = {
    "none": {"mcap": False, "images": False, "tlog": False, "report": False},
    "messages": {"mcap": True, "images": False, "tlog": False, "report": False},
    "all": {"mcap": True, "images": True, "tlog": True, "report": True},
}


@dataclass(frozen=True)
class Job:
    """A flight to make. `bench`: file of the base bench; `texts`: settings as texts of `--set`."""

    case: str
    bench: str | None
    texts: tuple[str, ...]
    folder: str  # for the files of the run
    recording: Recording = "none"
    keep: bool = True  # False: a recording is removed after a PASS
    flown_at: str = ""  # place of the case's first flight; this one is made on another node if there is one


@dataclass(frozen=True)
class Limit:
    """One measurement of a flight beside its limit, as in run.json."""

    name: str
    value: float | None
    limit: float | None
    unit: str
    ok: bool | None

    @property
    def margin(self) -> float | None:
        """Distance to the limit in units of the limit, negative where it is not met; None: not judged or measured.

        The limit is a minimum if a value above it is met, or one below it is not.
        """
        if self.limit is None or self.value is None:
            return None
        room = self.limit - self.value
        is_minimum = (room < 0.0) == bool(self.ok) and room != 0.0
        return (-room if is_minimum else room) / (abs(self.limit) or 1.0)


@dataclass(frozen=True)
class Outcome:
    """Outcome of one flight."""

    status: str  # PASS, FAIL or ERROR
    reasons: tuple[str, ...] = ()  # of a FAIL
    error_type: str = ""
    error: str = ""
    limits: tuple[Limit, ...] = ()
    digest: str = ""
    repeatable: bool = False
    sim_s: float = 0.0
    wall_s: float = 0.0  # of the whole job
    cpu_s: float = 0.0  # of the worker's own process
    place: str = ""  # worker that made it
    unmet: tuple[str, ...] = ()  # of what the bench declares: faults and gusts that did not come, or the whole flight
    flown: bool = True  # False: the vehicle, or every one of several, never left its start, and passed

    @classmethod
    def from_run(cls, run: Mapping[str, Any]) -> Outcome:
        """Return the outcome of a flight from the content of its run.json."""
        error = run["error"] or {}
        rows = [
            Limit(*(row[key] for key in ("name", "value", "limit", "unit", "ok"))) for row in run["verdict"]["rows"]
        ]
        vehicles = run.get("vehicles", {}).items()
        stayed = [f"{name}: {vehicle['unflown']}" for name, vehicle in vehicles if "unflown" in vehicle]
        return cls(
            run["status"],
            tuple(run["verdict"]["reasons"]),
            error.get("type", ""),
            error.get("message", ""),
            tuple(rows),
            run["digest"],
            bool(run["deterministic"]),
            run["sim_s"],
            unmet=(*([run["unflown"]] if "unflown" in run else stayed), *run.get("unmet", ())),
            flown=run["status"] != "PASS" or "unflown" not in run,
        )

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Outcome:
        """Return the outcome that `data` wrote."""
        limits = tuple(Limit(**limit) for limit in data["limits"])
        texts = {name: tuple(data.get(name, ())) for name in ("reasons", "unmet")}
        return cls(**{**data, **texts, "limits": limits})

    def data(self) -> dict[str, Any]:
        """Return the fields as plain data."""
        return asdict(self)

    @property
    def worst(self) -> Limit | None:
        """The limit with the smallest margin; None: nothing was judged."""
        judged = [limit for limit in self.limits if limit.margin is not None]
        return min(judged, key=lambda limit: limit.margin or 0.0, default=None)


class Slot(NamedTuple):
    """Place of a worker among those of one machine. Simulated autopilots need ports and processors of their own."""

    number: int = 0
    processors: tuple[int, ...] = ()  # empty: all
    name: str = ""


ONLY = Slot()


def fly(job: Job, slot: Slot = ONLY) -> Outcome:
    """Make a flight.

    Every failure is an outcome with the status ERROR. KeyboardInterrupt passes through.
    """
    began_s, began_cpu_s = time.monotonic(), time.process_time()
    folder = Path(job.folder)
    try:
        outcome = _flown(job, slot, folder)
    except Exception as error:  # noqa: BLE001 (one flight must not end a campaign)
        told = named(error)
        if told is None:
            outcome = Outcome("ERROR", error_type=type(error).__name__, error=f"{error} (a defect of the bench)")
        else:
            kind = "ConfigError" if isinstance(told, ConfigError) else type(told).__name__
            outcome = Outcome("ERROR", error_type=kind, error=str(told))
    if job.recording == "none" or (not job.keep and outcome.status == "PASS"):
        shutil.rmtree(folder, ignore_errors=True)
    wall_s, cpu_s = time.monotonic() - began_s, time.process_time() - began_cpu_s
    return replace(outcome, wall_s=wall_s, cpu_s=cpu_s, place=slot.name)


def _flown(job: Job, slot: Slot, folder: Path) -> Outcome:
    from hil.apps.campaign.engines.ports import with_own_ports
    from hil.config import load_bench
    from hil.run.bench_run import run_bench

    record = [f"record.{key}={str(value).lower()}" for key, value in _RECORD[job.recording].items()]
    bench = with_own_ports(load_bench(job.bench, settings=[*job.texts, *record]), slot.number)
    if bench.config.autopilot.profile.is_program and slot.processors:
        os.sched_setaffinity(0, slot.processors)  # bench and autopilot take turns on one of them
    result = run_bench(bench, folder, quiet=True)
    if (result.run["error"] or {}).get("type") == "Interrupted":
        raise KeyboardInterrupt
    return Outcome.from_run(result.run)
