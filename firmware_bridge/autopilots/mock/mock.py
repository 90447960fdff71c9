"""The mock Pixhawk in lockstep: on a serial port, in this process, or on a pseudo-terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache

from firmware_bridge.autopilots.installation import LOG_NAME, Aircraft, FixedWing, Installation, Surroundings, Vtol
from firmware_bridge.autopilots.mock.firmware import MOCK
from firmware_bridge.autopilots.mock.sensors import FAULTS, SENSORS
from firmware_bridge.autopilots.mock.wheel_parameters import wheel_parameters
from firmware_bridge.autopilots.profile import Misfit, Profile
from firmware_bridge.autopilots.px4.rotor_parameters import BASE_AIRFRAME, matching_airframe, mock_parameters
from firmware_bridge.autopilots.px4.vtol_parameters import vtol_parameters
from firmware_bridge.autopilots.px4.wing_parameters import plane_parameters
from firmware_bridge.autopilots.settings import AutopilotSettings
from firmware_bridge.links.autopilot_link import AutopilotLink, LinkCaps
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.mock_pixhawk.flight.mission_item import (
    PLANE_SUPPORTED,
    REPERTOIRES,
    SUPPORTED,
    VTOL_SUPPORTED,
    refusal,
)
from firmware_bridge.mock_pixhawk.ids import MissionResult
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable, airframe_kind, airframes
from firmware_bridge.transports.transport import Transport
from signals.documents.validate import nearest
from signals.mission import MissionItem

MOCK_BOOT_SENSORS = 20
PLANE_AIRFRAME, VTOL_AIRFRAME = "plane", "standard_vtol"  # whose surfaces and gains the vehicle's replace
_KINDS = ("multirotor", "plane", "VTOL")  # by CA_AIRFRAME


def make_link(installation: Installation, around: Surroundings) -> AutopilotLink:
    """Make the link. With `autopilot.port` the user has started the mock there."""
    from firmware_bridge.links.px4.lockstep import LockstepLink

    settings = installation.settings
    # The mock is started with this number, so null (unknown) means its default.
    boot_sensors = MOCK_BOOT_SENSORS if settings.boot_sensors is None else settings.boot_sensors
    start = None
    transport: Transport
    if settings.port is not None:
        from firmware_bridge.devices.serial_path import serial_path  # with the serial port, loads USB
        from firmware_bridge.transports.serial import SerialTransport

        transport = SerialTransport(serial_path(settings.port), baud=settings.baud)
    elif settings.transport == "loopback":
        transport = _in_this_process(installation, boot_sensors)
    else:
        transport, start = mock_on_a_pty(installation, around, boot_sensors)
    return LockstepLink(
        around.wrap(transport),
        LinkCaps(settings.kind, lockstep=True, deterministic=True, boot_sensors=boot_sensors),
        start_process=start,
        timeouts=installation.timeouts,
    )


def _in_this_process(installation: Installation, boot_sensors: int) -> Transport:
    from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk  # the whole mock
    from firmware_bridge.mock_pixhawk.faults import Died, parse_fault
    from firmware_bridge.transports.loopback import LoopbackTransport

    airframe, params = airframe_and_params(installation)
    peer = MockPixhawk(
        airframe=airframe,
        boot_sensors=boot_sensors,
        params=params,
        sysid=_system_id(installation.settings),
        faults=[parse_fault(text) for text in installation.settings.faults.texts()],
    )
    return LoopbackTransport(peer, crashes=(Died,))


def mock_command(port: str, *, boot_sensors: int, arguments: Sequence[str] = ()) -> list[str]:
    """Return the command line of the mock Pixhawk on serial port `port`."""
    module = [sys.executable, "-P", "-m", "firmware_bridge.mock_pixhawk"]
    return [*module, "--port", port, "--boot-sensors", str(boot_sensors), *arguments]


def mock_on_a_pty(
    installation: Installation,
    around: Surroundings,
    boot_sensors: int,
    *more: str,
    rotors: Mapping[str, float] | None = None,
) -> tuple[Transport, Callable[[], ChildProcess]]:
    """Return the near end of a pseudo-terminal, and a function that starts the mock on its far end.

    `rotors`: parameters beside those that make the mock's base airframe the vehicle.
    """
    from firmware_bridge.transports.pty import PtyTransport

    pty = PtyTransport()
    airframe, params = airframe_and_params(installation, rotors)
    arguments = [*more, "--airframe", airframe]
    if (system_id := _system_id(installation.settings)) is not None:
        arguments += ["--sysid", str(system_id)]
    for text in params:
        arguments += ["--param", text]
    for text in installation.settings.faults.texts():
        arguments += ["--fault", text]

    def start() -> ChildProcess:
        argv = mock_command(pty.far_path, boot_sensors=boot_sensors, arguments=arguments)
        return ChildProcess(argv, stderr_path=around.out / LOG_NAME)

    return pty, start


def airframe_and_params(installation: Installation, rotors: Mapping[str, float] | None = None) -> tuple[str, list[str]]:
    """Return the mock's airframe and NAME=VALUE parameters: those of the bench over those of the vehicle.

    Without `autopilot.airframe` the vehicle decides: an airframe with its rotors, else parameters from its geometry,
    with `rotors` over them.
    """
    settings, vehicle = installation.settings, installation.vehicle
    known = _table_of(vehicle)
    params = {name: value for name, value in settings.params_of_file.items() if name in known} | settings.params
    airframe = settings.airframe
    if airframe is None:
        airframe, own = _airframe_of(vehicle)
        params = own | (dict(rotors or {}) if own else {}) | params
    return airframe, [f"{name}={value!r}" for name, value in params.items()]


def _airframe_of(vehicle: Aircraft) -> tuple[str, dict[str, float]]:
    """Return the mock's airframe for a vehicle, and the parameters that make it the vehicle."""
    if isinstance(vehicle, Vtol):
        return VTOL_AIRFRAME, vtol_parameters(vehicle)
    if isinstance(vehicle, FixedWing):
        return PLANE_AIRFRAME, plane_parameters(vehicle) | wheel_parameters(vehicle)
    airframe = matching_airframe(vehicle)
    return (BASE_AIRFRAME, mock_parameters(vehicle)) if airframe is None else (airframe, {})


def _system_id(settings: AutopilotSettings) -> int | None:
    """Return the MAVLink system id of an instance above 0; None: the mock's parameter MAV_SYS_ID, by default 1."""
    return settings.system_id if settings.instance else None


def _table_of(vehicle: Aircraft) -> ParamTable:
    if isinstance(vehicle, Vtol):
        return _table()
    return _plane_table() if isinstance(vehicle, FixedWing) else _multirotor_table()


@cache
def _table() -> ParamTable:
    return ParamTable.of_firmware(hitl=True, plane=True, vtol=True)


@cache
def _plane_table() -> ParamTable:
    return ParamTable.of_firmware(hitl=True, plane=True)


@cache
def _multirotor_table() -> ParamTable:
    return ParamTable.of_firmware(hitl=True)


def misfits(settings: AutopilotSettings) -> Sequence[Misfit]:
    """Report an airframe or parameters that the mock does not have, and values out of range."""
    found: list[Misfit] = []
    if not settings.start and settings.port is None:
        found.append(Misfit(("autopilot", "start"), "is false, but autopilot.port is not set"))
    known = airframes()
    if settings.airframe is not None and settings.airframe not in known:
        message = f"is unknown to the mock autopilot: {settings.airframe!r}"
        found.append(Misfit(("autopilot", "airframe"), message, nearest(settings.airframe, known)))
    for name, value in settings.all_params.items():
        of_bench = name in settings.params
        place = ("autopilot", "params" if of_bench else "params_of_file", name)
        param = _table().find(name)
        if param is None:
            if not of_bench:
                continue  # another build's, which is left out
            hint = nearest(name, _table().names())
            if not hint.startswith("did"):
                hint = "names are PX4's; the mock has those in firmware_bridge/mock_pixhawk/parameters/parameters.txt"
            found.append(Misfit(place, "is unknown to the mock autopilot", hint))
        elif (refusal := param.refusal(value)) is not None:
            found.append(Misfit(place, f"cannot be {value:g}: it is {refusal}"))
    return found


def vehicle_misfits(settings: AutopilotSettings, vehicle: Aircraft) -> Sequence[Misfit]:
    """Report an airframe of another kind or with other rotors than the vehicle, or parameters of another kind."""
    kind = _kind_of(vehicle)
    if settings.airframe is not None and (other := airframe_kind(settings.airframe)) != kind:
        message = f"is {settings.airframe!r}, a {other}, but the vehicle {vehicle.name!r} is a {kind}"
        has = "rotors" if kind == "multirotor" else "surfaces"
        return (Misfit(("autopilot", "airframe"), message, f"leave it out: the vehicle's {has} are then taken"),)
    wrong = [name for name in settings.params if name in _table() and name not in _table_of(vehicle)]
    if wrong:
        message = f"is a parameter of a {_owner(wrong[0])}, and the vehicle {vehicle.name!r} is a {kind}"
        return tuple(Misfit(("autopilot", "params", name), message, "leave it out") for name in wrong)
    if isinstance(vehicle, FixedWing | Vtol):
        return ()
    count = len(vehicle.rotors)
    if settings.airframe is None or count == 4:
        return ()
    message = f"is {settings.airframe!r}, a quadrotor, but the vehicle {vehicle.name!r} has {count} rotors"
    return (Misfit(("autopilot", "airframe"), message, "leave it out: the vehicle's rotors are then taken"),)


def item_misfits(vehicle: Aircraft, items: Sequence[MissionItem]) -> Mapping[int, tuple[str, str]]:
    """Return what is wrong, and what to do, with each item that the mock refuses at the upload, by number."""
    from firmware_bridge.ground_station.procedure import in_mission_frame  # with the messages of MAVLink

    repertoire = REPERTOIRES[_KINDS.index(_kind_of(vehicle))]
    found: dict[int, tuple[str, str]] = {}
    for item in items:
        result, reason = refusal(in_mission_frame(item), len(items), repertoire)
        if result == MissionResult.UNSUPPORTED_FRAME:
            found[item.seq] = reason, "use 3: altitude above home"
        elif result != MissionResult.ACCEPTED:
            found[item.seq] = reason, ""
    return found


def _kind_of(vehicle: Aircraft) -> str:
    if isinstance(vehicle, Vtol):
        return "VTOL"
    return "plane" if isinstance(vehicle, FixedWing) else "multirotor"


def _owner(name: str) -> str:
    return "plane" if name in _plane_table() else "VTOL"


PROFILE = Profile(
    firmware=MOCK,
    sensors=SENSORS,
    own_faults=FAULTS,
    make_link=make_link,
    lockstep=True,
    repeatable=True,
    keys=frozenset({"transport", "port", "airframe", "faults", "params_file"}),
    misfits=misfits,
    known_params=True,
    vehicle_misfits=vehicle_misfits,
    expects_station=False,
    flies_planes=True,
    flies_vtols=True,
    item_misfits=item_misfits,
    plane_items=frozenset(PLANE_SUPPORTED - SUPPORTED),
    vtol_items=frozenset(VTOL_SUPPORTED - PLANE_SUPPORTED),
)
