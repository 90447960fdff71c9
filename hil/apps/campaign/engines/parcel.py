"""A job as data for another machine: the resolved bench and every file that it names. Imports little, as nodes do.

Small files (settings, vehicle, mission) go with each job. Scenes with their maps, and firmware with its start scripts,
are trees: archives that a node unpacks once, in a folder named by their hash.
"""

from __future__ import annotations

import io
import os
import shutil
import tarfile
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from hil.apps.campaign.flight import Job, Outcome

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
    """Write the bench of a parcel into `folder` and return its file. `trees`: where `unpack_tree` writes."""
    for name, content in parcel.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        placed = content.replace(TREES.encode(), str(trees).encode()) if path.name == "bench.yaml" else content
        path.write_bytes(placed)
    return folder / "bench.yaml"


def unpack_tree(name: str, trees: Path, content: Callable[[], bytes]) -> None:
    """Unpack a tree unless an earlier job has done so. `content` returns the archive."""
    if (trees / name).is_dir():
        return
    part = Path(tempfile.mkdtemp(prefix=f"{name}.", dir=trees))
    unpack(content(), part)
    try:
        os.rename(part, trees / name)
    except OSError:  # another process was first
        shutil.rmtree(part, ignore_errors=True)


def packed_recording(folder: Path, trees: Path) -> bytes:
    """Return the archive of a flight's folder, without the places of this machine in its bench files."""
    for path in folder.rglob("bench.yaml"):
        path.write_bytes(path.read_bytes().replace(str(trees).encode(), TREES.encode()))
    return packed((entry, entry.name) for entry in sorted(folder.iterdir()))


def packed(entries: Iterable[tuple[Path, str]]) -> bytes:
    """Return an archive that depends on names, modes and contents alone."""

    def plain(member: tarfile.TarInfo) -> tarfile.TarInfo:
        member.mtime, member.uid, member.gid, member.uname, member.gname = 0, 0, 0, "", ""
        return member

    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        for path, name in sorted(entries):
            archive.add(path, name, filter=plain)
    return buffer.getvalue()


def unpack(archive: bytes, folder: Path) -> None:
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        tar.extractall(folder, filter="data")
