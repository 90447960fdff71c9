"""A form of 3-D labels for frames that have a picture of the labelled camera and a sweep of the first LiDAR.

Each is one file of `label_forms/` with a class `Form`, which `dataset.formats` of a bench names; its files lie in the
folder of that name. Forms are written in the workers frame by frame, and ended by the process that ends the data set.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from hil.apps.dataset.formats.boxes import SeenObject, SweptObject
from hil.apps.dataset.formats.euroc import ROOT
from hil.apps.dataset.formats.labels import Catalogue
from hil.apps.dataset.formats.split import Split
from hil.apps.dataset.plan import DatasetPlan
from hil.apps.dataset.storage.tree import TreeWriter, Written, make_folder, writes
from signals.errors import RecordingError
from signals.samples import PointCloudSample, TruthState
from sim.frame.mount import Mount
from sim.frame.object_box import BoxedPoints, ObjectBox


class Annotation(NamedTuple):
    """One object of a sample. `size_m`: length, width, height; `visibility`: 0 to 1, in the camera."""

    instance: int
    class_id: int
    centre_W: tuple[float, float, float]
    size_m: tuple[float, float, float]
    yaw_rad: float
    speed_mps: float
    visibility: float
    lidar_points: int


class AnnotatedFrame(NamedTuple):
    """A frame of the camera as the journal keeps it; `swept`: with a sweep at the same time.

    `objects` has those of a swept frame if a form wants them (`LabelForm.annotates`).
    """

    frame: int
    t_ns: int
    p_WB: tuple[float, float, float]
    q_WB: tuple[float, float, float, float]
    swept: bool
    objects: tuple[Annotation, ...] = ()


Frames = Callable[[], Iterable[AnnotatedFrame]]  # yields the annotated frames in order, anew at each call


class JointSample(NamedTuple):
    """Contents of a frame with a sweep. `sweep` and its `points` have the motion of the vehicle taken out."""

    frame: int
    t_ns: int  # with the epoch of the data set
    truth: TruthState
    seen: Sequence[SeenObject]
    swept: Sequence[SweptObject]
    sweep: PointCloudSample
    points: BoxedPoints


class LabelForm:
    """A form of 3-D labels of one data set."""

    contents: ClassVar[str]  # of its folder, for the datasheet
    across: ClassVar[bool] = False  # it needs boxes that are upright in the camera
    annotates: ClassVar[bool] = False  # it needs the objects of all frames at the end

    def __init__(self, plan: DatasetPlan, catalogue: Catalogue) -> None:
        self.plan, self.catalogue = plan, catalogue
        self.camera = plan.config.sensors[plan.labelled or ""].parameters
        lidar = plan.config.sensors[plan.lidar or ""].parameters
        self.of_camera = Mount(self.camera.mount_m, self.camera.mount_rpy_deg)
        self.of_lidar = Mount(lidar.mount_m, lidar.mount_rpy_deg, optical=False)

    def files_of(self, sample: JointSample) -> Iterator[tuple[str, bytes]]:
        """Yield path in the data set and content of each file of a frame."""
        raise NotImplementedError

    def finish(self, tree: TreeWriter, split: Split, frames: Frames) -> Iterator[Written]:
        """Write what needs all frames. Raises RecordingError."""
        raise NotImplementedError

    def picture_of(self, frame: AnnotatedFrame) -> str:
        """Return the path of a frame's picture in the data set."""
        return f"{ROOT}/{self.plan.folder(self.plan.labelled or '', 'rgb')}/data/{frame.t_ns}.png"


def forms_of(plan: DatasetPlan, catalogue: Catalogue) -> list[LabelForm]:
    """Return the forms of a data set that join pictures and sweeps."""
    modules = (import_module(f"hil.apps.dataset.label_forms.{name}") for name in plan.joint_formats)
    return [module.Form(plan, catalogue) for module in modules]


def finish_forms(forms: Sequence[LabelForm], tree: TreeWriter, split: Split, frames: Frames) -> Iterator[Written]:
    """Write the files of all forms that need all frames. Raises RecordingError, also if no frame has a sweep."""
    if forms and not any(frame.swept for frame in frames()):
        plan = forms[0].plan
        raise RecordingError(
            f"{tree.root}: no frame has a sweep of {plan.lidar} at the same time, so there are no files of "
            f"{' and '.join(plan.joint_formats)}; record more --frames, or give both sensors the same rate_hz"
        )
    for form in forms:
        yield from form.finish(tree, split, frames)


def link(path: Path, target: str) -> None:
    """Make a link to a file or folder of the data set. Raises RecordingError."""
    with writes(path):
        if not path.is_symlink():
            make_folder(path.parent)
            os.symlink(target, path)


def annotations_of(
    seen: Sequence[SeenObject], swept: Sequence[SweptObject], inside: Callable[[ObjectBox], int]
) -> tuple[Annotation, ...]:
    """Return the annotations of a sample, by rising instance; `inside` counts the points of the sweep in a box."""
    by_sweep = {o.instance: o for o in swept}
    found = []
    for o in seen:
        other = by_sweep.pop(o.label.instance, None)
        points = inside(o.box) if other is None else other.inside
        found.append(_annotation(o.label.instance, o.label.class_id, o.box, o.visibility, points))
    found += [_annotation(o.instance, o.class_id, o.box, 0.0, o.inside) for o in by_sweep.values()]
    return tuple(sorted(found))


def _annotation(instance: int, class_id: int, box: ObjectBox, visibility: float, points: int) -> Annotation:
    x, y, z = box.centre_W.tolist()
    length, width, height = box.size_m.tolist()
    speed = float(np.sqrt(box.v_W @ box.v_W))
    return Annotation(instance, class_id, (x, y, z), (length, width, height), box.yaw_rad, speed, visibility, points)
