"""Writer of the 3-D labels of one moment: boxes as CSV, KITTI's files, and what nuScenes needs of a frame.

The first LiDAR is that of KITTI and nuScenes; boxes are written for each LiDAR.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np

from hil.apps.dataset.formats import boxes, kitti, nuscenes
from hil.apps.dataset.formats.boxes import SeenObject, SweptObject
from hil.apps.dataset.formats.euroc import ROOT
from hil.apps.dataset.formats.labels import Catalogue, PictureLabels
from hil.apps.dataset.formats.lidar_bin import lidar_bin
from hil.apps.dataset.formats.object_previews import picture_with_boxes, sweep_with_boxes
from hil.apps.dataset.moments import Taken
from hil.apps.dataset.object_reader import ObjectReader
from hil.apps.dataset.plan import EPOCH_NS, DatasetPlan
from hil.run.sensors.simulated_sensors import transform
from signals.samples import ImageSample, PointCloudSample, TruthState
from sim.frame.geometry import FrameGeometry
from sim.frame.object_box import BoxedPoints
from sim.sensors.camera import Camera
from sim.sensors.lidar import Lidar

Write = Callable[[str, bytes], None]


class ObjectWriter:
    """Writer of the 3-D labels of a data set; used by one thread."""

    def __init__(
        self, plan: DatasetPlan, geometry: FrameGeometry, catalogue: Catalogue, sensors: Mapping[str, Any]
    ) -> None:
        self._plan, self._catalogue = plan, catalogue
        self._sensors: Mapping[str, Any] = sensors
        self._camera: Camera | None = sensors[plan.labelled] if plan.labelled is not None else None
        self._reader = ObjectReader(geometry, catalogue, self._camera, across="kitti" in plan.formats)
        self._calibration = b""
        if "kitti" in plan.formats and self._camera is not None and plan.lidar is not None:
            lidar: Lidar = sensors[plan.lidar]
            mounts = [np.array(transform(m.p_BC, m.q_BC)).reshape(4, 4) for m in (self._camera.mount, lidar.mount)]
            self._calibration = kitti.calibration_text(self._camera.model, *mounts)

    def write(
        self, truth: TruthState, frame: int, taken: Taken, write: Write, *, shown: Collection[str] | None
    ) -> tuple[nuscenes.AnnotatedFrame | None, dict[str, bytes]]:
        """Write the files of one moment. Return its frame, if it has one, and pictures of the labels by file name.

        `shown`: pictures that there are already; None: none are wanted. Call it before the next sample is taken: the
        LiDARs know the instances of their last sweep.
        """
        seen: tuple[SeenObject, ...] = ()
        previews: dict[str, bytes] = {}
        if taken.picture is not None and taken.labels is not None:
            seen = self._picture(truth, taken.picture, taken.labels, write)
            file_name = f"{self._plan.labelled}-boxes3d.png"
            if self._camera is not None and shown is not None and file_name not in shown:
                previews[file_name] = picture_with_boxes(
                    taken.picture, self._camera.model, seen, self._catalogue.classes
                )
        frame_of: nuscenes.AnnotatedFrame | None = None
        if taken.picture is not None and frame >= 0:
            t_ns = truth.t_ns + EPOCH_NS
            frame_of = nuscenes.AnnotatedFrame(frame, t_ns, truth.p_WB, truth.q_WB, False)
        for name, sample in taken.sweeps.items():
            lidar: Lidar = self._sensors[name]
            untwisted = sample._replace(points_L=lidar.points_at_capture(sample))
            points = self._reader.boxed(untwisted)
            swept = self._reader.of_sweep(truth, points, lidar.instances())
            folder = f"{ROOT}/{self._plan.folder(name)}/{boxes.FOLDER}"
            write(f"{folder}/{sample.t_capture_ns}.csv", boxes.sweep_csv(swept, self._catalogue))
            if name == self._plan.lidar and frame_of is not None:
                frame_of = self._sample(truth, frame_of, (seen, swept, points), untwisted, write)
            file_name = f"{name}-above.png"
            if shown is not None and file_name not in shown:
                drawn = {o.instance: o.box for o in swept} | {o.label.instance: o.box for o in seen}
                previews[file_name] = sweep_with_boxes(
                    untwisted, drawn, self._catalogue.class_of_instance, self._catalogue.classes
                )
        return frame_of, previews

    def _picture(
        self, truth: TruthState, picture: ImageSample, labels: PictureLabels, write: Write
    ) -> tuple[SeenObject, ...]:
        seen = self._reader.of_picture(truth, labels)
        folder = f"{ROOT}/{self._plan.folder(self._plan.labelled or '', 'rgb')}/{boxes.FOLDER}"
        write(f"{folder}/{picture.t_capture_ns}.csv", boxes.picture_csv(seen, self._catalogue))
        return seen

    def _sample(
        self,
        truth: TruthState,
        frame_of: nuscenes.AnnotatedFrame,
        found: tuple[tuple[SeenObject, ...], tuple[SweptObject, ...], BoxedPoints],
        sweep: PointCloudSample,
        write: Write,
    ) -> nuscenes.AnnotatedFrame:
        """Write the files of a frame with picture and sweep; return it with its annotations."""
        formats, frame = self._plan.formats, frame_of.frame
        seen, swept, points = found
        if "kitti" in formats and self._camera is not None:
            name, folder = kitti.name_of(frame), f"{kitti.ROOT}/training"
            pose = self._camera.mount.pose(truth)
            write(f"{folder}/velodyne/{name}.bin", lidar_bin(sweep))
            write(f"{folder}/label_2/{name}.txt", kitti.label_text(seen, pose, self._catalogue))
            write(f"{folder}/calib/{name}.txt", self._calibration)
        objects: tuple[nuscenes.Annotation, ...] = ()
        if "nuscenes" in formats:
            data = nuscenes.lidar_bytes(sweep.points_L, sweep.intensity, sweep.ring)
            write(f"{nuscenes.ROOT}/{nuscenes.file_name(nuscenes.LIDAR, frame_of.t_ns)}", data)
            objects = nuscenes.annotations_of(seen, swept, points.count)
        return frame_of._replace(swept=True, objects=objects)
