"""Finds people and things in a camera's pictures, says how far away they are, how fast, and where in the world.

The network is loaded and warmed up before the bench hears of this client, so a flight never waits for it. Where the
vehicle is comes from IMU, GPS and barometer (`localiser` own), from the true state (truth) or is not asked (none: boxes
and ranges alone). Ranges come from `depth`, where that topic is named, else from level ground; speeds from `radar`'s
points. What is seen several times becomes a thing of the world, with a place and a motion of its own.
"""

from __future__ import annotations

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Mapping, Sequence

import numpy as np

from hil_companion.detect.detector import Detector
from hil_companion.detect.model_file import ModelFile
from hil_companion.detections import Detections, Found
from hil_companion.errors import CutError, OptionError
from hil_companion.explore.inertial import Moment
from hil_companion.explore.rotation import matrix_of
from hil_companion.explore.settings import number
from hil_companion.frame import Frame
from hil_companion.locate.geolocation import Camera, Geolocation, RadarView
from hil_companion.locate.journal import Journal
from hil_companion.locate.own_pose import TOPICS, OwnPose
from hil_companion.locate.pictures import BoxPictures
from hil_companion.locate.tiles import outdone, pieces, without_doubles
from hil_companion.locate.tracks import Sighting, Tracks, look_of
from hil_companion.protocol import Welcome

OUT_VARIABLE = "HIL_COMPANION_OUT"  # a folder for whatever a started client wants to leave; the bench sets it
LOCALISERS = ("own", "truth", "none")
TRUTH = "truth"
_MOST_PIECES = 8  # each way
_WEAK_SHARE = 0.6
_TIMED = 50  # pictures between two words on how long they take


class Detect:
    """`model`: an .onnx file, null: the shipped one. `tiles`: pieces across and down that a picture is looked at in.
    `objects`: labels that are followed through the world; null: all. `weak_score`: boxes below `threshold` are not
    told, but those of these labels down to this score keep somebody going; null: 0.6 of the threshold."""

    control = False

    def __init__(
        self,
        *,
        camera: str = "front/rgb",
        depth: str | None = None,
        radar: str | None = None,
        model: str | None = None,
        backend: str = "opencv",
        threads: int | None = None,
        threshold: float | None = None,
        tiles: Sequence[int] = (1, 1),
        localiser: str = "own",
        start: Sequence[float] = (0.0, 0.0, 0.23, 0.0),
        ground_z_m: float = 0.0,
        objects: Sequence[str] | None = ("person",),
        least_sightings: int = 3,
        weak_score: float | None = None,
        out: str | None = None,
        picture_every_s: float = 1.0,
    ) -> None:
        if localiser not in LOCALISERS:
            raise OptionError(f"detect: localiser {localiser!r}: one of {', '.join(LOCALISERS)} is needed")
        if not _list_of(tiles, int, 2) or not all(1 <= n <= _MOST_PIECES for n in tiles):
            raise OptionError(f"detect: tiles {tiles!r}: two whole numbers from 1 to {_MOST_PIECES} are needed")
        if objects is not None and not _list_of(objects, str):
            raise OptionError(f"detect: objects {objects!r}: a list of labels is needed")
        if not _list_of(start, (int, float), 4):
            raise OptionError(f"detect: start {start!r}: x, y, z and yaw are needed")
        for name, topic in (("camera", camera), ("depth", depth), ("radar", radar)):
            if topic is not None and (not isinstance(topic, str) or "/" not in topic):
                raise OptionError(f"detect: {name} {topic!r}: a topic such as front/rgb is needed")
        self._camera_topic, self._depth_topic, self._radar_topic = camera, depth, radar
        self._tiles = (tiles[0], tiles[1])
        self._localiser, self._start = localiser, tuple(float(v) for v in start)
        self._ground_z_m = number("ground_z_m", ground_z_m)
        self._labels = None if objects is None else frozenset(objects)
        self._least = int(number("least_sightings", least_sightings))
        self._every_s = number("picture_every_s", picture_every_s)
        folder = out if out is not None else os.environ.get(OUT_VARIABLE, "")
        self._folder = Path(folder) if folder else None
        self._detector = self._open(model, backend, threads)
        told = self._detector.model.score_threshold if threshold is None else number("threshold", threshold)
        self._threshold = float(told)
        weak = _WEAK_SHARE * self._threshold if weak_score is None else number("weak_score", weak_score)
        if not 0.0 <= weak <= self._threshold <= 1.0:
            raise OptionError(f"detect: threshold {told!r}, weak_score {weak!r}: 0 <= weak_score <= threshold <= 1")
        self._detector.threshold = weak
        self.topics = tuple(
            topic
            for topic in (camera, depth, radar, *(TOPICS if localiser == "own" else ()), TRUTH)
            if topic and (topic != TRUTH or localiser == "truth")
        )
        self.detections: Detections | None = None
        self.report: dict[str, Any] = {}
        self._place: Geolocation | None = None
        self._own: OwnPose | None = None
        self._pictures: BoxPictures | None = None
        self._journal: Journal | None = None
        self._reset()

    @staticmethod
    def _open(model: str | None, backend: str, threads: int | None) -> Any:
        detector = Detector(ModelFile.load(model), backend, threads)
        detector.warm_up()
        return detector

    def _reset(self) -> None:
        self._tracks = Tracks(self._least)
        self._told: list[Found] = []
        self._ms: list[float] = []
        self._looked = self._boxes = self._without_place = 0

    def start(self, welcome: Welcome) -> None:
        """A session begins: who is this camera, and where does it sit? CutError."""
        self.stop()
        self._reset()
        if self._camera_topic not in welcome.topics:
            there = ", ".join(sorted(welcome.topics)) or "none"
            raise CutError(f"detect: the bench sends no {self._camera_topic!r}; its topics: {there}")
        sensor = self._camera_topic.partition("/")[0]
        camera = Camera(sensor, welcome.sensors.get(sensor))
        self._place = Geolocation(camera, ground_z_m=self._ground_z_m)
        self._own = OwnPose(self._start) if self._localiser == "own" else None
        self._radar_at = None if self._radar_topic is None else _mount(self._radar_topic, welcome)
        if self._folder is not None:
            self._pictures = BoxPictures(self._folder, every_s=self._every_s)
            self._journal = Journal(self._folder)
        self.report = self._report()

    def __call__(self, frame: Frame) -> None:
        self.detections = None
        if self._own is not None:
            self._own.update(frame)
        if self._camera_topic not in frame:
            return
        assert self._place is not None
        picture = frame[self._camera_topic]
        rgb = picture.array
        self._check_size(rgb)
        begun_ns = time.perf_counter_ns()
        found = self._detect(rgb)
        self._ms.append((time.perf_counter_ns() - begun_ns) * 1e-6)
        t_ns = picture.t_capture_ns
        depth_m = self._depth(frame, t_ns)
        # Of what is too weak to tell, what may keep somebody going: unless it is more likely something else.
        found = [d for d in found if d.score >= self._threshold or (self._follows(d) and not outdone(d, found))]
        found = self._place.place(found, self._pose(frame, t_ns), depth_m, self._radar(frame))
        looks = [look_of(rgb, d.box_px) for d in found]
        objects = self._follow(found, looks, t_ns, by_depth=depth_m is not None)
        height, width = rgb.shape[:2]
        told = [d for d in found if d.score >= self._threshold]
        self.detections = Detections(self._camera_topic, t_ns, (width, height), told, objects)
        self._looked += 1
        self._boxes += len(told)
        self._without_place += sum(d.p_W is None for d in told)
        self.report = self._report()
        if self._journal is not None:
            self._journal.picture(frame.frame, t_ns, found, looks)
        if self._pictures is not None:
            self._pictures.look(rgb, told, t_ns)

    def stop(self) -> None:
        if self._pictures is not None:
            self._pictures.close()
            self._pictures = None
        if self._journal is not None:
            self._journal.close(self._tracks.found)
            self._journal = None

    def _detect(self, rgb: np.ndarray) -> list[Any]:
        if self._tiles == (1, 1):
            found: list[Any] = self._detector.detect(rgb)
            return found
        whole = list(self._detector.detect(rgb))  # what is large is best seen so
        for x0, y0, x1, y1 in pieces((rgb.shape[1], rgb.shape[0]), *self._tiles):
            for one in self._detector.detect(np.ascontiguousarray(rgb[y0:y1, x0:x1])):
                a, b, c, d = one.box_px
                whole.append(replace(one, box_px=(a + x0, b + y0, c + x0, d + y0)))
        return without_doubles(whole)

    def _check_size(self, rgb: np.ndarray) -> None:
        assert self._place is not None
        width, height = self._place.camera.size_px
        if rgb.ndim != 3 or rgb.shape != (height, width, 3):
            raise CutError(
                f"detect: {self._camera_topic} is a picture of shape {rgb.shape}, where the bench's calibration says "
                f"{width} x {height} in colour; name a camera's rgb"
            )

    def _depth(self, frame: Frame, t_ns: int) -> np.ndarray | None:
        """The depth picture of the same moment."""
        topic = self._depth_topic
        if topic is None or topic not in frame or frame[topic].t_capture_ns != t_ns:
            return None
        depth_m = frame[topic].array
        if depth_m.ndim != 2:
            raise CutError(f"detect: {topic} is no depth picture: its shape is {depth_m.shape}")
        return depth_m

    def _pose(self, frame: Frame, t_ns: int) -> Moment | None:
        if self._own is not None:
            return self._own.at(t_ns)
        if self._localiser != TRUTH:
            return None
        if TRUTH not in frame:
            raise CutError("detect: localiser 'truth' needs the topic truth; the bench sends none")
        truth = frame[TRUTH]
        back_s = (frame.t_ns - t_ns) * 1e-9  # the truth is the frame's; a picture may be a little older
        p, v = (np.asarray(truth[name], float) for name in ("p_WB", "v_WB_W"))
        p_then = (p - back_s * v).tolist()
        w, x, y, z = (float(c) for c in truth["q_WB"])
        return Moment(t_ns, (p_then[0], p_then[1], p_then[2]), (0.0, 0.0, 0.0), (w, x, y, z))

    def _radar(self, frame: Frame) -> RadarView | None:
        if self._radar_topic is None or self._radar_topic not in frame or self._radar_at is None:
            return None
        return RadarView(frame[self._radar_topic], *self._radar_at)

    def _follow(self, found: Sequence[Any], looks: Sequence[Any], t_ns: int, *, by_depth: bool) -> list[Found] | None:
        """Add what has a place to the world; what is there now, where that is news."""
        assert self._place is not None
        own_m = 0.0 if self._own is None else self._own.sigma_m
        sightings = [
            Sighting(
                d.label,
                d.p_W,
                self._place.sigma_m(d.range_m, own_m, by_depth=by_depth),
                look,
                sure=d.score >= self._threshold,
            )
            for d, look in zip(found, looks)
            if d.p_W is not None and self._follows(d) and not outdone(d, found)
        ]
        self._tracks.add(t_ns, sightings)
        objects = self._tracks.found
        if objects == self._told:
            return None
        self._told = objects
        return objects

    def _follows(self, found: Any) -> bool:
        return self._labels is None or found.label in self._labels

    def _report(self) -> dict[str, Any]:
        """For run.json: what was seen, and now and then how long a picture takes."""
        told: dict[str, Any] = {
            "model": self._detector.model.path.name,
            "localiser": self._localiser,
            "range_from": "depth" if self._depth_topic else "ground",
            "pictures": self._looked,
            "boxes": self._boxes,
            "boxes_without_place": self._without_place,
            "objects": len(self._told),
        }
        whole = len(self._ms) // _TIMED * _TIMED
        if whole:
            told["detect_ms_p50"] = round(sorted(self._ms[:whole])[whole // 2], 2)
        return told


def _mount(topic: str, welcome: Welcome) -> tuple[np.ndarray, np.ndarray]:
    sensor = topic.partition("/")[0]
    told: Mapping[str, Any] = welcome.sensors.get(sensor, {})
    try:
        w, x, y, z = (float(c) for c in told["q_BC"])
        return np.asarray(told["p_BC"], float).reshape(3), matrix_of((w, x, y, z))
    except (KeyError, TypeError, ValueError):
        raise CutError(
            f"detect: the bench does not say where the radar {sensor!r} sits; name its topic `points`"
        ) from None


def _list_of(values: Any, kind: Any, count: int | None = None) -> bool:
    good = isinstance(values, (list, tuple)) and all(isinstance(v, kind) and not isinstance(v, bool) for v in values)
    return good and (count is None or len(values) == count)
