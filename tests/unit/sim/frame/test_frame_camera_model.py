"""Camera models agree with OpenCV's to 1e-9 pixels, their inverse inverts, and what cannot exist is refused."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from sim.frame.calibration_text import camera_info_yaml, euroc_yaml, opencv_yaml
from sim.frame.camera_model import CameraModel
from sim.frame.distortion import BrownConrady, Distortion, KannalaBrandt

ORDINARY: dict[str, BrownConrady | None] = {
    "none": None,
    "euroc": BrownConrady(-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05),
    "five": BrownConrady(0.05, -0.02, 1e-3, -2e-3, 0.004),
    "rational": BrownConrady(0.1, -0.2, 1e-3, -2e-3, 0.05, 0.02, -0.01, 0.003),
}
FISHEYE = {"equidistant": KannalaBrandt(), "real": KannalaBrandt(-0.02, 0.003, -0.001, 0.0001)}


def points(n: int, seed: int = 3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.0, 1.0, (n, 3)) * [1.0, 0.8, 0.0] + [0.0, 0.0, 1.6]


@pytest.mark.parametrize("lens", ORDINARY)
def test_projection_is_opencvs(lens: str) -> None:
    distortion = ORDINARY[lens]
    camera = CameraModel.from_opencv(752, 480, 458.654, 457.296, 367.215, 248.375, distortion)
    k = np.array(camera.opencv_matrix).reshape(3, 3)
    assert (k[0, 0], k[1, 1], k[0, 2], k[1, 2]) == (458.654, 457.296, 367.215, 248.375)
    coefficients = np.array(distortion.coefficients if distortion else [0.0] * 5)
    theirs = cv2.projectPoints(points(500), np.zeros(3), np.zeros(3), k, coefficients)[0].reshape(-1, 2)
    # A pixel's centre is a whole number there and half past one here.
    assert np.abs(camera.project(points(500)) - 0.5 - theirs).max() < 1e-9


@pytest.mark.parametrize("lens", FISHEYE)
@pytest.mark.parametrize("fov_deg", [90.0, 185.0, 220.0])
def test_fisheye_is_opencvs(lens: str, fov_deg: float) -> None:
    camera = CameraModel.from_fov(640, 480, fov_deg, FISHEYE[lens])
    k = np.array(camera.opencv_matrix).reshape(3, 3)
    where = points(500)
    coefficients = np.array(FISHEYE[lens].coefficients)
    theirs = cv2.fisheye.projectPoints(where.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), k, coefficients)[0]
    assert np.abs(camera.project(where) - 0.5 - theirs.reshape(-1, 2)).max() < 1e-9


def every_camera() -> list[CameraModel]:
    cameras = [CameraModel.from_fov(97, 61, 90.0, lens) for lens in ORDINARY.values()]
    cameras += [CameraModel.from_opencv(752, 480, 458.654, 457.296, 367.215, 248.375, ORDINARY["euroc"])]
    return cameras + [CameraModel.from_fov(97, 61, fov, lens) for fov in (60.0, 200.0) for lens in FISHEYE.values()]


@pytest.mark.parametrize("camera", every_camera(), ids=lambda c: f"{c.distortion}"[:40])
def test_rays_go_through_the_middles_of_the_pixels(camera: CameraModel) -> None:
    rays = camera.rays()
    assert rays.shape == (camera.height, camera.width, 3)
    assert np.abs((rays**2).sum(axis=2) - 1.0).max() < 1e-12
    middles = np.stack(np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5), axis=-1)
    assert np.abs(camera.project(rays.reshape(-1, 3)) - middles.reshape(-1, 2)).max() < 1e-8


@pytest.mark.parametrize("lens", [None, BrownConrady(0.05, 0.01, k3=0.001), *FISHEYE.values()])
def test_the_field_of_view_is_the_angle_between_the_edges(lens: Distortion | None) -> None:
    for fov_deg in (1.0, 60.0, 120.0, *((180.0, 220.0) if isinstance(lens, KannalaBrandt) else ())):
        camera = CameraModel.from_fov(640, 480, fov_deg, lens)
        edge = np.array([[-camera.cx / camera.fx, 0.0]])
        x, _, z = camera.directions(edge)[0]
        assert math.degrees(math.atan2(-x, z)) == pytest.approx(0.5 * fov_deg, abs=1e-9)


def test_a_pinhole_of_90_degrees_has_its_focal_length_in_the_middle() -> None:
    camera = CameraModel.from_fov(320, 240, 90.0)
    assert camera.pinhole
    assert camera.fx == pytest.approx(160.0, abs=1e-12)
    assert (camera.cx, camera.cy) == (160.0, 120.0)
    assert camera.project(np.array([[1.0, -0.5, 1.0], [0.0, 0.0, -1.0]])) == pytest.approx(
        np.array([[320.0, 40.0], [np.nan, np.nan]]), nan_ok=True
    )
    assert not CameraModel.from_fov(8, 8, 90.0, BrownConrady(0.1)).pinhole
    assert CameraModel.from_fov(8, 8, 90.0, BrownConrady()).pinhole
    assert not CameraModel.from_fov(8, 8, 90.0, KannalaBrandt()).pinhole


@pytest.mark.parametrize(
    ("width", "height", "fov_deg", "lens", "message"),
    [
        (0, 8, 90.0, None, "width must be 1 to 8192"),
        (8, 8193, 90.0, None, "height must be 1 to 8192"),
        (8, 8, 0.0, None, "between 0 and 180"),
        (8, 8, -5.0, None, "between 0 and 180"),
        (8, 8, 180.0, None, "between 0 and 180"),
        (8, 8, 180.0, BrownConrady(0.1), "between 0 and 180"),
        (8, 8, 220.1, KannalaBrandt(), "between 0 and 220"),
        (8, 8, 1e-9, None, "focal length"),
        (8, 8, math.nan, None, "between 0 and 180"),
        (8, 8, 120.0, BrownConrady(-2.0), "turns back before a field of view of 120"),
    ],
)
def test_cameras_that_cannot_exist_are_refused(
    width: int, height: int, fov_deg: float, lens: Distortion | None, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        CameraModel.from_fov(width, height, fov_deg, lens)


@pytest.mark.parametrize(
    "camera",
    [
        CameraModel.from_opencv(640, 480, 320.0, 320.0, 319.5, 239.5, BrownConrady(-0.6)),
        CameraModel.from_opencv(640, 480, 200.0, 200.0, 319.5, 239.5, KannalaBrandt(-0.2)),
        CameraModel.from_opencv(640, 480, 320.0, 320.0, 319.5, 239.5, BrownConrady(0.0, 0.0, 0.9, 0.0)),
    ],
    ids=["turns back", "fisheye turns back", "tangential folds"],
)
def test_a_distortion_that_folds_the_picture_is_refused(camera: CameraModel) -> None:
    with pytest.raises(ValueError, match="two directions share a pixel"):
        camera.rays()


def test_the_inverse_never_takes_the_wrong_branch() -> None:
    """Beyond the radius where the lens turns back there is a second solution; the right one lies inside it."""
    lens = BrownConrady(-0.3, 0.0)
    turns_at = math.sqrt(1.0 / 0.9)  # d/dr (r - 0.3 r^3) = 0
    seen = np.array([[s * (r - 0.3 * r**3), 0.0] for r in np.linspace(0.0, turns_at * 0.999, 50) for s in (-1.0, 1.0)])
    d = lens.undistort(seen)
    assert np.all(np.abs(d[:, 0] / d[:, 2]) <= turns_at)
    assert np.abs(lens.distort(d) - seen).max() < 1e-9


def test_calibration_reads_back_in_opencv_and_yaml(tmp_path: Path) -> None:
    camera = CameraModel.from_opencv(752, 480, 458.654, 457.296, 367.215, 248.375, ORDINARY["euroc"])
    path = tmp_path / "opencv.yaml"
    path.write_text(opencv_yaml(camera))
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    k = store.getNode("camera_matrix").mat()
    d = store.getNode("distortion_coefficients").mat()
    assert int(store.getNode("fisheye_model").real()) == 0
    store.release()
    seen = cv2.projectPoints(points(20), np.zeros(3), np.zeros(3), k, d)[0].reshape(-1, 2)
    assert np.abs(camera.project(points(20)) - 0.5 - seen).max() < 1e-9

    info = yaml.safe_load(camera_info_yaml(camera, "front"))
    assert info["distortion_model"] == "plumb_bob"
    assert info["camera_matrix"]["data"] == list(camera.opencv_matrix)
    assert info["distortion_coefficients"]["cols"] == len(info["distortion_coefficients"]["data"]) == 5
    assert info["projection_matrix"]["data"][3] == 0.0

    euroc = yaml.safe_load(euroc_yaml(camera, rate_hz=20.0, T_BS=range(16)))
    assert euroc["intrinsics"] == [458.654, 457.296, 367.215, 248.375]
    assert euroc["distortion_model"] == "radial-tangential"
    assert euroc["distortion_coefficients"] == [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
    assert euroc["T_BS"]["data"] == [float(i) for i in range(16)]
    fisheye = CameraModel.from_fov(64, 48, 200.0, FISHEYE["real"])
    assert yaml.safe_load(camera_info_yaml(fisheye, "f"))["distortion_model"] == "equidistant"
    rational = CameraModel.from_fov(64, 48, 60.0, ORDINARY["rational"])
    assert len(yaml.safe_load(camera_info_yaml(rational, "r"))["distortion_coefficients"]["data"]) == 8


@pytest.mark.parametrize("lens", [None, ORDINARY["five"], FISHEYE["real"]])
def test_a_scaled_camera_has_the_same_view(lens: Distortion | None) -> None:
    camera = CameraModel.from_opencv(40, 30, 31.0, 29.0, 19.0, 15.0, lens)
    fine = camera.scaled(2)
    assert (fine.width, fine.height) == (80, 60)
    where = points(30)
    assert fine.project(where) == pytest.approx(2.0 * camera.project(where), rel=1e-12)
