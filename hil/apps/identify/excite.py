"""Writes a mission that makes a vehicle's parameters visible, within limits: `hil identify --excite`.

    acceleration   a = min(share of g tan(tilt), what the thrust leaves at that tilt)
    speed on legs  v = sqrt(a L / 2): half of a leg of length L accelerates, a quarter each end brakes
    sideways       the heading stays north; legs to east and west roll the vehicle, to north and south pitch it
    turns of yaw   headings alternate by 120 degrees at each point
    climbs         between the lower and the upper height at the vehicle's climb and sink rates

Each end of a leg is a doublet of the attitude: the vehicle tilts one way to brake and the other to leave.

Firmware turns in two ways. PX4 and the mock take the heading from the waypoint, and PX4 refuses a mission with
CONDITION_YAW; ArduCopter ignores the waypoint's heading and takes CONDITION_YAW. Its holds are whole seconds, and 0
rounds the corner. So there are two plans, each with a script that sets the firmware's own limits of speed and jerk.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from signals.documents.yaml_lines import dump_yaml
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics.multirotor import hover_control
from sim.physics.vehicle import Vehicle

_EARTH_RADIUS_M = 6378137.0
_TILT_DEG = 25.0  # autopilots allow 35 or more; the rest is for gusts
_TILT_LIMIT_DEG = 45.0  # of the flight's verdict: a controller overshoots
_THRUST_RESERVE = 0.8  # of full thrust, in the tilted flight
_MOST_SPEED_MPS, _SLOW_MPS = 10.0, 3.0
_CLIMB_MPS, _SINK_MPS = 3.0, 1.5  # within the default limits of PX4 and ArduCopter
_DOUBLET_M = 5.0
_REPEATS = 4
_YAW_DEG = (0.0, 120.0, 240.0, 120.0)

MANOEUVRES = {
    "roll": "legs of {doublet:g} m to east and west with the nose north: each end rolls the vehicle to and fro",
    "pitch": "legs of {doublet:g} m to north and south with the nose north: each end pitches the vehicle to and fro",
    "yaw": "turns of 120 degrees on the spot, to both sides",
    "climb": "climbs and descents between {low:g} and {high:g} m",
    "legs": "straight legs to and fro over {leg:g} m, at {slow:g} and at {fast:.1f} m/s, along both axes",
}
_TAKE_OFF, _WAYPOINT, _LAND, _SPEED, _YAW = 22, 16, 21, 178, 115


@dataclass(frozen=True)
class Limits:
    """Space for the flight about its start: half the side of a square, and the greatest height [m]."""

    room_m: float = 20.0
    ceiling_m: float = 15.0


@dataclass(frozen=True)
class ExciteFiles:
    """A plan and a script that flies it for each firmware, and how they were derived, a line for each manoeuvre."""

    plans: Sequence[Path]
    scripts: Sequence[Path]
    derivation: Sequence[str]


@dataclass(frozen=True)
class _Dialect:
    """Form of a mission for one firmware. `stem`: of its files; `turns`: by CONDITION_YAW; `least_hold_s`: shortest."""

    stem: str
    turns: bool
    least_hold_s: float
    parameters: Callable[[float], Mapping[str, float]]


def _px4_parameters(a_mps2: float) -> Mapping[str, float]:
    return {
        "MPC_ACC_HOR": round(max(a_mps2, 2.0), 2),
        "MPC_JERK_AUTO": 20.0,  # 4 by default, which smooths the doublets away
        "MPC_Z_V_AUTO_UP": _CLIMB_MPS,
        "MPC_Z_V_AUTO_DN": _SINK_MPS,
    }


def _ardupilot_parameters(a_mps2: float) -> Mapping[str, float]:
    return {
        "WPNAV_ACCEL": round(100.0 * max(a_mps2, 2.0), 0),  # cm/s2
        "WPNAV_JERK": 20.0,  # 1 m/s3 by default
        "PSC_JERK_XY": 20.0,
        "WPNAV_SPEED_UP": 100.0 * _CLIMB_MPS,
        "WPNAV_SPEED_DN": 100.0 * _SINK_MPS,
        "WP_YAW_BEHAVIOR": 0.0,  # keeps the heading of CONDITION_YAW through the next waypoint
    }


_DIALECTS = (
    _Dialect("excite", turns=False, least_hold_s=0.0, parameters=_px4_parameters),
    _Dialect("excite_ardupilot", turns=True, least_hold_s=1.0, parameters=_ardupilot_parameters),
)


def manoeuvre_text(name: str) -> str:
    """Return in words which manoeuvre shows a parameter; "" for an unknown name."""
    values = {"doublet": _DOUBLET_M, "low": 5.0, "high": 15.0, "leg": 40.0, "slow": _SLOW_MPS, "fast": _MOST_SPEED_MPS}
    return MANOEUVRES[name].format(**values) if name in MANOEUVRES else ""


def write_excitation(
    out: Path,
    vehicle: Vehicle,
    manoeuvres: Sequence[str],
    *,
    limits: Limits,
    home_deg: tuple[float, float],
    why: Sequence[str],
) -> ExciteFiles:
    """Write each dialect's plan and script into `out`. `why`: lines on the choice. Raises OSError."""
    a_mps2 = acceleration_mps2(vehicle)
    low_m = max(0.4 * limits.ceiling_m, 2.0)
    leg_m = 1.6 * limits.room_m
    fast_mps = min(math.sqrt(0.5 * a_mps2 * leg_m), _MOST_SPEED_MPS)
    values = {
        "doublet": min(_DOUBLET_M, limits.room_m),
        "low": low_m,
        "high": 0.9 * limits.ceiling_m,
        "leg": leg_m,
        "slow": min(_SLOW_MPS, fast_mps),
        "fast": fast_mps,
    }
    derivation = [
        *why,
        f"acceleration {a_mps2:.1f} m/s2: {_TILT_DEG:g} degrees of tilt, and {_THRUST_RESERVE:.0%} of full thrust "
        f"(it hovers at {_hover_share(vehicle):.0%})",
        *(f"{name}: {MANOEUVRES[name].format(**values)}" for name in manoeuvres),
    ]
    plans, scripts = [], []
    for dialect in _DIALECTS:
        items = _Items(home_deg, dialect)
        items.take_off(low_m)
        items.turn(0.0)
        for name in manoeuvres:
            _ADD[name](items, values)
        items.land()
        plan, script = out / f"{dialect.stem}.plan", out / f"{dialect.stem}.yaml"
        plan.write_text(json.dumps(items.plan(), indent=1) + "\n", encoding="utf-8")
        script.write_text(_script(vehicle, derivation, dialect, a_mps2, limits), encoding="utf-8")
        plans.append(plan)
        scripts.append(script)
    return ExciteFiles(plans, scripts, derivation)


def acceleration_mps2(vehicle: Vehicle) -> float:
    """Return the horizontal acceleration of the doublets, which the vehicle can hold without sinking."""
    # Of full thrust T a share s stays usable: s T cos(tilt) >= m g, so cos(tilt) >= hover share / s.
    cosine = min(_hover_share(vehicle) / _THRUST_RESERVE, 0.995)
    tilt = min(math.radians(_TILT_DEG), math.acos(cosine))
    return STANDARD_GRAVITY_MPS2 * math.tan(tilt)


def _hover_share(vehicle: Vehicle) -> float:
    """Return weight over full thrust."""
    u, f = hover_control(vehicle), vehicle.rotor_constants.thrust_model_factor
    return f * u * u + (1.0 - f) * u


class _Items:
    """Items of a plan, in metres east and north of home and above it."""

    def __init__(self, home_deg: tuple[float, float], dialect: _Dialect) -> None:
        self._home, self._dialect = home_deg, dialect
        self._items: list[dict[str, Any]] = []
        self._height_m = 0.0

    def _add(self, command: int, frame: int, params: Sequence[float | None]) -> None:
        number = len(self._items) + 1
        item = {"autoContinue": True, "command": command, "doJumpId": number, "frame": frame, "params": list(params)}
        self._items.append({**item, "type": "SimpleItem"})

    def _place(self, east_m: float, north_m: float) -> tuple[float, float]:
        latitude, longitude = self._home
        north_deg = math.degrees(north_m / _EARTH_RADIUS_M)
        east_deg = math.degrees(east_m / (_EARTH_RADIUS_M * math.cos(math.radians(latitude))))
        return round(latitude + north_deg, 8), round(longitude + east_deg, 8)

    def take_off(self, height_m: float) -> None:
        self._height_m = height_m
        self._add(_TAKE_OFF, 3, [0, 0, 0, None, *self._home, height_m])

    def land(self) -> None:
        self.to(0.0, 0.0)
        self._add(_LAND, 3, [0, 0, 0, None, *self._home, 0])

    def speed(self, mps: float) -> None:
        self._add(_SPEED, 2, [1, round(mps, 2), -1, 0, 0, 0, 0])

    def to(
        self,
        east_m: float,
        north_m: float,
        height_m: float | None = None,
        *,
        yaw_deg: float | None = 0.0,
        hold_s: float = 0.0,
    ) -> None:
        self._height_m = self._height_m if height_m is None else height_m
        hold_s = max(hold_s, self._dialect.least_hold_s)
        self._add(_WAYPOINT, 3, [hold_s, 0.5, 0, yaw_deg, *self._place(east_m, north_m), round(self._height_m, 2)])

    def turn(self, yaw_deg: float) -> None:
        """Turn, where the next waypoint's heading does not."""
        if self._dialect.turns:
            self._add(_YAW, 2, [yaw_deg, 0, 0, 0, 0, 0, 0])

    def plan(self) -> dict[str, Any]:
        return {
            "fileType": "Plan",
            "geoFence": {"circles": [], "polygons": [], "version": 2},
            "groundStation": "hil identify --excite",
            "mission": {
                "cruiseSpeed": 5, "firmwareType": 12, "globalPlanAltitudeMode": 1, "hoverSpeed": 5,
                "items": self._items, "plannedHomePosition": [*self._home, 0], "vehicleType": 2, "version": 2,
            },
            "rallyPoints": {"points": [], "version": 2},
            "version": 1,
        }  # fmt: skip


def _doublets(items: _Items, values: dict[str, float], east: float, north: float) -> None:
    items.to(0.0, 0.0, values["low"])
    items.speed(values["fast"])
    for k in range(2 * _REPEATS):
        sign = 0.5 * values["doublet"] * (1.0 if k % 2 == 0 else -1.0)
        # A short stop makes the autopilot brake at the end instead of rounding it.
        items.to(sign * east, sign * north, hold_s=0.5)
    items.to(0.0, 0.0, hold_s=1.0)


def _roll(items: _Items, values: dict[str, float]) -> None:
    _doublets(items, values, 1.0, 0.0)


def _pitch(items: _Items, values: dict[str, float]) -> None:
    _doublets(items, values, 0.0, 1.0)


def _yaw(items: _Items, values: dict[str, float]) -> None:
    items.to(0.0, 0.0, values["low"])
    for yaw_deg in _YAW_DEG * 2:
        items.turn(yaw_deg)
        items.to(0.0, 0.0, yaw_deg=yaw_deg, hold_s=0.5)
    items.turn(0.0)


def _climb(items: _Items, values: dict[str, float]) -> None:
    for _ in range(3):
        items.to(0.0, 0.0, values["high"])
        items.to(0.0, 0.0, values["low"])


def _legs(items: _Items, values: dict[str, float]) -> None:
    half = 0.5 * values["leg"]
    for mps in (values["slow"], values["fast"]):
        items.speed(mps)
        for east, north in ((half, 0.0), (-half, 0.0), (0.0, half), (0.0, -half)):
            items.to(east, north, hold_s=0.5)
    items.to(0.0, 0.0, hold_s=1.0)


_ADD = {"roll": _roll, "pitch": _pitch, "yaw": _yaw, "climb": _climb, "legs": _legs}


def _script(vehicle: Vehicle, derivation: Sequence[str], dialect: _Dialect, a_mps2: float, limits: Limits) -> str:
    """Return the mission script: agile set-points, wide limits on the path, narrow ones on space and tilt."""
    head = "".join(f"# {line}\n" for line in ("Excitation for `hil identify`, derived as follows.", *derivation))
    parameters = dialect.parameters(a_mps2)
    data = {
        "description": f"Excitation of {vehicle.name} for hil identify",
        "plan": f"{dialect.stem}.plan",
        "actions": [{"at_s": 2.0, "param": {name: value}, "required": False} for name, value in parameters.items()],
        "limits": {"max_cross_track_m": 3.0, "altitude_error_m": 2.0, "final_error_m": 1.0},
        "expect": [
            {"measure": "max_tilt_deg", "at_most": _TILT_LIMIT_DEG},
            {"measure": "max_altitude_m", "at_most": limits.ceiling_m},
            {"measure": "max_distance_m", "at_most": limits.room_m * math.sqrt(2.0)},
        ],
    }
    return head + str(dump_yaml(data))
