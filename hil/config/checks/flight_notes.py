"""Notes on a flight before it begins, for `hil check` and the warnings of a run: each kind has a file of its own."""

from __future__ import annotations

from hil.config.bench import Bench
from hil.config.checks.course_notes import course_notes
from hil.config.checks.far_notes import far_notes
from hil.config.checks.fault_notes import fault_notes
from hil.config.checks.heading_notes import heading_notes
from hil.config.checks.limit_notes import limit_notes
from hil.config.checks.mount_notes import mount_notes
from hil.config.checks.radius_notes import radius_notes


def flight_notes(bench: Bench) -> list[str]:
    """Describe limits, faults and sensors in vain, and what of its mission may not be flown as it is written."""
    kinds = (limit_notes, fault_notes, mount_notes, radius_notes, far_notes, heading_notes, course_notes)
    return [note for notes in kinds for note in notes(bench)]
