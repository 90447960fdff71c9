"""Warns of a radar or LiDAR that shows nothing of the scene: no echo in any frame, or a converter that clips."""

from __future__ import annotations

from hil.config import Bench
from hil.run.part import Part, RunContext

_CLIPPED_SHARE = 0.01  # of the samples


def clipping(clipped: int, samples: int) -> str:
    """Describe a converter that clips too many of its samples; "": it does not."""
    if clipped <= _CLIPPED_SHARE * samples:
        return ""
    return f"the converter clipped {clipped / samples:.0%} of the samples, so that ranges and speeds are false"


def no_return(sweeps: int) -> str:
    """Return that no ray of a LiDAR came back, in words."""
    why = "look where it points (mount_rpy_deg), and at its min_range_m and max_range_m"
    return f"no return in any of {sweeps} sweeps: {why}"


class EchoesPart(Part):
    name = "echoes"

    def conclude(self, run: RunContext) -> None:
        for name, radar in run.sensors.radars.items():
            counts = radar.counts
            if counts.frames and not counts.echoes:
                why = "look where it or its camera points (mount_rpy_deg), and at its mask"
                run.say("warning", f"radar {name}: no echo in any of {counts.frames} frames: {why}")
            if told := clipping(counts.clipped, counts.samples):
                run.say("warning", f"radar {name}: {told}: lower conversion_gain_db")
        for name, lidar in run.sensors.lidars.items():
            if lidar.sweeps and not lidar.returns:
                run.say("warning", f"lidar {name}: {no_return(lidar.sweeps)}")


def make(bench: Bench) -> Part:  # noqa: ARG001
    return EchoesPart()
