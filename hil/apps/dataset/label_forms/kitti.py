"""KITTI's object detection (Geiger, Lenz and Urtasun, CVPR 2012; the development kit's readme): labels and calibration.

    kitti/training/image_2/NNNNNN.png     the labelled camera's picture (a link)
    kitti/training/velodyne/NNNNNN.bin    float32 x, y, z [m] (forward, left, up), intensity
    kitti/training/label_2/NNNNNN.txt     one line per object that the picture shows
    kitti/training/calib/NNNNNN.txt       P0 .. P3, R0_rect, Tr_velo_to_cam, Tr_imu_to_velo
    kitti/training/labels/NNNNNN.label    as in SemanticKITTI (a link)
    kitti/ImageSets/{train,val,trainval,test}.txt

NNNNNN is the number of the frame, from 0; only frames with a sweep at the same time have files. The sweep has the
motion of the vehicle taken out, as KITTI's has.

A label is

    type truncated occluded alpha  left top right bottom  height width length  x y z  rotation_y

in the camera's frame C (x right, y down, z forward). x, y, z is the middle of the box's bottom face. The format turns
boxes about y of C alone, so that a box is the tight one whose height lies along y of C: with a camera that looks
downwards it is larger than the upright box of boxes/*.csv, and holds the object as that does.

    heading h of the object, normal to y of C    rotation_y = atan2(-h_z, h_x)    alpha = rotation_y - atan2(x, z)

occluded is 0 below `PARTLY` hidden, 1 below `LARGELY`, else 2. The projection of a point of L is P2 R0_rect
Tr_velo_to_cam; R0_rect is the unit matrix, since the camera has no distortion, and all four P are the one camera's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from hil.apps.dataset.formats.boxes import SeenObject
from hil.apps.dataset.formats.euroc import ROOT
from hil.apps.dataset.formats.labels import Catalogue
from hil.apps.dataset.formats.lidar_bin import lidar_bin
from hil.apps.dataset.formats.split import Split
from hil.apps.dataset.label_form import Frames, JointSample, LabelForm, link
from hil.apps.dataset.plan import DatasetPlan
from hil.apps.dataset.storage.tree import TreeWriter, Written
from hil.run.sensors.simulated_sensors import transform
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.object_box import ObjectBox

Float64 = NDArray[np.float64]

FOLDER = "kitti"
PARTLY, LARGELY = 0.05, 0.5  # hidden share
# Names of the format; other classes keep their own, which readers of KITTI leave out.
TYPES = {"person": "Pedestrian", "vehicle": "Car", "bicycle": "Cyclist"}


class Form(LabelForm):
    contents = "KITTI's object detection: image_2, velodyne, label_2, calib, ImageSets"
    across = True

    def __init__(self, plan: DatasetPlan, catalogue: Catalogue) -> None:
        super().__init__(plan, catalogue)
        T_BC, T_BL = (np.array(transform(m.p_BC, m.q_BC)).reshape(4, 4) for m in (self.of_camera, self.of_lidar))
        self._calibration = calibration_text(self.camera.model(), T_BC, T_BL)

    def files_of(self, sample: JointSample) -> Iterator[tuple[str, bytes]]:
        name, folder = name_of(sample.frame), f"{FOLDER}/training"
        pose = self.of_camera.pose(sample.truth)
        yield f"{folder}/velodyne/{name}.bin", lidar_bin(sample.sweep)
        yield f"{folder}/label_2/{name}.txt", label_text(sample.seen, pose, self.catalogue)
        yield f"{folder}/calib/{name}.txt", self._calibration

    def finish(self, tree: TreeWriter, split: Split, frames: Frames) -> Iterator[Written]:
        folder = tree.root / FOLDER / "training"
        numbers, times = [], ["#frame,timestamp [ns]\n"]
        for frame in frames():
            if frame.swept:
                name = name_of(frame.frame)
                numbers.append(frame.frame)
                times.append(f"{name},{frame.t_ns}\n")
                link(folder / "image_2" / f"{name}.png", f"../../../{self.picture_of(frame)}")
                labels = f"{ROOT}/{self.plan.folder(self.plan.lidar or '')}/labels/{frame.t_ns}.label"
                link(folder / "labels" / f"{name}.label", f"../../../{labels}")
        yield tree.write(f"{FOLDER}/timestamps.csv", "".join(times).encode())
        for file, data in image_sets(numbers, split.set_by_frame).items():
            yield tree.write(f"{FOLDER}/ImageSets/{file}", data)


def name_of(frame: int) -> str:
    """Return the name of a frame's files."""
    return f"{frame:06d}"


def occluded(occlusion: float) -> int:
    """Return the state 0 to 2 of a hidden share."""
    return 0 if occlusion < PARTLY else 1 if occlusion < LARGELY else 2


def camera_box(box: ObjectBox, pose: CameraPose) -> tuple[float, float, float, float]:
    """Return x, y, z [m] of the bottom's middle in C, and rotation_y, of a box upright in C."""
    R_WC = np.array(pose.R_WC).reshape(3, 3)
    bottom_W = box.centre_W - 0.5 * box.size_m[2] * box.axes_W[2]
    x, y, z = ((bottom_W - np.array(pose.p_WC)) @ R_WC).tolist()
    heading = box.axes_W[0] @ R_WC
    return x, y, z, math.atan2(-float(heading[2]), float(heading[0]))


def label_text(objects: Iterable[SeenObject], pose: CameraPose, catalogue: Catalogue) -> bytes:
    """Return the labels of one picture; `pose` is that of the camera."""
    lines = []
    for o in objects:
        if o.across is None:
            continue
        name = catalogue.classes.name(o.label.class_id)
        x, y, z, rotation_y = camera_box(o.across, pose)
        length, width, height = o.across.size_m.tolist()
        alpha = math.remainder(rotation_y - math.atan2(x, z), 2.0 * math.pi)
        numbers = (height, width, length, x, y, z, rotation_y)
        lines.append(
            f"{TYPES.get(name, name).replace(' ', '_')} {o.truncation:.4f} {occluded(o.occlusion)} {alpha:.6f} "
            f"{o.label.x_min:.2f} {o.label.y_min:.2f} {o.label.x_max:.2f} {o.label.y_max:.2f} "
            f"{' '.join(f'{n + 0.0:.6f}' for n in numbers)}\n"
        )
    return "".join(lines).encode()


def calibration_text(camera: CameraModel, T_BC: Float64, T_BL: Float64) -> bytes:
    """Return the calibration; `T_BC` and `T_BL` are the mounts of camera and LiDAR, (4, 4). The IMU is at B."""
    K = np.array(camera.opencv_matrix).reshape(3, 3)
    P = np.hstack([K, np.zeros((3, 1))])
    rows = {f"P{i}": P for i in range(4)}
    rows["R0_rect"] = np.eye(3)
    rows["Tr_velo_to_cam"] = (np.linalg.inv(T_BC) @ T_BL)[:3]
    rows["Tr_imu_to_velo"] = np.linalg.inv(T_BL)[:3]
    return "".join(f"{name}: {' '.join(f'{v + 0.0:.12e}' for v in m.ravel())}\n" for name, m in rows.items()).encode()


def image_sets(frames: Sequence[int], set_of: Sequence[str]) -> dict[str, bytes]:
    """Return the files of ImageSets by name; `set_of` is the set of every frame of the data set."""
    members = {"train": ("train",), "val": ("validation",), "test": ("test",), "trainval": ("train", "validation")}
    return {
        f"{file}.txt": "".join(f"{name_of(frame)}\n" for frame in frames if set_of[frame] in sets).encode()
        for file, sets in sorted(members.items())
    }
