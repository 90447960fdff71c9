"""Making of a batch in a worker: sampling of cameras, LiDARs and radars; encoding, labels and files of the samples.

The files depend only on the plan and the batch. A process has one `BatchMaker` of a data set, used by one thread.
"""

from __future__ import annotations

import pickle
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from isal.isal_zlib import crc32
from numpy.typing import NDArray

from hil.apps.dataset.engines.jobs import Job, JobResult
from hil.apps.dataset.formats import voc
from hil.apps.dataset.formats.coco import CocoPicture, coco_picture
from hil.apps.dataset.formats.euroc import ROOT
from hil.apps.dataset.formats.labels import Catalogue, LabelReader, PictureLabels, mask_texts
from hil.apps.dataset.formats.lidar_bin import lidar_bin, lidar_csv, lidar_label
from hil.apps.dataset.formats.pictures import DepthScale, PictureEncoder
from hil.apps.dataset.formats.previews import camera_previews, cloud_previews, visible_objects
from hil.apps.dataset.formats.radar_labels import FOLDER as RADAR_LABELS
from hil.apps.dataset.formats.radar_labels import radar_labels_csv
from hil.apps.dataset.formats.radar_npy import npy
from hil.apps.dataset.label_form import AnnotatedFrame
from hil.apps.dataset.moments import Batch, DueSample, Moment, Taken
from hil.apps.dataset.plan import EPOCH_NS, DatasetPlan
from hil.apps.dataset.storage.journal import BatchRecord, StoredChunk
from hil.apps.dataset.storage.recording import EncodedFrames, is_complete, pack_frames
from hil.apps.dataset.storage.tree import PREVIEW, WORK, TreeWriter, Written
from hil.config import load_bench
from hil.data_set_files import ANNOTATIONS, CLASS_MASKS, IMAGES
from hil.run.sensors.frame_stages import description
from hil.run.sensors.simulated_sensors import SimulatedSensors
from hil.run_files import BENCH_NAME
from signals.errors import RecordingError
from signals.samples import FrameSample, ImageSample, PointCloudSample, RadarSample, TruthState
from sim.frame.source import SharedFrames
from sim.sensors.catalog import KINDS

if TYPE_CHECKING:
    from hil.apps.dataset.object_writer import ObjectWriter


def _finished_path(index: int) -> str:
    """Return the file in which a worker passes a batch's record and its chunk of the recording to the main process."""
    return f"{WORK}/{index}.batch"


def take_finished(root: Path, index: int) -> tuple[BatchRecord, bytes]:
    """Read and delete the file with a worker's result of a batch: its record and its chunk of the recording.

    Raises RecordingError if the file cannot be read.
    """
    path = root / _finished_path(index)
    try:
        with open(path, "rb") as file:
            record = pickle.load(file)  # noqa: S301 (written by our own worker a moment ago)
            chunk = file.read()
        if len(chunk) != record.chunk.size:
            raise EOFError(f"{len(chunk)} bytes of a chunk of {record.chunk.size}")
        path.unlink()
    except (OSError, EOFError, pickle.UnpicklingError) as error:
        raise RecordingError(f"{path}: a worker's result cannot be read ({error}); continue with --resume") from error
    return record, chunk


class BatchMaker:
    """Sensors, encoders and label readers of one worker process; call it with a job."""

    def __init__(self, plan: DatasetPlan, tree: TreeWriter) -> None:
        self.plan, self.tree = plan, tree
        self._folders: dict[tuple[str, str], str] = {}
        frames = SharedFrames(plan.world)
        self.frames = frames.seen_by(plan.vehicle) if plan.vehicle else frames
        self.frames.expect(0)
        world = self.frames.geometry.world
        self.catalogue = Catalogue.of_geoms(
            self.frames.classes, np.asarray(world.geom_instance), np.asarray(world.geom_class)
        )
        self.sensors: dict[str, Any] = self._make_sensors()
        self.encoder = PictureEncoder(DepthScale(plan.config.dataset.depth_step_m), self.catalogue.palette)
        self.labels = LabelReader(self.catalogue)
        self.objects: ObjectWriter | None = None
        if plan.formats:
            from hil.apps.dataset.object_writer import ObjectWriter

            self.objects = ObjectWriter(plan, self.frames.geometry, self.catalogue, self.sensors)
        self.series = self.new_series(with_transform=False)

    def _make_sensors(self) -> dict[str, Any]:
        sensors = self.plan.frame_sensors
        simulated = SimulatedSensors(self.plan.bench, sensors, self.frames)
        return {name: simulated.make(name, labelled=self.catalogue.labelled) for name in sensors}

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
        folder = self._folders.get((name, channel))
        if folder is None:
            folder = self._folders[name, channel] = f"{ROOT}/{self.plan.folder(name, channel)}/data"
        return folder

    def sample(self, truth: TruthState, due: DueSample) -> FrameSample:
        """Take a due sample; `EPOCH_NS` is added to its times, as in all files of the data set."""
        sensor = self.sensors[due.sensor]
        if KINDS[self.plan.frame_sensors[due.sensor].kind].sweeps:
            sensor.set_previous_truth(due.previous)
        sample: FrameSample = sensor.sample(truth, due.seq)
        return sample._replace(
            t_capture_ns=sample.t_capture_ns + EPOCH_NS, t_available_ns=sample.t_available_ns + EPOCH_NS
        )

    def __call__(self, job: Job) -> JobResult:
        """Make the batch, unless an earlier attempt left it complete. Raises RecordingError."""
        complete = job.expected is not None and is_complete(self.tree, job.expected, job.offset)
        if not complete:
            self.make(job.batch)
        return JobResult(job.batch.index, complete)

    def make(self, batch: Batch) -> None:
        """Sample and write a batch; `take_finished` collects its record and chunk. Raises RecordingError."""
        writer = BatchWriter(self, batch)
        for moment in batch.moments:
            for vehicle, states in moment.others.items():
                self.frames.restore(vehicle, states)
            for due in moment.due:
                writer.store(due.sensor, self.sample(moment.truth, due), moment.frame)
            if self.objects is not None:
                writer.label_objects(self.objects, moment)
        writer.finish()


@dataclass
class BatchMakerFactory:
    """Factory of a worker's `BatchMaker`. Another process loads the bench saved in the folder of the data set."""

    plan: DatasetPlan | None
    frames: int
    quality: str
    tree: TreeWriter
    maker_type: type[BatchMaker] = BatchMaker
    vehicle: str = ""

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "plan": None}

    def __call__(self) -> BatchMaker:
        plan = self.plan
        if plan is None:
            bench = load_bench(self.tree.root / BENCH_NAME, flown=False)
            plan = DatasetPlan.of(bench, self.vehicle, self.frames, self.quality)
        return self.maker_type(plan, self.tree)


class BatchWriter:
    """Writer of one batch: call `store` for each sample, then `finish`."""

    def __init__(self, maker: BatchMaker, batch: Batch) -> None:
        self._maker, self._batch = maker, batch
        self.plan = maker.plan
        self._files: list[Written] = []
        self._samples: Counter[str] = Counter()
        self._frame_t_ns: list[int] = []
        self._objects: list[dict[int, int]] = []
        self._class_pixels = np.zeros(256, np.int64)
        self._pictures: list[CocoPicture] = []
        self._best_radar_frame: dict[str, tuple[float, int]] = {}
        self._taken = Taken(None, None, {})  # of this moment
        self._annotated: list[AnnotatedFrame] = []
        self._shown: set[str] = set()  # previews of 3-D labels
        if batch.index == 0:
            maker.series = maker.new_series(with_transform=True)

    def store(self, name: str, sample: FrameSample, frame: int) -> None:
        """Write one sample of sensor `name`; `frame` is the frame's number, -1 if the sample belongs to no frame."""
        self._samples[name] += 1
        if name == self.plan.reference:
            self._frame_t_ns.append(sample.t_capture_ns)
        png: dict[str, bytes] = {}
        if isinstance(sample, ImageSample):
            png = self._write_picture(name, sample, frame)
        elif isinstance(sample, PointCloudSample):
            self._write_sweep(name, sample)
        else:
            self._write_radar_frame(name, sample)
        self._maker.series[name].add_encoded(sample, png)

    def label_objects(self, objects: ObjectWriter, moment: Moment) -> None:
        """Write the 3-D labels of the samples stored since the moment began."""
        taken, self._taken = self._taken, Taken(None, None, {})
        shown = self._shown if self._batch.index == 0 else None
        frame, previews = objects.write(moment.truth, moment.frame, taken, self._write, shown=shown)
        if frame is not None:
            self._annotated.append(frame)
        for file_name, data in previews.items():
            self._shown.add(file_name)
            self._write(f"{PREVIEW}/{file_name}", data)

    def finish(self) -> None:
        """Write the file that `take_finished` reads: record and chunk of the recording. Raises RecordingError."""
        data, summary, channels = pack_frames(list(self._maker.series.values()))
        chunk = StoredChunk(len(data), crc32(data), summary, channels)
        self._maker.tree.write_parts(_finished_path(self._batch.index), (pickle.dumps(self._record(chunk)), data))

    def _write(self, path: str, data: bytes) -> None:
        self._files.append(self._maker.tree.write(path, data))

    def _write_data(self, name: str, channel: str, t_ns: int, ending: str, data: bytes) -> None:
        self._write(f"{self._maker.data_folder(name, channel)}/{t_ns}.{ending}", data)

    def _write_picture(self, name: str, sample: ImageSample, frame: int) -> dict[str, bytes]:
        encoder, channels, t_ns = self._maker.encoder, sample.channels, sample.t_capture_ns
        encoders: dict[str, Callable[[NDArray[Any]], bytes]] = {
            "rgb": encoder.rgb_png,
            "depth": encoder.depth_png,
            "segmentation": encoder.class_png,
            "instance": encoder.instance_png,
            "normal": encoder.normal_png,
            "infrared": encoder.counts_png,
        }
        png = {channel: encoders[channel](channels[channel]) for channel in channels if channel in encoders}
        for channel in channels:
            if channel in png:
                self._write_data(name, channel, t_ns, "png", png[channel])
            else:
                self._write_data(name, channel, t_ns, "npy", npy(channels[channel]))
        labels = self._write_labels(sample, frame) if name == self.plan.labelled else None
        if labels is not None:
            self._taken = self._taken._replace(picture=sample, labels=labels)
        if self._batch.index == 0 and self._samples[name] == 1:
            self._write_previews(name, camera_previews(channels, self._maker.catalogue.classes, labels))
        return png

    def _write_labels(self, sample: ImageSample, frame: int) -> PictureLabels:
        maker, t_ns = self._maker, sample.t_capture_ns
        labels = maker.labels.read(sample.channels)
        file_name = f"{t_ns}.png"
        self._write(f"{ANNOTATIONS}/{t_ns}.xml", voc.annotation_xml(file_name, labels, maker.catalogue.classes))
        self._write(f"{CLASS_MASKS}/{file_name}", maker.encoder.indexed_png(sample.channels["segmentation"]))
        masks = mask_texts(sample.channels["instance"], labels)
        self._pictures.append(coco_picture(frame, f"{IMAGES}/{file_name}", labels, masks, t_ns=t_ns))
        self._objects.append(dict(sorted(Counter(o.class_id for o in labels.objects).items())))
        self._class_pixels += labels.class_pixels
        return labels

    def _write_sweep(self, name: str, sample: PointCloudSample) -> None:
        t_ns = sample.t_capture_ns
        self._write_data(name, "", t_ns, "bin", lidar_bin(sample))
        folder = f"{ROOT}/{self.plan.folder(name)}"
        instance = self._maker.sensors[name].instances()
        self._write(f"{folder}/labels/{t_ns}.label", lidar_label(sample, instance))
        self._taken = self._taken._replace(sweeps={**self._taken.sweeps, name: sample})
        if self.plan.config.dataset.lidar_csv:
            self._write(f"{folder}/csv/{t_ns}.csv", lidar_csv(sample, instance))
        if self._batch.index == 0 and self._samples[name] == 1:
            previews = cloud_previews(sample.points_L, sample.segmentation, self._maker.catalogue.classes)
            self._write_previews(name, previews)

    def _write_radar_frame(self, name: str, sample: RadarSample) -> None:
        for channel, array in sample.channels.items():
            self._write_data(name, channel, sample.t_capture_ns, "npy", npy(array))
        radar, t_ns = self._maker.sensors[name], sample.t_capture_ns
        objects = radar.objects
        folder = f"{ROOT}/{self.plan.folder(name, next(iter(sample.channels)))}/{RADAR_LABELS}"
        ghosts = radar.ghosts if radar.has_ghosts else None
        self._write(f"{folder}/{t_ns}.csv", radar_labels_csv(objects, self._maker.catalogue, ghosts))
        if "range_doppler" in sample.channels:
            # The datasheet shows the frame with the most visible objects, of these the first one.
            rank = float(len(visible_objects(sample.channels["range_doppler"], objects, radar.seen)))
            best = self._best_radar_frame.get(name)
            if best is None or rank > best[0]:
                self._best_radar_frame[name] = (rank, t_ns)

    def _write_previews(self, name: str, previews: dict[str, bytes]) -> None:
        for file_name, data in previews.items():
            self._write(f"{PREVIEW}/{name}-{file_name}", data)

    def _record(self, chunk: StoredChunk) -> BatchRecord:
        pixels: NDArray[np.int64] = self._class_pixels
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
            annotated=tuple(self._annotated),
            best_radar_frame=self._best_radar_frame,
        )
