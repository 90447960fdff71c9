"""Batches of a data set on a node of a Ray cluster. Their files go back to the machine that writes the data set."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from isal.isal_zlib import crc32

from hil.apps.dataset.batch_maker import BatchMaker, BatchMakerFactory
from hil.apps.dataset.engines.jobs import Job, handled
from hil.apps.dataset.storage.tree import TreeWriter, Written
from hil.cluster.program import Program
from hil.cluster.tasks import this_node
from hil.cluster.trees import unpack_trees
from signals.errors import RecordingError
from sim.frame.path_traced import process as path_tracer


@dataclass(frozen=True)
class Order:
    """The data set that a node works on; `tree`: name of the archive with its saved bench."""

    program: Program
    tree: str
    factory: BatchMakerFactory


@dataclass(frozen=True)
class Reply:
    """Files of a batch by their paths in the data set, or the error that prevented them."""

    files: Mapping[str, bytes] = field(default_factory=dict)
    error: str = ""


class CollectedFiles(TreeWriter):
    """Writer that keeps the files of a batch in memory; `root` is the folder of the unpacked bench."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self._files: dict[str, bytes] = {}

    def write_parts(self, path: str, parts: Iterable[bytes]) -> Written:
        """Keep a file."""
        data = b"".join(parts)
        self._files[path] = data
        return Written(path, len(data), crc32(data))

    def take(self) -> dict[str, bytes]:
        """Return the files written since the last call."""
        files, self._files = self._files, {}
        return files


_maker: BatchMaker | None = None  # a worker of Ray serves one caller, and so one data set
_files: CollectedFiles


def make_batch(job: Job, order: Order, archives: Mapping[str, Any]) -> Reply:
    """Make a batch as a task of Ray; `archives` holds the reference of the saved bench. Raises OtherProgram."""
    global _files
    order.program.require()
    try:
        if _maker is None:
            _files = CollectedFiles(unpack_trees([order.tree], archives) / order.tree)
            path_tracer.threads_per_process = 1
        else:
            _files.take()
        handled(lambda: _kept_maker(order), job)
    except RecordingError as error:
        return Reply(error=f"{error} (on {this_node()})")
    return Reply(_files.take())


def _kept_maker(order: Order) -> BatchMaker:
    global _maker
    if _maker is None:
        _maker = replace(order.factory, tree=_files)()
    return _maker
