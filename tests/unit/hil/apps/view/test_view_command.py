"""`hil view`: files, views and refusals, on a world in closed form."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import mujoco
import numpy as np
import pytest

from hil.apps.view.command import SHEET_NAME, ViewCamera, view_scene
from hil.apps.view.points import default_points, extent_of, looking_at, pose_of
from hil.cli.app import run_command_line
from signals.channels import CHANNELS
from signals.classes import Classes
from signals.errors import ConfigError
from signals.samples import CHANNEL_UNITS, PointCloudSample
from sim.frame.camera_model import CameraModel
from sim.frame.mount import Mount
from sim.scene.scene import load_scene
from sim.scene.view_point import ViewPoint
from tests.worlds.spheres_world import SPHERES, FormulaFrames


def world() -> Any:
    geoms = "".join(f'<geom type="sphere" pos="{x} {y} {z}" size="{r}"/>' for x, y, z, r in SPHERES)
    text = f'<mujoco><worldbody><geom type="plane" size="0 0 1"/>{geoms}</worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(text)
    return SimpleNamespace(model=model, geom_visible=np.ones(model.ngeom, bool))


def view(out: Path, *, points: tuple[ViewPoint, ...] = (), **options: Any) -> tuple[list[Path], FormulaFrames]:
    frames = FormulaFrames()
    scene = load_scene("airfield").model_copy(update={"view": points})
    camera = ViewCamera(options.pop("at", None), options.pop("look", None), options.pop("size", "40x30"))
    return view_scene("x", out, camera, load=lambda name, seed: (scene, world(), frames), **options), frames


def test_the_contact_sheet_and_every_channel_alone(tmp_path: Path) -> None:
    points = (
        ViewPoint(name="front", at_m=(0.0, 0.0, 2.0), look_deg=(0.0, 0.0)),
        ViewPoint(name="side", at_m=(8.0, -9.0, 2.0), look_deg=(90.0, 0.0)),
    )
    files, _ = view(tmp_path, points=points)
    assert files[0] == tmp_path / SHEET_NAME
    ends = ("", "_radar", *(f"_{name}" for name in CHANNEL_UNITS))
    names = {f"{place}{end}.png" for place in ("front", "side") for end in ends}
    assert {file.name for file in files[1:]} == names | {"front_spinning_radar.png"}
    sheet = cv2.imread(str(files[0]))
    assert sheet.shape[1] > 1200
    colour = cv2.cvtColor(cv2.imread(str(tmp_path / "front_rgb.png")), cv2.COLOR_BGR2RGB)
    assert colour.shape == (30, 40, 3)
    assert tuple(colour[15, 20]) == (200, 40, 40)  # the ball straight ahead
    classes = cv2.cvtColor(cv2.imread(str(tmp_path / "front_segmentation.png")), cv2.COLOR_BGR2RGB)
    assert tuple(classes[15, 20]) == FormulaFrames.classes.colours[2]


def test_places_are_found_where_the_scene_names_none() -> None:
    extent = extent_of(world())
    assert extent.low[0] < 5.5 < 11.5 < extent.high[0]
    points = default_points(FormulaFrames(), extent)
    assert [point.name for point in points] == ["air", "eye", "corner", "above"]
    assert points == default_points(FormulaFrames(), extent)
    assert points[1].at_m[2] == 1.7
    # The view shows more than one of the three balls, and none close to the lens.
    camera = CameraModel.from_fov(80, 60, 90.0)
    picture: dict[str, Any] = {"instance": np.empty((60, 80), np.uint16), "range": np.empty((60, 80), np.float32)}
    pose = Mount((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).pose(pose_of(points[1]))
    FormulaFrames().renderer(camera).render(pose, picture)
    assert len({2, 3, 4} & set(np.unique(picture["instance"]).tolist())) >= 2
    assert np.percentile(picture["range"], 10.0) > 1.5


def test_a_look_is_a_yaw_to_the_north_and_a_pitch_down() -> None:
    R = np.array(Mount((0, 0, 0), (0, 0, 0)).pose(pose_of(ViewPoint(name="a", at_m=(0, 0, 5), look_deg=(90, 30)))).R_WC)
    assert R.reshape(3, 3)[:, 2] == pytest.approx([0.0, np.cos(np.radians(30)), -0.5], abs=1e-12)
    assert looking_at("b", (0, 0, 5), (0, 5, 0)).look_deg == pytest.approx((90.0, 45.0))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": "40"}, "WIDTHxHEIGHT"),
        ({"size": "0x30"}, "1 to 8192"),
        ({"size": "9000x30"}, "1 to 8192"),
        ({"at": "1,2"}, "3 numbers"),
        ({"at": "1,2,nan"}, "3 numbers"),
        ({"at": "1,2,3", "look": "10"}, "2 numbers"),
        ({"at": "1,2,3", "look": "10,91"}, "pitch within 90"),
        ({"look": "10,20"}, "needs --at"),
    ],
)
def test_wrong_options_are_refused(tmp_path: Path, options: dict[str, str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        view(tmp_path, **options)
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_scene_is_named_with_the_nearest(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["view", "airfeild"]) == 2
    assert "did you mean 'airfield'?" in capfd.readouterr().err
    assert run_command_line(["view", "no/such/scene.yaml"]) == 2


def test_every_channel_can_be_coloured_whatever_it_holds() -> None:
    from hil.run.report.frame_pictures import coloured, palette  # matplotlib

    classes = Classes(("none", "tree"), ((0, 0, 0), (1, 2, 3)))
    for channel in CHANNELS:
        shape = (3, 4, 3) if channel in ("rgb", "normal") else (3, 4)
        for value in (0.0, np.inf, np.nan, -np.inf, 250.0):
            if channel not in ("depth", "range", "normal", "radial_velocity") and not np.isfinite(value):
                continue
            out = coloured(channel, np.full(shape, value, np.float32), classes)
            assert out.shape == (3, 4, 3)
            assert out.dtype == np.uint8
    assert len({tuple(colour) for colour in palette(200).tolist()}) > 190


@pytest.mark.parametrize("n", [0, 500])
def test_a_sweep_becomes_a_picture_whatever_it_holds(tmp_path: Path, n: int) -> None:
    from hil.run.report.figures import save  # matplotlib
    from hil.run.report.frame_pictures import frame_figure, sheet_figure

    rng = np.random.default_rng(n)
    points = rng.normal(scale=20.0, size=(n, 3)).astype(np.float32)
    sweep = PointCloudSample(
        0,
        0,
        0,
        (0.0, 0.0, 1.0),
        (1.0, 0.0, 0.0, 0.0),
        points,
        np.linalg.norm(points, axis=1).astype(np.float32),
        rng.uniform(size=n).astype(np.float32),
        np.zeros(n, np.uint8),
        np.zeros(n, np.int32),
        rng.integers(0, 3, n).astype(np.uint8),
    )
    save(frame_figure("lidar", sweep, FormulaFrames.classes), tmp_path / "cloud.png")
    views = [(ViewPoint(name="a", at_m=(0, 0, 1), look_deg=(0, 0)), "title", {"rgb": np.zeros((6, 8, 3), np.uint8)})]
    save(sheet_figure(views, sweep), tmp_path / "sheet.png")
    for name in ("cloud.png", "sheet.png"):
        assert cv2.imread(str(tmp_path / name)).shape[1] > 1200


def test_an_odd_size_is_drawn_too(tmp_path: Path) -> None:
    files, _ = view(tmp_path, at="0,0,2", look="0,0", size="1x400")
    assert cv2.imread(str(files[0])).shape[0] < 6250  # 1250 for each row of three channels


def test_variants_of_a_scene_on_one_sheet(tmp_path: Path) -> None:
    settings = ["randomize={seed: 4, light: true}", "quality=low"]
    files = view_scene("airfield", tmp_path, ViewCamera("0,0,5", size="32x24"), variants=2, settings=settings)
    assert [file.name for file in files] == ["variants.png", "variant_4.png", "variant_5.png"]
    one, other = (cv2.imread(str(file)) for file in files[1:])
    assert one.shape == other.shape == (24, 32, 3)
    assert not np.array_equal(one, other)
