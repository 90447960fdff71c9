"""The whole of settings.json, with AirSim's default values for what it does not give."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from hil.apps.airsim.settings.cameras import Camera, camera_of, read_camera
from hil.apps.airsim.settings.reader import Reader, Report
from hil.apps.airsim.settings.relaxed_json import strict_json
from hil.apps.airsim.settings.sensors import default_sensors, read_sensors
from hil.apps.airsim.settings.surroundings import (
    Origin,
    Recording,
    Segmentation,
    TimeOfDay,
    read_origin,
    read_recording,
    read_segmentation,
    read_time_of_day,
    read_vector,
)
from hil.apps.airsim.settings.vehicles import Vehicle, VehicleDefaults, default_vehicle, read_vehicles
from signals.documents.json_lines import parse_json
from signals.errors import ConfigError, Problem
from signals.samples import Vec3

DEFAULT_PORT = 41451
_VERSION = 1.2  # the first that has the keys read here
_COSYS_VERSION = 2.0
_MOST_WIND_MPS, MOST_FORCE_N = 100.0, 200.0
_NOT_SIMULATED = ("Car", "SkidVehicle")
_RENAMED = ("AdditionalCameras", "CaptureSettings", "NoiseSettings", "UsageScenario", "SimpleFlight", "PX4")
_WITHOUT_MEANING = (
    "SeeDocsAt", "see_docs_at", "RecordUIVisible", "LogMessagesVisible", "ShowLosDebugLines", "ViewMode", "EngineSound",
    "SpeedUnitFactor", "SpeedUnitLabel", "CameraDirector", "SubWindows", "PawnPaths", "RpcEnabled", "EnableRpc",
    "Annotation", "MoveWorldOrigin",
)  # fmt: skip
_SILENT = ("SeeDocsAt", "see_docs_at")


@dataclass(frozen=True)
class AirSimSettings:
    """Settings of one server. Positions are relative to the scene's start: north, east, down in metres."""

    sim_mode: str  # Multirotor or ComputerVision
    vehicles: Mapping[str, Vehicle]
    external_cameras: Mapping[str, Camera]
    added: VehicleDefaults  # of vehicles that clients add
    clock_type: str
    clock_speed: float
    host: str  # LocalHostIp, "" if it is not given
    port: int
    scene: str  # "Default Environment", "" if it is not given
    physics_engine: str
    origin: Origin
    wind_mps: Vec3
    external_force_n: Vec3
    time_of_day: TimeOfDay
    segmentation: Segmentation
    recording: Recording
    text: str  # the file as it is
    notes: tuple[str, ...] = ()  # to be shown once

    @property
    def default_vehicle(self) -> str:
        """Name of the vehicle that a call without a name means."""
        chosen = [name for name, vehicle in self.vehicles.items() if vehicle.first_person]
        return chosen[0] if chosen else next(iter(self.vehicles))

    def added_vehicle(self, name: str) -> Vehicle:
        """Return the settings of a vehicle that a client adds."""
        return default_vehicle(self.added, name)


def read_settings(text: str, source: str) -> AirSimSettings:
    """Return the settings of a file's text. Raises ConfigError with all problems."""
    repeated: list[Problem] = []
    document = parse_json(strict_json(text), source, repeated=repeated)
    report = Report(document)
    root = Reader(report, (), document.data)
    if report.problems:
        raise ConfigError(report.problems)
    version = _read_version(root)
    sim_mode = _read_sim_mode(root)
    multirotor, cosys = sim_mode == "Multirotor", version >= _COSYS_VERSION
    camera = Camera()
    if (child := root.child("CameraDefaults")) is not None:
        camera = read_camera(child, camera)
    given = root.has("DefaultSensors")
    defaults = VehicleDefaults(
        sim_mode,
        camera,
        read_sensors(root, "DefaultSensors", {}, multirotor=multirotor, cosys=cosys)
        if given
        else default_sensors(multirotor, cosys),
        cosys,
    )
    settings = AirSimSettings(
        sim_mode,
        read_vehicles(root, defaults),
        {name: read_camera(reader, camera) for name, reader in root.named("ExternalCameras") or []},
        defaults,
        root.choice("ClockType", "SteppableClock", ("SteppableClock", "ScalableClock")),
        root.number("ClockSpeed", 1.0, 0.001, 1000.0),
        root.text("LocalHostIp"),
        root.whole("ApiServerPort", DEFAULT_PORT, 1, 65535),
        root.text("Default Environment"),
        root.choice("PhysicsEngineName", "FastPhysicsEngine", ("FastPhysicsEngine", "ExternalPhysicsEngine", "PhysX")),
        read_origin(root),
        read_vector(root, "Wind", _MOST_WIND_MPS),
        read_vector(root, "ExternalForce", MOST_FORCE_N),
        read_time_of_day(root),
        read_segmentation(root),
        read_recording(root),
        text,
    )
    _check_recording(root, settings)
    if settings.clock_type == "ScalableClock":
        root.note("ClockType", "has no meaning here", "choose with --clock")
    root.without_meaning(*_WITHOUT_MEANING)
    for key in ("Beacons", "PassiveEchoBeacons", "WorldLights"):
        if root.child(key) is not None:
            root.note(key, "is not simulated and left out")
    root.close("")
    if report.problems:
        raise ConfigError(sorted(report.problems, key=lambda problem: int(problem.where.rpartition(":")[2])))
    return _with_notes(settings, report, repeated)


def _read_version(root: Reader) -> float:
    version = root.number("SettingsVersion", root.number("SettingdVersion", 0.0, 0.0, 100.0), 0.0, 100.0)
    if version < _VERSION:
        if version > 0.0:
            root.note("SettingsVersion", f"is {version:g}: keys of files before {_VERSION} are not read")
        for key in _RENAMED:
            if root.has(key):
                root.child(key)
                hint = "write it below CameraDefaults or Vehicles, as files of SettingsVersion 1.2 have it"
                root.problem(key, "belongs to files before SettingsVersion 1.2", hint)
    return version


def _read_sim_mode(root: Reader) -> str:
    value = root.text("SimMode")
    if value in _NOT_SIMULATED:
        root.problem("SimMode", f"is {value}, which is not simulated here", "use Multirotor or ComputerVision")
        return "Multirotor"
    return root.choice("SimMode", "Multirotor", ("Multirotor", "ComputerVision"))


def _check_recording(root: Reader, settings: AirSimSettings) -> None:
    """Add a problem for every recorded image of a vehicle or camera that does not exist."""
    recording = Reader(root.report, ("Recording",), {})
    for i, image in enumerate(settings.recording.images or ()):
        vehicle = settings.vehicles.get(image.vehicle or next(iter(settings.vehicles), ""))
        if vehicle is None and settings.vehicles:
            what, known = f"vehicle {image.vehicle[:60]!r}", settings.vehicles.keys()
        elif vehicle is not None and camera_of(vehicle.cameras, image.camera) not in vehicle.cameras:
            what, known = f"camera {image.camera[:60]!r}", vehicle.cameras.keys()
        else:
            continue
        recording.problem(f"Cameras[{i}]", f"names the unknown {what}", f"known: {', '.join(known)}")


def _with_notes(settings: AirSimSettings, report: Report, repeated: list[Problem]) -> AirSimSettings:
    notes = [str(p) for p in (*repeated, *report.notes, *report.unknown.values())]
    told = sorted(set(report.without_meaning) - set(_SILENT))
    if told:
        notes.append(f"{report.document.source}: without meaning here: {', '.join(told)}")
    return replace(settings, notes=tuple(notes))
