"""What a data set will be: which sensors of which bench, how many frames, where each sensor's data go.

A frame is a picture of the first camera with colour, classes and instances, which is the one that is labelled; without
one a picture of the first camera, a sweep of the first LiDAR or a frame of the first radar. The others keep their own
rates.

Each batch of frames is a pure function of the truths in it, the seed and the sample numbers; whoever makes which batch
changes nothing. Sensors whose samples hang on the samples before are therefore refused here, or, where the recording
loses nothing by it, told not to look back.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from hil.config import Bench, BenchConfig, SensorConfig, load_bench
from hil.config.files import find
from hil.config.schema import Record, Trajectory
from hil.missions import load_mission
from hil.missions.mission import CHANGE_SPEED as SPEED
from hil.missions.mission import FRAME_GLOBAL, FRAME_MISSION, FRAME_RELATIVE, JUMP, TAKEOFF, WAYPOINT
from hil.signals.documents.validate import nearest
from hil.signals.errors import ConfigError, Problem
from hil.signals.geodesy import LocalFrame
from hil.signals.time import NS_PER_S
from sim.frame.quality import QUALITIES
from sim.scene.scene import Site
from sim.sensors.camera_parameters import CameraParameters
from sim.sensors.catalog import KINDS
from sim.sensors.radar_parameters import RadarParameters

DEFAULT_BENCH = "rigs/datasets/park_square.yaml"
DEFAULT_FRAMES, MAX_FRAMES = 500, 10_000_000
EPOCH_NS = 1_600_000_000 * NS_PER_S  # simulated time 0 in the files: 19 digits, as tools for EuRoC expect
BATCH_FRAMES = 10  # of the recording's chunks and the journal too, so never another number for one data set
MISSION_NAME = "trajectory.waypoints"

# Folder of a camera's channel in mav0, its number after it.
CHANNEL_FOLDERS = {"rgb": "cam", "depth": "depth", "segmentation": "segmentation", "instance": "instance"}
CHANNEL_FOLDERS |= {"normal": "normal", "range": "range", "geom": "geom", "radial_velocity": "radial_velocity"}
CHANNEL_FOLDERS |= {"material": "material"}
RADAR_FOLDERS = {"raw": "radar", "range_doppler": "range_doppler"}
_FOLDERS = {"camera": CHANNEL_FOLDERS, "radar": RADAR_FOLDERS}  # by kind; of other kinds it is the kind itself


@dataclass(frozen=True)
class DatasetPlan:
    """A data set to be made. `bench` is what is flown and drawn, quality and all."""

    bench: Bench
    frames: int
    quality: str

    @property
    def config(self) -> BenchConfig:
        return self.bench.config

    @cached_property
    def frame_sensors(self) -> dict[str, SensorConfig]:
        """Cameras, LiDARs and radars; radars last, because they read what cameras have drawn."""
        found = [(n, s) for n, s in self.config.sensors.items() if KINDS[s.kind].needs_frames]
        return dict(sorted(found, key=lambda pair: pair[1].kind == "radar"))

    @cached_property
    def flight_sensors(self) -> dict[str, SensorConfig]:
        """Those sampled in the flight."""
        return {n: s for n, s in self.config.sensors.items() if not KINDS[s.kind].needs_frames}

    @cached_property
    def reference(self) -> str:
        """The sensor whose samples are counted as frames."""
        sensors = self.frame_sensors
        if self.labelled is not None:
            return self.labelled
        return next(name for kind in ("camera", "lidar", "radar") for name, s in sensors.items() if s.kind == kind)

    @cached_property
    def labelled(self) -> str | None:
        """The camera that boxes and masks are of: the first one that has what it takes."""
        needed = {"rgb", "segmentation", "instance"}
        cameras = [n for n, s in self.frame_sensors.items() if s.kind == "camera"]
        return next((n for n in cameras if needed <= set(self.frame_sensors[n].parameters.channels)), None)

    @cached_property
    def numbers(self) -> dict[str, int]:
        """Of each sensor among those of its kind, from 0."""
        count: Counter[str] = Counter()
        numbers = {}
        for name, sensor in self.config.sensors.items():
            numbers[name] = count[sensor.kind]
            count[sensor.kind] += 1
        return numbers

    def folder(self, name: str, channel: str = "") -> str:
        """Of a sensor, or of a channel of it, in mav0."""
        kind = self.config.sensors[name].kind
        return f"{_FOLDERS.get(kind, {}).get(channel, kind)}{self.numbers[name]}"

    @property
    def flight_bench(self) -> Bench:
        """The same without what is drawn."""
        quiet = Record(mcap=False, images=False, tlog=False, report=False)
        config = self.config.model_copy(update={"sensors": self.flight_sensors, "record": quiet})
        return replace(self.bench, config=config)


def make_plan(
    config: Path | None,
    *,
    frames: int | None,
    quality: str | None,
    seed: int | None,
    settings: tuple[str, ...],
    work: Callable[[], Path],
) -> DatasetPlan:
    """Read and check everything. `work`: makes a folder where the course is put as a mission. ConfigError."""
    path = config if config is not None else find("mission", DEFAULT_BENCH, ())
    if quality is not None and quality not in QUALITIES:
        raise ConfigError([Problem("--quality", f"is unknown: {quality!r}", nearest(quality, QUALITIES))])
    laid = (f"quality={quality}",) if quality is not None else ()
    bench = load_bench(path, seed=seed, settings=(*settings, *laid))
    problems: list[Problem] = []
    count = DEFAULT_FRAMES if frames is None else frames
    if not 1 <= count <= MAX_FRAMES:
        problems.append(Problem("--frames", f"must be 1 to {MAX_FRAMES}, not {count}"))
    bench = _with_own_outputs(bench)
    problems += _problems(bench)
    if problems:
        raise ConfigError(problems)
    return DatasetPlan(_with_course(bench, work), count, bench.config.quality or "as the file says")


def _where(bench: Bench) -> str:
    path = bench.files.get("bench")
    return str(path) if path is not None else "the bench"


def _problems(bench: Bench) -> list[Problem]:
    config, where = bench.config, _where(bench)
    problems = []
    drawn = {n: s for n, s in config.sensors.items() if KINDS[s.kind].needs_frames}
    if not drawn:
        has = ", ".join(config.sensors)
        hint = f"it has {has}; add one under `sensors`, or leave CONFIG out for the bench that comes with `hil dataset`"
        problems.append(Problem(where, "has no camera, LiDAR or radar, so there are no frames to record", hint))
    if bench.mission is None and bench.script is None and config.dataset.trajectory is None:
        hint = "set `mission`, or `dataset: {trajectory: {preset: square}}`"
        problems.append(Problem(where, "flies nothing: it has neither a mission nor a trajectory", hint))
    if not config.autopilot.lockstep:
        kind = config.autopilot.kind
        hint = "choose the rig mock, px4_sitl or ardupilot_sitl"
        problems.append(Problem(where, f"has an autopilot that waits for nobody ({kind}): frames would be lost", hint))
    if config.companion.on:
        problems.append(Problem(where, "has companions, whose pictures are drawn in the flight", "leave them out"))
    at_risk = {fault.sensor for fault in config.faults.sensors}
    if bench.script is not None:
        at_risk |= bench.script.sensors_at_risk
    for name in sorted(at_risk & set(drawn)):
        hint = "samples are made out of order here, and a fault hangs on those before: record it with `hil run`"
        problems.append(Problem(f"{where}: sensors.{name}", "has faults declared", hint))
    for name, sensor in drawn.items():
        p = sensor.parameters
        if isinstance(p, CameraParameters) and p.exposure.auto and "rgb" in p.channels:
            hint = "set exposure.auto: false, or record it with `hil run`"
            message = "has automatic exposure, which hangs on the pictures before; frames are made out of order here"
            problems.append(Problem(f"{where}: sensors.{name}", message, hint))
        if isinstance(p, CameraParameters) and p.colour != "native":
            hint = "set colour: native"
            problems.append(Problem(f"{where}: sensors.{name}", f"draws its colour with {p.colour!r}", hint))
        if isinstance(p, RadarParameters) and not set(p.outputs) & set(RADAR_FOLDERS):
            hint = "set outputs: [raw, range_doppler]; points and tracks come from them with `hil radar`"
            problems.append(Problem(f"{where}: sensors.{name}", "has neither raw data nor maps to record", hint))
    return problems


def _with_own_outputs(bench: Bench) -> Bench:
    """Radars without what hangs on the frames before: tracks, the points they are made of, a learnt background."""
    sensors = dict(bench.config.sensors)
    for name, sensor in sensors.items():
        p = sensor.parameters
        if not isinstance(p, RadarParameters):
            continue
        kept = tuple(output for output in p.outputs if output in RADAR_FOLDERS)
        changes: dict[str, Any] = {"outputs": kept or p.outputs}
        if p.processing.clutter == "background":
            changes["processing"] = p.processing.model_copy(update={"clutter": "none"})
        sensors[name] = sensor.model_copy(update={"parameters": p.model_copy(update=changes)})
    return replace(bench, config=bench.config.model_copy(update={"sensors": sensors}))


def _with_course(bench: Bench, work: Callable[[], Path]) -> Bench:
    """The bench with its preset course as its mission."""
    trajectory = bench.config.dataset.trajectory
    if trajectory is None:
        return bench
    path = work() / MISSION_NAME
    path.write_text(waypoints_text(trajectory, bench.scene.site), encoding="utf-8")
    files: Mapping[str, Path] = {k: v for k, v in bench.files.items() if k != "plan"} | {"mission": path}
    config = bench.config.model_copy(update={"mission": str(path)})
    from hil.config import site_of

    return replace(
        bench, config=config, mission=load_mission(path, site=site_of(bench.scene)), files=files, script=None
    )


_CIRCLE_POINTS, _EIGHT_POINTS, _LANES = 24, 32, 5
_ITEMS = 64  # waypoints before the jump back, where the vehicle stops for a moment


def course(trajectory: Trajectory) -> list[tuple[float, float]]:
    """One round of a preset: places (east, north) [m] from the take-off place, without coming back to the first.

    square: corners (0, 0), (s, 0), (s, s), (0, s); circle: of diameter s, through the take-off place and (0, s);
    figure_eight: a lemniscate s wide (Gerono's: s / 2 sin a, s / 2 sin a cos a); survey: lanes of length s to the
    east, s / 4 apart, and back.
    """
    s = trajectory.side_m
    if trajectory.preset == "square":
        return [(0.0, 0.0), (s, 0.0), (s, s), (0.0, s)]
    if trajectory.preset == "circle":
        turns = [2.0 * math.pi * k / _CIRCLE_POINTS for k in range(_CIRCLE_POINTS)]
        return [(0.5 * s * math.sin(a), 0.5 * s * (1.0 - math.cos(a))) for a in turns]
    if trajectory.preset == "figure_eight":
        turns = [2.0 * math.pi * k / _EIGHT_POINTS for k in range(_EIGHT_POINTS)]
        return [(0.5 * s * math.sin(a), 0.5 * s * math.sin(a) * math.cos(a)) for a in turns]
    lanes = []
    for lane in range(_LANES):
        ends = [(0.0, lane * s / (_LANES - 1)), (s, lane * s / (_LANES - 1))]
        lanes += ends if lane % 2 == 0 else ends[::-1]
    return lanes


def waypoints_text(trajectory: Trajectory, site: Site) -> str:
    """The course as a .waypoints file, flown round and round by a jump back, however many frames are wanted."""
    frame = LocalFrame(site)
    height = trajectory.height_m
    home = _row(0, FRAME_GLOBAL, WAYPOINT, (0.0,) * 4, (site.latitude_deg, site.longitude_deg), site.altitude_m)
    take_off = _row(1, FRAME_RELATIVE, TAKEOFF, (0.0,) * 4, (site.latitude_deg, site.longitude_deg), height)
    speed = _row(2, FRAME_MISSION, SPEED, (1.0, trajectory.speed_mps, -1.0, 0.0), (0.0, 0.0), 0.0)
    rows = [home, take_off, speed]
    round_W = course(trajectory)
    for x, y in round_W * max(1, _ITEMS // len(round_W)):
        latitude, longitude, _ = frame.geodetic_from_enu((x, y, height))
        rows.append(_row(len(rows), FRAME_RELATIVE, WAYPOINT, (0.0,) * 4, (latitude, longitude), height))
    rows.append(_row(len(rows), FRAME_MISSION, JUMP, (3.0, -1.0, 0.0, 0.0), (0.0, 0.0), 0.0))
    return "\n".join(["QGC WPL 110", *rows, ""])


def _row(
    number: int, frame: int, command: int, params: Sequence[float], place: tuple[float, float], height_m: float
) -> str:
    values = [*params, *place, height_m]
    return "\t".join([str(number), str(int(number == 0)), str(frame), str(command), *(f"{v:.8f}" for v in values), "1"])
