"""Mission scripts: a plan, and actions during the flight.

Faults and gusts at a fixed simulated time become settings of the bench when the script is loaded, as if they were
written there. Commands to the autopilot, and actions that wait for an event of the flight, are carried out by
`firmware_bridge.ground_station.actions`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from firmware_bridge.ground_station.actions import Action, Effect, RunCommand, SetMode, SetParam, VehicleEvent
from firmware_bridge.ground_station.modes import WORDS, plain_word
from hil.config.missions.mission import CHANGE_SPEED, Mission
from hil.config.schema import Limits
from signals.documents.document import Document, Place
from signals.documents.validate import StrictModel, nearest, unit_of
from signals.time import NS_PER_S
from sim.physics.faults import RotorFault
from sim.physics.surface_faults import SurfaceFault, VehicleFault
from sim.scene.wind import GustEvent
from sim.sensors.faults import (
    Blocked,
    DriftAway,
    Dropout,
    Freeze,
    Jammer,
    Offset,
    SpoofedPlace,
    StuckBit,
)

_ARM_DISARM = 400  # MAV_CMD_COMPONENT_ARM_DISARM
_DAY_S = 86_400.0
_ACTION_KINDS = ("set_mode", "arm", "param", "command", "gust", "fault")
_EVENTS = ("armed", "disarmed", "takeoff", "landed", "waypoint N", "item N", "mode WORD")
SENSOR_FAULTS = {
    "freeze": Freeze,
    "dropout": Dropout,
    "offset": Offset,
    "drift": DriftAway,
    "stuck_bit": StuckBit,
    "blocked": Blocked,
    "jammer": Jammer,
    "spoofer": SpoofedPlace,
}
AUTOPILOT_FAULTS = ("die", "stall", "wrong_time", "garbage", "noise")

SensorFault = Freeze | Dropout | Offset | DriftAway | StuckBit | Blocked | Jammer | SpoofedPlace
Injected = VehicleFault | GustEvent | SensorFault
"""A disturbance that an action can begin during the flight."""

Inject = Callable[[Injected, bool], None]
"""Begins a disturbance; told whether its action is required."""

Instant = Annotated[float, Field(ge=0.0, le=_DAY_S)]
Real32 = Annotated[float, Field(ge=-3e38, le=3e38)]


class CommandSpec(StrictModel):
    """A COMMAND_LONG by its MAV_CMD number."""

    id: Annotated[int, Field(ge=0, le=65535)]
    params: Annotated[tuple[Real32, ...], Field(max_length=7)] = ()


class GustSpec(StrictModel):
    """A gust in the convention of weather reports: a direction of 270 is a west wind, which blows to the east."""

    speed_mps: Annotated[float, Field(gt=0.0, le=50.0)]
    direction_deg: Annotated[float, Field(ge=0.0, le=360.0)]  # from which it blows, clockwise from north
    for_s: Annotated[float, Field(ge=0.0, le=_DAY_S)]  # at full strength
    rise_s: Annotated[float, Field(gt=0.0, le=3600.0)] = 0.5  # rise time, and fall time

    def event(self, at_s: float) -> GustEvent:
        """Return the gust that begins at `at_s`, rounded so that it does not depend on a machine's sine."""
        angle = math.radians(self.direction_deg)
        east, north = (round(-self.speed_mps * part, 6) + 0.0 for part in (math.sin(angle), math.cos(angle)))
        return GustEvent(
            at_s=at_s, velocity_W_mps=(east, north, 0.0), rise_s=self.rise_s, hold_s=self.for_s, fall_s=self.rise_s
        )


class ActionSpec(StrictModel):
    """One entry of `actions`: a time or an event, and exactly one action."""

    at_s: Instant | None = None
    after: str | None = None
    delay_s: Instant | None = None
    required: bool = True
    set_mode: str | None = None
    arm: bool | None = None
    param: Annotated[dict[str, Real32], Field(min_length=1)] | None = None
    command: CommandSpec | None = None
    gust: GustSpec | None = None
    fault: dict[str, Any] | None = None

    @field_validator("after")
    @classmethod
    def _known_event(cls, text: str | None) -> str | None:
        if text is not None:
            parse_event(text)
        return text

    @field_validator("set_mode")
    @classmethod
    def _known_mode(cls, word: str | None) -> str | None:
        if word is not None and word not in WORDS:
            raise ValueError(f"no mode {word!r} ({nearest(word, WORDS)})")
        return word

    @field_validator("param")
    @classmethod
    def _names_fit_mavlink(cls, params: dict[str, float] | None) -> dict[str, float] | None:
        for name in params or ():
            if not re.fullmatch(r"[A-Z0-9_]{1,16}", name):
                raise ValueError(f"{name!r} cannot be a parameter: 1 to 16 of A-Z, 0-9 and _")
        return params

    @model_validator(mode="after")
    def _one_action_at_one_time(self) -> ActionSpec:
        if (self.at_s is None) == (self.after is None):
            raise ValueError("an action needs either at_s or after")
        if self.delay_s is not None and self.after is None:
            raise ValueError("delay_s goes with after")
        kinds = [name for name in _ACTION_KINDS if getattr(self, name) is not None]
        if len(kinds) != 1:
            has = f"has {' and '.join(kinds)}" if kinds else "has none"
            raise ValueError(f"an action does exactly one of {', '.join(_ACTION_KINDS)}; this one {has}")
        return self

    @property
    def in_settings(self) -> bool:
        """True for a gust or fault at a known time, which becomes a setting of the bench."""
        return self.at_s is not None and (self.gust is not None or self.fault is not None)

    @property
    def modes(self) -> dict[str, str]:
        """Mode words that the autopilot must have, by the key that names them."""
        named = {"set_mode": self.set_mode, "after": None if self.after is None else parse_event(self.after).word}
        return {key: word for key, word in named.items() if word}

    @property
    def text(self) -> str:
        """The action in the words of the script."""
        if self.set_mode is not None:
            return f"set_mode {self.set_mode}"
        if self.arm is not None:
            return "arm" if self.arm else "disarm"
        if self.param is not None:
            return "param " + ", ".join(f"{name} = {value:g}" for name, value in self.param.items())
        if self.command is not None:
            return f"command {self.command.id}"
        if self.gust is not None:
            return f"gust of {self.gust.speed_mps:g} m/s from {self.gust.direction_deg:g} deg"
        return "fault " + ", ".join(f"{key} {value}" for key, value in (self.fault or {}).items())


MeasureName = Literal[
    "max_tilt_deg",
    "max_rate_degps",
    "max_speed_mps",
    "max_climb_mps",
    "max_sink_mps",
    "min_altitude_m",
    "max_altitude_m",
    "max_distance_m",
    "hover_drift_m",
    "height_drift_m",
    "flight_time_s",
    "time_to_complete_s",
]
_NEED_WINDOW = ("min_altitude_m", "hover_drift_m", "height_drift_m")
_WHOLE_FLIGHT = ("flight_time_s", "time_to_complete_s")
_SIGNED = ("max_climb_mps", "max_sink_mps", "min_altitude_m", "max_altitude_m")
_MOST = {"deg": 180.0, "deg/s": 1e5, "m/s": 1e3, "m": 1e5, "s": _DAY_S}  # no flight measures more


class Expectation(StrictModel):
    """One declared measurement (definitions: `hil.run.verdict.measurements`), with limits or only for display."""

    measure: MeasureName
    name: str | None = None  # label in the results; default its measure
    from_s: Instant | None = None
    to_s: Instant | None = None
    at_most: float | None = None
    at_least: float | None = None

    @model_validator(mode="after")
    def _window(self) -> Expectation:
        if self.from_s is not None and self.to_s is not None and not self.to_s > self.from_s:
            raise ValueError(f"to_s {self.to_s:g} must come after from_s {self.from_s:g}")
        if self.measure in _NEED_WINDOW and (self.from_s is None or self.to_s is None):
            raise ValueError(f"{self.measure} needs from_s and to_s")
        if self.measure in _WHOLE_FLIGHT and (self.from_s is not None or self.to_s is not None):
            raise ValueError(f"{self.measure} covers the whole flight: leave from_s and to_s out")
        most = _MOST[self.unit]
        if self.at_most is not None and self.at_most >= most:
            raise ValueError(f"at_most {self.at_most:g} {self.unit} is met by any flight: write less than {most:g}")
        if self.at_least is not None and self.at_least <= -most:
            raise ValueError(f"at_least {self.at_least:g} {self.unit} is met by any flight: write more than {-most:g}")
        if self.at_least is not None and self.at_least <= 0.0 and self.measure not in (*_SIGNED, *_WHOLE_FLIGHT):
            raise ValueError(f"{self.measure} is at least 0 in any flight: give it another number")
        return self

    @property
    def label(self) -> str:
        """Label in the results."""
        return self.name or self.measure

    @property
    def unit(self) -> str:
        """Unit of the value."""
        return "deg/s" if self.measure == "max_rate_degps" else unit_of(self.measure).strip()


Outcome = Literal["complete", "aborted", "any", "crashed"]


class Script(StrictModel):
    """The contents of a script file."""

    description: str = ""
    plan: str | None = None  # a .plan or .waypoints file beside the script; null: only actions
    outcome: Outcome = "complete"  # required end of the flight
    actions: tuple[ActionSpec, ...] = ()
    limits: dict[str, Any] = Field(default_factory=dict)  # merged over those of the bench
    failsafe: dict[str, Any] | None = None  # replaces that of the bench
    expect: tuple[Expectation, ...] = ()

    @field_validator("expect")
    @classmethod
    def _labels_differ(cls, expect: tuple[Expectation, ...]) -> tuple[Expectation, ...]:
        labels = [entry.label for entry in expect]
        repeated = next((label for label in labels if labels.count(label) > 1), None)
        if repeated is not None:
            raise ValueError(f"two measurements are called {repeated!r}: give one of them another name")
        limit = next((label for label in labels if label in Limits.model_fields), None)
        if limit is not None:
            raise ValueError(f"a measurement is called {limit!r}, as a limit of every flight: give it another name")
        return expect


@dataclass(frozen=True)
class MissionScript:
    """A script that has been read. `plan_path` is the file of its plan, `document` knows the line of each key."""

    path: Path
    script: Script
    plan_path: Path | None
    document: Document = field(repr=False)

    @property
    def sensors_at_risk(self) -> frozenset[str]:
        """Sensors with faults that begin at an event of the flight."""
        on_event = [spec for spec in self.script.actions if spec.fault is not None and not spec.in_settings]
        return frozenset(spec.fault["sensor"] for spec in on_event if spec.fault and "sensor" in spec.fault)

    @property
    def required_params(self) -> dict[Place, float]:
        """Parameters that required actions set, by the place in the script."""
        return {
            ("actions", index, "param", name): value
            for index, spec in enumerate(self.script.actions)
            for name, value in (spec.param or {}).items()
            if spec.required
        }

    @property
    def changes_speeds(self) -> bool:
        """True if an action changes a speed in flight, or the mode, with the speed that it has."""
        actions = self.script.actions
        return any(a.set_mode is not None or (a.command is not None and a.command.id == CHANGE_SPEED) for a in actions)

    def name_of(self, index: int) -> str:
        """Return the place of an action in the script and what it does, for messages."""
        return f"{self.document.where(('actions', index))}: {self.script.actions[index].text}"


def parse_event(text: str) -> VehicleEvent:
    """Parse an event of the flight such as 'waypoint 3'. Raises ValueError.

    Waypoints count from 1 as in the verdict, items from 0 as in the plan.
    """
    word, _, rest = text.strip().partition(" ")
    rest = rest.strip()
    if word in ("armed", "disarmed", "takeoff", "landed") and not rest:
        return VehicleEvent(word)
    if word in ("waypoint", "item") and re.fullmatch(r"[0-9]{1,5}", rest) and (word == "item" or int(rest) > 0):
        return VehicleEvent(word, int(rest))
    if word == "mode" and rest in WORDS:
        return VehicleEvent(word, word=plain_word(rest))
    raise ValueError(f"no event is called {text!r}; known: {', '.join(_EVENTS)}")


def fault_at(fault: Mapping[str, Any], at_s: float) -> dict[str, Any]:
    """Return a fault of a rotor, surface or sensor as an entry of the bench's `faults`; `for_s` becomes `until_s`."""
    entry = {**fault, "at_s": at_s}
    for_s = entry.pop("for_s", None)
    if isinstance(for_s, int | float) and "sensor" in fault:
        entry["until_s"] = at_s + for_s
    return entry


def fault_model(fault: Mapping[str, Any]) -> type[VehicleFault]:
    """Return the model of a fault of the vehicle."""
    return SurfaceFault if "surface" in fault else RotorFault


def injected_at(spec: ActionSpec, at_s: float) -> Injected:
    """Return the gust or fault of a checked action that begins at `at_s`."""
    if spec.gust is not None:
        return spec.gust.event(at_s)
    assert spec.fault is not None
    entry = fault_at(spec.fault, at_s)
    model: Any = SENSOR_FAULTS[entry["kind"]] if "sensor" in entry else fault_model(entry)
    injected: Injected = model.model_validate(entry)
    return injected


def flight_actions(
    mission_script: MissionScript, mission: Mission | None, inject: Inject, *, tick_ns: int
) -> list[Action]:
    """Return the actions of the flight. Gusts and faults are passed to `inject` and begin with the next tick."""
    actions: list[Action] = []
    for index, spec in enumerate(mission_script.script.actions):
        if spec.in_settings:
            continue
        after = None if spec.after is None else parse_event(spec.after)
        if after is not None and after.kind == "waypoint":
            assert mission is not None  # checked when the script was read
            after = VehicleEvent("item", mission.waypoints[after.number - 1].seq)
        for step in _steps_of(spec, inject, tick_ns):
            actions.append(
                Action(
                    mission_script.name_of(index),
                    step,
                    at_ns=None if spec.at_s is None else round(spec.at_s * NS_PER_S),
                    after=after,
                    delay_ns=round((spec.delay_s or 0.0) * NS_PER_S),
                    required=spec.required,
                )
            )
    return actions


def _steps_of(spec: ActionSpec, inject: Inject, tick_ns: int) -> list[SetMode | SetParam | RunCommand | Effect]:
    if spec.set_mode is not None:
        return [SetMode(spec.set_mode)]
    if spec.arm is not None:
        return [RunCommand(_ARM_DISARM, (float(spec.arm),))]
    if spec.param is not None:
        return [SetParam(name, value) for name, value in spec.param.items()]
    if spec.command is not None:
        return [RunCommand(spec.command.id, spec.command.params)]

    def begin(t_ns: int) -> None:
        inject(injected_at(spec, (t_ns + tick_ns) / NS_PER_S), spec.required)

    return [Effect(begin)]
