"""Checks between the vehicles of a bench with several."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence

from hil.config.bench import Bench
from hil.config.layers import SettingsPart
from hil.config.schema import BenchConfig
from signals.documents.document import Place
from signals.documents.validate import at
from signals.errors import Problem

# Settings that all vehicles of a run must have in common. Only their rigs can make them differ.
SHARED_KEYS = ("tick_hz", "pace", "seed", "duration_s")
_MAX_SYSTEM_ID = 250


def vehicles_problems(
    vehicles: Mapping[str, Bench], located: Mapping[str, SettingsPart], *, flown: bool
) -> list[Problem]:
    """Report what two vehicles cannot share, and if they are to be `flown`, those that nobody flies.

    `located`: the settings of each.
    """
    problems: list[Problem] = []

    def report(name: str, place: Place, message: str, hint: str = "") -> None:
        problems.append(at(located[name], place, f"{name}: {message}" if not place else message, hint))

    configs = {name: bench.config for name, bench in vehicles.items()}
    first, *others = configs
    for name in others:
        for key in SHARED_KEYS:
            value, firsts = getattr(configs[name], key), getattr(configs[first], key)
            if value != firsts:
                message = f"the rig {configs[name].rig!r} sets {key} to {value}, and that of {first} to {firsts}"
                # ArduPilot's main loop needs the highest rate; the mock and PX4 fly at any.
                proposed = max(config.tick_hz for config in configs.values()) if key == "tick_hz" else firsts
                hint = f"write `{key}: {'null' if proposed is None else proposed}` at the top of the file"
                report(name, (), message, f"{hint}: all vehicles share it")
    for place, message, values_of in _UNIQUE:
        owner: dict[Hashable, str] = {}
        for name, config in configs.items():
            for value in values_of(config):
                if value in owner:
                    report(name, place, message.format(value=value, other=owner[value]))
                owner.setdefault(value, name)
    for name, config in configs.items():
        if flown and not is_flown(vehicles[name]):
            hint = "a mission, a companion with control: true, manual or router"
            report(name, (), "nobody flies this vehicle", hint)
        autopilot = config.autopilot
        for key in _board_ports(config) if len(configs) > 1 else ():
            if getattr(autopilot, key) is None:
                message = f"is not set, and a rig of kind {autopilot.kind} cannot run twice on one board"
                report(name, ("autopilot", key), message, "usb:SERIAL with the serial number that `hil devices` shows")
        if autopilot.on_restart == "reset":
            report(name, ("autopilot", "on_restart"), "cannot be reset in a bench with several vehicles")
        if not _board_ports(config) and autopilot.system_id > _MAX_SYSTEM_ID:
            report(name, ("autopilot", "instance"), f"gives the MAVLink system id {autopilot.system_id}, above 250")
    return problems + _start_problems(vehicles, located)


def is_flown(bench: Bench) -> bool:
    """Return True if anything of the bench flies its vehicle, or lets somebody else do so."""
    config = bench.config
    by_hand = config.manual.device is not None or bool(config.router.endpoints()) or bool(config.parts)
    return bench.mission is not None or bench.script is not None or config.flown_by_set_points or by_hand


def _start_problems(vehicles: Mapping[str, Bench], located: Mapping[str, SettingsPart]) -> list[Problem]:
    """Report vehicles that would stand in each other at the start."""
    from sim.physics.start_overlap import overlapping_starts  # loads MuJoCo

    starts = {name: (bench.vehicle, bench.config.start.flight_start()) for name, bench in vehicles.items()}
    problems = []
    for a, b in overlapping_starts(next(iter(vehicles.values())).scene, starts):
        distance_m = math.dist(vehicles[a].config.start.p_W, vehicles[b].config.start.p_W)
        hint = f"vehicles: {{{b}: {{start: {{p_W: [x, y, z]}}}}}}, or a formation"
        problems.append(at(located[b], ("start", "p_W"), f"puts {b} into {a}, {distance_m:.2f} m away", hint))
    return problems


def _ports(config: BenchConfig) -> list[Hashable]:
    autopilot = config.autopilot
    return [port for port in (autopilot.port, autopilot.mavlink_port) if port not in (None, "none")]


def _board_ports(config: BenchConfig) -> Sequence[str]:
    """Return the keys of the serial ports of an autopilot on a board; none for one that the bench starts."""
    return () if config.autopilot.binary is not None else config.autopilot.profile.board_ports


def _instances(config: BenchConfig) -> list[Hashable]:
    autopilot = config.autopilot
    on_a_port = bool(_board_ports(config)) or (autopilot.port is not None and autopilot.binary is None)
    return [] if on_a_port else [autopilot.instance]


def _companion_ports(config: BenchConfig) -> list[Hashable]:
    companion = config.companion
    if not companion.on or companion.port == 0:
        return []
    return [companion.port, *([] if companion.sensor_port is None else [companion.sensor_port])]


def _listening(config: BenchConfig) -> list[Hashable]:
    """Return the ports at which the router listens, and the SDKs' own ports; one ground station may serve several."""
    addresses = [config.router.sdk, config.router.companion, config.router.gcs, *config.router.more]
    own = [a for a in addresses if a is not None and not (a.startswith("udp:") and a == config.router.gcs)]
    return [address.rpartition(":")[2] for address in own]


_UNIQUE: tuple[tuple[Place, str, Callable[[BenchConfig], list[Hashable]]], ...] = (
    (("autopilot", "port"), "{value} is also the port of {other}", _ports),
    (("autopilot", "instance"), "{value} is also the instance of {other}: ports and system ids would be the same",
     _instances),
    (("companion", "port"), "{value} is also a companion port of {other}", _companion_ports),
    (("router",), "port {value} is also used by the router of {other}", _listening),
)  # fmt: skip
