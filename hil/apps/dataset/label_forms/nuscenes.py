"""nuScenes (Caesar et al., CVPR 2020; the development kit's schema): tables of scenes, samples, data and annotations.

    nuscenes/v1.0-hil/TABLE.json                  the 13 tables
    nuscenes/samples/CAM_FRONT/*.png              pictures of the labelled camera (links), sweeps/ those between samples
    nuscenes/samples/LIDAR_TOP/*.pcd.bin          float32 x, y, z [m], intensity (0 to 255), ring
    nuscenes/maps/empty.png                       the format wants a map's mask; this one holds nothing

* A sample is a frame with a sweep at the same time. A scene is a piece of the trajectory that belongs to one set; its
  name begins with the set's.
* The global frame is W (east, north, up), the ego frame B (x forward, y left, z up), a camera's x right, y down, z
  forward. LIDAR_TOP has nuScenes's own axes, x right, y forward, z up: x = -y_L, y = x_L.
* A box is upright in W. size is width, length, height; rotation (w, x, y, z) turns x of the box to the heading.
* An annotation is an object that the picture shows or that a point of the sweep lies on. num_lidar_pts counts the
  points inside the box, whatever they lie on. visibility is that in the one camera: (1 - occlusion) (1 - truncation).
* Each instance has its class as an additional field: a category joins several classes.
* Times are whole microseconds. Tokens are hashes of what they name.

The sweep has the motion of the vehicle taken out.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.apps.dataset.formats.labels import Catalogue
from hil.apps.dataset.formats.split import Split
from hil.apps.dataset.label_form import AnnotatedFrame, Annotation, Frames, JointSample, LabelForm, link
from hil.apps.dataset.storage.tree import TreeWriter, Written
from hil.run.report.channel_images import bgr_png
from signals.rotation import product
from signals.samples import Quat
from signals.time import NS_PER_S

FOLDER = "nuscenes"
VERSION = "v1.0-hil"
CAMERA, LIDAR = "CAM_FRONT", "LIDAR_TOP"
MAP_NAME = "maps/empty.png"
_PREFIX = "hil"
# Categories of nuScenes and nuScenes-lidarseg, whose colours the development kit knows; drones have none there.
CATEGORIES = {
    "person": "human.pedestrian.adult",
    "vehicle": "vehicle.car",
    "bicycle": "vehicle.bicycle",
    "motorcycle": "vehicle.motorcycle",
    "drone": "vehicle.drone",
    "dog": "animal",
    "bird": "animal",
    "barrier": "movable_object.barrier",
    **dict.fromkeys(("barrel", "bin", "crate"), "movable_object.pushable_pullable"),
    **dict.fromkeys(("bush", "hedge", "potted_plant", "tree", "vegetation"), "static.vegetation"),
    **dict.fromkeys(("building", "hall", "house", "tower", "container", "fence", "gate", "wall"), "static.manmade"),
    **dict.fromkeys(("bench", "furniture", "lamp", "playground", "pole", "sandbags", "stand"), "static.manmade"),
    **dict.fromkeys(("reflector", "sign", "stop_sign", "traffic_light", "windsock"), "static.manmade"),
}
_OTHER = "static.other"
_VISIBILITY = (("1", "v0-40", 0.0), ("2", "v40-60", 0.4), ("3", "v60-80", 0.6), ("4", "v80-100", 0.8))
_MOVING_FROM_MPS = 0.2
_ATTRIBUTES = ("pedestrian.moving", "pedestrian.standing", "vehicle.moving", "vehicle.stopped")
_US_PER_NS = 1000
_GAP_S = 2.0  # between flights there is a take-off; between frames of one, at most a period of the LiDAR
_Q_TOP: Quat = (math.sqrt(0.5), 0.0, 0.0, -math.sqrt(0.5))  # axes of LIDAR_TOP to those of L


class Form(LabelForm):
    contents = f"nuScenes, version {VERSION}: samples, sweeps and tables"
    annotates = True

    def files_of(self, sample: JointSample) -> Iterator[tuple[str, bytes]]:
        sweep = sample.sweep
        yield f"{FOLDER}/{file_name(LIDAR, sample.t_ns)}", lidar_bytes(sweep.points_L, sweep.intensity, sweep.ring)

    def finish(self, tree: TreeWriter, split: Split, frames: Frames) -> Iterator[Written]:
        times = [frame.t_ns for frame in frames()]
        usual_ns = min((b - a for a, b in pairwise(times)), default=0)
        gap_ns = max(round(_GAP_S * NS_PER_S), 2 * usual_ns)

        def each_scene() -> Iterator[Scene]:
            return scenes(frames(), split.set_by_frame, gap_ns)

        for scene in each_scene():
            for frame in scene.frames:
                name = file_name(CAMERA, frame.t_ns, is_sample=frame.swept)
                link(tree.root / FOLDER / name, f"../../../{self.picture_of(frame)}")
        yield tree.write(f"{FOLDER}/{MAP_NAME}", bgr_png(np.zeros((1, 1), np.uint8)))
        for path, texts in Tables(each_scene, self.catalogue, self._rig()).texts():
            yield tree.write_texts(f"{FOLDER}/{path}", texts)

    def _rig(self) -> Rig:
        plan, model = self.plan, self.camera.model()
        return Rig(
            p_BC=self.of_camera.p_BC,
            q_BC=self.of_camera.q_BC,
            K=model.opencv_matrix,
            width=model.width,
            height=model.height,
            p_BL=self.of_lidar.p_BC,
            q_BL=self.of_lidar.q_BC,
            vehicle=plan.vehicle or str(plan.config.vehicle),
            location=plan.bench.scene.name,
            description=f"{plan.bench.scene.name}, seed {plan.config.seed}, simulated",
        )


def lidar_bytes(points_L: NDArray[np.float32], intensity: NDArray[np.float32], ring: NDArray[Any]) -> bytes:
    """Return a .pcd.bin file, in the axes of LIDAR_TOP; intensity is 0 to 1."""
    rows = np.empty((len(points_L), 5), "<f4")
    rows[:, 0], rows[:, 1], rows[:, 2] = -points_L[:, 1], points_L[:, 0], points_L[:, 2]
    rows[:, 3], rows[:, 4] = 255.0 * intensity, ring
    return rows.tobytes()


def file_name(channel: str, t_ns: int, *, is_sample: bool = True) -> str:
    """Return the path of a picture or sweep in the folder of nuScenes."""
    ending = "pcd.bin" if channel == LIDAR else "png"
    folder = "samples" if is_sample else "sweeps"
    return f"{folder}/{channel}/{_PREFIX}__{channel}__{t_ns // _US_PER_NS}.{ending}"


def token(*parts: object) -> str:
    """Return the token of something, 32 hexadecimal digits."""
    return hashlib.blake2b("/".join(map(str, parts)).encode(), digest_size=16).hexdigest()


@dataclass(frozen=True)
class Scene:
    """Frames of one piece of the trajectory, in order, at least one of them a sample."""

    name: str
    frames: tuple[AnnotatedFrame, ...]

    @property
    def samples(self) -> tuple[AnnotatedFrame, ...]:
        """The frames with annotations."""
        return tuple(frame for frame in self.frames if frame.swept)


def scenes(frames: Iterable[AnnotatedFrame], set_of: Sequence[str], gap_ns: int) -> Iterator[Scene]:
    """Yield the scenes; a new one begins with another set, or more than `gap_ns` after the frame before."""
    piece: list[AnnotatedFrame] = []
    count = 0
    for frame in chain(frames, (None,)):
        ends = piece and (
            frame is None or set_of[frame.frame] != set_of[piece[0].frame] or frame.t_ns - piece[-1].t_ns > gap_ns
        )
        if ends:
            if any(one.swept for one in piece):
                count += 1
                yield Scene(f"{set_of[piece[0].frame]}-{count:04d}", tuple(piece))
            piece = []
        if frame is not None:
            piece.append(frame)


@dataclass(frozen=True)
class Rig:
    """Properties of all samples: mounts of camera and LiDAR (position, quaternion), the camera's matrix and size."""

    p_BC: tuple[float, ...]
    q_BC: Quat
    K: tuple[float, ...]
    width: int
    height: int
    p_BL: tuple[float, ...]
    q_BL: Quat
    vehicle: str
    location: str
    description: str


class Tables:
    """The tables of a data set, row by row."""

    def __init__(self, each_scene: Callable[[], Iterable[Scene]], catalogue: Catalogue, rig: Rig) -> None:
        """`each_scene` returns the scenes anew for each table: memory holds one at a time."""
        self._scenes, self._catalogue, self._rig = each_scene, catalogue, rig

    def texts(self) -> Iterator[tuple[str, Iterator[str]]]:
        """Yield the path of each table in the folder of nuScenes, and its text in pieces."""
        # Each method makes the table of its name.
        makers: tuple[Callable[[], Iterable[Mapping[str, Any]]], ...] = (
            *(self._attribute, self._calibrated_sensor, self._category, self._ego_pose, self._instance, self._log),
            *(self._map, self._sample, self._sample_annotation, self._sample_data, self._scene, self._sensor),
            self._visibility,
        )
        for rows in makers:
            yield f"{VERSION}/{rows.__name__[1:]}.json", _array(rows())

    def _attribute(self) -> Iterator[dict[str, Any]]:
        for name in _ATTRIBUTES:
            yield {"token": token("attribute", name), "name": name, "description": ""}

    def _category(self) -> Iterator[dict[str, Any]]:
        known = self._catalogue.classes.names
        classes: dict[str, list[str]] = {}
        for class_id in sorted(self._catalogue.object_classes):
            if class_id < len(known):
                classes.setdefault(category(known[class_id]), []).append(known[class_id])
        for name, members in classes.items():
            description = f"class {', '.join(members)}"
            yield {"token": token("category", name), "name": name, "description": description}

    def _visibility(self) -> Iterator[dict[str, Any]]:
        for level, name, _ in _VISIBILITY:
            low, high = name[1:].split("-")
            yield {"token": level, "level": name, "description": f"visibility between {low} and {high} %"}

    def _log(self) -> Iterator[dict[str, Any]]:
        yield {
            "token": token("log"),
            "logfile": "",
            "vehicle": self._rig.vehicle,
            "date_captured": "2020-09-13",  # the day of the data set's first time
            "location": self._rig.location,
        }

    def _map(self) -> Iterator[dict[str, Any]]:
        yield {
            "token": token("map"),
            "log_tokens": [token("log")],
            "category": "semantic_prior",
            "filename": MAP_NAME,
        }

    def _sensor(self) -> Iterator[dict[str, Any]]:
        for channel, modality in ((CAMERA, "camera"), (LIDAR, "lidar")):
            yield {"token": token("sensor", channel), "channel": channel, "modality": modality}

    def _calibrated_sensor(self) -> Iterator[dict[str, Any]]:
        rig = self._rig
        K = [list(rig.K[i : i + 3]) for i in (0, 3, 6)]
        q_top = product(rig.q_BL, _Q_TOP)
        for channel, p, q, matrix in ((CAMERA, rig.p_BC, rig.q_BC, K), (LIDAR, rig.p_BL, q_top, [])):
            yield {
                "token": token("calibrated_sensor", channel),
                "sensor_token": token("sensor", channel),
                "translation": list(p),
                "rotation": list(q),
                "camera_intrinsic": matrix,
            }

    def _scene(self) -> Iterator[dict[str, Any]]:
        for scene in self._scenes():
            samples = scene.samples
            yield {
                "token": token("scene", scene.name),
                "log_token": token("log"),
                "nbr_samples": len(samples),
                "first_sample_token": token("sample", samples[0].frame),
                "last_sample_token": token("sample", samples[-1].frame),
                "name": scene.name,
                "description": self._rig.description,
            }

    def _sample(self) -> Iterator[dict[str, Any]]:
        for scene in self._scenes():
            frames = [sample.frame for sample in scene.samples]
            for sample, before, after in zip(scene.samples, _before(frames), _after(frames), strict=True):
                yield {
                    "token": token("sample", sample.frame),
                    "timestamp": sample.t_ns // _US_PER_NS,
                    "prev": _token_or_none("sample", before),
                    "next": _token_or_none("sample", after),
                    "scene_token": token("scene", scene.name),
                }

    def _ego_pose(self) -> Iterator[dict[str, Any]]:
        for scene in self._scenes():
            for frame in scene.frames:
                for channel in (CAMERA, LIDAR) if frame.swept else (CAMERA,):
                    yield {
                        "token": token("sample_data", channel, frame.frame),
                        "timestamp": frame.t_ns // _US_PER_NS,
                        "rotation": list(frame.q_WB),
                        "translation": list(frame.p_WB),
                    }

    def _sample_data(self) -> Iterator[dict[str, Any]]:
        rig = self._rig
        for scene in self._scenes():
            samples = scene.samples
            sizes = {CAMERA: (rig.width, rig.height, "png"), LIDAR: (0, 0, "pcd")}
            for channel, (width, height, kind) in sizes.items():
                frames = scene.frames if channel == CAMERA else samples
                numbers = [frame.frame for frame in frames]
                nearest = 0
                for frame, before, after in zip(frames, _before(numbers), _after(numbers), strict=True):
                    while nearest + 1 < len(samples) and abs(samples[nearest + 1].t_ns - frame.t_ns) <= abs(
                        samples[nearest].t_ns - frame.t_ns
                    ):
                        nearest += 1
                    own = token("sample_data", channel, frame.frame)
                    yield {
                        "token": own,
                        "sample_token": token("sample", samples[nearest].frame),
                        "ego_pose_token": own,
                        "calibrated_sensor_token": token("calibrated_sensor", channel),
                        "timestamp": frame.t_ns // _US_PER_NS,
                        "fileformat": kind,
                        "is_key_frame": frame.swept,
                        "height": height,
                        "width": width,
                        "filename": file_name(channel, frame.t_ns, is_sample=frame.swept),
                        "prev": _token_or_none("sample_data", channel, before),
                        "next": _token_or_none("sample_data", channel, after),
                    }

    def _sample_annotation(self) -> Iterator[dict[str, Any]]:
        for scene in self._scenes():
            shown = _frames_by_instance(scene)
            place = {(o, f): i for o, frames in shown.items() for i, f in enumerate(frames)}
            for sample in scene.samples:
                for o in sample.objects:
                    frames, i = shown[o.instance], place[o.instance, sample.frame]
                    length, width, height = o.size_m
                    yield {
                        "token": token("annotation", sample.frame, o.instance),
                        "sample_token": token("sample", sample.frame),
                        "instance_token": token("instance", scene.name, o.instance),
                        "visibility_token": visibility_token(o.visibility),
                        "attribute_tokens": [token("attribute", name) for name in self._attributes_of(o)],
                        "translation": list(o.centre_W),
                        "size": [width, length, height],
                        "rotation": [math.cos(0.5 * o.yaw_rad), 0.0, 0.0, math.sin(0.5 * o.yaw_rad)],
                        "prev": token("annotation", frames[i - 1], o.instance) if i else "",
                        "next": token("annotation", frames[i + 1], o.instance) if i + 1 < len(frames) else "",
                        "num_lidar_pts": o.lidar_points,
                        "num_radar_pts": 0,
                    }

    def _instance(self) -> Iterator[dict[str, Any]]:
        names = self._catalogue.classes
        for scene in self._scenes():
            for instance, frames in sorted(_frames_by_instance(scene).items()):
                name = names.name(self._catalogue.class_of_instance[instance])
                yield {
                    "token": token("instance", scene.name, instance),
                    "category_token": token("category", category(name)),
                    "class": name,
                    "nbr_annotations": len(frames),
                    "first_annotation_token": token("annotation", frames[0], instance),
                    "last_annotation_token": token("annotation", frames[-1], instance),
                }

    def _attributes_of(self, o: Annotation) -> tuple[str, ...]:
        kind = category(self._catalogue.classes.name(o.class_id))
        moves = o.speed_mps > _MOVING_FROM_MPS
        if kind.startswith("human.pedestrian"):
            return ("pedestrian.moving" if moves else "pedestrian.standing",)
        if kind.startswith("vehicle."):
            return ("vehicle.moving" if moves else "vehicle.stopped",)
        return ()


def category(class_name: str) -> str:
    """Return the category of a class."""
    return CATEGORIES.get(class_name, _OTHER)


def visibility_token(share: float) -> str:
    """Return the level, 1 to 4, of a visible share."""
    return next(level for level, _, least in reversed(_VISIBILITY) if share >= least)


def _frames_by_instance(scene: Scene) -> dict[int, list[int]]:
    shown: dict[int, list[int]] = {}
    for sample in scene.samples:
        for o in sample.objects:
            shown.setdefault(o.instance, []).append(sample.frame)
    return shown


def _before(numbers: Sequence[int]) -> list[int | None]:
    return [None, *numbers[:-1]]


def _after(numbers: Sequence[int]) -> list[int | None]:
    return [*numbers[1:], None]


def _token_or_none(*parts: object) -> str:
    return "" if parts[-1] is None else token(*parts)


def _array(rows: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    yield "[\n"
    first = True
    for row in rows:
        yield f"{'' if first else ',' + chr(10)}{json.dumps(row, separators=(',', ':'))}"
        first = False
    yield "\n]\n"
