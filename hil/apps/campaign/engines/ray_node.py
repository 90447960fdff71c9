"""One flight of a campaign on a node of a Ray cluster, in a process of its own that ends with Ray's worker."""

from __future__ import annotations

import os
import shutil
import socket
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hil.apps.campaign.engines.local import LocalEngine
from hil.apps.campaign.engines.numbers import user_folder
from hil.apps.campaign.engines.parcel import Parcel, Reply, packed_recording, unpack_tree, write_bench
from hil.apps.campaign.engines.program import source_digest

_WAIT_S = 3600.0


@dataclass(frozen=True)
class Order:
    """Conditions of a flight on a node."""

    sources: str  # hash of the program of the campaign
    generation: int  # flights of another one get another process
    cores: int
    timeout_s: float | None


class OtherProgram(Exception):
    """A node has another version of the bench."""


_engine: LocalEngine | None = None
_generation = -1


def fly_task(parcel: Parcel, archives: Mapping[str, Any], order: Order) -> Reply:
    """Make a flight as a task of Ray, on the node that Ray has chosen."""
    import ray

    node = ray.get_runtime_context().get_node_id()
    return fly_parcel(parcel, archives, order, f"node {node[:12]} ({socket.gethostname()})")


def fly_parcel(parcel: Parcel, archives: Mapping[str, Any], order: Order, place: str) -> Reply:
    """Make the flight of a parcel. `archives` holds references of Ray to its trees. Raises OtherProgram, OSError."""
    global _engine, _generation
    if source_digest() != order.sources:
        raise OtherProgram(source_digest())
    root = user_folder()
    trees, flights = root / "trees", root / "flights"
    if _engine is None:
        trees.mkdir(exist_ok=True)
        flights.mkdir(exist_ok=True)
        _remove_abandoned(flights)
        _engine = LocalEngine(1, cores=order.cores, timeout_s=order.timeout_s)
    elif _generation != order.generation:
        _engine.renew()
    _generation = order.generation
    for name in parcel.trees:
        unpack_tree(name, trees, lambda name=name: _content(archives[name]))  # type: ignore[misc]
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


def _content(reference: Any) -> bytes:
    import ray

    return bytes(ray.get(reference))


def _remove_abandoned(flights: Path) -> None:
    """Remove the folders of flights whose process has been killed."""
    for folder in flights.iterdir():
        with suppress(ValueError, OSError):
            if not Path("/proc", str(int(folder.name.split("-")[0]))).exists():
                shutil.rmtree(folder, ignore_errors=True)
