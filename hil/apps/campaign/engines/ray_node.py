"""One flight of a campaign on a node of a Ray cluster, in a process of its own that ends with Ray's worker."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hil.apps.campaign.engines.local import LocalEngine
from hil.apps.campaign.engines.parcel import Parcel, Reply, packed_recording, write_bench
from hil.cluster.program import Program
from hil.cluster.tasks import this_node
from hil.cluster.trees import unpack_trees, user_folder

_WAIT_S = 3600.0


@dataclass(frozen=True)
class Order:
    """Conditions of a flight on a node."""

    program: Program  # of the campaign
    generation: int  # flights of another one get another process
    cores: int
    timeout_s: float | None


_engine: LocalEngine | None = None
_generation = -1


def fly_task(parcel: Parcel, archives: Mapping[str, Any], order: Order) -> Reply:
    """Make a flight as a task of Ray, on the node that Ray has chosen."""
    return fly_parcel(parcel, archives, order, this_node())


def fly_parcel(parcel: Parcel, archives: Mapping[str, Any], order: Order, place: str) -> Reply:
    """Make the flight of a parcel; `archives` holds references of Ray to its trees.

    Raises OtherProgram, HilError, OSError.
    """
    global _engine, _generation
    order.program.require()
    flights = user_folder() / "flights"
    if _engine is None:
        flights.mkdir(exist_ok=True)
        _remove_abandoned(flights)
        _engine = LocalEngine(1, cores=order.cores, timeout_s=order.timeout_s)
    elif _generation != order.generation:
        _engine.renew()
    _generation = order.generation
    trees = unpack_trees(parcel.trees, archives)
    work = Path(tempfile.mkdtemp(prefix=f"{os.getpid()}-", dir=flights))
    try:
        bench = write_bench(parcel, work / "bench", trees)
        folder = work / "run"
        _engine.submit(replace(parcel.job, bench=str(bench), folder=str(folder)))
        while not (ended := _engine.wait(_WAIT_S)):
            pass
        outcome, lost = ended[0].outcome, ended[0].lost
        if outcome is None:
            return Reply(None, f"{lost} on {place}")
        wanted = parcel.job.recording != "none" and folder.is_dir()
        recording = packed_recording(folder, trees) if wanted else b""
        return Reply(replace(outcome, place=place), "", recording)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _remove_abandoned(flights: Path) -> None:
    """Remove the folders of flights whose process has been killed."""
    for folder in flights.iterdir():
        with suppress(ValueError, OSError):
            if not Path("/proc", str(int(folder.name.split("-")[0]))).exists():
                shutil.rmtree(folder, ignore_errors=True)
