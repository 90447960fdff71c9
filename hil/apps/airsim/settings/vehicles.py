"""Vehicles of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from hil.apps.airsim.settings.cameras import Camera, built_in_cameras, read_cameras
from hil.apps.airsim.settings.reader import Reader
from hil.apps.airsim.settings.sensors import Sensor, read_sensors
from signals.documents.validate import nearest
from signals.samples import Vec3

VehicleType = Literal["SimpleFlight", "PX4Multirotor", "ArduCopter", "ComputerVision"]

_TYPES: Mapping[str, tuple[VehicleType, ...]] = {
    "Multirotor": ("SimpleFlight", "PX4Multirotor", "ArduCopter"),
    "ComputerVision": ("ComputerVision",),
}
# Other types of AirSim and Cosys-AirSim.
_OTHERS = ("PhysXCar", "ArduRover", "ArduCopterSolo", "BoxCar", "CPHusky", "Pioneer")
# The bench connects the autopilots.
_CONNECTION = (
    "UseSerial", "SerialPort", "SerialBaudRate", "UdpIp", "UdpPort", "UseTcp", "TcpPort", "LockStep", "Lockstep",
    "ControlIp", "ControlPort", "ControlPortLocal", "ControlPortRemote", "SitlIp", "SitlPort", "LocalHostIp", "Model",
    "LogViewerHostIp", "LogViewerPort", "LogViewerSendPort", "QgcHostIp", "QgcPort", "Logs", "OffboardCompID",
    "OffboardSysID", "SimCompID", "SimSysID", "VehicleCompID", "VehicleSysID",
)  # fmt: skip


@dataclass(frozen=True)
class Vehicle:
    """One vehicle. Its start is relative to the scene's start: north, east, down in metres, and degrees."""

    name: str
    kind: VehicleType
    position_m: Vec3 = (0.0, 0.0, 0.0)
    rotation_deg: Vec3 = (0.0, 0.0, 0.0)  # roll, pitch, yaw
    collisions: bool = True
    pass_through: bool = False  # collisions are reported and change no motion
    first_person: bool = False  # the vehicle that a call without a name means
    cameras: Mapping[str, Camera] = field(default_factory=dict)
    sensors: Mapping[str, Sensor] = field(default_factory=dict)


@dataclass(frozen=True)
class VehicleDefaults:
    """Values that vehicles take where their section gives none."""

    sim_mode: str
    camera: Camera
    sensors: Mapping[str, Sensor]
    cosys: bool  # a file of Cosys-AirSim


def default_vehicle(defaults: VehicleDefaults, name: str = "") -> Vehicle:
    """Return the vehicle of a file without `Vehicles`, or one that a client adds."""
    kind = _TYPES[defaults.sim_mode][0]
    return Vehicle(name or kind, kind, cameras=built_in_cameras(defaults.camera), sensors=defaults.sensors)


def read_vehicles(root: Reader, defaults: VehicleDefaults) -> dict[str, Vehicle]:
    """Return the vehicles that are created at the start, by name and sorted by it."""
    given = root.named("Vehicles")
    if not given:
        vehicle = default_vehicle(defaults)
        return {vehicle.name: vehicle}
    vehicles: dict[str, Vehicle] = {}
    for name, reader in given:
        kind = _read_type(reader, defaults.sim_mode)
        if kind is None:
            continue
        if not name.strip():
            reader.problem(None, "is a vehicle without a name")
        vehicle = _read_vehicle(name, kind, reader, defaults)
        if reader.flag("AutoCreate", True):
            vehicles[name] = vehicle
        reader.close("Vehicles")
    if not vehicles and not root.report.problems:
        types = " or ".join(_TYPES[defaults.sim_mode])
        hint = f"one needs VehicleType {types}, and AutoCreate must not be false"
        root.problem("Vehicles", f"holds no vehicle that SimMode {defaults.sim_mode} creates", hint)
    return vehicles


def _read_type(reader: Reader, sim_mode: str) -> VehicleType | None:
    """Return the type of a vehicle, None if it is wrong or if the mode leaves the vehicle out."""
    value = reader.text("VehicleType")
    of_mode = _TYPES[sim_mode]
    known = {word.lower(): word for words in _TYPES.values() for word in words}
    kind = known.get(value.lower())
    if kind in of_mode:
        return kind
    if kind is not None or value.lower() in (other.lower() for other in _OTHERS):
        reader.note("VehicleType", f"is {value}: the vehicle is left out, because SimMode {sim_mode} has none of it")
        return None
    if value:
        reader.problem("VehicleType", f"has an unknown value: {value[:60]!r}", nearest(value, of_mode))
    else:
        reader.problem(None, "has no VehicleType", f"such as {of_mode[0]}")
    return None


def _read_vehicle(name: str, kind: VehicleType, reader: Reader, defaults: VehicleDefaults) -> Vehicle:
    pass_through = reader.flag("EnableCollisionPassthrogh", reader.flag("EnableCollisionPassthrough", False))
    reader.without_meaning("DefaultVehicleState", "PawnPath", "RC", "AllowAPIAlways", "EnableTrace", "Lights")
    reader.without_meaning("DebugSymbolScale", *_CONNECTION)
    if kind not in ("PX4Multirotor", "ArduCopter"):
        reader.without_meaning("Parameters")
    elif reader.child("Parameters") is not None:
        reader.note("Parameters", "is left out", "give these parameters to the bench, as autopilot.params")
    multirotor = defaults.sim_mode == "Multirotor"
    return Vehicle(
        name,
        kind,
        reader.vector((0.0, 0.0, 0.0)),
        reader.angles_deg((0.0, 0.0, 0.0)),
        reader.flag("EnableCollisions", True),
        pass_through,
        reader.flag("IsFpvVehicle", False),
        read_cameras(reader, defaults.camera),
        read_sensors(reader, "Sensors", defaults.sensors, multirotor=multirotor, cosys=defaults.cosys),
    )
