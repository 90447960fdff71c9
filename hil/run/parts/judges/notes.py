"""Warns before a flight of what its bench and its mission ask for in vain."""

from __future__ import annotations

from hil.config import Bench
from hil.config.checks.flight_notes import flight_notes
from hil.run.part import Part, RunContext


class NotesPart(Part):
    name = "notes"

    def open(self, run: RunContext) -> None:
        # Before the links open: an autopilot would wait meanwhile.
        for note in flight_notes(run.bench):
            run.say("warning", note)


def make(bench: Bench) -> Part:  # noqa: ARG001
    return NotesPart()
