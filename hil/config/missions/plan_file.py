"""Reads plan files of QGroundControl (.plan).

Format: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html. Simple items are used
unchanged. For surveys and corridor scans the items that QGroundControl computed (`TransectStyleComplexItem.Items`) are
flown. The speeds at the top of the file are only used by QGroundControl to plan, and are not sent to the autopilot;
DO_CHANGE_SPEED commands a speed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from hil.config.missions.mission import JUMP, Geopoint, Mission, RawItem, checked_mission, on_globe
from signals.documents.document import Document, Place, shown_path
from signals.documents.json_lines import read_json
from signals.documents.validate import nearest, shown
from signals.errors import Problem
from signals.words import counted


class _PlanReader:
    """Collects the items and problems of one plan."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.problems: list[Problem] = []
        self.items: list[RawItem] = []
        self.jump_ids: dict[int, int] = {}  # doJumpId -> sequence number
        self.jumps: list[tuple[int, Place]] = []

    def report(self, place: Place, message: str, hint: str = "") -> None:
        self.problems.append(Problem(self.document.where(place), message, hint))

    def plan(self) -> tuple[list[RawItem], Geopoint | None]:
        """Return the items and the planned home position; problems are in `problems`."""
        data = self.document.data
        if not isinstance(data, dict) or data.get("fileType") != "Plan":
            file_type = data.get("fileType") if isinstance(data, dict) else None
            message = "is not a QGroundControl plan" + (
                f" but a {file_type!r} file" if file_type else ': it has no "fileType": "Plan"'
            )
            self.report(("fileType",), message)
            return [], None
        mission = data.get("mission")
        if not isinstance(mission, dict):
            self.report(("mission",), 'has no "mission"')
            return [], None
        entries = mission.get("items")
        if not isinstance(entries, list):
            self.report(("mission", "items"), 'the mission has no list "items"')
            return [], None
        for index, entry in enumerate(entries):
            self.entry(entry, ("mission", "items", index), f"item {index + 1}")
        self._resolve_jumps()
        return self.items, self._home(mission)

    def entry(self, entry: Any, place: Place, name: str) -> None:
        kind = entry.get("type") if isinstance(entry, dict) else None
        if kind == "SimpleItem":
            self._simple(entry, place, name)
        elif kind == "ComplexItem":
            self._complex(entry, place, name)
        else:
            hint = nearest(kind, ("SimpleItem", "ComplexItem")) if isinstance(kind, str) else ""
            self.report((*place, "type"), f"{name} is not a SimpleItem or ComplexItem", hint)

    def _complex(self, entry: dict[str, Any], place: Place, name: str) -> None:
        kind = entry.get("complexItemType")
        transects = entry.get("TransectStyleComplexItem")
        if not isinstance(transects, dict):
            self.report(
                place,
                f"{name} is a complex item of type {shown(kind)}, which cannot be expanded",
                "surveys and corridor scans can",
            )
            return
        items = transects.get("Items")
        transects_place = (*place, "TransectStyleComplexItem")
        if not isinstance(items, list) or not items:
            self.report(transects_place, f"{name} ({kind}) holds no computed items", "save it again in QGroundControl")
            return
        for index, item in enumerate(items):
            label = f"{name} ({kind}), part {index + 1}"
            if not isinstance(item, dict) or item.get("type", "SimpleItem") != "SimpleItem":
                self.report((*transects_place, "Items", index), f"{label} is not a SimpleItem")
            else:
                self._simple(item, (*transects_place, "Items", index), label)

    def _simple(self, entry: dict[str, Any], place: Place, name: str) -> None:
        numbers: list[int] = []
        for key in ("command", "frame"):
            value = entry.get(key)
            if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= 65535:
                wanted = "must be a whole number from 0 to 65535"
                problem = f"{wanted}, not {shown(value)}" if key in entry else "is missing"
                self.report((*place, key), f"{name}: {key} {problem}")
            else:
                numbers.append(value)
        params = entry.get("params")
        if not isinstance(params, list) or len(params) != 7:
            count = f"{len(params)}" if isinstance(params, list) else "none"
            self.report((*place, "params"), f"{name}: params must be a list of 7 numbers, found {count}")
            return
        values: list[float] = []
        for index, value in enumerate(params):
            value_place = (*place, "params", index)
            if value is None:
                values.append(math.nan)
            elif isinstance(value, bool) or not isinstance(value, int | float):
                self.report(value_place, f"{name}: param {index + 1} must be a number or null, not {shown(value)}")
            elif not _is_finite(value):
                self.report(
                    value_place, f"{name}: param {index + 1} is not finite: {shown(value)}", "null leaves a value open"
                )
            else:
                values.append(float(value))
        if len(numbers) != 2 or len(values) != 7:
            return
        command, frame = numbers
        seq = len(self.items)
        jump_id = entry.get("doJumpId")
        if isinstance(jump_id, int):
            self.jump_ids.setdefault(jump_id, seq)
        if command == JUMP:
            self.jumps.append((seq, place))
        document = self.document
        self.items.append(
            RawItem(
                where=lambda i: document.where(place if i is None else (*place, "params", i)),
                name=name,
                frame=frame,
                command=command,
                params=(values[0], values[1], values[2], values[3], values[4], values[5], values[6]),
                autocontinue=entry.get("autoContinue", True) is True,
            )
        )

    def _resolve_jumps(self) -> None:
        """Replace doJumpId, by which DO_JUMP names its target, by the sequence number that the autopilot needs."""
        for seq, place in self.jumps:
            item = self.items[seq]
            target = item.params[0]
            target_seq = self.jump_ids.get(int(target)) if _is_finite(target) and target == int(target) else None
            if target_seq is None:
                message = f"{item.name} jumps to the item with doJumpId {target:g}, which does not exist"
                self.report((*place, "params", 0), message)
                target_seq = 0
            _, p2, p3, p4, p5, p6, p7 = item.params
            self.items[seq] = replace(item, params=(float(target_seq), p2, p3, p4, p5, p6, p7))

    def _home(self, mission: dict[str, Any]) -> Geopoint | None:
        home = mission.get("plannedHomePosition")
        if home is None:
            return None
        has_three = isinstance(home, list) and len(home) == 3
        if not has_three or not all(
            isinstance(v, int | float) and not isinstance(v, bool) and _is_finite(v) for v in home
        ):
            message = "plannedHomePosition must be latitude, longitude and altitude"
            self.report(("mission", "plannedHomePosition"), message)
            return None
        point = Geopoint(*(float(v) for v in home))
        if not on_globe(point):
            self.report(("mission", "plannedHomePosition"), "plannedHomePosition is not on the globe")
        return point


def _is_finite(value: float) -> bool:
    return abs(value) < 3e38  # MAVLink sends 32-bit floats; compared without float(), which fails for huge integers


def read_plan(path: Path, *, site: Geopoint | None = None) -> Mission:
    """Read and check a .plan file. Raises ConfigError with every problem found."""
    reader = _PlanReader(read_json(path))
    items, home = reader.plan()
    mission = checked_mission(path, shown_path(path), items, home, site=site, problems=reader.problems)
    return replace(mission, notes=tuple(_left_out(reader.document)))


def _left_out(document: Document) -> Iterator[str]:
    """Describe the geofences and rally points of a plan, which are not uploaded."""
    for section, lists, what in (("geoFence", ("polygons", "circles"), "geofence"), ("rallyPoints", ("points",), "")):
        held = document.data.get(section)
        entries = [held.get(name) for name in lists] if isinstance(held, dict) else []
        count = sum(len(each) for each in entries if isinstance(each, list))
        if count:
            things = counted(count, what or "rally point")
            yield f"{document.where((section,))}: {things} of the plan not uploaded: nothing keeps to them here"
