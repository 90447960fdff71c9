"""Finds the stretches of a log in which a vehicle flies freely: no ground, no crash, no gap.

    motors    the summed thrust of the vehicle's model is above a quarter of its median while it is up
    height    higher above the ground before take-off and after landing than 1.5 times the vehicle's radius
    crash     the specific force, averaged over 20 ms, exceeds twice what all rotors give; or the vehicle lies
              on its back
    gaps      no motor output (or gyro, or pose) for more than five samples and 0.1 s; or gyro and pose both repeat
              their values for more than 0.3 s, as tables of a radio link do where it lost the data

What is left out, and from when to when, becomes a note.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.flight_log import FlightLog, Series
from hil.run.flight_logs.log_format import LogFile
from hil.run.flight_logs.rotor_model import greatest_specific_force_mps2, steady_speeds_radps, wrench

Interval = tuple[float, float]

_SHORTEST_S = 0.5  # of a stretch with the motors up; less is a test of the motors
_UP_SHARE = 0.25  # of the flight's median thrust; idling motors give 1 to 5 %
_WITHOUT_HEIGHT_S = 2.0  # left out after take-off and before landing where no height is known
_FALL_S = 2.0  # motors that stop in the air: time until the ground is reached
_LANDING_S = 0.5  # before the height of landing is reached: ground effect
_CRASH_FACTOR = 2.0  # times the greatest specific force; vibration averages out over 20 ms
_LANDING_FACTOR = 2.0  # times that again: a hard landing is no crash
_CRASH_MEAN_S = 0.02
_BEFORE_CRASH_S, _AFTER_CRASH_S = 0.3, 1.0
_AFTERMATH_S = 3.0  # shorter flight after a crash is part of it
_GAP_S, _GAP_SAMPLES = 0.1, 5.0
_REPEATED_S = 0.3  # a gyro in flight does not read the same for so long
_INVERTED_COS = -0.2  # cosine of the tilt: beyond 100 degrees
_SATURATED = 0.99
_NOTED_SATURATION = 0.01


@dataclass(frozen=True)
class Saturation:
    """Share of samples in which a motor is commanded to its limit, and the first such time."""

    share: float
    first_s: float


def motors_up(log: FlightLog, file: LogFile) -> list[Interval]:
    """Return the stretches with the motors up. Raises ConfigError if there is none."""
    thrust_n = wrench(steady_speeds_radps(log, file.vehicle), file.vehicle)[:, 2]
    high = float(np.percentile(thrust_n, 95.0))
    level = float(np.median(thrust_n[thrust_n > 0.2 * high])) if high > 0.0 else 0.0
    if not level > 0.0:
        message = f"shows motors at rest from {log.start_s:.2f} to {log.end_s:.2f} s: it contains no flight"
        raise file.refuse(message, "name a log from arming to disarming", topic=file.topic("motors"))
    # A short dip is a manoeuvre: motors stop for less than 0.3 s in the air.
    up = _intervals(log.motors.t_s, thrust_n > _UP_SHARE * level)
    merged: list[Interval] = []
    for start_s, end_s in up:
        if merged and start_s - merged[-1][1] < 0.3:
            merged[-1] = (merged[-1][0], end_s)
        else:
            merged.append((start_s, end_s))
    return [(start_s, end_s) for start_s, end_s in merged if end_s - start_s >= _SHORTEST_S]


def find_flights(log: FlightLog, file: LogFile, up: Sequence[Interval]) -> list[FlightLog]:
    """Return the stretches of free flight within those with the motors up, each a log of its own."""
    stretches: list[tuple[Interval, float | None]] = []
    for interval in up:
        free, ground_m = _above_ground(log, file, interval)
        if free is None:
            continue
        for before in _without_crashes(log, file, free, interval[1]):
            stretches += [(part, ground_m) for part in _without_gaps(log, file, before)]
    flights: list[FlightLog] = []
    for (start_s, end_s), ground_m in stretches:
        name = log.name if len(stretches) == 1 else f"{log.name}.{len(flights) + 1}"
        declared = log.ground_m is not None
        flights.append(replace(log.between(start_s, end_s, name), ground_m=log.ground_m if declared else ground_m))
    return flights


def saturation_of(flights: Sequence[FlightLog]) -> Saturation:
    """Return how much of the flights has a motor's command at its upper limit; measured speeds have none."""
    samples, saturated, first_s = 0, 0, float("nan")
    for flight in flights:
        if flight.motors_kind != "command":
            continue
        at_limit: NDArray[np.bool_] = np.asarray((flight.motors.values >= _SATURATED).any(axis=1))
        if at_limit.any() and not saturated:
            first_s = float(flight.motors.t_s[np.argmax(at_limit)])
        samples += len(at_limit)
        saturated += int(at_limit.sum())
    return Saturation(saturated / samples if samples else 0.0, first_s)


def note_saturation(flights: Sequence[FlightLog], file: LogFile) -> None:
    """Note motors at their limit; refuse flights that are at it most of the time."""
    found = saturation_of(flights)
    topic = file.topic("motors")
    message = f"is at full command in {found.share:.0%} of the flight, first at {found.first_s:.2f} s"
    if found.share > 0.5:
        hint = "there it tells nothing of the thrust's curve: fly lighter, slower, or with a charged battery"
        raise file.refuse(message, hint, topic=topic)
    if found.share > _NOTED_SATURATION:
        file.note(message, "a lighter vehicle or gentler flight tells more of the thrust's curve", topic=topic)


def _intervals(t_s: NDArray[np.float64], mask: NDArray[np.bool_]) -> list[Interval]:
    """Return first and last time of each stretch where the mask holds."""
    edges = np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [(float(t_s[a]), float(t_s[b])) for a, b in zip(starts, ends, strict=True)]


def _above_ground(log: FlightLog, file: LogFile, up: Interval) -> tuple[Interval | None, float | None]:
    """Return the part between take-off and landing, and the ground's height before take-off, else after landing.

    A log that begins or ends in the air is not cut there; one that does both does not show the ground.
    """
    start_s, end_s = up
    began_in_air = start_s - log.motors.t_s[0] < 0.2
    ended_in_air = log.motors.t_s[-1] - end_s < 0.2
    if log.pose is None:
        cut = (
            start_s if began_in_air else start_s + _WITHOUT_HEIGHT_S,
            end_s if ended_in_air else end_s - _WITHOUT_HEIGHT_S,
        )
        return (cut if cut[1] - cut[0] > 0.0 else None), None
    clear_m = 1.5 * file.vehicle.bounding_radius_m
    part = log.pose.between(start_s, end_s)
    if not len(part):
        return None, None
    z_m = part.values[:, 2]
    stands_m = []
    if not began_in_air:
        stands_m.append(_ground_m(log.pose, start_s - 0.3, start_s + 0.3))
        start_s = _first_above(part.t_s, z_m, stands_m[-1] + clear_m)
    if not ended_in_air:
        stands_m.append(_ground_m(log.pose, end_s - 0.3, end_s + _FALL_S))
        end_s = -_first_above(-part.t_s[::-1], z_m[::-1], stands_m[-1] + clear_m) - _LANDING_S
    ground_m = stands_m[0] - _standing_height_m(file) if stands_m else None
    if end_s > start_s:
        return (start_s, end_s), ground_m
    rise_m = float(z_m.max() - min(stands_m)) if stands_m else 0.0
    message = f"rises {rise_m:.3g} m with the motors up from {up[0]:.2f} to {up[1]:.2f} s"
    hint = f"flight begins at {clear_m:.2g} m; if it flew higher, check the unit of the height"
    file.note(message, hint, topic=file.topic("pose"))
    return None, ground_m


def _standing_height_m(file: LogFile) -> float:
    """Return how high the vehicle's origin is above the ground on which it stands."""
    spheres = file.vehicle.feet or file.vehicle.hull
    return max((sphere.radius_m - sphere.position_m[2] for sphere in spheres), default=0.0)


def _first_above(t_s: NDArray[np.float64], z_m: NDArray[np.float64], limit_m: float) -> float:
    above = z_m > limit_m
    return float(t_s[np.argmax(above)]) if above.any() else float("inf")


def _ground_m(pose: Series, start_s: float, end_s: float) -> float:
    """Return the lowest height in a time in which the vehicle stands."""
    near = pose.between(start_s, end_s)
    source = near if len(near) else pose
    return float(np.min(source.values[:, 2]))


def _without_crashes(log: FlightLog, file: LogFile, flight: Interval, up_until_s: float) -> list[Interval]:
    """Return the parts before and after each blow; those below the clearance, until the motors stop, count as well."""
    limit_mps2 = _CRASH_FACTOR * greatest_specific_force_mps2(file.vehicle)
    found: list[tuple[float, str, str]] = []
    if log.accel is not None:
        part = log.accel.between(flight[0], max(flight[1], up_until_s))
        if len(part) > 2:
            width = max(1, round(_CRASH_MEAN_S / float(np.median(np.diff(part.t_s)))))
            kernel = np.full(width, 1.0 / width)
            mean = np.stack([np.convolve(c, kernel, "same") for c in part.values.T], axis=1)
            limits_mps2 = np.where(part.t_s > flight[1], _LANDING_FACTOR * limit_mps2, limit_mps2)
            for start_s, _ in _intervals(part.t_s, np.linalg.norm(mean, axis=1) > limits_mps2):
                found.append((start_s, f"a blow of more than {limit_mps2:.0f} m/s2", file.topic("accel")))
    if log.pose is not None:
        part = log.pose.between(*flight)
        x, y = part.values[:, 4], part.values[:, 5]
        inverted = [
            i for i in _intervals(part.t_s, 1.0 - 2.0 * (x * x + y * y) < _INVERTED_COS) if i[1] >= flight[1] - 1.0
        ]
        found += [(start_s, "the vehicle on its back until the end", file.topic("pose")) for start_s, _ in inverted]
    kept: list[Interval] = []
    start_s, end_s = flight
    for at_s, what, topic in sorted(found):
        if at_s < start_s:
            continue
        cut_s = min(at_s - _BEFORE_CRASH_S, flight[1])
        if cut_s > start_s:
            kept.append((start_s, cut_s))
        start_s = at_s + _AFTER_CRASH_S
        hint = f"the flight is used up to {cut_s:.2f} s"
        if end_s - start_s < _AFTERMATH_S:
            file.note(f"shows a crash at {at_s:.2f} s: {what}", hint, topic=topic)
            return kept
        file.note(f"shows a collision at {at_s:.2f} s: {what}", f"{hint}, and from {start_s:.2f} s", topic=topic)
    kept.append((start_s, end_s))
    return kept


def _without_gaps(log: FlightLog, file: LogFile, flight: Interval) -> list[Interval]:
    """Return the parts between gaps; each stretch without one of the series is left out."""
    gaps: list[tuple[float, float]] = []
    for name in ("motors", "rate", "accel", "pose"):
        series: Series | None = getattr(log, name)
        if series is None:
            continue
        part = series.between(*flight)
        if len(part) < 2:
            message = f"has no values in the flight from {flight[0]:.2f} to {flight[1]:.2f} s"
            file.note(message, "log it in flight, too; this flight is not used", topic=file.topic(name))
            return []
        steps = np.diff(part.t_s)
        longest_s = max(_GAP_S, _GAP_SAMPLES * float(np.median(steps)))
        own = [(float(part.t_s[i]), float(part.t_s[i + 1])) for i in np.flatnonzero(steps > longest_s)]
        ends = [(flight[0], float(part.t_s[0])), (float(part.t_s[-1]), flight[1])]
        own += [(a, b) for a, b in ends if b - a > longest_s]
        if own:
            worst = max(own, key=lambda gap: gap[1] - gap[0])
            total_s = sum(b - a for a, b in own)
            message = f"has a gap from {worst[0]:.2f} to {worst[1]:.2f} s"
            if len(own) > 1:
                message = f"has {len(own)} gaps of {total_s:.2f} s in all; the longest is {message[6:]}"
            hint = "the flight is split there; a faster card or fewer topics avoid gaps"
            file.note(message, hint, topic=file.topic(name))
        gaps += own
    repeated = _repeated(log, flight)
    if repeated:
        worst = max(repeated, key=lambda gap: gap[1] - gap[0])
        total_s = sum(b - a for a, b in repeated)
        longest = f"longest from {worst[0]:.2f} to {worst[1]:.2f} s"
        message = f"repeats its values, as the pose does, for {total_s:.2f} s, {longest}"
        hint = "the flight is split there; log on board, or look after the radio link"
        file.note(message, hint, topic=file.topic("rate"))
    gaps += repeated
    kept: list[Interval] = []
    start_s = flight[0]
    for a, b in sorted(gaps):
        if a - start_s >= _SHORTEST_S:
            kept.append((start_s, a))
        start_s = max(start_s, b)
    if flight[1] - start_s >= _SHORTEST_S:
        kept.append((start_s, flight[1]))
    return kept


def _repeated(log: FlightLog, flight: Interval) -> list[Interval]:
    """Return the stretches in which gyro and pose both keep their last values."""
    if log.rate is None or log.pose is None:
        return []
    rate, pose = (_same(series.between(*flight)) for series in (log.rate, log.pose))
    both = [(max(a, c), min(b, d)) for a, b in rate for c, d in pose]
    return [(a, b) for a, b in both if b - a > _REPEATED_S]


def _same(series: Series) -> list[Interval]:
    """Return the stretches of one value for longer than `_REPEATED_S`, until the next one comes."""
    changes = np.flatnonzero((np.diff(series.values, axis=0) != 0.0).any(axis=1)) + 1
    edges = np.concatenate([[0], changes, [max(len(series) - 1, 0)]])
    first_s, last_s = series.t_s[edges[:-1]], series.t_s[edges[1:]]
    long = last_s - first_s > _REPEATED_S
    return [(float(a), float(b)) for a, b in zip(first_s[long], last_s[long], strict=True)]
