"""Plan of a data set: the bench to fly, the number of frames and the folder of each sensor.

A frame is one sample of the reference sensor. The reference is the first camera that records colour, classes and
instances, which is also the camera that is labelled; without one it is the first camera, LiDAR or radar. All other
sensors keep their own rates.

Each batch of frames is a pure function of its true states, the seed and the sample numbers, so any worker process may
make any batch. A sensor whose samples depend on earlier samples is therefore refused, and the outputs of a radar that
depend on earlier frames are switched off.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from firmware_bridge.autopilots.catalog import PROFILES
from hil.apps.dataset.trajectory import waypoints_text
from hil.config import Bench, BenchConfig, SensorConfig, load_bench, site_of
from hil.config.checks.course_notes import first_note
from hil.config.files import find
from hil.config.missions import load_mission
from hil.config.schema import MAX_HEIGHT_M, Record, Trajectory
from hil.data_set_files import LABEL_FORMATS
from signals.channels import CHANNELS
from signals.documents.validate import nearest
from signals.errors import ConfigError, Problem
from signals.time import NS_PER_S
from sim.frame.quality import QUALITIES
from sim.physics.vehicle import Vehicle
from sim.scene.world import World
from sim.sensors.camera_parameters import CameraParameters
from sim.sensors.catalog import KINDS
from sim.sensors.radar_parameters import RadarParameters

DEFAULT_BENCH = "rigs/datasets/park_loop.yaml"
DEFAULT_FRAMES, MAX_FRAMES = 500, 10_000_000
EPOCH_NS = 1_600_000_000 * NS_PER_S  # simulated time 0 in the files: 19 digits, as tools for EuRoC expect
ALWAYS_WRITTEN = ("euroc", "voc", "coco", "mcap")
BATCH_FRAMES = 10  # fixed: the recording's chunks and the journal's rows are batches, and --resume compares them
MISSION_NAME = "trajectory.waypoints"
_MOST_RAISED_M = 40.0  # that a course is raised to be clear

# Folder names in mav0 by channel; the sensor's number is appended.
CHANNEL_FOLDERS = {name: name for name in CHANNELS} | {"rgb": "cam"}
RADAR_FOLDERS = {"raw": "radar", "range_doppler": "range_doppler"}
_FOLDERS = {"camera": CHANNEL_FOLDERS, "radar": RADAR_FOLDERS}  # by kind; other kinds name their folder themselves


@dataclass(frozen=True)
class DatasetPlan:
    """A data set to make: the bench that is flown and rendered, and the number of frames.

    `quality` is the rendering quality as the manifest names it; the bench already contains it. `bench` is that of the
    recorded vehicle, `group` that of all vehicles if there are several.
    """

    bench: Bench
    frames: int
    quality: str
    group: Bench | None = None

    @classmethod
    def of(cls, bench: Bench, vehicle: str, frames: int, quality: str) -> DatasetPlan:
        """Make the plan of one vehicle of a bench, by its name; empty: the bench has only one."""
        return cls(bench.vehicles[vehicle], frames, quality, bench) if vehicle else cls(bench, frames, quality)

    @property
    def config(self) -> BenchConfig:
        """Configuration of the bench."""
        return self.bench.config

    @property
    def vehicle(self) -> str:
        """Name of the recorded vehicle; empty if the bench has only one."""
        return "" if self.group is None else self.config.name

    @property
    def other_vehicles(self) -> dict[str, Vehicle]:
        """The other vehicles of the bench, by name."""
        benches = {} if self.group is None else self.group.vehicles
        return {name: bench.vehicle for name, bench in benches.items() if name != self.vehicle}

    @cached_property
    def world(self) -> World:
        """Geometry of the scene and of all vehicles of a bench with several."""
        return (self.group or self.bench).world

    @cached_property
    def frame_sensors(self) -> dict[str, SensorConfig]:
        """Cameras, LiDARs and radars by name; radars last, because they read the cameras' pictures."""
        sensors = _frame_sensors(self.bench)
        return dict(sorted(sensors.items(), key=lambda pair: pair[1].kind == "radar"))

    @cached_property
    def flight_sensors(self) -> dict[str, SensorConfig]:
        """Sensors sampled during the flight (IMU, GPS and the like), by name."""
        return _flight_sensors(self.config)

    @cached_property
    def reference(self) -> str:
        """Name of the sensor whose samples are the frames."""
        sensors = self.frame_sensors
        if self.labelled is not None:
            return self.labelled
        preferred = (name for kind in ("camera", "lidar", "radar") for name, s in sensors.items() if s.kind == kind)
        return next(preferred, next(iter(sensors)))

    @cached_property
    def labelled(self) -> str | None:
        """Name of the labelled camera: the first with rgb, segmentation and instance. None if there is none."""
        needed = {"rgb", "segmentation", "instance"}
        cameras = [n for n, s in self.frame_sensors.items() if s.kind == "camera"]
        return next((n for n in cameras if needed <= set(self.frame_sensors[n].parameters.channels)), None)

    @property
    def formats(self) -> frozenset[str]:
        """Forms of 3-D labels to write; empty: none."""
        return frozenset(self.config.dataset.formats)

    @property
    def joint_formats(self) -> list[str]:
        """Names of `formats` that join a picture and a sweep: all but boxes."""
        return sorted(self.formats - {"boxes"})

    @cached_property
    def lidar(self) -> str | None:
        """Name of the first LiDAR, that of `joint_formats`. None if there is none."""
        return next((name for name, sensor in self.frame_sensors.items() if sensor.kind == "lidar"), None)

    @cached_property
    def numbers(self) -> dict[str, int]:
        """Number of each sensor among the sensors of its kind, from 0, by name."""
        count: Counter[str] = Counter()
        numbers = {}
        for name, sensor in self.config.sensors.items():
            numbers[name] = count[sensor.kind]
            count[sensor.kind] += 1
        return numbers

    def folder(self, name: str, channel: str = "") -> str:
        """Return the folder in mav0 of a sensor, or of one of its channels."""
        kind = self.config.sensors[name].kind
        return f"{_FOLDERS.get(kind, {}).get(channel, kind)}{self.numbers[name]}"

    def flight_bench(self, seed: int) -> Bench:
        """Return the bench with this seed and without cameras, LiDARs, radars and recordings."""
        if self.group is None:
            return _for_flight(self.bench, seed)
        vehicles = {name: _for_flight(bench, seed) for name, bench in self.group.vehicles.items()}
        # A vehicle that falls is not sampled any more, so the recorded one cannot be lost.
        config = vehicles[self.vehicle].config
        autopilot = config.autopilot.model_copy(update={"on_loss": "error"})
        config = config.model_copy(update={"autopilot": autopilot})
        vehicles[self.vehicle] = replace(vehicles[self.vehicle], config=config)
        return replace(self.group, vehicles=vehicles)


def _flight_sensors(config: BenchConfig) -> dict[str, SensorConfig]:
    return {n: s for n, s in config.sensors.items() if not KINDS[s.kind].needs_frames}


def _frame_sensors(bench: Bench) -> dict[str, SensorConfig]:
    return {n: s for n, s in bench.config.sensors.items() if KINDS[s.kind].needs_frames}


def _for_flight(bench: Bench, seed: int) -> Bench:
    record = Record(mcap=False, images=False, tlog=False, report=False)
    changes = {"sensors": _flight_sensors(bench.config), "record": record, "seed": seed}
    return replace(bench, config=bench.config.model_copy(update=changes))


def make_plan(
    config: Path | None,
    *,
    vehicle: str | None = None,
    frames: int | None,
    quality: str | None,
    seed: int | None,
    settings: tuple[str, ...],
    work: Callable[[], Path],
    formats: tuple[str, ...] = (),
) -> DatasetPlan:
    """Load and check the bench. Raises ConfigError with every problem.

    `config` defaults to the bench that comes with `hil dataset`. `work` returns a folder for the mission file of a
    preset course; it is called only if the bench has one. `vehicle`: the one to record, of a bench with several.
    `formats`: of 3-D labels, in place of the bench's own `dataset.formats`.
    """
    # The default bench is found as missions are: by its path, in the working directory or beside the package.
    path = config if config is not None else find("mission", DEFAULT_BENCH, ())
    if quality is not None and quality not in QUALITIES:
        raise ConfigError.at("--quality", f"is unknown: {quality!r}", nearest(quality, QUALITIES))
    quality_setting = (f"quality={quality}",) if quality is not None else ()
    format_setting = _format_setting(formats)
    group = load_bench(path, seed=seed, settings=(*settings, *quality_setting, *format_setting), flown=False)
    bench = _recorded(group, vehicle)
    problems: list[Problem] = []
    count = DEFAULT_FRAMES if frames is None else frames
    if not 1 <= count <= MAX_FRAMES:
        problems.append(Problem("--frames", f"must be 1 to {MAX_FRAMES}, not {count}"))
    bench = _with_memoryless_radars(bench)
    where = _bench_name(group)
    problems += _problems(bench, where if vehicle is None else f"{where}: {vehicle}")
    for name, other in group.vehicles.items():
        if name != vehicle:
            problems += _flight_problems(other.config, f"{where}: {name}")
    if problems:
        raise ConfigError(problems)
    bench, quality = _with_course(bench, work), bench.config.quality or "as the file says"
    if vehicle is None:
        return DatasetPlan(bench, count, quality)
    return DatasetPlan(bench, count, quality, replace(group, vehicles={**group.vehicles, vehicle: bench}))


def _format_setting(formats: tuple[str, ...]) -> tuple[str, ...]:
    """Return the setting of these forms of labels. Raises ConfigError for one that is unknown or always written."""
    problems = []
    for name in formats:
        if name in ALWAYS_WRITTEN:
            message = f"does not name {name}: it is always written"
            problems.append(Problem("--format", message, f"leave it out, or choose one of {', '.join(LABEL_FORMATS)}"))
        elif name not in LABEL_FORMATS:
            problems.append(Problem("--format", f"is unknown: {name!r}", nearest(name, LABEL_FORMATS)))
    if problems:
        raise ConfigError(problems)
    return (f"dataset.formats=[{', '.join(dict.fromkeys(formats))}]",) if formats else ()


def _recorded(bench: Bench, vehicle: str | None) -> Bench:
    """Return the bench of the vehicle to record. Raises ConfigError if there is none of this name."""
    names = ", ".join(bench.vehicles)
    if vehicle is None and bench.vehicles:
        able = [name for name, other in bench.vehicles.items() if _frame_sensors(other)]
        hint = f"--vehicle NAME; with a camera, LiDAR or radar: {', '.join(able) or 'none'}"
        message = f"has several vehicles ({names}), and a data set is recorded by one"
        raise ConfigError.at(_bench_name(bench), message, hint)
    if vehicle is None:
        return bench
    if not bench.vehicles:
        message = f"has no meaning: {_bench_name(bench)} has one vehicle, without a name"
        raise ConfigError.at("--vehicle", message, "leave it out")
    if vehicle not in bench.vehicles:
        message = f"is unknown: {vehicle!r}; the vehicles are {names}"
        raise ConfigError.at("--vehicle", message, nearest(vehicle, bench.vehicles))
    return bench.vehicles[vehicle]


def _bench_name(bench: Bench) -> str:
    path = bench.files.get("bench")
    return str(path) if path is not None else "the bench"


def _flight_problems(config: BenchConfig, where: str) -> list[Problem]:
    """Report what no vehicle of a data set's flight can have."""
    problems = []
    if not config.autopilot.lockstep:
        kind = config.autopilot.kind
        hint = f"choose a rig of these: {', '.join(name for name, profile in PROFILES.items() if profile.lockstep)}"
        message = f"has a free-running autopilot ({kind}), which does not wait for frames: some would be lost"
        problems.append(Problem(where, message, hint))
    if config.companion.on:
        hint = "remove the section `companion`"
        problems.append(Problem(where, "has companions, whose pictures are rendered in flight", hint))
    for key, served in (("foxglove.port", config.foxglove.port), ("ros2.domain", config.ros2.domain)):
        if served is not None:
            message = f"has {key}, and nobody can follow the flights of a data set"
            problems.append(Problem(where, message, f"--set {key}=null"))
    return problems


def _problems(bench: Bench, where: str) -> list[Problem]:
    """Report what the recorded vehicle cannot have."""
    config = bench.config
    problems = []
    frame_sensors = _frame_sensors(bench)
    if not frame_sensors:
        has = ", ".join(config.sensors)
        hint = f"it has {has}; add one under `sensors`, or leave CONFIG out for the bench that comes with `hil dataset`"
        problems.append(Problem(where, "has no camera, LiDAR or radar, so there are no frames to record", hint))
    if bench.mission is None and bench.script is None and config.dataset.trajectory is None:
        hint = "set `mission`, or `dataset: {trajectory: {preset: square}}`"
        problems.append(Problem(where, "flies nothing: it has neither a mission nor a trajectory", hint))
    missing = config.missing_sensors()
    if config.dataset.trajectory is not None and missing:
        message = f"must hold a {' and a '.join(missing)} that feeds the flight controller: it flies a course"
        problems.append(Problem(f"{where}: sensors", message))
    problems += _flight_problems(config, where)
    faulty_sensors = {fault.sensor for fault in config.faults.sensors}
    if bench.script is not None:
        faulty_sensors |= bench.script.sensors_at_risk
    for name in sorted(faulty_sensors & set(frame_sensors)):
        hint = "a fault depends on earlier samples, and samples are made out of order here: record it with `hil run`"
        problems.append(Problem(f"{where}: sensors.{name}", "has faults declared", hint))
    if config.dataset.formats and frame_sensors:
        problems += _label_problems(DatasetPlan(bench, 1, ""), where)
    for name, sensor in frame_sensors.items():
        p = sensor.parameters
        if isinstance(p, CameraParameters) and p.exposure.auto and "rgb" in p.channels:
            hint = "set exposure.auto: false, or record it with `hil run`"
            message = "has automatic exposure, which depends on earlier pictures; frames are made out of order here"
            problems.append(Problem(f"{where}: sensors.{name}", message, hint))
        if isinstance(p, CameraParameters) and p.colour not in ("native", "path_traced"):
            hint = "set colour: native or path_traced"
            problems.append(Problem(f"{where}: sensors.{name}", f"renders its colour with {p.colour!r}", hint))
        if isinstance(p, RadarParameters) and not set(p.outputs) & set(RADAR_FOLDERS):
            hint = "set outputs: [raw, range_doppler]; `hil radar` makes points and tracks of them"
            problems.append(Problem(f"{where}: sensors.{name}", "has neither raw data nor maps to record", hint))
    return problems


def _label_problems(plan: DatasetPlan, where: str) -> list[Problem]:
    """Report what the forms of 3-D labels need and the bench does not have."""
    place = f"{where}: dataset.formats"
    if plan.labelled is None and plan.lidar is None:
        hint = "add a LiDAR, or channels: [rgb, segmentation, instance] to a camera"
        return [Problem(place, "needs a LiDAR or a camera that shows classes and instances", hint)]
    problems = []
    joint = " and ".join(plan.joint_formats)
    if not joint:
        return []
    if plan.labelled is None:
        hint = "add channels: [rgb, segmentation, instance] to a camera, or choose boxes"
        problems.append(Problem(place, f"needs a camera that shows classes and instances, for {joint}", hint))
    else:
        camera = plan.frame_sensors[plan.labelled]
        if not camera.parameters.model().pinhole:
            hint = "remove its distortion, or choose boxes"
            message = f"cannot describe the distortion of the camera {plan.labelled}: {joint} has rectified pictures"
            problems.append(Problem(place, message, hint))
    if plan.lidar is None:
        hint = "add one under `sensors`, for example lidar: {preset: vlp16, rate_hz: 10}, or choose boxes"
        problems.append(Problem(place, f"needs a LiDAR, for {joint}", hint))
    return problems


def _with_memoryless_radars(bench: Bench) -> Bench:
    """Switch off a radar's points and tracks, which are not recorded, and the background learnt from earlier frames."""
    sensors = dict(bench.config.sensors)
    for name, sensor in sensors.items():
        p = sensor.parameters
        if not isinstance(p, RadarParameters):
            continue
        outputs = tuple(output for output in p.outputs if output in RADAR_FOLDERS)
        changes: dict[str, Any] = {"outputs": outputs or p.outputs}
        if p.processing.clutter == "background":
            changes["processing"] = p.processing.model_copy(update={"clutter": "none"})
        sensors[name] = sensor.model_copy(update={"parameters": p.model_copy(update=changes)})
    return replace(bench, config=bench.config.model_copy(update={"sensors": sensors}))


def _with_course(bench: Bench, work: Callable[[], Path]) -> Bench:
    """Return the bench with its preset course, if it has one, as its mission. Raises ConfigError."""
    trajectory = bench.config.dataset.trajectory
    if trajectory is None:
        return bench
    path = work() / MISSION_NAME
    if not trajectory.clear:
        return _on_course(bench, trajectory, path)
    highest_m, note = min(trajectory.height_m + _MOST_RAISED_M, MAX_HEIGHT_M), ""
    while trajectory.height_m <= highest_m:
        flown = _on_course(bench, trajectory, path)
        note = first_note(flown)
        if not note:
            return flown
        trajectory = trajectory.model_copy(update={"height_m": trajectory.height_m + 1.0})
    message = f"finds no free way up to {highest_m:g} m: {note}"
    raise ConfigError.at("dataset.trajectory.clear", message, "take another course or place, or clear: false")


def _on_course(bench: Bench, trajectory: Trajectory, path: Path) -> Bench:
    """Return the bench with a preset course as its mission, which is written to `path`."""
    path.write_text(waypoints_text(trajectory, bench.scene.site, bench.config.start.p_W), encoding="utf-8")
    files: Mapping[str, Path] = {k: v for k, v in bench.files.items() if k != "plan"} | {"mission": path}
    dataset = bench.config.dataset.model_copy(update={"trajectory": trajectory})
    config = bench.config.model_copy(update={"mission": str(path), "dataset": dataset})
    mission = load_mission(path, site=site_of(bench.scene))
    sources = tuple(("dataset.trajectory", name) for _, name in mission.sources)  # the file is not the user's
    return replace(bench, config=config, mission=replace(mission, sources=sources), files=files, script=None)
