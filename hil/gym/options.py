"""Options of the environments: those that all tasks share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, Field, model_validator

from hil.config import Bench
from hil.config.load import load_bench
from hil.gym.randomize import Randomize, switch
from signals.documents.validate import StrictModel, validate
from signals.errors import ConfigError, Problem
from signals.time import NS_PER_S
from sim.physics.integration import Integration

ActionKind = Literal["motors", "controls", "rates", "velocity", "position"]
Speed = Annotated[float, Field(gt=0.0, le=50.0)]
Rate = Annotated[float, Field(gt=0.0, le=50.0)]
FUNCTION = "function"  # mark of an option that may be a function instead of its name
Length = Annotated[float, Field(gt=0.0, le=10_000.0)]
_CLASSICAL_FROM_M, _CLASSICAL_M, _CLASSICAL_NS = 1e-6, 1e-5, 5_000_000  # half of it was measured at 5 ms
_Pixels = Annotated[int, Field(ge=64, le=4096, multiple_of=2)]


class FlightOptions(StrictModel):
    """Action, step and episode. An action is in -1..1; the limits below are its meaning at 1."""

    action: ActionKind = "rates"
    controller: Literal["ideal", "rig"] = "ideal"  # rig: the autopilot of the bench's rig flies set-points
    step_s: Annotated[float, Field(gt=0.0, le=60.0)] = 0.02  # a whole number of ticks of the bench
    episode_s: Annotated[float, Field(gt=0.0, le=86_400.0)] = 10.0  # then the episode is truncated
    rate_radps: Rate = 4.0  # about x and y of B
    yaw_rate_radps: Rate = 2.0
    thrust_ratio: Annotated[float, Field(gt=1.0, le=20.0)] = 2.0  # collective thrust over the weight; 1 at action 0
    speed_mps: Speed = 5.0  # horizontal
    climb_mps: Speed = 2.0
    extent_m: tuple[Length, Length, Length] = (10.0, 10.0, 5.0)  # of positions, around the origin of the episode
    # Greatest error of position that the integration may have after 3 s of hard manoeuvres (`integration`).
    tolerance_m: Annotated[float, Field(ge=1e-9, le=1.0)] = 1e-9
    randomize: Annotated[Randomize | bool | None, AfterValidator(switch)] = None
    render_size: tuple[_Pixels, _Pixels] = (640, 480)
    render_view: str = "chase"  # a camera of the bench, or split
    record_dir: str | None = None  # folder for a recording of each episode

    @model_validator(mode="after")
    def _fits_together(self) -> FlightOptions:
        if self.controller == "rig" and self.action not in ("velocity", "position"):
            raise ValueError(f"controller rig flies velocity or position, not {self.action}")
        if self.episode_s < self.step_s:
            raise ValueError(f"episode_s {self.episode_s:g} is shorter than step_s {self.step_s:g}")
        return self

    def integration(self) -> Integration:
        """Return the method of the flight: order 8, or the classical one with the steps that the tolerance needs.

        The classical method is of order 4: error = _CLASSICAL_M (step / _CLASSICAL_NS)^4, from measurements of the x500
        in the manoeuvre of `hil bench gym`.
        """
        if self.tolerance_m < _CLASSICAL_FROM_M:
            return Integration()
        step_ns = _CLASSICAL_NS * (self.tolerance_m / _CLASSICAL_M) ** 0.25
        return Integration(method="classical", longest_ns=int(step_ns))

    def ticks(self, tick_ns: int, name: str) -> int:
        """Return the ticks of a step. Raises ConfigError unless they are a whole number."""
        ticks = round(self.step_s * NS_PER_S / tick_ns)
        if ticks < 1 or abs(ticks * tick_ns - self.step_s * NS_PER_S) > 0.5:
            best = max(1, ticks) * tick_ns / NS_PER_S
            message = f"step_s {self.step_s:g} is not a whole number of the bench's ticks of {tick_ns / NS_PER_S:g} s"
            raise ConfigError.at(name, message, f"use {best:g}, or another tick_hz")
        return ticks

    def steps(self) -> int:
        """Return the steps of an episode."""
        return round(self.episode_s / self.step_s)


def read_bench(
    bench: Bench | Path | str | None, settings: Sequence[str], name: str, default: Path | None = None
) -> Bench:
    """Return a loaded bench, or the one of a file with `settings`; None: that of `default`. Raises ConfigError."""
    if not isinstance(settings, list | tuple) or not all(isinstance(text, str) for text in settings):
        hint = 'such as settings=["tick_hz=500"]'
        raise ConfigError.at(name, f"settings must be a list of texts, not {settings!r}", hint)
    if isinstance(bench, Bench):
        if settings:
            message = "settings change a bench that is read from a file, not a loaded one"
            raise ConfigError.at(name, message, "give them to hil.config.load.load_bench")
        return bench
    if bench is not None and not isinstance(bench, str | Path):
        raise ConfigError.at(name, f"bench must be a file or a loaded bench, not {bench!r}")
    return load_bench(default if bench is None else bench, settings=settings, flown=False)


class _Arguments:
    """Source of keyword arguments, for messages."""

    def __init__(self, name: str) -> None:
        self._name = name

    def where(self, place: tuple[int | str, ...]) -> str:  # noqa: ARG002 (the protocol `Located`)
        return self._name


Model = TypeVar("Model", bound=FlightOptions)


def read_options(model: type[Model], values: dict[str, Any], name: str) -> Model:
    """Return the options given by keywords; those marked with FUNCTION may be functions.

    `name` is that of the environment. Raises ConfigError with every problem.
    """
    functions = {key: value for key, value in values.items() if callable(value)}
    data = {key: None if key in functions else value for key, value in values.items()}
    try:
        options, problems = validate(model, data, _Arguments(name))
    except TypeError as error:  # no data of JSON, such as an array
        options, problems = None, [Problem(name, f"options must be numbers, texts and lists: {error}")]
    takes = {key for key, field in model.model_fields.items() if field.metadata == [FUNCTION]}
    problems += [Problem(name, f"{key}: takes no function") for key in functions if key not in takes]
    if options is None or problems:
        raise ConfigError(problems)
    return options.model_copy(update=functions)
