"""Frames of `hil bench realism`: poses of a low-flying delivery drone around the objects of a scene, with the truth.

A pose looks at one object from 1.8 to 15 m (logarithmically uniform, from the side of the object's bounding box), 1.2
to 6 m up, from any azimuth and at a random time of the scene; the object is within 12 degrees across and 8 degrees up
or down of the picture's middle. A pose is drawn again until the sky is free above the camera, nothing is closer than
0.5 m, and the object counts (`Truth.counts`). All draws come from one generator of scene, seed and kind.

With a range of elevations, the camera stands at an elevation of that range seen from the object's middle, 3 to 16 m
beyond its outline: for views from far above, which the poses of a low flight hardly have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.mujoco_rays import cast
from hil.apps.bench_suite.sensors.raster_cases import camera_pose, looking
from lab.realism.kinds import BY_NAME, Kind, objects_of
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.mujoco_backend import WorldPose
from sim.frame.quality import QUALITIES, with_quality
from sim.frame.renderer import CameraPose, FrameRenderer
from sim.frame.source import SharedFrames
from sim.scene.scene import load_scene
from sim.scene.surfaces import SKIN
from sim.scene.world import World
from sim.world_loader import load_world

WIDTH, HEIGHT, FOV_DEG = 640, 480, 70.0
MIN_SHARE, MIN_PX = 0.6, 40  # of the object's unoccluded pixels; longer side of its box
_NEAR_M, _FAR_M = 0.05, 1000.0
_DISTANCE_M, _HEIGHT_M = (1.8, 15.0), (1.2, 6.0)
_MAX_DOWN_DEG = 50.0
_YAW_DEG, _PITCH_DEG, _ROLL_DEG = 12.0, 8.0, 3.0
_FROM_ABOVE_M = (3.0, 16.0)
_CLEAR_M = 0.5
_TRIES = 40  # for each frame
_PERSON = BY_NAME["person"]
_SPAN_NS = 60_000_000_000


@dataclass(frozen=True)
class Truth:
    """Object in a picture: the box of its visible pixels (edges), and the visible share of its unoccluded pixels.

    The unoccluded pixels are those of the object alone, in a picture of three times the width and height.
    """

    kind: Kind
    name: str
    box_px: tuple[float, float, float, float]
    share: float

    @property
    def side_px(self) -> float:
        """Longer side of the box."""
        return max(self.box_px[2] - self.box_px[0], self.box_px[3] - self.box_px[1])

    @property
    def counts(self) -> bool:
        """True if the object is visible and large enough to be asked for."""
        return self.share >= MIN_SHARE and self.side_px >= MIN_PX


@dataclass(frozen=True)
class Frame:
    """Picture of one quality with its truth. `target`: name of the object that the camera was aimed at."""

    scene: str
    seed: int | None  # of the map; None: the scene's own
    kind: Kind  # of the target
    quality: str
    target: str
    distance_m: float
    height_m: float
    truths: tuple[Truth, ...]
    rgb: NDArray[np.uint8]

    def without_picture(self) -> Frame:
        """Return the frame without its picture, for keeping."""
        return replace(self, rgb=np.empty((0, 0, 3), np.uint8))


class Scenario:
    """Scene with one seed of its map, from which frames are taken; `elevation_deg`: lowest and highest elevation."""

    def __init__(self, scene: str, seed: int | None, elevation_deg: tuple[float, float] | None = None) -> None:
        self.scene, self.seed, self._elevation_deg = scene, seed, elevation_deg
        self.world: World = load_world(load_scene(scene), map_seed=seed)
        self.objects = objects_of(self.world)
        self._frames = SharedFrames(self.world)
        self._camera = CameraModel.from_fov(WIDTH, HEIGHT, FOV_DEG)
        self._truth = self._renderer("low")
        self._colour: dict[str, Any] = {}
        self._alone: dict[int, tuple[FrameGeometry, FrameRenderer]] = {}
        self._pose = WorldPose(self.world)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """Kinds that the scene holds."""
        return tuple(dict.fromkeys(self.objects.values()))

    def poses(self, kind: Kind, count: int, qualities: Callable[[int], Sequence[str]]) -> Iterator[list[Frame]]:
        """Yield the frames of `count` poses around the objects of a kind, fewer if there are not enough poses.

        The objects are taken in turn. `qualities`: those of the frames of a pose, by its number.
        """
        names = [instance for instance, of in self.objects.items() if of == kind]
        if not names:
            return
        text = f"{self.scene} {self.seed} {kind.name}"
        text += "" if self._elevation_deg is None else f" {self._elevation_deg}"
        rng = np.random.Generator(np.random.Philox(list(text.encode())))
        turn = 0
        for number in range(count):
            for _ in range(_TRIES):
                instance = names[turn % len(names)]
                turn += 1
                t_ns = int(rng.integers(0, _SPAN_NS))
                pose, distance_m = self._draw_pose(rng, instance, t_ns)
                truths = self._truths(pose, t_ns, instance)
                if truths is not None:
                    break
            else:
                return
            name, height_m = self.world.instance_names[instance], pose.p_WC[2]
            yield [
                Frame(
                    self.scene,
                    self.seed,
                    kind,
                    quality,
                    name,
                    distance_m,
                    height_m,
                    truths,
                    self._picture(quality, pose),
                )
                for quality in qualities(number)
            ]

    def _draw_pose(self, rng: np.random.Generator, instance: int, t_ns: int) -> tuple[CameraPose, float]:
        low, high = self._bounds(instance, t_ns)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        azimuth = rng.uniform(-math.pi, math.pi)
        east, north = math.cos(azimuth), math.sin(azimuth)
        if self._elevation_deg is not None:
            distance = math.exp(rng.uniform(math.log(_FROM_ABOVE_M[0]), math.log(_FROM_ABOVE_M[1])))
            elevation = math.radians(rng.uniform(*self._elevation_deg))
            reach = math.hypot(half[0], half[1]) + distance
            offset = np.array([math.cos(elevation) * east, math.cos(elevation) * north, math.sin(elevation)])
            p_W = middle + reach * offset
            p_W[2] = max(p_W[2], low[2] + _HEIGHT_M[0])
            return self._aimed(rng, p_W, middle, azimuth), distance
        side = min(half[0] / max(abs(east), 1e-9), half[1] / max(abs(north), 1e-9))
        distance = math.exp(rng.uniform(math.log(_DISTANCE_M[0]), math.log(_DISTANCE_M[1])))
        ground = (side + distance) * math.tan(math.radians(_MAX_DOWN_DEG))
        height = rng.uniform(_HEIGHT_M[0], max(_HEIGHT_M[0], min(_HEIGHT_M[1], middle[2] + ground)))
        p_W = middle + (side + distance) * np.array([east, north, 0.0])
        p_W[2] = low[2] + height
        return self._aimed(rng, p_W, middle, azimuth), distance

    @staticmethod
    def _aimed(
        rng: np.random.Generator, p_W: NDArray[np.float64], middle: NDArray[np.float64], azimuth: float
    ) -> CameraPose:
        """Return a pose that looks back at `middle`, which lies away from the picture's middle by chance."""
        across = math.hypot(p_W[0] - middle[0], p_W[1] - middle[1])
        down_deg = math.degrees(math.atan2(p_W[2] - middle[2], across))
        R_WC = looking(
            math.degrees(azimuth) + 180.0 + rng.uniform(-_YAW_DEG, _YAW_DEG),
            down_deg + rng.uniform(-_PITCH_DEG, _PITCH_DEG),
            roll_deg=rng.uniform(-_ROLL_DEG, _ROLL_DEG),
        )
        return camera_pose(p_W, R_WC)

    def _bounds(self, instance: int, t_ns: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the axis-aligned box of an object's visible geoms in W [m]."""
        data, model = self._pose.at(t_ns), self.world.model
        geoms = np.flatnonzero((self.world.geom_instance == instance) & self.world.geom_visible)
        rotation = data.geom_xmat[geoms].reshape(-1, 3, 3)
        centre = data.geom_xpos[geoms] + np.einsum("nij,nj->ni", rotation, model.geom_aabb[geoms, :3])
        reach = np.einsum("nij,nj->ni", np.abs(rotation), model.geom_aabb[geoms, 3:])
        return (centre - reach).min(axis=0), (centre + reach).max(axis=0)

    def _truths(self, pose: CameraPose, t_ns: int, target: int) -> tuple[Truth, ...] | None:
        """Return the objects in a picture; None if the pose is not free or the target does not count."""
        if not self._sky_is_free(pose):
            return None
        self._frames.expect(t_ns)
        out: dict[str, NDArray[Any]] = {
            "range": np.empty((HEIGHT, WIDTH), np.float32),
            "instance": np.empty((HEIGHT, WIDTH), np.uint16),
            "material": np.empty((HEIGHT, WIDTH), np.uint8),
        }
        self._truth.render(pose, out)
        if out["range"].min() < _CLEAR_M:
            return None
        instances = np.unique(out["instance"]).tolist()
        if target not in instances:
            return None
        first = self._truth_of(target, out["instance"], pose, t_ns)
        if not first.counts:
            return None
        others = [i for i in instances if i in self.objects and i != target]
        truths = [first, *(self._truth_of(i, out["instance"], pose, t_ns) for i in others)]
        return (*truths, *self._riders(out["instance"], out["material"]))

    def _riders(self, instances: NDArray[np.uint16], surfaces: NDArray[np.uint8]) -> list[Truth]:
        """Return the people who are part of another object, such as drivers; they never count.

        Their box is that of the visible skin, made twice as wide and high.
        """
        skin = np.isin(surfaces, [i for i, surface in enumerate(self.world.surfaces) if surface == SKIN])
        riders = []
        for instance in np.unique(instances[skin]).tolist():
            kind = self.objects.get(instance)
            if kind is None or kind.name == _PERSON.name:
                continue
            x_min, y_min, x_max, y_max = _box_of(skin & (instances == instance))
            across, down = 0.5 * (x_max - x_min), 0.5 * (y_max - y_min)
            box = (x_min - across, y_min - down, x_max + across, y_max + down)
            riders.append(Truth(_PERSON, f"rider of {self.world.instance_names[instance]}", box, 0.0))
        return riders

    def _sky_is_free(self, pose: CameraPose) -> bool:
        geom, _, _ = cast(self.world.model, self._pose.data, np.array(pose.p_WC), np.array([[0.0, 0.0, 1.0]]))
        return bool(geom[0] < 0)

    def _truth_of(self, instance: int, picture: NDArray[np.uint16], pose: CameraPose, t_ns: int) -> Truth:
        pixels = picture == instance
        whole = self._whole_px(instance, pose, t_ns)
        share = min(1.0, float(np.count_nonzero(pixels)) / whole) if whole else 0.0
        return Truth(self.objects[instance], self.world.instance_names[instance], _box_of(pixels), share)

    def _whole_px(self, instance: int, pose: CameraPose, t_ns: int) -> float:
        """Return the pixels of an object that nothing hides, within and outside of the picture."""
        if instance not in self._alone:
            only = self.world.geom_visible & (self.world.geom_instance == instance)
            geometry = FrameGeometry(replace(self.world, geom_visible=only))
            camera = CameraModel(
                3 * WIDTH // 2,
                3 * HEIGHT // 2,
                0.5 * self._camera.fx,
                0.5 * self._camera.fy,
                0.5 * (self._camera.cx + WIDTH),
                0.5 * (self._camera.cy + HEIGHT),
            )
            self._alone[instance] = (geometry, FrameRenderer(geometry, camera, planes_m=(_NEAR_M, _FAR_M)))
        geometry, renderer = self._alone[instance]
        geometry.expect(t_ns)
        out = renderer.buffers("instance")
        renderer.render(pose, out)
        return 4.0 * float(np.count_nonzero(out["instance"] == instance))

    def _picture(self, quality: str, pose: CameraPose) -> NDArray[np.uint8]:
        if quality not in self._colour:
            self._colour[quality] = self._renderer(quality)
        rgb = np.empty((HEIGHT, WIDTH, 3), np.uint8)
        self._colour[quality].render(pose, {"rgb": rgb})
        return rgb

    def _renderer(self, quality: str) -> Any:
        values = with_quality({"resolution": (WIDTH, HEIGHT)}, quality, given=("resolution",))
        return self._frames.renderer(
            self._camera,
            shadows=values["shadows"],
            supersample=values["supersample"],
            shading=QUALITIES[quality].shading,
            near_m=_NEAR_M,
            far_m=_FAR_M,
        )


def _box_of(pixels: NDArray[np.bool_]) -> tuple[float, float, float, float]:
    """Return the box of the pixels that are True."""
    rows, columns = np.nonzero(pixels)
    return (float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1))
