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
_PORT = (1, 65535)


@dataclass(frozen=True)
class MavLink:
    """Connection of a vehicle with an own autopilot."""

    use_serial: bool = True
    serial_port: str = "*"
    baud: int = 115200
    udp_ip: str = "127.0.0.1"
    udp_port: int = 14560
    use_tcp: bool = False
    tcp_port: int = 4560
    lockstep: bool = True
    control_ip: str = "127.0.0.1"
    control_port_local: int = 14540
    control_port_remote: int = 14580
    local_host_ip: str = "127.0.0.1"
    model: str = "Generic"
    parameters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Vehicle:
    """One vehicle. Its start is relative to the scene's start: north, east, down in metres, and degrees."""

    name: str
    kind: VehicleType
    position_m: Vec3 = (0.0, 0.0, 0.0)
    rotation_deg: Vec3 = (0.0, 0.0, 0.0)  # roll, pitch, yaw
    armed: bool = True
    collisions: bool = True
    pass_through: bool = False  # collisions are reported and change no motion
    first_person: bool = False  # the vehicle that a call without a name means
    cameras: Mapping[str, Camera] = field(default_factory=dict)
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    mavlink: MavLink | None = None


@dataclass(frozen=True)
class VehicleDefaults:
    """Values that vehicles take where their section gives none."""

    sim_mode: str
    camera: Camera
    sensors: Mapping[str, Sensor]
    noisy_imu: bool


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
    state = reader.choice("DefaultVehicleState", "Armed", ("Armed", "Disarmed", "Inactive", "Active", "Unknown"))
    pass_through = reader.flag("EnableCollisionPassthrogh", reader.flag("EnableCollisionPassthrough", False))
    reader.without_meaning("PawnPath", "RC", "AllowAPIAlways", "EnableTrace", "Lights", "DebugSymbolScale")
    multirotor = defaults.sim_mode == "Multirotor"
    return Vehicle(
        name,
        kind,
        reader.vector((0.0, 0.0, 0.0)),
        reader.angles_deg((0.0, 0.0, 0.0)),
        state in ("Armed", "Active"),
        reader.flag("EnableCollisions", True),
        pass_through,
        reader.flag("IsFpvVehicle", False),
        read_cameras(reader, defaults.camera),
        read_sensors(reader, "Sensors", defaults.sensors, multirotor=multirotor, noisy_imu=defaults.noisy_imu),
        _read_mavlink(reader, kind),
    )


def _read_mavlink(reader: Reader, kind: VehicleType) -> MavLink | None:
    reader.without_meaning(
        "LogViewerHostIp", "LogViewerPort", "LogViewerSendPort", "QgcHostIp", "QgcPort", "Logs", "OffboardCompID",
        "OffboardSysID", "SimCompID", "SimSysID", "VehicleCompID", "VehicleSysID",
    )  # fmt: skip
    if kind not in ("PX4Multirotor", "ArduCopter"):
        reader.without_meaning(
            "UseSerial", "SerialPort", "SerialBaudRate", "UdpIp", "UdpPort", "UseTcp", "TcpPort", "LockStep",
            "Lockstep", "ControlIp", "ControlPort", "ControlPortLocal", "ControlPortRemote", "SitlIp", "SitlPort",
            "LocalHostIp", "Model", "Parameters",
        )  # fmt: skip
        return None
    default = MavLink()
    # Older keys first: the newer one wins where both are given.
    local = reader.whole("ControlPort", default.control_port_local, *_PORT)
    local = reader.whole("ControlPortLocal", reader.whole("SitlPort", local, *_PORT), *_PORT)
    return MavLink(
        use_serial=reader.flag("UseSerial", default.use_serial),
        serial_port=reader.text("SerialPort", default.serial_port),
        baud=reader.whole("SerialBaudRate", default.baud, 300, 12_000_000),
        udp_ip=reader.text("UdpIp", default.udp_ip),
        udp_port=reader.whole("UdpPort", default.udp_port, *_PORT),
        use_tcp=reader.flag("UseTcp", default.use_tcp),
        tcp_port=reader.whole("TcpPort", default.tcp_port, *_PORT),
        # AirSim's documentation writes Lockstep, its code reads LockStep.
        lockstep=reader.flag("LockStep", reader.flag("Lockstep", default.lockstep)),
        control_ip=reader.text("ControlIp", reader.text("SitlIp", default.control_ip)),
        control_port_local=local,
        control_port_remote=reader.whole("ControlPortRemote", default.control_port_remote, *_PORT),
        local_host_ip=reader.text("LocalHostIp", default.local_host_ip),
        model=reader.text("Model", default.model),
        parameters=reader.numbers("Parameters", -1e9, 1e9),
    )
