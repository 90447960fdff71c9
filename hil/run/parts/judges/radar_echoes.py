"""Warns of a radar whose frames show nothing of the scene: no echo in any of them, or a converter that clips."""

from __future__ import annotations

from hil.config import Bench
from hil.run.part import Part, RunContext

_CLIPPED_SHARE = 0.01  # of the samples


def clipping(clipped: int, samples: int) -> str:
    """Describe a converter that clips too many of its samples; "": it does not."""
    if clipped <= _CLIPPED_SHARE * samples:
        return ""
    return f"the converter clipped {clipped / samples:.0%} of the samples, so that ranges and speeds are false"


class RadarEchoesPart(Part):
    name = "radar_echoes"

    def conclude(self, run: RunContext) -> None:
        for name, radar in run.sensors.radars.items():
            counts = radar.counts
            if counts.frames and not counts.echoes:
                why = "look where it or its camera points (mount_rpy_deg), and at its mask"
                run.say("warning", f"radar {name}: no echo in any of {counts.frames} frames: {why}")
            if told := clipping(counts.clipped, counts.samples):
                run.say("warning", f"radar {name}: {told}: lower conversion_gain_db")


def make(bench: Bench) -> Part:  # noqa: ARG001
    return RadarEchoesPart()
