"""The followed flight on the report page: pictures, and a table of how the two flights differ."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

from hil.run.follow.difference import Motion, differences
from hil.run.follow.flight import FollowedFlight
from hil.run.follow.pictures import Compared, MotorRows, follow_pictures
from hil.run.recorder.track import TrackArrays
from hil.run.report.html import table, text
from hil.run.report.page import Report

_ROWS = (
    ("Position", "position", "m"),
    ("Velocity", "velocity", "mps"),
    ("Attitude", "attitude", "deg"),
    ("Rate", "rate", "degps"),
)
_UNITS = {"mps": "m/s", "degps": "deg/s"}


def follow_report(
    out: Path,
    flight: FollowedFlight,
    *,
    simulated: Motion,
    real: Motion,
    track: TrackArrays,
    began_s: float,
    keys: Mapping[str, Any],
) -> Report:
    """Return pictures and section of a followed flight, of which `simulated` and `real` have the same times."""
    n = len(simulated.p_WB)
    t_s = flight.course.t_s[:n]
    log = flight.log.between(flight.begin_s, flight.begin_s + float(t_s[-1]), flight.log.name)
    commands = log.motors_kind == "command"
    unit = "0 to 1" if commands else "rad/s"
    inside = (track.t_s >= began_s) & (track.t_s <= began_s + float(t_s[-1]))
    compared = Compared(
        title=f"{flight.log.name}: real and simulated",
        t_s=t_s,
        real=real,
        simulated=simulated,
        set_points_W=flight.course.p_W[:n],
        differences=differences(t_s, simulated, real),
        real_motors=MotorRows(log.motors.t_s - flight.begin_s, log.motors.values, unit),
        simulated_motors=MotorRows(
            track.t_s[inside] - began_s, (track.controls if commands else track.rotor_speed_radps)[inside], unit
        ),
    )
    return Report(follow_pictures(out, compared), [("Followed flight", _html(flight, keys))])


def _html(flight: FollowedFlight, keys: Mapping[str, Any]) -> str:
    numbers = [
        (name, *(text(keys[f"{what}_{kind}_{unit}"], _UNITS.get(unit, unit)) for kind in ("rms", "max")))
        for name, what, unit in _ROWS
    ]
    x, y, z = flight.home_L_m
    facts = [
        ("Log", str(flight.log.source)),
        ("Flight", f"{flight.number} of {flight.flights}, {flight.begin_s:.2f} to {flight.end_s:.2f} s of its clock"),
        ("Set-points", flight.course.words),
        ("Clocks", f"simulated time = time of the log {keys['time_offset_s']:+.3f} s"),
        ("Frames", f"({x:.2f}, {y:.2f}, {z:.2f}) m of the log, where it took off, is the start here; east stays east"),
        ("Heading at take-off", f"{keys['start_yaw_deg']:.1f} deg from east"),
        ("The simulated flight is later by", text(keys["delay_s"], "s")),
        ("Followed", f"{keys['followed_s']:.1f} of {flight.duration_s:.1f} s"),
    ]
    if flight.wind_W_mps is not None:
        facts.append(("Wind in the log", "({:.2f}, {:.2f}, {:.2f}) m/s".format(*flight.wind_W_mps)))
    notes = "".join(f"<li>{escape(note)}</li>" for note in flight.notes)
    differences_table = table(numbers, ("Simulated less real", "rms", "greatest"))
    return f"{differences_table}{table(facts)}" + (f"<ul>{notes}</ul>" if notes else "")
