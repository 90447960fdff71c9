"""Judges a search for people from ground truth (the section `search` of a bench).

The client's answer is its last list of objects: each with a position and the time of its last sighting. The truth is
the list of people whom the camera could see, from pictures rendered at the vehicle's true pose four times a second.

visible        a person with at least `visible_px` pixels in at least `visible_samples` of these pictures
found          a visible person with an object of the client within `gate_m` at the time of the object's last sighting.
               Each object is assigned to one person, the nearest pairs first; a person may have several objects
found_share    found people divided by visible people
error_m        median over the found people: horizontal distance of the object with most sightings from the person at
               the time of that object's last sighting
false_objects  objects without a person of the class within `gate_m`, visible or not
doubles        objects beyond the first of a person; judged, as false objects, only with `count_duplicates`
"""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hil.config import SensorConfig
from hil.config.schema import Search
from hil.run.verdict.true_people import TruePeople, TruePerson, visible_px
from hil.run.verdict.verdict import AIRBORNE_M, Row, rows_within
from signals.detections import Detections, FoundObject
from signals.errors import RecordingError
from signals.samples import TruthState
from signals.time import NS_PER_S
from sim.frame.source import FrameSource
from sim.scene.world import World

PEOPLE_NAME, PICTURE_NAME = "people.json", "search.png"
_SAMPLE_PERIOD_NS = NS_PER_S // 4
_VISIBLE, _HIDDEN, _FOUND, _FALSE, _PATH = "#0072b2", "#9aa5b1", "#009e73", "#d55e00", "#c7ced6"


@dataclass(frozen=True)
class PersonResult:
    """A person of the scene and the client's objects for it.

    Positions are x, y in W, at the time of the best object, or of the picture with most pixels if there is none.
    """

    name: str
    visible: bool
    looks: int  # pictures with enough pixels
    most_px: int
    truth_m: tuple[float, float]
    found_m: tuple[float, float] | None = None
    error_m: float | None = None
    t_s: float | None = None
    objects: tuple[int, ...] = ()


@dataclass(frozen=True)
class SearchResult:
    """Measurements of a search; None: not measured."""

    client: str = ""
    visible: int = 0
    found: int = 0
    found_share: float | None = None
    error_m: float | None = None
    worst_error_m: float | None = None
    false_objects: int = 0
    doubles: int = 0
    objects: int = 0
    people: tuple[PersonResult, ...] = ()
    false_at: tuple[FoundObject, ...] = field(default=())

    def as_map(self) -> dict[str, Any]:
        """Return the fields for run.json; people.json lists the people."""
        names = [name for name in type(self).__dataclass_fields__ if name not in ("people", "false_at")]
        return {name: getattr(self, name) for name in names}


class SearchMeasurement:
    """Collects ground truth and the clients' detections during the flight; call `conclude` after it."""

    def __init__(self, search: Search, camera: SensorConfig) -> None:
        self._search, self._camera = search, camera
        self._objects: dict[str, tuple[FoundObject, ...]] = {}  # by client: its newest list
        self._looks: list[TruthState] = []
        self._home_m: float | None = None
        self._next_ns = 0
        self.result = SearchResult()

    def add(self, truth: TruthState) -> None:
        """Add the true state of one tick; call it for every tick, in order."""
        if self._home_m is None:
            self._home_m = truth.p_WB[2]
        if truth.t_ns >= self._next_ns and truth.p_WB[2] > self._home_m + AIRBORNE_M:
            self._next_ns = truth.t_ns - truth.t_ns % _SAMPLE_PERIOD_NS + _SAMPLE_PERIOD_NS
            self._looks.append(truth)

    def detected(self, client: str, detections: Detections) -> None:
        """Keep the list of objects that a client sends with a detection."""
        if detections.objects is not None:
            self._objects[client] = detections.objects

    def conclude(self, frames: FrameSource, world: World) -> None:
        """Render the pictures of the flight and compare; this takes seconds."""
        people = TruePeople(world, self._search.label)
        pixels = visible_px(frames, self._camera, people.people, self._looks)
        client = max(self._objects, key=lambda name: len(self._objects[name]), default="")
        objects = [o for o in self._objects.get(client, ()) if o.label == self._search.label]
        near, wrong = matched(objects, people, self._search.gate_m)
        results = []
        for k, person in enumerate(people.people):
            counts = pixels[:, k]
            looks = int((counts >= self._search.visible_px).sum())
            best_ns = self._looks[int(counts.argmax())].t_ns if len(counts) else 0
            most_px = int(counts.max(initial=0))
            results.append(_person(person, people, near.get(k, []), looks, most_px, best_ns, self._search))
        self.result = _summed(client, results, objects, wrong)

    def judged(self) -> tuple[list[Row], list[str]]:
        """Return the measurements beside their limits, and the reasons why the flight fails."""
        return judged(self.result, self._search)

    def write(self, out: Path, track_m: Sequence[tuple[float, float]] | None = None) -> None:
        """Write people.json and the map search.png into `out`. Raises RecordingError."""
        result = self.result
        content = result.as_map() | {
            "people": [vars(one) for one in result.people],
            "false": [one._asdict() for one in result.false_at],
        }
        flown = track_m or [(t.p_WB[0], t.p_WB[1]) for t in self._looks]
        try:
            (out / PEOPLE_NAME).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
            search_figure(result, self._search, flown).savefig(out / PICTURE_NAME, dpi=110)
        except OSError as error:
            raise RecordingError(f"{out}: the search's result cannot be written ({error.strerror or error})") from error


def matched(
    objects: Sequence[FoundObject], people: TruePeople, gate_m: float
) -> tuple[dict[int, list[tuple[float, FoundObject]]], list[FoundObject]]:
    """Assign objects to people.

    Returns index of the person -> (distance [m], object) of its objects, most sightings first; and the objects
    without a person within `gate_m`.
    """
    near: dict[int, list[tuple[float, FoundObject]]] = {}
    pairs = []
    for i, one in enumerate(objects):
        for k, person in enumerate(people.people):
            distance = math.dist(people.place_m(person, one.t_ns), one.p_W[:2])
            if distance <= gate_m:
                pairs.append((distance, i, k))
    taken_i: set[int] = set()
    # First each person gets its nearest object that is left, then each object left goes to its nearest person.
    for one_each in (True, False):
        for distance, i, k in sorted(pairs):
            if i not in taken_i and not (one_each and k in near):
                taken_i.add(i)
                near.setdefault(k, []).append((distance, objects[i]))
    wrong = [one for i, one in enumerate(objects) if i not in taken_i]
    for mine in near.values():
        mine.sort(key=lambda pair: (-pair[1].sightings, pair[0]))
    return near, wrong


def _person(
    person: TruePerson,
    people: TruePeople,
    mine: Sequence[tuple[float, FoundObject]],
    looks: int,
    most_px: int,
    best_ns: int,
    search: Search,
) -> PersonResult:
    seen = (person.name, looks >= search.visible_samples, looks, most_px)
    if not mine:
        return PersonResult(*seen, people.place_m(person, best_ns))
    distance, best = mine[0]
    numbers = tuple(one.number for _, one in mine)
    truth_m, found_m = people.place_m(person, best.t_ns), (best.p_W[0], best.p_W[1])
    return PersonResult(*seen, truth_m, found_m, distance, best.t_ns / NS_PER_S, numbers)


def _summed(
    client: str, results: Sequence[PersonResult], objects: Sequence[FoundObject], wrong: Sequence[FoundObject]
) -> SearchResult:
    visible = [one for one in results if one.visible]
    found = [one for one in visible if one.error_m is not None]
    errors = sorted(one.error_m for one in found if one.error_m is not None)
    return SearchResult(
        client,
        len(visible),
        len(found),
        len(found) / len(visible) if visible else None,
        statistics.median(errors) if errors else None,
        errors[-1] if errors else None,
        len(wrong),
        sum(max(0, len(one.objects) - 1) for one in results),
        len(objects),
        tuple(results),
        tuple(wrong),
    )


def judged(result: SearchResult, search: Search) -> tuple[list[Row], list[str]]:
    """Return the rows of the verdict, and the reasons why it fails."""
    reasons: list[str] = []
    if not result.client:
        reasons.append("no client sent a list of the objects found: start one that does (companion.start: [detect])")
    elif not result.visible:
        reasons.append(f"no {search.label!r} was visible to the camera during the flight: fly where there are some")
    wrong = result.false_objects + (result.doubles if search.count_duplicates else 0)
    most_wrong = None if search.max_false is None else float(search.max_false)
    rows, failed = rows_within(
        ("found_share", result.found_share, search.min_found_share, "", True),
        ("search_error_m", result.error_m, search.max_error_m, "m", False),
        ("false_objects", float(wrong), most_wrong, "", False),
    )
    return rows, [*reasons, *failed]


def search_figure(result: SearchResult, search: Search, flown_m: Sequence[tuple[float, float]]) -> Any:
    """Return a map, east to the right and north up [m], with a line from each found person to the client's object."""
    from matplotlib.figure import Figure  # takes half a second

    figure = Figure(figsize=(8.6, 7.6), layout="constrained")
    ax = figure.subplots()
    if flown_m:
        ax.plot([p[0] for p in flown_m], [p[1] for p in flown_m], "-", color=_PATH, lw=1.2, label="path flown")
    groups = (
        ("visible", _VISIBLE, [one for one in result.people if one.visible]),
        ("not or hardly visible", _HIDDEN, [one for one in result.people if not one.visible]),
    )
    for label, colour, people in groups:
        if people:
            xy = [one.truth_m for one in people]
            ax.plot([p[0] for p in xy], [p[1] for p in xy], "o", color=colour, ms=9, mfc="none", mew=1.6, label=label)
    found = [one for one in result.people if one.found_m is not None]
    for one in found:
        assert one.found_m is not None
        ax.plot([one.truth_m[0], one.found_m[0]], [one.truth_m[1], one.found_m[1]], "-", color=_FOUND, lw=1.0)
        ax.annotate(f"{one.error_m:.1f} m", one.found_m, (5, 5), textcoords="offset points", fontsize=7, color=_FOUND)
    if found:
        at = [one.found_m for one in found if one.found_m is not None]
        ax.plot([p[0] for p in at], [p[1] for p in at], "+", color=_FOUND, ms=10, mew=2.0, label="found")
    if result.false_at:
        at = [(one.p_W[0], one.p_W[1]) for one in result.false_at]
        ax.plot([p[0] for p in at], [p[1] for p in at], "x", color=_FALSE, ms=9, mew=2.0, label="false object")
    share = "none" if result.found_share is None else f"{100.0 * result.found_share:.0f} %"
    error = "" if result.error_m is None else f", median error {result.error_m:.2f} m"
    ax.set_title(f"{search.label}: found {result.found} of {result.visible} visible ({share}){error}", loc="left")
    ax.set(xlabel="east [m]", ylabel="north [m]", aspect="equal")
    ax.grid(True, color="#e6e9ed", linewidth=0.7)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
