"""The section `randomize` where a bench is concerned: noise of its sensors, and what was drawn, as data."""

from __future__ import annotations

from typing import Any

import pydantic

from hil.config.layers import Settings
from hil.config.schema import BenchConfig
from hil.signals.documents.validate import at
from hil.signals.errors import Problem
from sim.randomize.looks import drawn
from sim.randomize.noise import noise_factor, with_noise
from sim.scene.scene import Scene


def noise_factors(config: BenchConfig) -> dict[str, float]:
    """By what the errors of each sensor are multiplied; nothing for those that stay as they are."""
    limits, seed = config.randomize.noise, config.randomize.seed
    if limits is None:
        return {}
    seed = config.seed if seed is None else seed
    factors = {name: noise_factor(limits, seed, sensor.kind, name) for name, sensor in config.sensors.items()}
    return {name: factor for name, factor in factors.items() if factor is not None}


def noisy_parameters(config: BenchConfig, name: str) -> Any:
    """Parameters of a sensor with its own factor of noise."""
    sensor = config.sensors[name]
    factor = noise_factors(config).get(name)
    return sensor.parameters if factor is None else with_noise(sensor.kind, sensor.parameters, factor)


def noise_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Sensors that the drawn factor takes beyond what their errors may be."""
    problems = []
    for name, factor in noise_factors(config).items():
        try:
            noisy_parameters(config, name)
        except pydantic.ValidationError as error:
            item = error.errors(include_url=False)[0]
            where = ".".join(map(str, item["loc"]))
            message = f"makes the errors of {name!r} {factor:.3g} times as large, and {where} is then out of its range"
            problems.append(at(settings, ("randomize", "noise"), message, "narrow the limits of its kind"))
    return problems


def drawn_of(config: BenchConfig, scene: Scene) -> dict[str, Any] | None:
    """Everything that was drawn; None where nothing is switched on."""
    told = drawn(scene, config.randomize)
    if told is not None and config.randomize.noise is not None:
        told["noise"] = noise_factors(config)
    return told
