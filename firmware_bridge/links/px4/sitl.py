"""Makes the link to PX4 SITL, and starts a user's own build of it.

PX4's start script reads the airframe from PX4_SIM_MODEL and PX4_SYS_AUTOSTART, and sets a parameter for every variable
PX4_PARAM_<NAME>; but it stores none that is the firmware's default, and then the value of a later script, such as the
airframe's, comes in its place. So these are set twice (`_kept`). PX4 keeps parameters, missions and logs in its working
folder, so that a run in a clean folder starts from the airframe's defaults.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Container, Mapping
from pathlib import Path
from typing import Any

from firmware_bridge.links.autopilot_link import LinkCaps
from firmware_bridge.links.child_process import ChildProcess, FirmwareBuild
from firmware_bridge.links.px4.ground_channel import GroundChannel
from firmware_bridge.links.px4.lockstep import LockstepLink
from firmware_bridge.transports.tcp import TcpServer
from firmware_bridge.transports.transport import Transport
from signals.documents.validate import nearest
from signals.errors import ConfigError, PortNotFound

# From this tick on PX4 answers one to one only if it integrates the IMU at the tick's rate and writes no log.
_FAST_TICK_HZ = 400
# PX4 connects to its simulator at the first, and listens for ground stations on the second; instances count up.
_SIMULATOR_PORT, _GROUND_PORT = 4560, 18570


def px4_sitl_link(
    instance: int,
    *,
    wrap: Callable[[Transport], Transport] = lambda transport: transport,
    uneven_answers: bool = False,
    **settings: Any,
) -> LockstepLink:
    """Return the link to PX4 SITL, which connects to the bench. `wrap` wraps the simulator's transport.

    Its boot time is unknown and its threads run on wall-clock time, so a run is not repeatable bit by bit.
    `uneven_answers`: it is a VTOL (`LinkCaps`). Other settings as `LockstepLink`.
    """
    caps = LinkCaps(
        "px4_sitl",
        lockstep=True,
        deterministic=False,
        boot_sensors=None,
        busy_processors=2,
        uneven_answers=uneven_answers,
        air_temperature=True,
    )
    ground = GroundChannel(_GROUND_PORT + instance)
    return LockstepLink(wrap(TcpServer(_SIMULATOR_PORT + instance)), caps, ground=ground, **settings)


def px4_sitl_process(
    build: FirmwareBuild, *, airframe: str, tick_hz: int, params: Mapping[str, float], instance: int = 0
) -> ChildProcess:
    """Return PX4, not yet started. `airframe` is a name ("none_iris") or a number ("10016").

    PortNotFound if there is no such program, or no start scripts beside it; ConfigError if it has no such airframe.
    """
    binary = build.binary.expanduser().resolve()
    if not binary.is_file():
        raise PortNotFound(str(binary), "does not exist; set autopilot.binary to PX4's program, such as "
                           "build/px4_sitl_default/bin/px4")  # fmt: skip
    data = _data_folder(binary)
    number, name = _airframe(data, airframe)
    given = px4_parameters(tick_hz, params, own=_parameters_of(data, number, name))
    settings = {"PX4_SIM_MODEL": name, "PX4_SYS_AUTOSTART": number} | given
    _clean(build.folder)
    return ChildProcess(
        [str(binary), "-i", str(instance), "-d", *build.arguments, str(data)],
        stderr_path=build.log,
        cwd=build.folder,
        env=settings | dict(build.env),
        log_output=True,
        own_group=True,
    )


def px4_parameters(tick_hz: int, params: Mapping[str, float], own: Container[str] = ()) -> dict[str, str]:
    """Return the environment that sets the parameters of this tick; `params` overrides. `own`: set by PX4's scripts."""
    fast = {"IMU_INTEG_RATE": float(tick_hz), "SDLOG_MODE": -1.0} if tick_hz >= _FAST_TICK_HZ else {}
    return {
        f"PX4_PARAM_{key}": _kept(key, value) if key in own else _text(value)
        for key, value in (fast | dict(params)).items()
    }


def _text(value: float) -> str:
    return f"{int(value)}" if value == int(value) else repr(value)


def _kept(name: str, value: float) -> str:
    """Return two lines of which PX4's script sets another value, then this one: then it is stored in any case."""
    return f"{_text(value + 1.0)}\nPX4_PARAM_{name}={_text(value)}"


def _parameters_of(data: Path, number: str, name: str) -> frozenset[str]:
    """Return the names of the parameters that the start scripts set: for simulators, an airframe, a kind of vehicle."""
    scripts = [
        data / "init.d-posix" / "airframes" / f"{number}_{name}",
        *sorted((data / "init.d").glob("rc.*_defaults")),
        *sorted((data / "init.d-posix").glob("px4-rc.*")),
    ]
    texts = [path.read_text(errors="replace") for path in scripts if path.is_file()]
    return frozenset(found for text in texts for found in re.findall(r"param set-default (?:-s )?(\w+)", text))


def px4_hand_start(
    binary: Path | None, *, airframe: str, tick_hz: int, params: Mapping[str, float], instance: int
) -> tuple[dict[str, str], list[str]]:
    """Return environment and command line with which the user starts PX4 for a bench that waits for it.

    Without a `binary` the command is `px4`, and the folder of its start scripts is left to the user.
    """
    key = "PX4_SYS_AUTOSTART" if airframe.isdigit() else "PX4_SIM_MODEL"
    if binary is None:
        return {key: airframe} | px4_parameters(tick_hz, params), ["px4", "-i", str(instance), "-d", "etc"]
    data = _data_folder(binary)
    number, name = _airframe(data, airframe)
    given = px4_parameters(tick_hz, params, own=_parameters_of(data, number, name))
    env = {"PX4_SIM_MODEL": name, "PX4_SYS_AUTOSTART": number} | given
    return env, [str(binary), "-i", str(instance), "-d", str(data)]


def _clean(folder: Path) -> None:
    """Remove the files of an earlier run. PortNotFound if the folder holds other files."""
    ours = (folder / "dataman").exists() or (folder / "etc").is_symlink()
    if folder.is_dir() and any(folder.iterdir()) and not ours:
        raise PortNotFound(str(folder), "has files that are not PX4's: choose another --out")
    shutil.rmtree(folder, ignore_errors=True)


def _data_folder(binary: Path) -> Path:
    """Return PX4's `etc`, which lies beside the folder of the binary in a build tree."""
    for data in (binary.parent.parent / "etc", binary.parent / "etc", binary.parent.parent / "share/px4/etc"):
        if (data / "init.d-posix" / "rcS").is_file():
            return data
    raise PortNotFound(
        str(binary),
        f"has no start scripts: {binary.parent.parent / 'etc'} is not PX4's etc folder; is it a SITL build?",
    )


def _airframe(data: Path, airframe: str) -> tuple[str, str]:
    """Return (number, name) of the airframe, found by its number or its name. ConfigError if there is none."""
    known = _airframes(data)
    for number, name in known.items():
        if airframe in (number, name):
            return number, name
    raise ConfigError.at("autopilot.airframe", *_unknown_airframe(known, airframe))


def _airframes(data: Path) -> dict[str, str]:
    """Return the airframes in PX4's start scripts, number -> name."""
    known: dict[str, str] = {}
    for path in sorted((data / "init.d-posix" / "airframes").glob("*")):
        match = re.fullmatch(r"(\d+)_([A-Za-z0-9_-]+)", path.name)
        if match:
            known[match[1]] = match[2]
    return known


def _unknown_airframe(known: Mapping[str, str], airframe: str) -> tuple[str, str]:
    near = nearest(airframe, known if airframe.isdigit() else known.values(), listed=False)
    external = ", ".join(f"{number} {name}" for number, name in known.items() if name.startswith("none_"))
    hint = f"for external simulators it has: {external or 'none'}"
    return f"is unknown to this PX4: {airframe!r}", f"{near} {hint}" if near else hint


def airframe_problem(binary: Path, airframe: str) -> tuple[str, str] | None:
    """Return what is wrong with the airframe for this build and what to do; None if it has it, or has no scripts."""
    try:
        known = _airframes(_data_folder(binary.expanduser().resolve()))
    except PortNotFound:
        return None  # the run tells
    return None if airframe in (*known, *known.values()) else _unknown_airframe(known, airframe)
