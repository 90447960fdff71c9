"""Colour of the native raster against its equations in double precision."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.raster_cases import camera_pose
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import Execution, FrameRenderer
from sim.frame.shading import PLAIN, Shading, daylight_rgb
from sim.scene.light import Light
from sim.scene.scene import load_scene
from sim.world_loader import load_world
from tests.unit.sim.frame.test_frame_raster import ISAS

Array = NDArray[np.float64]
CAMERA = CameraModel.from_fov(96, 96, 40.0)
DOWN = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
SCENE = """\
name: shading
description: one thing under a sun
site: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488.0}
ground_friction: 0.8
light: {sun_elevation_deg: 40.0, sun_azimuth_deg: 200.0}
map: {mjcf: map.xml}
"""


def geometry_of(folder: Path, assets: str, geoms: str) -> FrameGeometry:
    (folder / "map.xml").write_text(f"<mujoco><asset>{assets}</asset><worldbody>{geoms}</worldbody></mujoco>")
    (folder / "scene.yaml").write_text(SCENE)
    return FrameGeometry(load_world(load_scene(folder / "scene.yaml")))


def rgb_of(geometry: FrameGeometry, p: tuple[float, float, float], R_WC: Array, shading: Shading, **told) -> Array:  # type: ignore[no-untyped-def]
    renderer = FrameRenderer(geometry, CAMERA, shading=shading, **told)
    out = renderer.buffers("rgb")
    renderer.render(camera_pose(np.array(p), R_WC), out)
    return np.asarray(out["rgb"], float)


def linear(code: Array) -> Array:
    c = code / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def rays_W(R_WC: Array) -> Array:
    columns, rows = np.meshgrid(np.arange(96) + 0.5, np.arange(96) + 0.5)
    d = np.stack([(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones((96, 96))], axis=-1)
    return d @ R_WC.T


def test_filtered_textures_are_nearer_to_the_mean_over_the_pixel(tmp_path: Path) -> None:
    texels = np.random.default_rng(3).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "noise.png"), cv2.GaussianBlur(texels, (0, 0), 1.0))
    assets = (
        '<texture name="noise" type="2d" file="noise.png"/>'
        '<material name="noise" texture="noise" texuniform="true" texrepeat="1 1" specular="0"/>'
    )
    geometry = geometry_of(tmp_path, assets, '<geom name="ground" type="plane" size="50 50 1" material="noise"/>')
    for height_m in (6.0, 12.0, 30.0):
        errors = []
        for filtering in (False, True):
            shading = Shading(filtering=filtering)
            exact = linear(rgb_of(geometry, (0.0, 0.0, height_m), DOWN, PLAIN, supersample=4))
            made = linear(rgb_of(geometry, (0.0, 0.0, height_m), DOWN, shading))
            errors.append(np.sqrt(np.mean((made - exact) ** 2)))
        assert errors[1] < 0.85 * errors[0], (height_m, errors)


def test_a_filtered_magnified_texture_is_the_bilinear_surface(tmp_path: Path) -> None:
    """Texels 5 cm wide, seen from 1 m: each pixel is the bilinear mean in linear light of the four texels around it."""
    texels = np.random.default_rng(5).integers(30, 226, (16, 16, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "coarse.png"), texels[:, :, ::-1])
    assets = (
        '<texture name="coarse" type="2d" file="coarse.png"/>'
        '<material name="coarse" texture="coarse" texuniform="true" texrepeat="2.5 2.5" specular="0"/>'
    )
    geometry = geometry_of(tmp_path, assets, '<geom name="ground" type="plane" size="0 0 1" material="coarse"/>')
    made = rgb_of(geometry, (0.013, 0.021, 1.0), DOWN, Shading(filtering=True))
    d = rays_W(DOWN)
    at = np.array([0.013, 0.021]) + d[..., :2] / -d[..., 2:]
    x, y = at[..., 0] / 0.05 - 0.5, at[..., 1] / 0.05 - 0.5  # texels from the corner of the image at the origin
    light = linear(texels.astype(float))
    mean = np.zeros((96, 96, 3))
    for i in (0, 1):
        for j in (0, 1):
            column, row = np.floor(x).astype(int) + i, np.floor(y).astype(int) + j
            weight = abs(1 - i - (x - np.floor(x))) * abs(1 - j - (y - np.floor(y)))
            mean += weight[..., None] * light[15 - row % 16, column % 16]
    shade = (
        linear(rgb_of(geometry, (0.013, 0.021, 1.0), DOWN, PLAIN))
        / light[15 - np.round(y).astype(int) % 16, np.round(x).astype(int) % 16]
    )
    expected = mean * np.median(shade, axis=(0, 1))
    assert np.quantile(abs(linear(made) - expected), 0.99) < 0.01


@pytest.mark.parametrize(("specular", "shininess"), [(1.0, 0.9), (0.5, 0.4), (0.2, 0.1)])
def test_highlights_follow_their_equations(tmp_path: Path, specular: float, shininess: float) -> None:
    assets = f'<material name="paint" rgba="0.5 0.2 0.1 1" specular="{specular}" shininess="{shininess}"/>'
    geometry = geometry_of(tmp_path, assets, '<geom name="ball" type="sphere" size="1" pos="0 0 3" material="paint"/>')
    p = (0.0, -4.0, 3.5)
    R_WC = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # looks north
    plain, shiny = rgb_of(geometry, p, R_WC, PLAIN), rgb_of(geometry, p, R_WC, Shading(highlights=True))
    d = rays_W(R_WC)
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    o = np.array(p) - (0.0, 0.0, 3.0)
    b = d @ o
    root = b * b - (o @ o - 1.0)
    hit = root > 0.01
    n = o + (-b - np.sqrt(np.maximum(root, 0.0)))[..., None] * d
    light = FrameRenderer(geometry, CAMERA).geometry.world.scene.light
    sun, cosine = np.array(light.to_sun_W), -np.sum(n * d, axis=-1).clip(-1.0, 0.0)
    half = (sun - d) / np.linalg.norm(sun - d, axis=-1, keepdims=True)
    f0, gloss = 0.08 * specular, shininess
    share = gloss * (f0 + (max(gloss, f0) - f0) * (1.0 - cosine) ** 5)
    e = 1024.0 * gloss**3
    up = (d + 2.0 * cosine[..., None] * n)[..., 2]
    above = np.clip(up * 0.5 / (1.05 - gloss) + 0.5, 0.0, 1.0)[..., None]
    w = np.clip(up, 0.0, 1.0)
    k = (w * (2.0 - w))[..., None]
    horizon, zenith = np.array(light.sky_horizon_rgb), np.array(light.sky_zenith_rgb)
    ground = 0.45 * np.array(light.ambient_rgb)
    around = ground + above * (horizon + k * (zenith - horizon) - ground)
    sunny = np.clip(n @ sun, 0.0, None) * np.exp(-e * (1.0 - np.sum(n * half, axis=-1))) * (e + 8.0) / 8.0
    fresnel = f0 + (1.0 - f0) * (1.0 - np.clip(-np.sum(d * half, axis=-1), 0.0, 1.0)) ** 5
    expected = linear(plain) * (1.0 - share)[..., None] + around * share[..., None]
    expected += (sunny * fresnel)[..., None] * np.array(light.sun_rgb)
    assert abs(linear(shiny) - np.clip(expected, 0.0, 1.0))[hit].max() < 0.012
    assert abs(shiny - plain)[hit].max() > 3.0
    assert np.array_equal(shiny[~hit & (root < 0.0)], plain[~hit & (root < 0.0)])


@pytest.mark.parametrize("slope", [(0.3, 0.0), (0.0, -0.4), (-0.2, 0.25)])
def test_a_texture_of_one_normal_shades_as_a_tilted_plane(tmp_path: Path, slope: tuple[float, float]) -> None:
    normal = np.array([slope[0], slope[1], np.sqrt(1.0 - slope[0] ** 2 - slope[1] ** 2)])
    cv2.imwrite(str(tmp_path / "white.png"), np.full((8, 8, 3), 255, np.uint8))
    cv2.imwrite(
        str(tmp_path / "relief.png"), np.tile(np.round(127.5 * (normal[::-1] + 1.0)).astype(np.uint8), (8, 8, 1))
    )
    assets = (
        '<texture name="white" type="2d" file="white.png"/><texture name="relief" type="2d" file="relief.png"/>'
        '<material name="m" rgba="0.6 0.6 0.6 1" specular="0"><layer role="rgb" texture="white"/>'
        '<layer role="normal" texture="relief"/></material><mesh name="quad" file="quad.obj" inertia="shell"/>'
    )
    corners = "v -9 -9 0\nv 9 -9 0\nv 9 9 0\nv -9 9 0\nvt 0 0\nvt 9 0\nvt 9 9\nvt 0 9\n"
    (tmp_path / "quad.obj").write_text(corners + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
    things = {
        "plane": '<geom name="ground" type="plane" size="9 9 1" material="m"/>',
        "mesh": '<geom name="ground" type="mesh" mesh="quad" material="m" contype="0" conaffinity="0"/>',
    }
    for thing, geom in things.items():
        geometry = geometry_of(tmp_path, assets, geom)
        light = geometry.world.scene.light
        flat = linear(rgb_of(geometry, (0.0, 0.0, 3.0), DOWN, PLAIN))[48, 48]
        tilted = linear(rgb_of(geometry, (0.0, 0.0, 3.0), DOWN, Shading(relief=True)))[48, 48]
        sky, sun = np.array(light.ambient_rgb), np.array(light.sun_rgb)

        def lit(n: Array) -> Array:
            above = 0.5 * n[2] + 0.5
            return sky * (0.45 + above * 0.55) + max(float(n @ np.array(light.to_sun_W)), 0.0) * sun  # noqa: B023

        assert tilted / flat == pytest.approx(lit(normal) / lit(np.array([0.0, 0.0, 1.0])), abs=0.03), thing


def test_the_film_curve_keeps_middle_grey_and_never_turns_back(tmp_path: Path) -> None:
    steps = "".join(
        f'<geom name="g{i}" type="box" size="0.01 1 0.01" pos="{0.02 * i - 0.64:.3f} 0 0" material="m{i}"/>'
        for i in range(64)
    )
    assets = "".join(f'<material name="m{i}" rgba="{i / 63} {i / 63} {i / 63} 1" specular="0"/>' for i in range(64))
    geometry = geometry_of(tmp_path, assets, steps)
    lin = linear(rgb_of(geometry, (0.0, 0.0, 1.5), DOWN, Shading(exposure_ev=-1.5)))[:, 48]
    film = linear(rgb_of(geometry, (0.0, 0.0, 1.5), DOWN, Shading(exposure_ev=-1.5, tone="filmic")))[:, 48]
    order = np.argsort(lin[:, 1])
    assert np.all(np.diff(film[order, 1]) >= 0.0)
    assert np.interp(0.18, lin[order, 1], film[order, 1]) == pytest.approx(0.18, abs=0.01)
    e = 0.723 * lin[order]
    curve = e * (2.51 * e + 0.03) / (e * (2.43 * e + 0.59) + 0.14)
    assert abs(film[order] - curve).max() < 0.012


def test_white_balance_is_that_of_daylight() -> None:
    assert daylight_rgb(6504.0) == pytest.approx((1.0, 1.0, 1.0), abs=0.01)
    # D50, x = 0.3457, y = 0.3585, with the same matrix.
    xyz = np.array([0.3457 / 0.3585, 1.0, (1 - 0.3457 - 0.3585) / 0.3585])
    rgb = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]) @ xyz
    assert daylight_rgb(5003.0) == pytest.approx(rgb / rgb[1], abs=2e-3)
    assert daylight_rgb(4000.0)[0] > daylight_rgb(5000.0)[0] > 1.0 > daylight_rgb(5000.0)[2]


@pytest.mark.parametrize("isa", ISAS)
def test_every_instruction_set_and_number_of_threads_gives_the_same_colours(isa: str) -> None:
    geometry = FrameGeometry(load_world(load_scene("urban_delivery")))
    shading = Shading(
        filtering=True, highlights=True, relief=True, tone="filmic", exposure_ev=0.5, white_balance_k=5000.0
    )
    R_WC = np.array([[1.0, 0.0, 0.0], [0.0, -0.5, 0.8660254037844386], [0.0, -0.8660254037844386, -0.5]])
    expected = rgb_of(geometry, (0.0, -20.0, 12.0), R_WC, shading, shadows=True)
    execution = Execution(threads=2, isa=isa)
    assert np.array_equal(
        rgb_of(geometry, (0.0, -20.0, 12.0), R_WC, shading, shadows=True, execution=execution), expected
    )


@pytest.mark.parametrize("isa", ISAS)
def test_a_high_wall_takes_half_of_the_light_of_the_floor_beside_it(tmp_path: Path, isa: str) -> None:
    """At the foot of an endless wall half of the hemisphere is open; over the open floor and on the wall, all of it."""
    wall = '<geom name="ground" type="plane" size="0 0 1"/><geom name="wall" type="box" size="1 60 30" pos="11 0 30"/>'
    geometry = geometry_of(tmp_path, "", wall)
    light = Light(sun_rgb=(0.0, 0.0, 0.0))

    def share(p: tuple[float, float, float], R_WC: Array) -> float:
        """Return the share of the ambient light in the middle of the picture."""
        told = {"light": light, "execution": Execution(isa=isa)}
        with_it, without = (
            linear(rgb_of(geometry, p, R_WC, Shading(ambient_occlusion=on), **told)) for on in (True, False)
        )
        return float((with_it / without)[46:50, 46:50].mean())

    east = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    assert share((9.6, 0.0, 5.0), DOWN) == pytest.approx(0.2 + 0.8 * 0.5, abs=0.06)
    assert share((-30.0, 0.0, 5.0), DOWN) == pytest.approx(1.0, abs=0.01)
    assert share((5.0, 0.0, 20.0), east) == pytest.approx(1.0, abs=0.1)
