"""Warns of limits that the bench sets and that do not judge its kind of vehicle."""

from __future__ import annotations

from hil.config import Bench
from hil.config.checks.limit_notes import limit_notes
from hil.run.part import Part, RunContext


class UnjudgedPart(Part):
    name = "unjudged"

    def __init__(self, notes: list[str]) -> None:
        self._notes = notes

    def begin(self, run: RunContext) -> None:
        for note in self._notes:
            run.say("warning", note)


def make(bench: Bench) -> Part:
    return UnjudgedPart(limit_notes(bench))
