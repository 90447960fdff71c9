"""A worker's job: samples the cameras, LiDARs and radars of a batch, and encodes, labels and writes the samples.

The files depend on the plan and the batch alone. A process has one `BatchDrawer`, used by one thread.
"""

from __future__ import annotations

import os
import pickle
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from isal.isal_zlib import crc32
from numpy.typing import NDArray

from hil.apps.dataset.formats import voc
from hil.apps.dataset.formats.coco import CocoPicture, coco_picture
from hil.apps.dataset.formats.euroc import ROOT
from hil.apps.dataset.formats.labels import Catalogue, LabelReader, PictureLabels, mask_texts
from hil.apps.dataset.formats.lidar_bin import lidar_bin, lidar_csv, lidar_label
from hil.apps.dataset.formats.pictures import DepthScale, PictureEncoder
from hil.apps.dataset.formats.previews import camera_previews, cloud_previews, radar_previews
from hil.apps.dataset.formats.radar_npy import npy
from hil.apps.dataset.moments import Batch, DueSample
from hil.apps.dataset.plan import EPOCH_NS, DatasetPlan
from hil.apps.dataset.storage.journal import BatchRecord, StoredChunk
from hil.apps.dataset.storage.recording import EncodedFrames, pack_frames, part_path
from hil.apps.dataset.storage.tree import PREVIEW, WORK, TreeWriter, Written, unwritable
from hil.apps.dataset.workers import Job, JobResult
from hil.run.sensors.frame_stages import description, make_frames
from hil.run.sensors.simulated_sensors import SimulatedSensors
from signals.errors import RecordingError
from signals.samples import FrameSample, ImageSample, PointCloudSample, RadarSample, TruthState
from sim.sensors.lidar import Lidar


def _finished_path(root: Path, index: int) -> Path:
    """Return the file in which a worker passes a batch's record and its chunk of the recording to the main process."""
    return root / WORK / f"{index}.batch"


def take_finished(root: Path, index: int) -> tuple[BatchRecord, bytes]:
    """Read and delete what a worker left of a batch: its record and its chunk of the recording.

    Raises RecordingError if the file cannot be read.
    """
    path = _finished_path(root, index)
    try:
        record, chunk = pickle.loads(path.read_bytes())  # noqa: S301 (written by our own worker a moment ago)
        path.unlink()
    except (OSError, EOFError, pickle.UnpicklingError) as error:
        raise RecordingError(f"{path}: a worker's result cannot be read ({error}); continue with --resume") from error
    return record, chunk


class BatchDrawer:
    """Sensors, encoders and label readers of one worker process; call it with a job."""

    def __init__(self, plan: DatasetPlan, root: Path) -> None:
        self.plan, self.root = plan, root
        self.tree = TreeWriter(root)
        self._folders: dict[tuple[str, str], str] = {}
        self.frames = make_frames(plan.bench)
        self.frames.expect(0)
        self.sensors: dict[str, Any] = self._make_sensors()
        world = self.frames.geometry.world
        self.catalogue = Catalogue.of_geoms(
            self.frames.classes, np.asarray(world.geom_instance), np.asarray(world.geom_class)
        )
        self.encoder = PictureEncoder(DepthScale(plan.config.dataset.depth_step_m), self.catalogue.palette)
        self.labels = LabelReader(self.catalogue)
        self.series = self.new_series(with_transform=False)

    def _make_sensors(self) -> dict[str, Any]:
        sensors = self.plan.frame_sensors
        simulated = SimulatedSensors(self.plan.bench, sensors, self.frames)
        return {name: simulated.make(name) for name in sensors}

    def new_series(self, *, with_transform: bool) -> dict[str, EncodedFrames]:
        """Return an empty series of recorded frames per sensor.

        With `with_transform` the first chunk also declares each sensor's mounting (/tf_static).
        """
        series = {n: EncodedFrames(n, description(n, s), i) for i, (n, s) in enumerate(self.sensors.items())}
        for frames in series.values():
            frames.with_transform = with_transform
        return series

    def data_folder(self, name: str, channel: str) -> str:
        """Return the folder in the tree of a sensor's files, or of one of its channels."""
        found = self._folders.get((name, channel))
        if found is None:
            found = self._folders[name, channel] = f"{ROOT}/{self.plan.folder(name, channel)}/data"
        return found

    def sample(self, truth: TruthState, due: DueSample) -> FrameSample:
        """Take a due sample; its times are in the time of the files."""
        sensor = self.sensors[due.sensor]
        if isinstance(sensor, Lidar):
            sensor.follow(due.previous)
        taken: FrameSample = sensor.sample(truth, due.seq)
        return taken._replace(
            t_capture_ns=taken.t_capture_ns + EPOCH_NS, t_available_ns=taken.t_available_ns + EPOCH_NS
        )

    def __call__(self, job: Job) -> JobResult:
        """Make the batch, unless an earlier attempt left it complete. Raises RecordingError."""
        expected = job.expected
        found = expected is not None and self.is_complete(expected, part_path(self.root), job.offset)
        if not found:
            self.make(job.batch)
        return JobResult(job.batch.index, found)

    def make(self, batch: Batch) -> None:
        """Sample and write a batch; `take_finished` collects its record and chunk. Raises RecordingError."""
        writer = BatchWriter(self, batch)
        for moment in batch.moments:
            for due in moment.due:
                writer.store(due.sensor, self.sample(moment.truth, due), moment.frame)
        writer.finish()

    def is_complete(self, record: BatchRecord, recording: Path, offset: int) -> bool:
        """Return True if all files of a batch and its chunk at `offset` of the recording have their checksums."""
        if not all(self.tree.holds(file) for file in record.files):
            return False
        try:
            with open(recording, "rb", buffering=0) as file:
                data = os.pread(file.fileno(), record.chunk.size, offset)
        except OSError:
            return False
        return len(data) == record.chunk.size and crc32(data) == record.chunk.crc32


class BatchWriter:
    """Writes one batch: call `store` for each sample, then `finish`."""

    def __init__(self, drawer: BatchDrawer, batch: Batch) -> None:
        self._drawer, self._batch = drawer, batch
        self.plan = drawer.plan
        self._files: list[Written] = []
        self._samples: Counter[str] = Counter()
        self._frame_t_ns: list[int] = []
        self._objects: list[dict[int, int]] = []
        self._pixels = np.zeros(256, np.int64)
        self._pictures: list[CocoPicture] = []
        if batch.index == 0:
            drawer.series = drawer.new_series(with_transform=True)

    def store(self, name: str, sample: FrameSample, frame: int) -> None:
        """Write one sample of sensor `name`; `frame` is the frame's number, -1 between frames."""
        self._samples[name] += 1
        if name == self.plan.reference:
            self._frame_t_ns.append(sample.t_capture_ns)
        png: dict[str, bytes] = {}
        if isinstance(sample, ImageSample):
            png = self._picture(name, sample, frame)
        elif isinstance(sample, PointCloudSample):
            self._sweep(name, sample)
        else:
            self._radar(name, sample)
        self._drawer.series[name].add_encoded(sample, png)

    def finish(self) -> None:
        """Write the record and the chunk of the recording to the file of `take_finished`. Raises RecordingError."""
        data, facts, channels = pack_frames(list(self._drawer.series.values()))
        chunk = StoredChunk(len(data), crc32(data), facts, channels)
        path = _finished_path(self._drawer.root, self._batch.index)
        try:
            path.write_bytes(pickle.dumps((self._record(chunk), data)))
        except OSError as error:
            raise unwritable(path, error) from error

    def _write(self, path: str, data: bytes) -> None:
        self._files.append(self._drawer.tree.write(path, data))

    def _data(self, name: str, channel: str, t_ns: int, ending: str, data: bytes) -> None:
        self._write(f"{self._drawer.data_folder(name, channel)}/{t_ns}.{ending}", data)

    def _picture(self, name: str, sample: ImageSample, frame: int) -> dict[str, bytes]:
        encoder, channels, t_ns = self._drawer.encoder, sample.channels, sample.t_capture_ns
        encoders: dict[str, Callable[[NDArray[Any]], bytes]] = {
            "rgb": encoder.rgb_png,
            "depth": encoder.depth_png,
            "segmentation": encoder.class_png,
            "instance": encoder.instance_png,
            "normal": encoder.normal_png,
        }
        png = {channel: encoders[channel](channels[channel]) for channel in channels if channel in encoders}
        for channel in channels:
            if channel in png:
                self._data(name, channel, t_ns, "png", png[channel])
            else:
                self._data(name, channel, t_ns, "npy", npy(channels[channel]))
        labelled = name == self.plan.labelled
        labels = self._label(sample, frame) if labelled else None
        if self._batch.index == 0 and self._samples[name] == 1:
            self._preview(name, camera_previews(channels, self._drawer.catalogue.classes, labels))
        return png

    def _label(self, sample: ImageSample, frame: int) -> PictureLabels:
        drawer, t_ns = self._drawer, sample.t_capture_ns
        labels = drawer.labels.read(sample.channels)
        file_name = f"{t_ns}.png"
        self._write(f"{voc.ANNOTATIONS}/{t_ns}.xml", voc.annotation_xml(file_name, labels, drawer.catalogue.classes))
        self._write(f"{voc.CLASS_MASKS}/{file_name}", drawer.encoder.indexed_png(sample.channels["segmentation"]))
        masks = mask_texts(sample.channels["instance"], labels)
        self._pictures.append(coco_picture(frame, f"{voc.IMAGES}/{file_name}", labels, masks, t_ns=t_ns))
        self._objects.append(dict(sorted(Counter(o.class_id for o in labels.objects).items())))
        self._pixels += labels.class_pixels
        return labels

    def _sweep(self, name: str, sample: PointCloudSample) -> None:
        t_ns = sample.t_capture_ns
        self._data(name, "", t_ns, "bin", lidar_bin(sample))
        folder = f"{ROOT}/{self.plan.folder(name)}"
        self._write(f"{folder}/labels/{t_ns}.label", lidar_label(sample))
        if self.plan.config.dataset.lidar_csv:
            self._write(f"{folder}/csv/{t_ns}.csv", lidar_csv(sample))
        if self._batch.index == 0 and self._samples[name] == 1:
            self._preview(name, cloud_previews(sample.points_L, sample.segmentation, self._drawer.catalogue.classes))

    def _radar(self, name: str, sample: RadarSample) -> None:
        for channel, array in sample.channels.items():
            self._data(name, channel, sample.t_capture_ns, "npy", npy(array))
        if self._batch.index == 0 and self._samples[name] == 1 and "range_doppler" in sample.channels:
            self._preview(name, radar_previews(sample.channels["range_doppler"]))

    def _preview(self, name: str, previews: dict[str, bytes]) -> None:
        for file_name, data in previews.items():
            self._write(f"{PREVIEW}/{name}-{file_name}", data)

    def _record(self, chunk: StoredChunk) -> BatchRecord:
        pixels: NDArray[np.int64] = self._pixels
        return BatchRecord(
            index=self._batch.index,
            first_frame=self._batch.first_frame,
            frames=self._batch.frames,
            flight_crc32=self._batch.crc,
            files=tuple(self._files),
            samples=dict(sorted(self._samples.items())),
            frame_t_ns=tuple(self._frame_t_ns),
            objects=tuple(self._objects),
            class_pixels={i: int(n) for i, n in enumerate(pixels.tolist()) if n},
            chunk=chunk,
            pictures=tuple(self._pictures),
        )
