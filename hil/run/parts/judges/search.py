"""The section `search`: search of a companion for people, judged from ground truth (`hil.run.verdict.search`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hil.config import Bench, SensorConfig
from hil.config.schema import Search
from hil.run.part import Part, RunContext
from hil.run.report.page import Report
from hil.run.verdict.search import SearchMeasurement
from hil.run.verdict.verdict import Verdict
from hil.run_files import SEARCH_PICTURE_NAME
from signals.detections import Detections
from signals.samples import TruthState


class SearchPart(Part):
    name = "search"

    def __init__(self, search: Search, camera: SensorConfig) -> None:
        self._measured = SearchMeasurement(search, camera)

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [self._measured.add]

    def on_detections(self, client: str, detections: Detections, t_ns: int) -> None:  # noqa: ARG002
        self._measured.detected(client, detections)

    def conclude(self, run: RunContext) -> None:
        frames = run.part("sensors").scene(run)
        self._measured.conclude(frames, frames.geometry.world)
        self._measured.write(run.out)

    def verdict(self) -> Verdict:
        return Verdict(*self._measured.verdict_rows())

    def run_keys(self) -> dict[str, Any]:
        return {"search": self._measured.result.as_map()}

    def report(self, run: RunContext) -> Report:
        picture = run.out / SEARCH_PICTURE_NAME
        return Report(
            [("Map of the people and of the objects that the client found", picture)] if picture.exists() else []
        )


def make(bench: Bench) -> Part:
    search = bench.config.search
    assert search is not None
    return SearchPart(search, bench.config.sensors[search.camera])
