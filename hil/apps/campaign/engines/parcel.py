"""A job as data for another machine: the resolved bench and every file that it names. Imports little, as nodes do.

Small files (settings, vehicle, mission) go with each job. Scenes with their maps, and firmware with its start scripts,
are trees (hil/cluster/trees.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hil.apps.campaign.flight import Job, Outcome
from hil.cluster.trees import packed
from hil.run_files import BENCH_NAME

TREES = "/hil-campaign-trees"  # stands in a bench file for the folder where a node unpacks trees


@dataclass(frozen=True)
class Parcel:
    """A job whose bench is in `files`, by their names; `trees`: hashes of the archives that they need."""

    job: Job
    files: Mapping[str, bytes]
    trees: tuple[str, ...]


@dataclass(frozen=True)
class Reply:
    """End of a job on a node: its outcome, or how its process was lost, and the archive of its recording."""

    outcome: Outcome | None
    lost: str = ""
    recording: bytes = b""


def write_bench(parcel: Parcel, folder: Path, trees: Path) -> Path:
    """Write the bench of a parcel into `folder` and return its file. `trees`: where they are unpacked."""
    for name, content in parcel.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        placed = content.replace(TREES.encode(), str(trees).encode()) if path.name == BENCH_NAME else content
        path.write_bytes(placed)
    return folder / BENCH_NAME


def packed_recording(folder: Path, trees: Path) -> bytes:
    """Return the archive of a flight's folder, without the places of this machine in its bench files."""
    for path in folder.rglob(BENCH_NAME):
        path.write_bytes(path.read_bytes().replace(str(trees).encode(), TREES.encode()))
    return packed((entry, entry.name) for entry in sorted(folder.iterdir()))
