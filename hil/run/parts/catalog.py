"""The parts of a run in their order, and the condition under which a bench has each.

A part's module is imported only in runs that have the part. It has a function `make(bench) -> Part`. The module of a
part that a bench names in its section `parts` has `make(bench, settings) -> Part` and a model `Settings` instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module

from firmware_bridge.autopilots.settings import MockFaults
from hil.config import Bench
from hil.config.checks.part_settings import part_module
from hil.config.schema import AT_GOAL, Faults
from hil.run.part import Part
from sim.physics.fixed_wing import is_plane
from sim.physics.vtol import is_vtol

Condition = Callable[[Bench], bool]


def _has_faults(bench: Bench) -> bool:
    config = bench.config
    gusts = () if config.wind is None else config.wind.gusts
    waits = bench.script is not None and bool(bench.script.sensors_at_risk)
    return config.faults != Faults() or config.autopilot.faults != MockFaults() or bool(gusts) or waits


def _script_params(bench: Bench) -> bool:
    known = bench.config.autopilot.profile.known_params
    return bench.script is not None and not known and bool(bench.script.required_params)


def _sees_sky(bench: Bench) -> bool:
    return any(getattr(sensor.parameters, "sky", None) is not None for sensor in bench.config.sensors.values())


def _may_stay(bench: Bench) -> bool:
    """Return True if a vehicle that never moves meets all that the bench asks of the flight."""
    if bench.outcome in ("aborted", "any"):
        return True
    config = bench.config
    if config.goal is not None:
        return config.goal.outcome != AT_GOAL
    # ROS 2 nodes that never come are judged where no script is.
    flown = bench.mission is not None or (config.flown_by_set_points and bench.script is None)
    return not flown and config.search is None


def _may_touch(bench: Bench) -> bool:
    """Return True if the vehicle should land where it touches something, and there is more than flat ground."""
    crash = bench.config.crash
    asked = crash is not None and crash.touch_m is not None and bench.outcome not in ("crashed", "any")
    return asked and not is_plane(bench.vehicle) and not bench.scene.is_bare


def _always(bench: Bench) -> bool:  # noqa: ARG001
    return True


_VEHICLE: tuple[tuple[str, Condition], ...] = (
    ("simulated.vehicle", _always),
    ("links.intake", _always),  # before the sensors: it refuses faults that the autopilot would not notice
    ("simulated.sensors", _always),
    ("simulated.vibration", lambda bench: bench.config.vibration != "off"),
    ("simulated.gnss", _sees_sky),
    ("links.faults", _always),
)
_CRASH: tuple[tuple[str, Condition], ...] = (("judges.crash", lambda bench: bench.config.crash is not None),)
_JUDGES: tuple[tuple[str, Condition], ...] = (
    ("judges.notes", _always),
    ("judges.flight", lambda bench: not is_plane(bench.vehicle) and not is_vtol(bench.vehicle)),
    ("judges.vtol_flight", lambda bench: is_vtol(bench.vehicle)),
    ("judges.plane_flight", lambda bench: is_plane(bench.vehicle)),
    *_CRASH,
    ("judges.touch", _may_touch),
    ("judges.fly_away", lambda bench: bench.config.fly_away_m is not None),
    ("judges.goal", lambda bench: bench.config.goal is not None),
    ("judges.search", lambda bench: bench.config.search is not None),
    ("judges.unflown", _may_stay),
    ("judges.echoes", lambda bench: any(s.kind in ("radar", "lidar") for s in bench.config.sensors.values())),
)
_PILOTS: tuple[tuple[str, Condition], ...] = (
    ("pilots.companion", lambda bench: bench.config.companion.on),
    ("pilots.mission", lambda bench: not bench.config.flown_by_set_points),
    ("pilots.follow", lambda bench: bench.config.follow.flies),
    ("pilots.script", lambda bench: bench.script is not None),
    ("pilots.manual", lambda bench: bench.config.manual.device is not None),
    ("links.ros2.part", lambda bench: bench.config.ros2.domain is not None),
    ("simulated.unmet_faults", _has_faults),  # last: what the flight missed is told before what it did not meet
)
_LINKS: tuple[tuple[str, Condition], ...] = (
    (
        "links.parameters",
        lambda bench: (
            bool(bench.config.autopilot.all_params or bench.config.autopilot.airframe) or _script_params(bench)
        ),
    ),
    ("links.signing", lambda bench: bench.config.autopilot.signing_key_file is not None),
    ("links.router", lambda bench: bool(bench.config.router.endpoints())),
    ("links.failsafe", _always),
    ("links.autopilot", _always),
)


def parts_of(bench: Bench, more: Sequence[Part] = (), *, judged: bool = True) -> list[Part]:
    """Return the parts of a run of `bench`, not yet opened. `more`: parts that the caller of the run adds.

    Parts of the section `parts` and those of the caller come before the links to the outside, so that their commands
    are signed too. `judged`: False leaves out the parts that measure and judge the flight, but for crashes.
    """
    inner = [*_VEHICLE, *(_JUDGES if judged else _CRASH), *_PILOTS]
    named = [part_module(name).make(bench, settings) for name, settings in bench.config.parts.items()]
    return [*_make(inner, bench), *named, *more, *_make(_LINKS, bench)]


def settled(bench: Bench) -> Bench:
    """Return the bench, or that of each vehicle, with what its parts set in it: the start of a followed flight.

    Raises ConfigError.
    """
    if bench.vehicles:
        return replace(bench, vehicles={name: settled(vehicle) for name, vehicle in bench.vehicles.items()})
    if not bench.config.follow.flies:
        return bench
    own: Bench = import_module("hil.run.parts.pilots.follow").settled(bench)
    return own


def shared_parts(bench: Bench) -> list[Callable[[str], Sequence[Part]]]:
    """Return the makers of parts that the vehicles of a run share; each makes the parts of a vehicle by its name."""
    if bench.config.foxglove.port is None:
        return []
    return [import_module("hil.run.parts.links.foxglove.part").parts_maker(bench)]


def check_parts(bench: Bench) -> None:
    """Raise ConfigError for settings that a part refuses, such as of a package that is not installed."""
    for vehicle in bench.vehicles.values() or (bench,):
        parts_of(vehicle)
    shared_parts(bench)


def link_parts(bench: Bench) -> list[Part]:
    """Return the parts that connect the autopilot, for a flight that something else than a run steps."""
    return _make(_LINKS, bench)


def _make(entries: Sequence[tuple[str, Condition]], bench: Bench) -> list[Part]:
    return [import_module(f"hil.run.parts.{name}").make(bench) for name, condition in entries if condition(bench)]
