"""The flight of a log that a run follows: which one, from when to when, and where it lies in W.

    flight    the motors are up (airborne.py) for `_LEAST_FLIGHT_S`, and the vehicle rises `_LEAST_HEIGHT_M`
    followed  from the first to the last time at which it is above the take-off height h over the ground of take-off or
              landing; h is 2 m, or half of the flight's greatest height if that is less. If the vehicle is slow within
              30 s of the first time, from there on: the simulated vehicle begins at rest, too
    aligned   p_W = p_L + (start of the bench - place of take-off in the log L). Both frames are ENU, so nothing is
              turned: east stays east. The vehicle starts with the heading that it had in the log

The place of take-off is where the log's vehicle stands before its motors turn. Of a log that begins in the air it is
the lowest point below which the flight begins, and a note says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.config import Bench
from hil.config.schema import Follow
from hil.run.flight_logs.airborne import Interval, motors_up
from hil.run.flight_logs.flight_log import FlightLog, Series
from hil.run.flight_logs.log_format import LogFile, read_log
from hil.run.flight_logs.rotor_model import steady_speeds_radps, wrench
from hil.run.follow.course import Course, course_of, measured_velocity
from hil.run_files import MCAP_NAME
from signals.errors import ConfigError
from signals.rotation import yaw_of
from signals.samples import Vec3
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics.vehicle import Vehicle

Rows = NDArray[np.float64]

_LEAST_FLIGHT_S, _LEAST_HEIGHT_M = 3.0, 0.3
_TAKEOFF_M = 2.0
_SLOW_MPS, _SLOW_WITHIN_S = 0.5, 30.0
_LEAST_FOLLOWED_S = 2.0
_STANDING_S = 1.0  # before the motors turn
_POSE_GAP_S = 1.0
_JUMP_M, _JUMP_MPS = 1.0, 40.0  # a step of the position by more than both together is no motion
_OTHER_VEHICLE = 4.0  # lift over weight, or weight over lift, of the bench's vehicle with the log's motors
_AROUND_S = 60.0  # simulated time for start, take-off and landing
_ROUND_DIGITS = 6  # of numbers that feed state: last bits of libraries' sines and sums differ between processors


@dataclass(frozen=True)
class FollowedFlight:
    """One flight of a log. Times on the log's own clock, places in W unless they end in L."""

    log: FlightLog
    number: int
    flights: int
    begin_s: float
    end_s: float
    home_L_m: Vec3
    shift_m: Vec3  # p_W = p_L + shift
    yaw_rad: float  # at take-off
    takeoff_height_m: float
    course: Course
    wind_W_mps: Vec3 | None  # mean over the followed time
    notes: Sequence[str]

    @property
    def duration_s(self) -> float:
        return self.end_s - self.begin_s


def followed_flight(bench: Bench) -> FollowedFlight:
    """Return the flight that a bench follows. Raises ConfigError that names topic, time and remedy."""
    follow = bench.config.follow
    assert follow.log is not None
    start, vehicle = bench.config.start.p_W, bench.vehicle
    stand_W = (start[0], start[1], start[2] + vehicle.standing_height_m)
    log = Path(follow.log)
    files = [log / MCAP_NAME if log.is_dir() else log, *([] if follow.columns is None else [Path(follow.columns)])]
    flight, file = _read(follow, vehicle, stand_W, tuple(_stamp(path) for path in files))
    _check_bench(bench, flight, file)
    return flight


def _stamp(path: Path) -> tuple[int, int]:
    """Return what changes when a file is written anew."""
    try:
        stat = path.stat()
    except OSError:
        return 0, 0  # reading it says why
    return stat.st_mtime_ns, stat.st_size


@lru_cache(maxsize=2)
def _read(follow: Follow, vehicle: Vehicle, stand_W: Vec3, stamp: Any) -> tuple[FollowedFlight, LogFile]:
    """Read a log; a run asks for it when it sets up the start and again when it makes its parts."""
    del stamp  # a log that was written anew is another one
    assert follow.log is not None
    columns = None if follow.columns is None else Path(follow.columns)
    file = LogFile(Path(follow.log), vehicle, columns, follow.of)
    log = read_log(file)
    if log.pose is None or not len(log.pose):
        what = "has no set-points and no position" if log.set_points is None else "has set-points, but no position"
        hint = "log the estimator's attitude and position, or give their columns: they tell where the flight lies"
        raise file.refuse(f"{what} with an attitude from {log.start_s:.2f} to {log.end_s:.2f} s", hint)
    flights = _flights(log, log.pose, file)
    number, interval = _chosen(flights, follow, file)
    return _flight(log, log.pose, file, follow, (number, len(flights)), interval, stand_W), file


def _flights(log: FlightLog, pose: Series, file: LogFile) -> list[Interval]:
    """Return the stretches with the motors up that leave the ground."""
    up = motors_up(log, file)
    flown = []
    for start_s, end_s in up:
        z_m = pose.between(start_s, end_s).values[:, 2]
        if end_s - start_s >= _LEAST_FLIGHT_S and len(z_m) and float(np.ptp(z_m)) >= _LEAST_HEIGHT_M:
            flown.append((start_s, end_s))
    if not flown:
        text = f"contains no flight from {log.start_s:.2f} to {log.end_s:.2f} s"
        hint = f"a flight rises {_LEAST_HEIGHT_M:g} m and takes {_LEAST_FLIGHT_S:g} s with the motors up"
        raise file.refuse(text, hint, topic=f"{file.topic('motors')}, {file.topic('pose')}")
    return flown


def _chosen(flights: Sequence[Interval], follow: Follow, file: LogFile) -> tuple[int, Interval]:
    spans = ", ".join(f"{n}: {a:.2f} to {b:.2f} s" for n, (a, b) in enumerate(flights, 1))
    if follow.flight is None:
        if len(flights) > 1:
            raise file.refuse(f"holds {len(flights)} flights ({spans})", "choose one: --flight 1")
        return 1, flights[0]
    if follow.flight > len(flights):
        raise file.refuse(f"holds no flight {follow.flight}, but these: {spans}", "choose one of them: --flight 1")
    return follow.flight, flights[follow.flight - 1]


def _flight(
    log: FlightLog,
    pose: Series,
    file: LogFile,
    follow: Follow,
    number: tuple[int, int],
    interval: Interval,
    stand_W: Vec3,
) -> FollowedFlight:
    start_s, stop_s = interval
    notes = [str(note) for note in file.notes]
    flown = pose.between(start_s, stop_s)
    before = pose.between(start_s - _STANDING_S, start_s)
    if len(before) and start_s - log.motors.t_s[0] >= 0.2:
        home = np.median(before.values[:, :3], axis=0)
        q_WB = before.values[-1, 3:]
    else:
        home = np.array([*flown.values[0, :2], float(flown.values[:, 2].min())])
        q_WB = flown.values[0, 3:]
        notes.append(
            f"the log begins in the air at {start_s:.2f} s: the place of take-off is taken below, at its lowest height"
        )
    z_m = flown.values[:, 2]
    after = pose.between(stop_s, stop_s + 2.0)
    landed = len(after) > 0 and log.motors.t_s[-1] - stop_s >= 0.2
    ground_end_m = float(after.values[-1, 2]) if landed else float(home[2])
    height_m = min(_TAKEOFF_M, 0.5 * (float(z_m.max()) - float(home[2])))
    if height_m < 0.5 * _LEAST_HEIGHT_M:
        text = f"rises {2.0 * height_m:.2f} m above its place of take-off from {start_s:.2f} to {stop_s:.2f} s"
        raise file.refuse(text, "check the height's unit and sign", topic=file.topic("pose"))
    rising, falling = z_m >= home[2] + height_m, z_m >= min(ground_end_m, float(z_m.max()) - height_m) + height_m
    begin_s = _slow_after(log, float(flown.t_s[np.argmax(rising)]), flown.t_s)
    end_s = float(flown.t_s[len(z_m) - 1 - np.argmax(falling[::-1])])
    if end_s - begin_s < _LEAST_FOLLOWED_S:
        text = f"is {end_s - begin_s:.1f} s above {height_m:.1f} m, from {begin_s:.2f} s: too short to follow"
        raise file.refuse(text, f"name a flight of {_LEAST_FOLLOWED_S:g} s", topic=file.topic("pose"))
    _check_pose(pose.between(begin_s, end_s), file)
    _check_vehicle(log.between(begin_s, end_s, log.name), file)
    shift = np.round(np.asarray(stand_W) - home, _ROUND_DIGITS)
    course = course_of(log, begin_s, end_s, shift, measured=follow.set_points == "measured")
    wind_W_mps = _mean_wind(log, begin_s, end_s)
    if follow.wind == "log" and wind_W_mps is None:
        text = f"has no estimate of the wind from {begin_s:.2f} to {end_s:.2f} s"
        raise file.refuse(text, "leave follow.wind out, and set the wind of that day by `wind`", topic="wind")
    return FollowedFlight(
        log=log,
        number=number[0],
        flights=number[1],
        begin_s=begin_s,
        end_s=end_s,
        home_L_m=_vec3(home),
        shift_m=_vec3(shift),
        yaw_rad=round(yaw_of(tuple(q_WB.tolist())), _ROUND_DIGITS),
        takeoff_height_m=round(height_m, _ROUND_DIGITS),
        course=course,
        wind_W_mps=wind_W_mps,
        notes=notes,
    )


def _mean_wind(log: FlightLog, begin_s: float, end_s: float) -> Vec3 | None:
    """Return the mean velocity of the air, to 1 mm/s; None if the log has none in this time."""
    wind = None if log.wind is None else log.wind.between(begin_s, end_s)
    if wind is None or not len(wind):
        return None
    east, north = wind.values.mean(axis=0).tolist()
    return round(east, 3), round(north, 3), 0.0


def _slow_after(log: FlightLog, above_s: float, t_s: Rows) -> float:
    """Return the first time of `t_s` from `above_s` on at which the vehicle is slow; `above_s` if it soon is not."""
    near_s = t_s[(t_s >= above_s) & (t_s <= above_s + _SLOW_WITHIN_S)]
    slow = np.linalg.norm(measured_velocity(log, near_s), axis=1) < _SLOW_MPS
    return float(near_s[np.argmax(slow)]) if slow.any() else above_s


def _vec3(values: Rows) -> Vec3:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _check_pose(pose: Series, file: LogFile) -> None:
    """Refuse a measured flight with gaps or jumps: neither fallback nor comparison would mean anything there."""
    steps_s = np.diff(pose.t_s)
    if len(steps_s) and float(steps_s.max()) > _POSE_GAP_S:
        at = int(np.argmax(steps_s))
        text = f"has a gap from {pose.t_s[at]:.2f} to {pose.t_s[at + 1]:.2f} s"
        hint = "a faster card or fewer topics avoid gaps; name another flight of the log (--flight)"
        raise file.refuse(text, hint, topic=file.topic("pose"))
    moved_m = np.linalg.norm(np.diff(pose.values[:, :3], axis=0), axis=1)
    jumps = np.flatnonzero(moved_m > _JUMP_M + _JUMP_MPS * steps_s)
    if len(jumps):
        text = f"jumps by {moved_m[jumps[0]]:.1f} m at {pose.t_s[jumps[0] + 1]:.2f} s"
        hint = "an estimator that lost its place measured no flight; name another flight of the log (--flight)"
        raise file.refuse(text, hint, topic=file.topic("pose"))


def _check_vehicle(flight: FlightLog, file: LogFile) -> None:
    """Refuse motors that lift several times the bench's vehicle, or cannot lift it at all."""
    vehicle = file.vehicle
    lift_n = float(np.median(wrench(steady_speeds_radps(flight, vehicle), vehicle)[:, 2]))
    ratio = lift_n / (vehicle.mass_kg * STANDARD_GRAVITY_MPS2)
    if not 1.0 / _OTHER_VEHICLE < ratio < _OTHER_VEHICLE:
        text = f"lifts {ratio:.2g} times the weight of {vehicle.name!r} from {flight.start_s:.2f} s"
        hint = "the log is another vehicle's: name that one's file, --set vehicle=FILE"
        raise file.refuse(text, hint, topic=file.topic("motors"))


def _check_bench(bench: Bench, flight: FollowedFlight, file: LogFile) -> None:
    """Refuse a flight that this bench ends before its end."""
    config, course = bench.config, flight.course
    topic = course.topic or file.topic("pose")
    needed_s = flight.duration_s + _AROUND_S
    if needed_s > config.duration_s:
        text = f"flies for {flight.duration_s:.0f} s, from {flight.begin_s:.2f} to {flight.end_s:.2f} s, and with "
        text += f"{_AROUND_S:g} s for start and landing the run ends before, after duration_s: {config.duration_s:g}"
        raise file.refuse(text, f"--set duration_s={needed_s:.0f}", topic=topic)
    start_W = np.asarray(flight.home_L_m) + np.asarray(flight.shift_m)
    away_m = np.linalg.norm(course.p_W - start_W, axis=1)
    limit_m = config.fly_away_m
    if limit_m is not None and float(away_m.max()) > limit_m:
        at = int(np.argmax(away_m > limit_m))
        x, y, z = course.p_W[at]
        text = f"leads {away_m[at]:.0f} m away at {flight.begin_s + course.t_s[at]:.2f} s, to ({x:.0f}, {y:.0f}, "
        text += f"{z:.0f}) m in the scene, and the flight ends at fly_away_m: {limit_m:g}"
        raise file.refuse(text, f"--set fly_away_m={1.2 * float(away_m.max()):.0f}", topic=topic)


def refuse_obstacle(flight: FollowedFlight, at: int, what: str) -> ConfigError:
    """Return the error for a set-point, number `at` of the course, that lies in the ground or in an obstacle."""
    x, y, z = flight.course.p_W[at]
    t_s = flight.begin_s + float(flight.course.t_s[at])
    topic = flight.course.topic or "position"
    return ConfigError.at(
        f"{flight.log.source}: {topic}",
        f"leads {what} at {t_s:.2f} s, at ({x:.1f}, {y:.1f}, {z:.1f}) m in the scene",
        "start elsewhere (start.p_W), or choose a scene with room for it (--scene airfield)",
    )
