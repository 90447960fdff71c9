"""Checks of the section `search`: its camera, and whether a client of the bench can report what is searched for."""

from __future__ import annotations

from collections.abc import Sequence

from hil.config.companion.clients import known_clients, make_client_importable
from hil.config.layers import Settings
from hil.config.schema import BenchConfig, Companion
from signals.documents.validate import at, nearest
from signals.errors import Problem

_DETECTOR = "detect"  # of the shipped clients, the one that reports objects


def search_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Report a search that nobody flies, with a camera that there is not, or for what the detector never reports."""
    search = config.search
    problems: list[Problem] = []
    if search is None:
        return problems

    def report(place: tuple[str, ...], message: str, hint: str) -> None:
        problems.append(at(settings, ("search", *place), message, hint))

    if not config.companion.on:
        report((), "needs a companion that searches", "companion: {start: [detect]}")
    camera = config.sensors.get(search.camera)
    if camera is None or camera.kind != "camera":
        cameras = [name for name, sensor in config.sensors.items() if sensor.kind == "camera"]
        hint = nearest(search.camera, cameras) or f"cameras: {', '.join(cameras) or 'none'}"
        report(("camera",), f"is not a camera of this bench: {search.camera!r}", hint)
    classes, reported = _labels(config.companion)
    if classes and search.label not in classes:
        report(("label",), f"is not a class of the detector: {search.label!r}", nearest(search.label, classes))
    elif reported and search.label not in reported:
        text = f"is {search.label!r}, and detect reports the objects of {', '.join(reported)} alone"
        report(("label",), text, f"companion: {{settings: {{objects: [{search.label}]}}}}")
    return problems


def _labels(companion: Companion) -> tuple[Sequence[str], Sequence[str]]:
    """Return the classes of the model of `detect` and the labels of the objects that it reports, or () if unknown.

    Unknown they are where another client may report objects, or `detect` will end with an error of its settings.
    """
    started = [cut for cut in companion.start if cut.name == _DETECTOR]
    others = [cut for cut in companion.start if cut.name not in known_clients()]
    if not started or others or companion.clients > len(companion.start) or companion.trace is not None:
        return (), ()
    make_client_importable()
    from hil_companion.cuts.detect_settings import DetectSettings
    from hil_companion.detect.model_file import ModelFile
    from hil_companion.errors import OptionError

    try:
        chosen = DetectSettings(**{**companion.settings, **started[0].settings})
        classes = ModelFile.load(chosen.model).classes
    except (OptionError, TypeError):
        return (), ()
    return classes, classes if chosen.objects is None else chosen.objects
