"""Writer of the 3-D labels of one moment: boxes as CSV, for each LiDAR, and the files of the forms (label_form.py)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

from hil.apps.dataset.formats import boxes
from hil.apps.dataset.formats.boxes import SeenObject
from hil.apps.dataset.formats.euroc import ROOT
from hil.apps.dataset.formats.labels import Catalogue, PictureLabels
from hil.apps.dataset.formats.object_previews import picture_with_boxes, sweep_with_boxes
from hil.apps.dataset.label_form import AnnotatedFrame, JointSample, annotations_of, forms_of
from hil.apps.dataset.moments import Taken
from hil.apps.dataset.object_reader import ObjectReader
from hil.apps.dataset.plan import EPOCH_NS, DatasetPlan
from signals.samples import ImageSample, TruthState
from sim.frame.geometry import FrameGeometry
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
        self._forms = forms_of(plan, catalogue)
        across = any(form.across for form in self._forms)
        self._reader = ObjectReader(geometry, catalogue, self._camera, across=across)

    def write(
        self, truth: TruthState, frame: int, taken: Taken, write: Write, *, shown: Collection[str] | None
    ) -> tuple[AnnotatedFrame | None, dict[str, bytes]]:
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
        frame_of: AnnotatedFrame | None = None
        if taken.picture is not None and frame >= 0:
            t_ns = truth.t_ns + EPOCH_NS
            frame_of = AnnotatedFrame(frame, t_ns, truth.p_WB, truth.q_WB, False)
        for name, sample in taken.sweeps.items():
            lidar: Lidar = self._sensors[name]
            untwisted = sample._replace(points_L=lidar.points_at_capture(sample))
            points = self._reader.boxed(untwisted)
            swept = self._reader.of_sweep(truth, points, lidar.instances())
            folder = f"{ROOT}/{self._plan.folder(name)}/{boxes.FOLDER}"
            write(f"{folder}/{sample.t_capture_ns}.csv", boxes.sweep_csv(swept, self._catalogue))
            if name == self._plan.lidar and frame_of is not None:
                joint = JointSample(frame, frame_of.t_ns, truth, seen, swept, untwisted, points)
                frame_of = self._joined(frame_of, joint, write)
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

    def _joined(self, frame_of: AnnotatedFrame, joint: JointSample, write: Write) -> AnnotatedFrame:
        """Write the files of a frame with picture and sweep; return it with the objects that a form wants."""
        for form in self._forms:
            for path, data in form.files_of(joint):
                write(path, data)
        wanted = any(form.annotates for form in self._forms)
        objects = annotations_of(joint.seen, joint.swept, joint.points.count) if wanted else ()
        return frame_of._replace(swept=True, objects=objects)
