"""Count of what the shipped detectors find in photographs: here one of the data sets' pictures in their place."""

from __future__ import annotations

from pathlib import Path

import pytest

from lab.realism import photographs

from hil_companion.detect.model_file import SHIPPED  # isort: skip

PICTURE = Path(__file__).parents[2] / "worlds" / "detect_people.png"
PEOPLE = ((253.0, 70.0, 266.0, 92.0), (43.0, 69.0, 58.0, 92.0), (217.0, 50.0, 226.0, 70.0))


@pytest.mark.parametrize("model", SHIPPED)
def test_people_found_and_false_boxes_are_counted(monkeypatch: pytest.MonkeyPatch, model: str) -> None:
    objects = {"one.png": tuple(("person", box) for box in PEOPLE), "none.png": (("vehicle", (0.0, 0.0, 5.0, 5.0)),)}
    monkeypatch.setattr(photographs, "_ALL_OBJECTS", objects)
    content = PICTURE.read_bytes()
    rows = {row[0]: row[1:] for row in photographs.own_detector_table({"one.png": content}).rows}
    assert rows[f"{model}, from 0.3, whole"][0] == "3 of 3"
    rows = {row[0]: row[1:] for row in photographs.own_detector_table({"none.png": content}).rows}
    people, vehicles, false = rows[f"{model}, from 0.3, whole"]
    assert (people, vehicles) == ("0 of 0", "0 of 1")
    assert int(false) >= 3
