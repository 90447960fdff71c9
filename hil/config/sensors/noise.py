"""Noise levels of the sensors, scaled by the factors that `randomize.noise` draws from the seed."""

from __future__ import annotations

from typing import Any

import pydantic

from hil.config.layers import Settings
from hil.config.schema import BenchConfig
from signals.documents.validate import at
from signals.errors import Problem
from sim.sensors.noise_factor import noise_factor, with_noise


def noise_factors(config: BenchConfig) -> dict[str, float]:
    """Return the noise factor of each sensor that has one."""
    limits, seed = config.randomize.noise, config.randomize.seed
    if limits is None:
        return {}
    seed = config.noise_seed if seed is None else seed
    factors = {name: noise_factor(limits, seed, sensor.kind, name) for name, sensor in config.sensors.items()}
    return {name: factor for name, factor in factors.items() if factor is not None}


def scaled_parameters(config: BenchConfig, name: str) -> Any:
    """Return the parameters of a sensor, with its noise scaled by its factor if it has one."""
    sensor = config.sensors[name]
    factor = noise_factors(config).get(name)
    return sensor.parameters if factor is None else with_noise(sensor.kind, sensor.parameters, factor)


def noise_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Report each sensor whose factor takes a parameter out of its range."""
    problems = []
    for name, factor in noise_factors(config).items():
        try:
            scaled_parameters(config, name)
        except pydantic.ValidationError as error:
            item = error.errors(include_url=False)[0]
            parameter = ".".join(map(str, item["loc"]))
            message = (
                f"makes the errors of {name!r} {factor:.3g} times as large, and {parameter} is then out of its range"
            )
            problems.append(
                at(
                    settings,
                    ("randomize", "noise"),
                    message,
                    "narrow the limits of this kind of sensor in randomize.noise",
                )
            )
    return problems
