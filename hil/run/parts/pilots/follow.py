"""The section `follow`: flies the set-points of a logged flight, and compares the two flights.

    before     the vehicle climbs to the height at which the followed time begins, and flies to the first set-point
    following  once it has been there and slow for a second, or 20 s after it reached the height: the set-point of each
               instant, 50 a second, with the pilot of companions (OFFBOARD, or GUIDED on ArduPilot)
    after      it lands where the last set-point is

Both flights have the same time from there on: time of the log = simulated time - `time_offset_s`. The real flight is
recorded as /followed/pose, /velocity, /angular_velocity and /set_point, 50 times a second.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from firmware_bridge.ground_station.phased_flight import Phase
from hil.config import Bench
from hil.run.follow.course import RATE_HZ, measured_velocity, pose_at, sampled
from hil.run.follow.difference import Motion, delay_s, differences, greatest, rms
from hil.run.follow.flight import FollowedFlight, followed_flight, refuse_obstacle
from hil.run.offboard import PilotedPart, offboard_pilot
from hil.run.part import Part, RunContext
from hil.run.report.page import Report
from hil.run.verdict.clearance import Clearance, vehicle_radius_m
from hil.run.verdict.verdict import Row, Verdict
from signals.desired import DesiredState
from signals.samples import FollowedSample, TruthState, Vec3
from signals.time import NS_PER_S
from signals.units import DEG_PER_RAD
from sim.scene.wind import Wind

Rows = NDArray[np.float64]

PORT = "followed"
_PERIOD_NS = NS_PER_S // RATE_HZ
_STALE_S = 1.0
_NEAR_M, _SLOW_MPS = 1.0, 0.3  # at the first set-point; an estimator with GPS may be off by the first
_STAYS_NS = NS_PER_S
_PATIENCE_NS = 20 * NS_PER_S  # at the height of the beginning
_CLIMBED_M = 0.3
_BESIDE_M = 1.0  # between two places of the course that are held against the scene
_MOST_PLACES = 2000

_JUDGED = (  # key of the section, reason, unit
    ("position_rms_m", "position differs by {} rms", "m"),
    ("position_max_m", "position differs by up to {}", "m"),
    ("velocity_rms_mps", "velocity differs by {} rms", "m/s"),
    ("attitude_rms_deg", "attitude differs by {} rms", "deg"),
)


class FollowPart(PilotedPart):
    name = "follow"
    _run: RunContext  # from `open` on

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._flight = followed_flight(bench)
        log, course = self._flight.log, self._flight.course
        at_s = self._flight.begin_s + course.t_s
        assert log.pose is not None
        pose = pose_at(log.pose, at_s)
        rate = None if log.rate is None or not len(log.rate) else sampled(log.rate, at_s)
        self._real = Motion(
            p_WB=pose[:, :3] + np.asarray(self._flight.shift_m),
            q_WB=pose[:, 3:],
            v_WB_W=measured_velocity(log, at_s),
            w_WB_B=np.full_like(course.p_W, np.nan) if rate is None else rate,
        )
        self._log_hash = _digest(log.source)
        self._climbed_ns: int | None = None
        self._there_ns: int | None = None  # since when it is at the first set-point
        self._began_ns: int | None = None
        self._next = 0  # set-point of the course
        self._due_ns = 0  # of the next set-point before and after the course
        self._flown: list[tuple[float, ...]] = []  # the simulated flight at the times of the set-points

    # -- the run ----------------------------------------------------------------------------------------------------

    def open(self, run: RunContext) -> None:
        self._run = run
        _check_room(self._flight, self._bench, run)
        for note in self._flight.notes:
            run.event("status", note)
        run.event("status", f"follows {self._flight.log.source}: {self._flight.course.words}")

    def build(self, run: RunContext) -> None:
        takeoff_m = self._flight.takeoff_height_m
        self._pilot = offboard_pilot(
            self._bench, run, setpoint_hz=RATE_HZ, stale_s=_STALE_S, takeoff_height_m=takeoff_m
        )

    def command_sources(self) -> list[OffboardPilot]:
        return [] if self._pilot is None else [self._pilot]

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [self._observe]

    def _observe(self, truth: TruthState) -> None:
        """Give the pilot the set-point of this tick, and keep both flights at the set-points' instants."""
        pilot = self._pilot
        assert pilot is not None
        t_ns = truth.t_ns
        if self._began_ns is None and pilot.phase is Phase.FLYING and self._is_there(truth):
            self._began_ns = t_ns
            offset_s = t_ns / NS_PER_S - self._flight.begin_s
            self._run.event("status", f"follows the log from its {self._flight.begin_s:.2f} s on ({offset_s:+.2f} s)")
        course = self._flight.course
        if self._began_ns is not None and self._next < len(course.t_s):
            if t_ns >= self._began_ns + self._next * _PERIOD_NS:
                self._follow(truth, self._began_ns + self._next * _PERIOD_NS)
            return
        if t_ns >= self._due_ns:
            self._due_ns = t_ns + _PERIOD_NS
            after = self._began_ns is not None
            pilot.set_desired(DesiredState(land=True) if after else self._to_the_beginning(truth), t_ns)

    def _is_there(self, truth: TruthState) -> bool:
        """Return True once the course may begin."""
        first = self._flight.course.p_W[0]
        if self._climbed_ns is None:
            if truth.p_WB[2] < first[2] - _CLIMBED_M:
                return False
            self._climbed_ns = truth.t_ns
        if truth.t_ns - self._climbed_ns >= _PATIENCE_NS:
            return True
        if math.dist(truth.p_WB, first) > _NEAR_M or math.hypot(*truth.v_WB_W) > _SLOW_MPS:
            self._there_ns = None
            return False
        if self._there_ns is None:
            self._there_ns = truth.t_ns
        return truth.t_ns - self._there_ns >= _STAYS_NS

    def _to_the_beginning(self, truth: TruthState) -> DesiredState:
        """Return the set-point before the course: straight up, then to its first place."""
        course = self._flight.course
        x, y, z = course.p_W[0].tolist()
        if self._climbed_ns is None and truth.p_WB[2] < z - _CLIMBED_M:
            x, y, _ = self._bench.config.start.p_W
        return DesiredState(p_W=(x, y, z), yaw_rad=float(course.yaw_rad[0]))

    def _follow(self, truth: TruthState, due_ns: int) -> None:
        assert self._pilot is not None
        course, real, k = self._flight.course, self._real, self._next
        p = _vec3(course.p_W[k])
        desired = DesiredState(
            p_W=p,
            v_W=_vec3(course.v_W[k]),
            a_W=_vec3(course.a_W[k]),
            yaw_rad=float(course.yaw_rad[k]),
            yaw_rate_radps=float(course.yaw_rate_radps[k]),
        )
        self._pilot.set_desired(desired, truth.t_ns, due_ns)
        self._next += 1
        self._flown.append((*truth.p_WB, *truth.q_WB, *truth.v_WB_W, *truth.w_WB_B))
        w, x, y, z = real.q_WB[k].tolist()
        sample = FollowedSample(
            k, due_ns, truth.t_ns, _vec3(real.p_WB[k]), (w, x, y, z), _vec3(real.v_WB_W[k]), _vec3(real.w_WB_B[k]), p
        )
        self._run.recorder.sample(PORT, sample)

    # -- the results ------------------------------------------------------------------------------------------------

    def _simulated(self) -> Motion:
        rows = np.array(self._flown, np.float64).reshape(-1, 13)
        return Motion(rows[:, :3], rows[:, 3:7], rows[:, 7:10], rows[:, 10:])

    def _real_so_far(self) -> Motion:
        n = len(self._flown)
        real = self._real
        return Motion(real.p_WB[:n], real.q_WB[:n], real.v_WB_W[:n], real.w_WB_B[:n])

    def _figures(self) -> dict[str, Any]:
        """Return the numbers of run.json that tell how the flights differ."""
        t_s = self._flight.course.t_s[: len(self._flown)]
        simulated, real = self._simulated(), self._real_so_far()
        d = differences(t_s, simulated, real)
        figures: dict[str, Any] = {"position_mean_m": d.by_axis_m.mean(axis=0).tolist() if len(t_s) else None}
        for name, values in (
            ("position_m", d.position_m),
            ("velocity_mps", d.velocity_mps),
            ("attitude_deg", d.attitude_deg),
            ("rate_degps", d.rate_radps * DEG_PER_RAD),
        ):
            what, _, unit = name.rpartition("_")
            figures[f"{what}_rms_{unit}"], figures[f"{what}_max_{unit}"] = rms(values), greatest(values)
        return figures | {"delay_s": delay_s(t_s, simulated.p_WB, real.p_WB)}

    @property
    def _followed_s(self) -> float:
        return max(len(self._flown) - 1, 0) / RATE_HZ

    @property
    def _completed(self) -> bool:
        return len(self._flown) == len(self._flight.course.t_s)

    def verdict(self) -> Verdict:
        figures, follow = self._figures(), self._bench.config.follow
        rows, reasons = [], []
        for name, what, unit in _JUDGED:
            value, limit = figures[name], getattr(follow, name)
            ok = limit is None or (value is not None and value <= limit)
            rows.append(Row(f"follow_{name}", value, limit, unit, ok))
            if not ok and value is not None:
                measured, allowed = what.format(f"{value:.3g} {unit}"), f"{limit:g} {unit}"
                reasons.append(f"{measured} from the followed flight, more than {allowed}")
        if not self._completed:
            reasons.append(f"followed {self._followed_s:.1f} s of {self._flight.duration_s:.1f} s of the logged flight")
        return Verdict(rows, reasons)

    def run_keys(self) -> dict[str, Any]:
        flight, course = self._flight, self._flight.course
        began_s = None if self._began_ns is None else self._began_ns / NS_PER_S
        return {
            "follow": {
                "log": str(flight.log.source),
                "log_blake2b": self._log_hash,
                "flight": flight.number,
                "flights": flight.flights,
                "set_points": course.topic or "measured trajectory",
                "set_points_words": course.words,
                "measured_share": course.measured,
                "log_from_s": flight.begin_s,
                "log_to_s": flight.end_s,
                "time_offset_s": None if began_s is None else began_s - flight.begin_s,
                "home_in_log_m": list(flight.home_L_m),
                "shift_m": list(flight.shift_m),
                "start_yaw_deg": flight.yaw_rad * DEG_PER_RAD,
                "takeoff_height_m": flight.takeoff_height_m,
                "wind_in_log_mps": None if flight.wind_W_mps is None else list(flight.wind_W_mps),
                "followed_s": self._followed_s,
                "completed": self._completed,
                **self._figures(),
                "notes": list(flight.notes),
            }
        }

    def report(self, run: RunContext) -> Report:
        if len(self._flown) < 2:
            return Report()
        from hil.run.follow.section import follow_report  # matplotlib takes its time

        assert self._began_ns is not None
        return follow_report(
            run.out,
            self._flight,
            simulated=self._simulated(),
            real=self._real_so_far(),
            track=run.recorder.track.arrays(),
            began_s=self._began_ns / NS_PER_S,
            keys=self.run_keys()["follow"],
        )


def _vec3(row: Rows) -> Vec3:
    x, y, z = row.tolist()
    return x, y, z


def _digest(path: Path) -> str:
    """Return the hash of the log, so that a replay with another file is seen."""
    try:
        with open(path, "rb") as opened:
            return hashlib.file_digest(opened, "blake2b").hexdigest()[:32]
    except OSError:
        return ""


def _check_room(flight: FollowedFlight, bench: Bench, run: RunContext) -> None:
    """Refuse set-points in the ground or in an obstacle. Raises ConfigError that names the first one.

    Held against the scene are places of the course `_BESIDE_M` apart or closer: the way between two of them must be
    free, and the vehicle must have room at each. People and other vehicles, which move, are left to the flight.
    """
    p_W = flight.course.p_W
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p_W, axis=0), axis=1))])
    count = min(max(math.ceil(along_m[-1] / _BESIDE_M), 1), _MOST_PLACES)
    places = np.unique(np.searchsorted(along_m, np.linspace(0.0, along_m[-1], count + 1)).clip(0, len(p_W) - 1))
    meter = Clearance(run.part("sensors").scene(run).geometry)
    radius_m = vehicle_radius_m(bench.vehicle)
    before: Vec3 | None = None
    for at in places.tolist():
        here = _vec3(p_W[at])
        if before is not None and meter.is_blocked(before, here):
            raise refuse_obstacle(flight, at, "through the ground or an obstacle")
        if meter.nearest_m(here, 0) < radius_m:
            raise refuse_obstacle(flight, at, f"within {radius_m:.2f} m of the ground or an obstacle")
        before = here


def settled(bench: Bench) -> Bench:
    """Return the bench with the heading at take-off of its followed flight and, if asked for, that day's wind."""
    flight = followed_flight(bench)
    start = bench.config.start.model_copy(update={"yaw_deg": flight.yaw_rad * DEG_PER_RAD})
    update: dict[str, Any] = {"start": start}
    if bench.config.follow.wind == "log" and flight.wind_W_mps is not None:
        wind = bench.config.wind or Wind()
        update["wind"] = wind.model_copy(update={"steady_W_mps": flight.wind_W_mps})
    return replace(bench, config=bench.config.model_copy(update=update))


def make(bench: Bench) -> Part:
    return FollowPart(bench)
