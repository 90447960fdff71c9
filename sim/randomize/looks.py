"""What one seed makes of a scene: the scene with another light, other air, other colours, and more people.

    scene = randomized(scene, settings, seed)

Light and weather are plain parts of the scene that comes out. Surfaces and people need its geometry: the scene carries
how they are drawn (`Looks`), `load_world` puts the people in, and cameras draw surfaces by it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from sim.randomize.light import draw_light, draw_weather
from sim.randomize.settings import PeopleLimits, Randomize, TextureLimits
from sim.scene.weather import Weather

if TYPE_CHECKING:
    from sim.scene.scene import Scene


@dataclass(frozen=True)
class Looks:
    """How a scene's surfaces and people are drawn, and the scene before anything was."""

    seed: int
    textures: TextureLimits | None
    people: PeopleLimits | None
    original: Scene = field(repr=False, compare=False)


def randomized(scene: Scene, settings: Randomize, seed: int) -> Scene:
    """The scene as `settings.seed`, or else `seed`, makes it look; the same scene where nothing is switched on."""
    if not settings.on:
        return scene
    seed = settings.seed if settings.seed is not None else seed
    original = scene.original
    changed: dict[str, Any] = {}
    if settings.light is not None:
        changed["light"] = draw_light(settings.light, seed).model_copy(update={"fog_per_m": scene.light.fog_per_m})
    if settings.haze is not None:
        changed["weather"] = draw_weather(settings.haze, seed)
        changed["light"] = changed.get("light", scene.light).model_copy(update={"fog_per_m": 0.0})
    return scene.model_copy(update=changed).with_looks(Looks(seed, settings.textures, settings.people, original))


def in_weather(scene: Scene, weather: Weather | None) -> Scene:
    """The scene with other air; None: its own."""
    if weather is None:
        return scene
    original = scene.original
    light = scene.light.model_copy(update={"fog_per_m": 0.0})
    changed = scene.model_copy(update={"weather": weather, "light": light})
    return changed.with_looks(Looks(0, None, None, original))


def drawn(scene: Scene, settings: Randomize) -> dict[str, Any] | None:
    """What was drawn of a scene, as data; None: nothing. Noise is each sensor's own (sim/randomize/noise.py)."""
    if not settings.on or scene.looks is None:
        return None
    told: dict[str, Any] = {"seed": scene.looks.seed}
    if settings.light is not None:
        told["light"] = scene.light.model_dump(mode="json", exclude={"fog_per_m"})
    if settings.haze is not None:
        told["haze"] = scene.weather.model_dump(mode="json")
    if settings.textures is not None or settings.people is not None:
        from sim.scene.world import load_world  # geometry, only where it has a say

        world = load_world(scene)
        if settings.textures is not None:
            told["textures"] = {name: asdict(look) for name, look in world.surface_looks.items()}
        if settings.people is not None:
            told["people"] = [person.as_data() for person in world.added_people]
    return told
