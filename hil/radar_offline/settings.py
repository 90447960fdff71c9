"""The settings of a radar offline: those of the recorded one or a preset's, and `--set` over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hil.config.layers import Settings, lay_settings
from hil.config.preset_values import find_preset, laid_over
from hil.signals.documents.validate import validate
from hil.signals.errors import ConfigError, Problem
from sim.radar.chirp import Chirp
from sim.sensors.radar_parameters import RadarParameters

_OF_A_SENSOR = frozenset({"preset", "kind", "autopilot", "rate_hz"})


def settings_of(
    recorded: Mapping[str, Any] | None, *, preset: str | None, default_preset: str, texts: Sequence[str]
) -> RadarParameters:
    """`recorded`: the section of a radar in a bench that says everything; a preset given replaces it.

    Raises ConfigError with every problem.
    """
    settings = Settings()
    problems: list[Problem] = lay_settings(settings, texts)
    base: dict[str, Any] = {}
    if preset is not None or recorded is None:
        settings.put(("preset",), preset or default_preset, "--preset")
        found = find_preset(preset or default_preset, settings, ("preset",), problems)
        if found is not None and not isinstance(found.parameters, RadarParameters):
            problems.append(Problem("--preset", f"is a {found.kind}, not a radar"))
        elif found is not None:
            base = found.parameters.model_dump(mode="json")
    else:
        base = {key: value for key, value in recorded.items() if key not in _OF_A_SENSOR}
    if problems:
        raise ConfigError(problems)
    over = {key: value for key, value in settings.data.items() if key != "preset"}
    built, problems = validate(RadarParameters, laid_over(RadarParameters, base, over), settings)
    if problems or built is None:
        raise ConfigError(problems)
    return built


def with_chirp(parameters: RadarParameters, chirp: Chirp, receivers: int, where: str) -> RadarParameters:
    """The parameters for frames that have been recorded: their chirps, and no impairments to be added.

    Raises ConfigError where the antenna has other receivers than the frames.
    """
    have = len(parameters.antenna.rx_positions_m)
    if have != receivers:
        message = f"has {receivers} receivers, and the radar's antenna.rx_positions_m {have}"
        raise ConfigError([Problem(where, message, "--set antenna.rx_positions_m=[[x,y,z],...] of these receivers")])
    unfit = parameters.processing.problem_with(chirp)
    if unfit:
        raise ConfigError([Problem(where, f"its frames do not suit processing.{unfit}", "--set processing.KEY=VALUE")])
    impairments = type(parameters.impairments)()
    return parameters.model_copy(update={"chirp": chirp, "impairments": impairments})
