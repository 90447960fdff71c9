"""Warns before a flight of waypoints that may be passed by, of headings that come late, and of what is in the way."""

from __future__ import annotations

from hil.config import Bench
from hil.config.checks.course_notes import course_notes
from hil.config.checks.heading_notes import heading_notes
from hil.config.checks.radius_notes import radius_notes
from hil.run.part import Part, RunContext


class CoursePart(Part):
    name = "course"

    def open(self, run: RunContext) -> None:
        # Before the links open: an autopilot would wait meanwhile.
        for note in (*radius_notes(run.bench), *heading_notes(run.bench), *course_notes(run.bench)):
            run.say("warning", note)


def make(bench: Bench) -> Part:  # noqa: ARG001
    return CoursePart()
