"""Pictures of the report: each function draws PNG files into the run's folder and returns (caption, file) of each.

Importing this module loads matplotlib, half a second: parts import it when the flight is over.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from hil.config.missions.path import PlanPoint
from hil.run.companion.files import FrameTimes
from hil.run.recorder.track import TrackArrays
from hil.run.report import figures, frame_pictures, plane_figures, radar_pictures
from hil.run.verdict.plane_track import PlaneTrackArrays
from signals.classes import Classes
from signals.samples import FrameSample, RadarSample
from sim.radar.chirp import Chirp

Picture = tuple[str, Path]
Bins = Sequence[tuple[float, int]]  # middle of a histogram's bin [ns], count
FLIGHT_NAME = "flight.png"
_HARMFUL_MS = 20.0  # samples this late disturb PX4's estimator: firmware_bridge.links.realtime.health


def flight_pictures(out: Path, track: TrackArrays, plan: Sequence[PlanPoint], title: str) -> list[Picture]:
    """Draw the flown path, attitude and motors; nothing for an empty track. `plan`: its points in flying order."""
    if not len(track.t_s):
        return []
    flight = figures.save(figures.flight_figure(track, plan, title), out / FLIGHT_NAME)
    motion = figures.save(figures.motion_figure(track), out / "motion.png")
    return [
        ("Flown path against plan, altitude, attitude and motor commands", flight),
        ("Speed and rotor speeds", motion),
    ]


def plane_pictures(out: Path, track: PlaneTrackArrays, surface_names: Sequence[str]) -> list[Picture]:
    """Draw a plane's airspeed, energy, angles of the flow and surfaces; nothing for an empty track."""
    if not len(track.t_s):
        return []
    path = figures.save(plane_figures.plane_figure(track, surface_names), out / "plane.png")
    return [("Airspeed, energy, angle of attack and surfaces", path)]


def timing_pictures(out: Path, rtt_bins_ns: Bins, phase_us: Mapping[str, float]) -> list[Picture]:
    """Draw round trips to the autopilot, and mean wall time of each phase of a tick [us]."""
    if not rtt_bins_ns and not phase_us:
        return []
    path = figures.save(figures.timing_figure(rtt_bins_ns, phase_us), out / "timing.png")
    return [("Round trips and wall time by phase", path)]


def punctuality_pictures(out: Path, lateness_bins_ns: Bins, age_bins_ns: Bins) -> list[Picture]:
    """Draw how late samples were sent to a free-running autopilot, and how old its motor commands were."""
    if not lateness_bins_ns:
        return []
    figure = figures.realtime_figure(lateness_bins_ns, age_bins_ns, _HARMFUL_MS)
    path = figures.save(figure, out / "realtime.png")
    return [("Punctuality of samples and motor commands", path)]


def companion_pictures(out: Path, timing: Mapping[str, FrameTimes]) -> list[Picture]:
    """Draw the times of every frame, by client."""
    if not timing:
        return []
    path = figures.save(figures.companion_figure(timing), out / "companion.png")
    return [("Times of every frame to the companions and back", path)]


def frames_pictures(
    out: Path, frames: Mapping[str, FrameSample], classes: Classes, chirps: Mapping[str, Chirp]
) -> list[Picture]:
    """Draw one frame of each camera, LiDAR and radar as `frame_NAME.png`. `chirps`: by radar."""
    pictures: list[Picture] = []
    for name, sample in frames.items():
        if isinstance(sample, RadarSample):
            title, caption = frame_pictures.frame_title(name, sample), "with the most points or tracks"
            figure = radar_pictures.radar_figure(title, sample.channels, chirps[name])
        else:
            figure, caption = frame_pictures.frame_figure(name, sample, classes), "in mid-flight"
        pictures.append((f"Frame of {name} {caption}", figures.save(figure, out / f"frame_{name}.png")))
    return pictures
