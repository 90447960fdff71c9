"""Files of a data set that stay open and grow with each batch: recording, journal, tables and their checkpoints."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass
from pathlib import Path

from hil.apps.dataset.formats.coco import CocoPicture
from hil.apps.dataset.label_form import AnnotatedFrame
from hil.apps.dataset.plan import DatasetPlan
from hil.apps.dataset.storage.journal import Journal
from hil.apps.dataset.storage.layout import flight_folders, flight_mounts, headers
from hil.apps.dataset.storage.recording import DatasetRecording
from hil.apps.dataset.storage.tables import Checkpoints, Tables
from hil.apps.dataset.storage.tree import JOURNAL
from hil.run_files import BENCH_NAME

MakeCheckpoints = Callable[[Path, Tables], Checkpoints]


@dataclass(frozen=True)
class DatasetStore:
    """The growing files below `root`. Batches are appended in order, by one process."""

    root: Path
    tables: Tables
    journal: Journal
    recording: DatasetRecording
    checkpoints: Checkpoints

    @classmethod
    def open(cls, root: Path, plan: DatasetPlan, bench: bytes, make_checkpoints: MakeCheckpoints) -> DatasetStore:
        """Open the files; journal and recording keep the data of an earlier attempt.

        `bench` is the saved bench file of the recorded vehicle, attached to the recording. Raises RecordingError if a
        file cannot be written.
        """
        tables = Tables(root, headers(plan), flight_folders(plan))
        journal = Journal(root / JOURNAL)
        metadata = {"scene": plan.bench.scene.name, "seed": str(plan.config.seed), "quality": plan.quality}
        if plan.vehicle:
            metadata["vehicle"] = plan.vehicle
        recording = DatasetRecording(
            root,
            tick_ns=plan.config.tick_ns,
            metadata=metadata,
            attachments={BENCH_NAME: bench},
            mounts=flight_mounts(plan),
        )
        return cls(root, tables, journal, recording, make_checkpoints(root, tables))

    def coco_pictures(self, batches: Container[int]) -> Iterator[CocoPicture]:
        """Yield the labels of the pictures of some batches in order.

        They are read from the journal, because memory may not hold them all.
        """
        return (picture for record, _ in self.journal.entries(batches) for picture in record.pictures)

    def annotated_frames(self) -> Iterator[AnnotatedFrame]:
        """Yield the frames with 3-D labels of all batches in order, as `coco_pictures` does."""
        return (frame for record, _ in self.journal.entries() for frame in record.annotated)

    def close(self) -> None:
        """Close all files. Idempotent."""
        self.checkpoints.close()
        self.recording.close()
        self.journal.close()
