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
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from hil.apps.dataset.formats.boxes import SeenObject
from hil.apps.dataset.formats.labels import Catalogue
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.object_box import ObjectBox

Float64 = NDArray[np.float64]

ROOT = "kitti"
PARTLY, LARGELY = 0.05, 0.5  # hidden share
# Names of the format; other classes keep their own, which readers of KITTI leave out.
TYPES = {"person": "Pedestrian", "vehicle": "Car", "bicycle": "Cyclist"}


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
