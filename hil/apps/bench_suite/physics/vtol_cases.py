"""Rows and checks of VTOLs: ten seconds of random commands against plane_reference.py, error beside time.

    tiltrotor: transition, gusty     from hover; tilts jump anywhere in their range, past full speed of their servos
    tiltrotor: ahead, gusty          from trimmed flight, the same commands
    tailsitter: hover, gusty         from hover with the nose up
    two sets of rotors, tilts, gusty from hover; a tiltrotor with two rotors of another propeller, one on a tilt

Commands jump every 0.03 to 0.5 s, each by itself: rotors about hover, tilts and surfaces over their whole range, so
that the vehicle turns over. A tick's cost is compared with that of the same vehicle without tilts, in turns.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.physics.flight_cases import TICK_S
from hil.apps.bench_suite.physics.plane_cases import GUSTY, HEIGHT_M, SECONDS, PlaneFlight, measured, random_commands
from hil.apps.bench_suite.result import Check, Row, ShowStatus
from hil.apps.bench_suite.timing import best_times
from sim.physics import multirotor
from sim.physics.fixed_wing import Airframe
from sim.physics.vehicle import Vehicle, load_vehicle

Float64 = NDArray[np.float64]


def two_sets(name: str) -> Vehicle:
    """Return a vehicle whose last rotors are a set of another propeller: larger, slower, with other blades."""
    data = load_vehicle(name).model_dump()
    c = data["rotor_constants"]
    others = c | {
        "thrust_coefficient_n_per_radps2": 1.6 * c["thrust_coefficient_n_per_radps2"],
        "max_speed_radps": 0.8 * c["max_speed_radps"],
        "moment_ratio_m": 0.8 * c["moment_ratio_m"],
        "radius_m": 1.15 * c["radius_m"],
        "inertia_kgm2": 1.5 * c["inertia_kgm2"],
        "time_constant_up_s": 2.0 * c["time_constant_up_s"],
    }
    data["rotor_sets"] = {"others": {"rotor_model": data["rotor_model"], "rotor_constants": others}}
    data["rotors"] = [*data["rotors"][:2], *({**rotor, "set": "others"} for rotor in data["rotors"][2:])]
    return Vehicle.model_validate(data)


def hover_commands(vehicle: Vehicle, seconds: float, seed: int) -> Float64:
    """Return random commands, of the rotors about hover."""
    hover = multirotor.hover_control(vehicle)
    return random_commands(vehicle, seconds, seed, rotors=(0.7 * hover, 1.3 * hover))


@dataclass(frozen=True)
class VtolFlight(PlaneFlight):
    """A flight of a VTOL from hover, or from trimmed flight ahead."""

    ahead: bool = False

    @cached_property
    def start_state(self) -> Float64:
        """State from which the flight begins: p, q, v, w, rotors, tilts, surfaces."""
        vehicle = self.vehicle
        most = np.array([c.max_speed_radps for c in vehicle.constants_of_rotors])
        count = len(vehicle.rotors)
        state = np.zeros(13 + len(vehicle.commands))
        state[2], state[3] = HEIGHT_M, 1.0
        if self.ahead:
            airframe = Airframe(vehicle)
            trim = airframe.trim(airframe.cruise_mps)
            state[7:10] = trim.v_B_mps
            state[13 : 13 + count] = np.maximum(0.1, np.array(trim.controls[:count])) * most
            for k, tilt in enumerate(vehicle.tilts):
                state[13 + count + k] = tilt.ahead_rad(vehicle.rotors)
        else:
            state[3:7] = vehicle.standing_quat(0.3)
            state[7] = 2.0
            state[13 : 13 + count] = [vehicle.hover_speeds_radps()[i] for i in range(count)]
        return state


def cases(seconds: float) -> dict[str, VtolFlight]:
    """Return the flights by name."""
    tiltrotor, tailsitter, other = load_vehicle("tiltrotor"), load_vehicle("tailsitter"), two_sets("tiltrotor")
    return {
        "tiltrotor: transition, gusty": VtolFlight(tiltrotor, hover_commands(tiltrotor, seconds, 1), wind=GUSTY),
        "tiltrotor: ahead, gusty": VtolFlight(tiltrotor, hover_commands(tiltrotor, seconds, 2), wind=GUSTY, ahead=True),
        "tailsitter: hover, gusty": VtolFlight(tailsitter, hover_commands(tailsitter, seconds, 3), wind=GUSTY),
        "two sets of rotors, tilts, gusty": VtolFlight(other, hover_commands(other, seconds, 4), wind=GUSTY),
    }


def vtol_rows(status: ShowStatus, *, quick: bool) -> tuple[list[Row], list[Check]]:
    """Measure all cases."""
    rows: list[Row] = []
    worst = 0.0
    for case, flight in cases(2.0 if quick else SECONDS).items():
        status(case)
        more, error = measured(case, flight, quick=quick)
        rows += more
        worst = max(worst, error)
    status("cost of tilts")
    cost = Check(
        "tiltrotor: processor time of a tick over that without tilts", _cost(quick=quick), "<=", 1.5, "x", "speed"
    )
    return rows, [Check("VTOLs, random commands, tilts, gusts: position error", worst, "<=", 1e-6, "m"), cost]


def _cost(*, quick: bool) -> float:
    tilting = load_vehicle("tiltrotor")
    rigid = tilting.model_copy(update={"tilts": ()})
    runs: dict[str, Any] = {}
    for name, vehicle in (("tilting", tilting), ("rigid", rigid)):
        hold = np.tile(np.array(vehicle.rest_commands), (round(5.0 / TICK_S), 1))
        hold[:, : len(vehicle.rotors)] = multirotor.hover_control(vehicle)
        runs[name] = partial(VtolFlight(vehicle, hold).fly, record=False)
    times = best_times(runs, rounds=2 if quick else 7)
    return times["tilting"] / times["rigid"]
