"""Variant of a scene under one seed: other light, other weather, other colours, more people.

    scene = randomized(scene, settings, seed)

Light and weather are plain parts of the new scene. Surfaces and people depend on geometry, so the scene carries their
seed and limits (sim/scene/appearance.py) for the loader of its world.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from sim.randomize.light import draw_light, draw_weather
from sim.randomize.settings import Randomize
from sim.scene.appearance import Appearance
from sim.scene.scene import Scene
from sim.scene.weather import Weather
from sim.scene.world import World


def randomized(scene: Scene, settings: Randomize, seed: int) -> Scene:
    """Return the variant of the scene for `settings.seed`, or else `seed`; the same scene if no feature is on."""
    if not settings.on:
        return scene
    seed = settings.seed if settings.seed is not None else seed
    original = scene.original
    changed: dict[str, Any] = {}
    if settings.light is not None:
        changed["light"] = draw_light(settings.light, seed).model_copy(update={"fog_per_m": scene.light.fog_per_m})
    if settings.haze is not None:
        changed["weather"] = draw_weather(scene.weather, settings.haze, seed)
        changed["light"] = changed.get("light", scene.light).model_copy(update={"fog_per_m": 0.0})
    return scene.model_copy(update=changed).with_appearance(
        Appearance(seed, settings.textures, settings.people, settings.objects), original
    )


def in_weather(scene: Scene, weather: Weather | None) -> Scene:
    """Return the scene in other weather; None: the scene unchanged."""
    if weather is None:
        return scene
    original = scene.original
    light = scene.light.model_copy(update={"fog_per_m": 0.0})
    changed = scene.model_copy(update={"weather": weather, "light": light})
    return changed.with_appearance(Appearance(0, None, None), original)


def drawn(scene: Scene, settings: Randomize, load: Callable[[Scene], World]) -> dict[str, Any] | None:
    """Return the random values of a scene, as data; None: nothing is random. Noise: sim/sensors/noise_factor.py.

    `load` makes the scene's world, and is called only if surfaces or people are random.
    """
    if not settings.on or scene.appearance is None:
        return None
    data: dict[str, Any] = {"seed": scene.appearance.seed}
    if settings.light is not None:
        data["light"] = scene.light.model_dump(mode="json", exclude={"fog_per_m"})
    if settings.haze is not None:
        data["haze"] = scene.weather.model_dump(mode="json", include={"visibility_m"})
    if any(limits is not None for limits in (settings.textures, settings.people, settings.objects)):
        world = load(scene)
        if settings.textures is not None:
            data["textures"] = {name: asdict(surface) for name, surface in world.surface_appearance.items()}
        if settings.people is not None:
            data["people"] = [person.as_data() for person in world.added_people]
        if settings.objects is not None:
            data["objects"] = [added.as_data() for added in world.added_objects]
    return data
