"""Checks of a search: its camera, whether a client can report what is searched for, and whether the scene has any."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hil.config.companion.clients import known_clients, make_client_importable
from hil.config.layers import Settings
from hil.config.schema import BenchConfig, Companion
from signals.documents.validate import at, nearest
from signals.errors import Problem
from sim.scene.classes import GROUND_CLASSES
from sim.scene.scene import Scene
from sim.world_loader import load_world

_DETECTOR = "detect"  # of the shipped clients, the one that reports objects


def search_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Report a search that nobody flies, with a camera that there is not, or for what the detector never reports."""
    search = config.search
    problems: list[Problem] = []
    if search is None:
        return problems

    def report(place: tuple[str, ...], message: str, hint: str) -> None:
        problems.append(at(settings, ("search", *place), message, hint))

    companion = config.companion
    shipped = _are_shipped(companion)
    detectors = [cut for cut in companion.start if cut.name == _DETECTOR]
    if not companion.on or (shipped and not detectors):
        more = " or, for one that connects itself, clients: 1 more than are started" if companion.on else ""
        report((), "needs a companion that searches", f"companion: {{start: [detect]}}{more}")
    camera = config.sensors.get(search.camera)
    if camera is None or camera.kind != "camera":
        cameras = [name for name, sensor in config.sensors.items() if sensor.kind == "camera"]
        hint = nearest(search.camera, cameras) or f"cameras: {', '.join(cameras) or 'none'}"
        report(("camera",), f"is not a camera of this bench: {search.camera!r}", hint)
    if shipped and detectors:
        classes, reported = _labels({**companion.settings, **detectors[0].settings})
        if classes and search.label not in classes:
            report(("label",), f"is not a class of the detector: {search.label!r}", nearest(search.label, classes))
        elif classes and search.label not in reported:
            alone = f"the objects of {', '.join(reported)} alone" if reported else "no objects"
            text = f"is {search.label!r}, and detect reports {alone}"
            report(("label",), text, f"companion: {{settings: {{objects: [{search.label}]}}}}")
    return problems


def missing_object_problems(config: BenchConfig, scene: Scene, settings: Settings) -> list[Problem]:
    """Report a label of which the scene has no object, before a flight that could find none.

    What a seed adds differs from flight to flight: then the search's own verdict tells.
    """
    if config.search is None or (scene.appearance is not None and scene.appearance.adds):
        return []
    world, label = load_world(scene), config.search.label
    classes, objects = list(world.class_names), np.asarray(world.geom_class)[np.asarray(world.geom_instance) > 0]
    there = [classes[number] for number in np.unique(objects) if classes[number] not in GROUND_CLASSES]
    if label in there:
        return []
    message = f"is {label!r}, of which the scene {scene.name!r} has no object: nothing could be found"
    return [at(settings, ("search", "label"), message, nearest(label, there))]


def _are_shipped(companion: Companion) -> bool:
    """Return True if no other client than shipped ones can report objects, as far as the bench tells."""
    if not companion.start or companion.clients > len(companion.start) or companion.trace is not None:
        return False
    return all(cut.name in known_clients() for cut in companion.start)


def _labels(settings: Mapping[str, Any]) -> tuple[Sequence[str], Sequence[str]]:
    """Return the classes of the model of `detect`, and the labels of the objects that it reports.

    Both are () if `detect` will end with an error of these settings, or of its model.
    """
    make_client_importable()
    from hil_companion.cuts.detect_settings import DetectSettings
    from hil_companion.detect.model_file import ModelFile
    from hil_companion.errors import OptionError

    try:
        chosen = DetectSettings(**settings)
        classes = ModelFile.load(chosen.model).classes
    except (OptionError, TypeError, ValueError):
        return (), ()
    return classes, classes if chosen.objects is None else chosen.objects
