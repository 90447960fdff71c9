"""Detects people and objects in a camera's pictures and reports their range, speed and place in the world.

The network is loaded and warmed up before this client connects, so a flight never waits for it. The vehicle's pose is
estimated from IMU, GPS and barometer (`localiser` own), read from the true state (truth) or not used (none: boxes and
ranges only). Ranges come from the topic `depth` if one is set, else from level ground; speeds from the points of the
topic `radar`. Repeated sightings become a track with a position and a velocity in the world, and the tracks of one
object are joined.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any, Mapping, Sequence

import numpy as np

from hil_companion.cuts.detect_settings import TRUTH, DetectSettings
from hil_companion.cuts.settings import output_folder
from hil_companion.detect.detector import Detector
from hil_companion.detect.model_file import ModelFile
from hil_companion.detections import Detections, Found
from hil_companion.errors import CutError, OptionError
from hil_companion.frame import Frame
from hil_companion.link.protocol import Welcome
from hil_companion.locate.existence import (
    LEAST_EVIDENCE,
    PERSON,
    RIVAL,
    WEAK,
    Evidence,
    sighting_evidence,
    thing_evidence,
)
from hil_companion.locate.geolocation import Camera, Geolocation, RadarView
from hil_companion.locate.journal import Journal
from hil_companion.locate.looks import look_of, object_pixels
from hil_companion.locate.objects import Objects
from hil_companion.locate.own_pose import TOPICS, OwnPose
from hil_companion.locate.pictures import BoxPictures
from hil_companion.locate.tiles import on_seat, pieces, rival_score, without_duplicates
from hil_companion.locate.tracks import Sighting, Tracks
from hil_companion.locate.views import Views
from hil_companion.navigation.inertial import NavState
from hil_companion.navigation.rotation import matrix_of

_TIMED_PICTURES = 50  # pictures between two updates of the computing time in the report


class Detect:
    """The CUT `detect`. Keyword arguments: the fields of `DetectSettings`."""

    control = False
    settings_type = DetectSettings
    _geolocation: Geolocation  # from `start` on
    _views: Views  # from `start` on

    def __init__(self, **settings: Any) -> None:
        s = self._settings = DetectSettings(**settings)
        self._labels = None if s.objects is None else frozenset(s.objects)
        self._folder = output_folder(s.out)
        self._detector = self._load(s.model, s.backend, s.threads)
        self._threshold = float(self._detector.model.score_threshold if s.threshold is None else s.threshold)
        if not 0.0 <= self._threshold <= 1.0:
            raise OptionError(f"detect: threshold {self._threshold!r}: a number from 0 to 1 is needed")
        self._detector.threshold = max(0.0, self._threshold - RIVAL)
        own_pose = TOPICS if s.localiser == "own" else ()
        truth = (TRUTH,) if s.localiser == TRUTH else ()
        self.topics = tuple(topic for topic in (s.camera, s.depth, s.radar, *own_pose, *truth) if topic)
        self.detections: Detections | None = None
        self.report: dict[str, Any] = {}
        self._own_pose: OwnPose | None = None
        self._radar_mount: tuple[np.ndarray, np.ndarray] | None = None
        self._pictures: BoxPictures | None = None
        self._journal: Journal | None = None
        self._reset()

    @staticmethod
    def _load(model: str | None, backend: str, threads: int | None) -> Any:
        detector = Detector(ModelFile.load(model), backend, threads)
        detector.warm_up()
        return detector

    def _reset(self) -> None:
        self._tracks = Tracks()
        self._objects = Objects()
        self._reported: list[Found] = []
        self._detect_ms: list[float] = []  # computing time of each picture
        self._picture_count = self._box_count = self._boxes_without_place = 0

    def start(self, welcome: Welcome) -> None:
        """Begin a session with the calibrations that the bench sends. Raises CutError."""
        self.stop()
        self._reset()
        s = self._settings
        if s.camera not in welcome.topics:
            topics = ", ".join(sorted(welcome.topics)) or "none"
            raise CutError(f"detect: the bench sends no {s.camera!r}; its topics: {topics}")
        sensor = s.camera.partition("/")[0]
        camera = Camera(sensor, welcome.sensors.get(sensor))
        self._geolocation = Geolocation(camera, ground_z_m=float(s.ground_z_m))
        self._views = Views(camera)
        self._own_pose = OwnPose(tuple(float(v) for v in s.start)) if s.localiser == "own" else None
        self._radar_mount = None if s.radar is None else _mount(s.radar, welcome)
        if self._folder is not None:
            self._pictures = BoxPictures(self._folder, every_s=float(s.picture_every_s))
            self._journal = Journal(self._folder)
        self.report = self._report()

    def __call__(self, frame: Frame) -> None:
        self.detections = None
        if self._own_pose is not None:
            self._own_pose.update(frame)
        if self._settings.camera not in frame:
            return
        picture = frame[self._settings.camera]
        rgb = picture.array
        self._check_size(rgb)
        begun_ns = time.perf_counter_ns()
        found = self._detect(rgb)
        self._detect_ms.append((time.perf_counter_ns() - begun_ns) * 1e-6)
        t_ns = picture.t_capture_ns
        depth_m = self._depth(frame, t_ns)
        candidates = found  # boxes below the threshold are sightings and rivals
        found = [d for d in found if d.score >= self._least_score(d, candidates)]
        pose = self._pose(frame, t_ns)
        pixels = [object_pixels(rgb, d.box_px) if self._is_tracked(d) else None for d in found]
        found = self._geolocation.place(found, pose, depth_m, self._radar(frame), pixels)
        looks = [None if shown is None else look_of(shown, d.box_px) for d, shown in zip(found, pixels)]
        objects = self._track(found, looks, candidates, t_ns, pose, depth_m)
        height, width = rgb.shape[:2]
        boxes = [d for d in found if d.score >= self._threshold]
        self.detections = Detections(self._settings.camera, t_ns, (width, height), boxes, objects)
        self._picture_count += 1
        self._box_count += len(boxes)
        self._boxes_without_place += sum(d.p_W is None for d in boxes)
        self.report = self._report()
        if self._journal is not None:
            self._journal.picture(frame.frame, t_ns, found, looks)
        if self._pictures is not None:
            self._pictures.add(rgb, boxes, t_ns)

    def stop(self) -> None:
        if self._pictures is not None:
            self._pictures.close()
            self._pictures = None
        if self._journal is not None:
            self._journal.close(self._objects.found(self._tracks.tracks, self._views))
            self._journal = None

    def _detect(self, rgb: np.ndarray) -> list[Any]:
        across, down = self._settings.tiles
        found: list[Any] = list(self._detector.detect(rgb))
        if (across, down) == (1, 1):
            return found
        # The pieces add small objects; large ones are detected best in the whole picture.
        for x0, y0, x1, y1 in pieces((rgb.shape[1], rgb.shape[0]), across, down):
            for detection in self._detector.detect(np.ascontiguousarray(rgb[y0:y1, x0:x1])):
                a, b, c, d = detection.box_px
                found.append(replace(detection, box_px=(a + x0, b + y0, c + x0, d + y0)))
        return without_duplicates(found)

    def _check_size(self, rgb: np.ndarray) -> None:
        width, height = self._geolocation.camera.size_px
        if rgb.ndim != 3 or rgb.shape != (height, width, 3):
            raise CutError(
                f"detect: {self._settings.camera} is a picture of shape {rgb.shape}, but the bench's calibration says "
                f"{width} x {height} in colour; name a camera's rgb"
            )

    def _depth(self, frame: Frame, t_ns: int) -> np.ndarray | None:
        """Return the depth picture that was captured at the same time; None if there is none. Raises CutError."""
        topic = self._settings.depth
        if topic is None or topic not in frame or frame[topic].t_capture_ns != t_ns:
            return None
        depth_m = frame[topic].array
        if depth_m.ndim != 2:
            raise CutError(f"detect: {topic} is not a depth picture: its shape is {depth_m.shape}")
        return depth_m

    def _pose(self, frame: Frame, t_ns: int) -> NavState | None:
        """Return the vehicle's pose at `t_ns`; None if it is unknown. Raises CutError."""
        if self._own_pose is not None:
            return self._own_pose.at(t_ns)
        if self._settings.localiser != TRUTH:
            return None
        if TRUTH not in frame:
            raise CutError("detect: localiser 'truth' needs the topic truth; the bench sends none")
        truth = frame[TRUTH]
        age_s = (frame.t_ns - t_ns) * 1e-9  # a picture may be a little older than the truth in its frame
        p, v = (np.asarray(truth[name], float) for name in ("p_WB", "v_WB_W"))
        p_then = (p - age_s * v).tolist()
        w, x, y, z = (float(c) for c in truth["q_WB"])
        return NavState(t_ns, (p_then[0], p_then[1], p_then[2]), (0.0, 0.0, 0.0), (w, x, y, z))

    def _radar(self, frame: Frame) -> RadarView | None:
        topic = self._settings.radar
        if topic is None or topic not in frame or self._radar_mount is None:
            return None
        return RadarView(frame[topic], *self._radar_mount)

    def _track(
        self,
        found: Sequence[Any],
        looks: Sequence[np.ndarray | None],
        candidates: Sequence[Any],
        t_ns: int,
        pose: NavState | None,
        depth_m: np.ndarray | None,
    ) -> list[Found] | None:
        """Add all boxes with a position to the tracks; return the objects to report, None if they are unchanged."""
        geolocation, sightings = self._geolocation, []
        own_m, yaw_rad = (
            (0.0, 0.0) if self._own_pose is None else (self._own_pose.sigma_m, self._own_pose.yaw_sigma_rad)
        )
        for d, look in zip(found, looks):
            if d.p_W is None or pose is None or not self._is_tracked(d):
                continue
            height_m = geolocation.height_m(d, pose)
            evidence = self._evidence(d, candidates, height_m, geolocation.middle_m(d, pose, depth_m))
            if evidence.best >= LEAST_EVIDENCE:
                by_depth = depth_m is not None
                cov = geolocation.covariance(d.p_W, pose, own_m, yaw_rad, by_depth=by_depth, height_m=height_m)
                sightings.append(Sighting(d.label, d.p_W, cov, look, evidence))
        self._tracks.add(t_ns, sightings)
        self._views.add(pose, depth_m)
        objects = self._objects.found(self._tracks.tracks, self._views)
        if objects == self._reported:
            return None
        self._reported = objects
        return objects

    def _least_score(self, box: Any, candidates: Sequence[Any]) -> float:
        """Return the score from which a box is kept. People on seats often have low ones."""
        if not self._is_tracked(box):
            return self._threshold
        weak = self._threshold - WEAK
        return self._threshold - RIVAL if box.label == PERSON and on_seat(box, candidates, weak) else weak

    def _evidence(
        self, box: Any, candidates: Sequence[Any], height_m: float | None, middle_m: float | None
    ) -> Evidence:
        over, rival = box.score - self._threshold, rival_score(box, candidates)
        rival_over = None if rival is None else rival - self._threshold
        if box.label != PERSON:
            return thing_evidence(over, rival_over)
        return sighting_evidence(
            over, rival_over, height_m, middle_m, on_seat=on_seat(box, candidates, self._threshold - WEAK)
        )

    def _is_tracked(self, found: Any) -> bool:
        return self._labels is None or found.label in self._labels

    def _report(self) -> dict[str, Any]:
        """Return the entries for run.json: counts, and every 50 pictures their median computing time."""
        report: dict[str, Any] = {
            "model": self._detector.model.path.name,
            "localiser": self._settings.localiser,
            "range_from": "depth" if self._settings.depth else "ground",
            "pictures": self._picture_count,
            "boxes": self._box_count,
            "boxes_without_place": self._boxes_without_place,
            "objects": len(self._reported),
        }
        count = len(self._detect_ms) // _TIMED_PICTURES * _TIMED_PICTURES
        if count:
            report["detect_ms_p50"] = round(sorted(self._detect_ms[:count])[count // 2], 2)
        return report


def _mount(topic: str, welcome: Welcome) -> tuple[np.ndarray, np.ndarray]:
    """Return position and rotation of a radar on the vehicle. Raises CutError."""
    sensor = topic.partition("/")[0]
    calibration: Mapping[str, Any] = welcome.sensors.get(sensor, {})
    try:
        w, x, y, z = (float(c) for c in calibration["q_BC"])
        return np.asarray(calibration["p_BC"], float).reshape(3), matrix_of((w, x, y, z))
    except (KeyError, TypeError, ValueError):
        raise CutError(
            f"detect: the bench sends no mounting pose of the radar {sensor!r}; name its topic `points`"
        ) from None
