"""Judges a search for people from ground truth (the section `search` of a bench).

The client's answer is its last list of objects: each with a position and the time of its last sighting. Of several
clients that with the most objects of the class counts. The truth is the list of people visible to the camera in
pictures rendered at the vehicle's true pose four times a second.

visible        a person with at least `visible_px` pixels in at least `visible_samples` of these pictures
found          a visible person with an object of the client within `gate_m` at the time of the object's last sighting.
               Each object is assigned to one person, the nearest pairs first; a person may have several objects
found_share    found people divided by visible people
error_m        median over the found people: horizontal distance of the object with most sightings from the person at
               the time of that object's last sighting
worst_error_m  the greatest of these distances
false_objects  objects without a person of the class within `gate_m`, visible or not
doubles        further objects of a person who already has one; added to the false objects if `count_duplicates` is on
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
from hil.run_files import PEOPLE_NAME, SEARCH_PICTURE_NAME
from signals.detections import Detections, FoundObject
from signals.errors import file_errors
from signals.samples import TruthState
from signals.time import NS_PER_S
from sim.frame.source import SharedFrames
from sim.scene.world import World

_SAMPLE_PERIOD_NS = NS_PER_S // 4
_VISIBLE, _HIDDEN, _FOUND, _FALSE, _PATH = "#0072b2", "#9aa5b1", "#009e73", "#d55e00", "#c7ced6"


@dataclass(frozen=True)
class PersonResult:
    """A person of the scene, and the objects of the client that are assigned to this person.

    Positions are x, y in W, at the time of the object with most sightings, or without an object, of the picture with
    most pixels.
    """

    name: str
    visible: bool
    looks: int  # number of pictures with at least `visible_px` pixels
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
        self._objects: dict[str, tuple[FoundObject, ...]] = {}  # by client, the newest list
        self._sampled_states: list[TruthState] = []
        self._home_m: float | None = None
        self._next_ns = 0
        self.result = SearchResult()

    def add(self, truth: TruthState) -> None:
        """Add the true state of one tick; call it for every tick, in order."""
        if self._home_m is None:
            self._home_m = truth.p_WB[2]
        if truth.t_ns >= self._next_ns and truth.p_WB[2] > self._home_m + AIRBORNE_M:
            self._next_ns = truth.t_ns - truth.t_ns % _SAMPLE_PERIOD_NS + _SAMPLE_PERIOD_NS
            self._sampled_states.append(truth)

    def detected(self, client: str, detections: Detections) -> None:
        """Keep the list of objects that a client sends with a detection."""
        if detections.objects is not None:
            self._objects[client] = detections.objects

    def conclude(self, frames: SharedFrames, world: World) -> None:
        """Render the pictures of the flight and compare; this takes seconds."""
        people = TruePeople(world, self._search.label)
        pixels = visible_px(frames, self._camera, people.people, self._sampled_states)
        found = {name: [o for o in objects if o.label == self._search.label] for name, objects in self._objects.items()}
        client = max(found, key=lambda name: len(found[name]), default="")
        objects = found.get(client, [])
        assigned, unassigned = assign_objects(objects, people, self._search.gate_m)
        results = []
        for k, person in enumerate(people.people):
            counts = pixels[:, k]
            looks = int((counts >= self._search.visible_px).sum())
            best_ns = self._sampled_states[int(counts.argmax())].t_ns if len(counts) else 0
            most_px = int(counts.max(initial=0))
            results.append(_person(person, people, assigned.get(k, []), looks, most_px, best_ns, self._search))
        self.result = _summary(client, results, objects, unassigned)

    def verdict_rows(self) -> tuple[list[Row], list[str]]:
        """Return the measurements beside their limits, and the reasons why the flight fails."""
        return judge_search(self.result, self._search)

    def write(self, out: Path, track_m: Sequence[tuple[float, float]] | None = None) -> None:
        """Write people.json and the map search.png into `out`. Raises RecordingError."""
        result = self.result
        content = result.as_map() | {
            "people": [vars(person) for person in result.people],
            "false": [obj._asdict() for obj in result.false_at],
        }
        flown = track_m or [(t.p_WB[0], t.p_WB[1]) for t in self._sampled_states]
        with file_errors(out, "the search's result cannot be written"):
            (out / PEOPLE_NAME).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
            search_figure(result, self._search, flown).savefig(out / SEARCH_PICTURE_NAME, dpi=110)


def assign_objects(
    objects: Sequence[FoundObject], people: TruePeople, gate_m: float
) -> tuple[dict[int, list[tuple[float, FoundObject]]], list[FoundObject]]:
    """Assign objects to people.

    Returns index of the person -> (distance [m], object) of the assigned objects, most sightings first; and the
    objects without a person within `gate_m`.
    """
    assigned: dict[int, list[tuple[float, FoundObject]]] = {}
    pairs = []
    for i, obj in enumerate(objects):
        for k, person in enumerate(people.people):
            distance = math.dist(people.position_m(person, obj.t_ns), obj.p_W[:2])
            if distance <= gate_m:
                pairs.append((distance, i, k))
    done: set[int] = set()  # indices of assigned objects
    # First each person gets the nearest unassigned object, then each remaining object goes to the nearest person.
    for one_each in (True, False):
        for distance, i, k in sorted(pairs):
            if i not in done and not (one_each and k in assigned):
                done.add(i)
                assigned.setdefault(k, []).append((distance, objects[i]))
    for pairs_of_person in assigned.values():
        pairs_of_person.sort(key=lambda pair: (-pair[1].sightings, pair[0]))
    return assigned, [obj for i, obj in enumerate(objects) if i not in done]


def _person(
    person: TruePerson,
    people: TruePeople,
    assigned: Sequence[tuple[float, FoundObject]],
    looks: int,
    most_px: int,
    best_ns: int,
    search: Search,
) -> PersonResult:
    visibility = (person.name, looks >= search.visible_samples, looks, most_px)
    if not assigned:
        return PersonResult(*visibility, people.position_m(person, best_ns))
    distance, best = assigned[0]
    numbers = tuple(obj.number for _, obj in assigned)
    truth_m, found_m = people.position_m(person, best.t_ns), (best.p_W[0], best.p_W[1])
    return PersonResult(*visibility, truth_m, found_m, distance, best.t_ns / NS_PER_S, numbers)


def _summary(
    client: str, results: Sequence[PersonResult], objects: Sequence[FoundObject], unassigned: Sequence[FoundObject]
) -> SearchResult:
    visible = [person for person in results if person.visible]
    found = [person for person in visible if person.error_m is not None]
    errors = sorted(person.error_m for person in found if person.error_m is not None)
    return SearchResult(
        client,
        len(visible),
        len(found),
        len(found) / len(visible) if visible else None,
        statistics.median(errors) if errors else None,
        errors[-1] if errors else None,
        len(unassigned),
        sum(max(0, len(person.objects) - 1) for person in results),
        len(objects),
        tuple(results),
        tuple(unassigned),
    )


def judge_search(result: SearchResult, search: Search) -> tuple[list[Row], list[str]]:
    """Return the rows of the verdict, and the reasons why it fails."""
    reasons: list[str] = []
    if not result.client:
        reasons.append("no client sent a list of the objects found: start one that does (companion.start: [detect])")
    elif not result.visible:
        reasons.append(f"no {search.label!r} was visible to the camera during the flight: fly where there is one")
    false_count = result.false_objects + (result.doubles if search.count_duplicates else 0)
    rows, failed = rows_within(
        ("found_share", result.found_share, search.min_found_share, "", True),
        ("search_error_m", result.error_m, search.max_error_m, "m", False),
        ("worst_search_error_m", result.worst_error_m, search.max_worst_error_m, "m", False),
        ("false_objects", float(false_count), search.max_false, "", False),
        ("double_objects", float(result.doubles), search.max_doubles, "", False),
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
        ("visible", _VISIBLE, [person for person in result.people if person.visible]),
        ("not or hardly visible", _HIDDEN, [person for person in result.people if not person.visible]),
    )
    for label, colour, people in groups:
        if people:
            xy = [person.truth_m for person in people]
            ax.plot([p[0] for p in xy], [p[1] for p in xy], "o", color=colour, ms=9, mfc="none", mew=1.6, label=label)
    pairs = [(p.truth_m, p.found_m, p.error_m) for p in result.people if p.found_m is not None]
    for truth_m, found_m, error_m in pairs:
        ax.plot([truth_m[0], found_m[0]], [truth_m[1], found_m[1]], "-", color=_FOUND, lw=1.0)
        ax.annotate(f"{error_m:.1f} m", found_m, (5, 5), textcoords="offset points", fontsize=7, color=_FOUND)
    if pairs:
        xy = [found_m for _, found_m, _ in pairs]
        ax.plot([p[0] for p in xy], [p[1] for p in xy], "+", color=_FOUND, ms=10, mew=2.0, label="found")
    if result.false_at:
        xy = [(obj.p_W[0], obj.p_W[1]) for obj in result.false_at]
        ax.plot([p[0] for p in xy], [p[1] for p in xy], "x", color=_FALSE, ms=9, mew=2.0, label="false object")
    share = "none" if result.found_share is None else f"{100.0 * result.found_share:.0f} %"
    error = "" if result.error_m is None else f", median error {result.error_m:.2f} m"
    ax.set_title(f"{search.label}: found {result.found} of {result.visible} visible ({share}){error}", loc="left")
    ax.set(xlabel="east [m]", ylabel="north [m]", aspect="equal")
    ax.grid(True, color="#e6e9ed", linewidth=0.7)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
