"""One camera of the server: where it is mounted, its lens, and its pose at the present tick."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from hil.apps.airsim.rpc.arguments import Pose
from hil.apps.airsim.rpc.methods import RpcError
from hil.apps.airsim.settings.cameras import Camera as CameraSettings
from hil.apps.airsim.settings.cameras import Gimbal
from hil.apps.airsim.world.drone import Drone
from hil.apps.airsim.world.ned import NedFrame, q_WB_from_q_NF, unit_rotation
from signals._kernel import det_atan2, det_cos, det_sin, roll_pitch_yaw, rotate_into_world
from signals.frames import frd_from_flu, q_NF_from_q_WB
from signals.rotation import matrix_of, product
from signals.samples import Quat, Vec3
from signals.units import DEG_PER_RAD, RAD_PER_DEG
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.distortion import BrownConrady
from sim.frame.mount import Mount, quaternion_of_rpy

LEAST_FOV_DEG, MOST_FOV_DEG = 0.01, 170.0
_LEAST_MM, _MOST_MM = 0.1, 1000.0
_IMAGE_TYPES = 12
DISTORTION = ("K1", "K2", "K3", "P1", "P2")
_FORWARD = Mount((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).q_BC
_MOST_DISTORTION = 100.0


class CameraPlace(NamedTuple):
    """Position, and attitude FLU->ENU, of a camera that looks along x."""

    p_W: Vec3
    q_WC: Quat

    @property
    def optical(self) -> CameraPose:
        """Pose of the optical frame, for renderers."""
        return CameraPose(self.p_W, matrix_of(product(self.q_WC, _FORWARD)))


@dataclass
class Lens:
    """Lens of AirSim's cinematography calls, with the film of Unreal's default camera.

    Focus and aperture are kept for clients that read them back.
    """

    film_width_mm: float = 23.76
    film_height_mm: float = 13.365
    focus_cm: float = 100_000.0
    aperture: float = 2.8
    manual_focus: bool = False
    focus_plane: bool = False

    def set_film(self, width_mm: float, height_mm: float) -> None:
        """Set the size of the film. Raises RpcError."""
        for size in (width_mm, height_mm):
            if not _LEAST_MM <= size <= _MOST_MM:
                raise RpcError(f"a side of the film must be {_LEAST_MM:g} to {_MOST_MM:g} mm, not {size:g}")
        self.film_width_mm, self.film_height_mm = width_mm, height_mm

    def focal_length_mm(self, fov_deg: float) -> float:
        """Return the focal length of a horizontal field of view."""
        half = 0.5 * fov_deg * RAD_PER_DEG
        return 0.5 * self.film_width_mm * det_cos(half) / det_sin(half)

    def fov_deg(self, focal_length_mm: float) -> float:
        """Return the horizontal field of view of a focal length. Raises RpcError."""
        if not _LEAST_MM <= focal_length_mm <= 100.0 * _MOST_MM:
            raise RpcError(
                f"the focal length must be {_LEAST_MM:g} to {100.0 * _MOST_MM:g} mm, not {focal_length_mm:g}"
            )
        return 2.0 * det_atan2(0.5 * self.film_width_mm, focal_length_mm) * DEG_PER_RAD

    def film(self) -> str:
        """Return the film as AirSim describes it."""
        return f"Sensor Width: {self.film_width_mm:f} Sensor Height: {self.film_height_mm:f}"

    def settings(self, fov_deg: float) -> str:
        """Return the lens as AirSim describes it."""
        return f"Focal Length: {self.focal_length_mm(fov_deg):f} F-stop: {self.aperture:f}"

    def field_of_view(self, fov_deg: float) -> str:
        """Return the fields of view, which follow from the film."""
        f = self.focal_length_mm(fov_deg)
        vertical = 2.0 * det_atan2(0.5 * self.film_height_mm, f) * DEG_PER_RAD
        return f"Current Field Of View:\n\tHorizontal: {fov_deg:f},\n\tVertical: {vertical:f}"


@dataclass
class ServedCamera:
    """Camera of a vehicle, or of the world (`drone` None). Positions: forward, right, down; or north, east, down."""

    name: str
    settings: CameraSettings
    drone: Drone | None
    frame: NedFrame  # in which clients see its poses
    position_F: Vec3 = field(init=False)
    q_FC: Quat = field(init=False)  # camera FRD -> body FRD, or -> NED
    gimbal: Gimbal = field(init=False)
    fov_deg: float | None = None  # of all image types, set by a client
    lens: Lens = field(default_factory=Lens)
    distortion: dict[str, float] = field(default_factory=lambda: dict.fromkeys(DISTORTION, 0.0))

    def __post_init__(self) -> None:
        self.gimbal = self.settings.gimbal
        self.position_F = self.settings.position_m
        self.q_FC = quaternion_of_rpy(self.settings.rotation_deg)

    @property
    def key(self) -> str:
        """Name that no other camera of the server has."""
        return self.name if self.drone is None else f"{self.drone.name}/{self.name}"

    def size(self, image_type: int) -> tuple[int, int]:
        """Return width and height of an image type in pixels."""
        capture = self.settings.capture(image_type)
        return capture.width_px, capture.height_px

    def fov(self, image_type: int) -> float:
        """Return the field of view of an image type along its longer side in degrees."""
        return self.settings.capture(image_type).fov_deg if self.fov_deg is None else self.fov_deg

    def model(self, image_type: int) -> CameraModel:
        """Return the projection of an image type."""
        width, height = self.size(image_type)
        f = CameraModel.from_fov(max(width, height), min(width, height), self.fov(image_type)).fx
        plain = CameraModel(width, height, f, f, 0.5 * width, 0.5 * height)
        k1, k2, k3, p1, p2 = (self.distortion[key] for key in DISTORTION)
        if not any((k1, k2, k3, p1, p2)):
            return plain
        return CameraModel(width, height, plain.fx, plain.fy, plain.cx, plain.cy, BrownConrady(k1, k2, p1, p2, k3))

    def set_pose(self, pose: Pose) -> None:
        """Mount the camera elsewhere; a gimbal then holds the angles of the pose. Raises RpcError."""
        w, x, y, z = unit_rotation(pose.orientation)
        if not all(abs(component) <= 1e5 for component in pose.position):
            raise RpcError(f"the position {tuple(pose.position)} is beyond 100 km")
        self.position_F = (*pose.position,)
        if self.gimbal.stabilization > 0.0:  # as APIPCamera::setCameraPose
            roll, pitch, yaw = (angle * DEG_PER_RAD for angle in roll_pitch_yaw((w, x, y, z)))
            self.gimbal = replace(self.gimbal, roll_deg=roll, pitch_deg=pitch, yaw_deg=yaw)
        else:
            self.q_FC = (w, x, y, z)

    def set_fov(self, fov_deg: float) -> None:
        """Set the field of view of all image types. Raises RpcError."""
        if not LEAST_FOV_DEG <= fov_deg <= MOST_FOV_DEG:
            raise RpcError(f"the field of view must be {LEAST_FOV_DEG:g} to {MOST_FOV_DEG:g} degrees, not {fov_deg:g}")
        self.fov_deg = fov_deg

    def set_distortion(self, name: str, value: float) -> None:
        """Set a distortion parameter: K1, K2, K3, P1 or P2. Raises RpcError, also if two directions share a pixel."""
        if name not in self.distortion:
            raise RpcError(f"there is no distortion parameter '{name[:40]}'; they are {', '.join(DISTORTION)}")
        if not -_MOST_DISTORTION <= value <= _MOST_DISTORTION:
            raise RpcError(f"the distortion parameter {name} must be within {_MOST_DISTORTION:g}, not {value:g}")
        before = self.distortion[name]
        self.distortion[name] = value
        try:
            for image_type in range(_IMAGE_TYPES):
                model = self.model(image_type)
                corners = np.array([(-model.cx, -model.cy), (model.cx, -model.cy), (0.0, 0.0)])
                model.directions(corners / (model.fx, model.fy))
        except ValueError as error:
            self.distortion[name] = before
            raise RpcError(f"{name} = {value:g}: {error}") from None

    def place(self) -> CameraPlace:
        """Return the place at the present tick."""
        if self.drone is None:
            p_W, q_WC = self.frame.to_W(self.position_F), q_WB_from_q_NF(self.q_FC)
        else:
            truth = self.drone.vehicle.truth
            dx, dy, dz = rotate_into_world(truth.q_WB, frd_from_flu(self.position_F))
            x, y, z = truth.p_WB
            w, i, j, k = self.q_FC
            p_W, q_WC = (x + dx, y + dy, z + dz), product(truth.q_WB, (w, i, -j, -k))
        return CameraPlace(p_W, _held(q_WC, self.gimbal))

    def pose(self) -> Pose:
        """Return the pose at the present tick as AirSim gives it."""
        place = self.place()
        return self.frame.pose(place.p_W, place.q_WC)

    def projection_matrix(self, image_type: int) -> list[list[float]]:
        """Return AirSim's projection matrix: NED of the camera to clip coordinates, with the near plane at 10 cm.

        x and y of the clip coordinates are those of Unreal, whose w is the distance along the axis; signs are AirSim's.
        """
        width, height = self.size(image_type)
        half = 0.5 * self.fov(image_type) * RAD_PER_DEG
        a = max(width, height) * det_cos(half) / det_sin(half)
        return [
            [0.0, a / width, 0.0, 0.0],
            [0.0, 0.0, -a / height, 0.0],
            [0.0, 0.0, 0.0, 10.0],
            [-1.0, 0.0, 0.0, 0.0],
        ]


def _held(q_WC: Quat, gimbal: Gimbal) -> Quat:
    """Return an attitude as a gimbal holds it: the angles of the world that are given, as far as it is stabilised."""
    share = gimbal.stabilization
    held = (gimbal.roll_deg, gimbal.pitch_deg, gimbal.yaw_deg)
    if share == 0.0 or held == (None, None, None):
        return q_WC
    moved = (angle * DEG_PER_RAD for angle in roll_pitch_yaw(q_NF_from_q_WB(q_WC)))
    roll, pitch, yaw = (
        angle if wanted is None else share * wanted + (1.0 - share) * angle
        for angle, wanted in zip(moved, held, strict=True)
    )
    return q_WB_from_q_NF(quaternion_of_rpy((roll, pitch, yaw)))
