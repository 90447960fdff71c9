"""Files of KITTI and nuScenes that are written after the last frame: lists, links and tables."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from hil.apps.dataset.formats import kitti, nuscenes
from hil.apps.dataset.formats.euroc import ROOT
from hil.apps.dataset.formats.labels import Catalogue
from hil.apps.dataset.formats.nuscenes import AnnotatedFrame, Rig, Scene, Tables
from hil.apps.dataset.formats.split import Split
from hil.apps.dataset.plan import DatasetPlan
from hil.apps.dataset.storage.tree import TreeWriter, Written, make_folder, writes
from hil.run.report.channel_images import bgr_png
from signals.errors import RecordingError
from signals.time import NS_PER_S
from sim.frame.mount import Mount

Frames = Callable[[], Iterable[AnnotatedFrame]]

_GAP_S = 2.0  # between flights there is a take-off; between frames of one, at most a period of the LiDAR


def object_files(
    plan: DatasetPlan, tree: TreeWriter, split: Split, catalogue: Catalogue, frames: Frames
) -> Iterator[Written]:
    """Write the remaining files of KITTI and nuScenes, if the plan has them. Raises RecordingError.

    `frames` yields the annotated frames in order, anew at each call.
    """
    if not plan.formats & {"kitti", "nuscenes"}:
        return
    if not any(frame.swept for frame in frames()):
        raise RecordingError(
            f"{tree.root}: no frame has a sweep of {plan.lidar} at the same time, so kitti and nuscenes have none; "
            "record more --frames, or give both sensors the same rate_hz"
        )
    if "kitti" in plan.formats:
        yield from _kitti(plan, tree, split, frames)
    if "nuscenes" in plan.formats:
        yield from _nuscenes(plan, tree, split, catalogue, frames)


def link(path: Path, target: str) -> None:
    """Make a link to a file or folder of the data set. Raises RecordingError."""
    with writes(path):
        if not path.is_symlink():
            make_folder(path.parent)
            os.symlink(target, path)


def _kitti(plan: DatasetPlan, tree: TreeWriter, split: Split, frames: Frames) -> Iterator[Written]:
    folder = tree.root / kitti.ROOT / "training"
    numbers, times = [], ["#frame,timestamp [ns]\n"]
    for frame in frames():
        if frame.swept:
            name = kitti.name_of(frame.frame)
            numbers.append(frame.frame)
            times.append(f"{name},{frame.t_ns}\n")
            link(folder / "image_2" / f"{name}.png", f"../../../{_picture(plan, frame)}")
            labels = f"{ROOT}/{plan.folder(plan.lidar or '')}/labels/{frame.t_ns}.label"
            link(folder / "labels" / f"{name}.label", f"../../../{labels}")
    yield tree.write(f"{kitti.ROOT}/timestamps.csv", "".join(times).encode())
    for file, data in kitti.image_sets(numbers, split.set_by_frame).items():
        yield tree.write(f"{kitti.ROOT}/ImageSets/{file}", data)


def _picture(plan: DatasetPlan, frame: AnnotatedFrame) -> str:
    return f"{ROOT}/{plan.folder(plan.labelled or '', 'rgb')}/data/{frame.t_ns}.png"


def _nuscenes(
    plan: DatasetPlan, tree: TreeWriter, split: Split, catalogue: Catalogue, frames: Frames
) -> Iterator[Written]:
    times = [frame.t_ns for frame in frames()]
    usual_ns = min((b - a for a, b in pairwise(times)), default=0)
    gap_ns = max(round(_GAP_S * NS_PER_S), 2 * usual_ns)

    def scenes() -> Iterator[Scene]:
        return nuscenes.scenes(frames(), split.set_by_frame, gap_ns)

    for scene in scenes():
        for frame in scene.frames:
            name = nuscenes.file_name(nuscenes.CAMERA, frame.t_ns, is_sample=frame.swept)
            link(tree.root / nuscenes.ROOT / name, f"../../../{_picture(plan, frame)}")
    yield tree.write(f"{nuscenes.ROOT}/{nuscenes.MAP_NAME}", bgr_png(np.zeros((1, 1), np.uint8)))
    for path, texts in Tables(scenes, catalogue, _rig(plan)).texts():
        yield tree.write_texts(f"{nuscenes.ROOT}/{path}", texts)


def _rig(plan: DatasetPlan) -> Rig:
    camera = plan.config.sensors[plan.labelled or ""].parameters
    lidar = plan.config.sensors[plan.lidar or ""].parameters
    of_camera = Mount(camera.mount_m, camera.mount_rpy_deg)
    of_lidar = Mount(lidar.mount_m, lidar.mount_rpy_deg, optical=False)
    model = camera.model()
    return Rig(
        p_BC=of_camera.p_BC,
        q_BC=of_camera.q_BC,
        K=model.opencv_matrix,
        width=model.width,
        height=model.height,
        p_BL=of_lidar.p_BC,
        q_BL=of_lidar.q_BC,
        vehicle=plan.vehicle or str(plan.config.vehicle),
        location=plan.bench.scene.name,
        description=f"{plan.bench.scene.name}, seed {plan.config.seed}, simulated",
    )
