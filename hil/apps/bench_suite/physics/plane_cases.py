"""Rows and checks of planes: ten seconds of random commands against plane_reference.py, error beside time.

    random, gusty   from trimmed flight, in turbulence and gusts     greatest position error [m]
    spin, gusty     from a spin                                      the same
    tail slide      nose up, sliding backwards through no airspeed   the same

Commands jump every 0.03 to 0.5 s, each by itself, over the whole range of each: surfaces at their rate limits, engines
that stop, and stall. The cost of a tick is compared with that of a quadrotor in the vigorous flight of flight_cases.py,
in turns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.physics import plane_reference as reference
from hil.apps.bench_suite.physics.flight_cases import TICK_NS, TICK_S, ThisProject, vigorous
from hil.apps.bench_suite.physics.multirotor_reference import attitude_error_rad
from hil.apps.bench_suite.result import Check, Row, ShowStatus
from hil.apps.bench_suite.timing import best_times
from sim.physics.disturbances import Disturbances
from sim.physics.fixed_wing import Airframe
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.integration import Integration
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from sim.scene.wind import GustEvent, Turbulence, Wind

Float64 = NDArray[np.float64]
GUSTY = Wind(
    steady_W_mps=(4.0, -3.0, 0.0),
    turbulence=Turbulence(level="moderate"),
    gusts=(GustEvent(at_s=1.3, velocity_W_mps=(-6.0, 4.0, 3.0), rise_s=0.5, hold_s=0.7, fall_s=0.3),),
)
CALM = Wind(steady_W_mps=(0.0, 0.0, 0.0))

# Changes of the trimmed start, by place in the state: q (3 to 6), v in W (7 to 9), w in B (10 to 12), propeller (13).
LEVEL: Mapping[int, float] = {}
SPIN: Mapping[int, float] = {7: 6.0, 9: -9.0, 10: 2.0, 11: 0.5, 12: -4.0}
INVERTED: Mapping[int, float] = {3: 0.02, 4: 1.0, 11: -1.0}
TAIL_SLIDE: Mapping[int, float] = {3: 0.7071, 5: -0.7071, 7: 0.0, 9: -4.0, 13: 60.0}
SIDEWAYS: Mapping[int, float] = {7: 1.0, 8: 14.0, 9: -2.0, 12: 3.0}

HEIGHT_M, SECONDS = 900.0, 10.0
_CASES = {"random, gusty": (LEVEL, 1, GUSTY), "spin, gusty": (SPIN, 2, GUSTY), "tail slide": (TAIL_SLIDE, 4, CALM)}
_METHODS = {  # the bench's own first
    "this project, order 8 @ 4 ms": Integration(step_ns=4_000_000),
    "this project, order 8 @ 1 ms": Integration(step_ns=1_000_000),
    "this project, classical RK4 @ 1 ms": Integration("classical", 1_000_000),
}
_PLANES = ("skywalker_x8", "aerosonde", "trainer")


class Errors(NamedTuple):
    """Greatest differences of a flight from the reference."""

    position_m: float
    attitude_rad: float
    deflection_rad: float


def prompt_engine(vehicle: Vehicle) -> Vehicle:
    """Return a vehicle without wheels whose engine has no dead time: the reference has neither."""
    constants = vehicle.rotor_constants.model_copy(update={"dead_time_s": 0.0})
    wings = tuple(force for force in vehicle.forces if force.is_wing)
    return vehicle.model_copy(update={"rotor_constants": constants, "forces": wings})


def random_commands(
    vehicle: Vehicle, seconds: float, seed: int, *, rotors: tuple[float, float] = (0.0, 1.0)
) -> Float64:
    """Return commands that jump every 0.03 to 0.5 s, each by itself: rotors from `rotors`, servos over their range."""
    random = np.random.default_rng(seed)
    ticks = round(seconds / TICK_S)
    columns = []
    for command in vehicle.commands:
        values: list[float] = []
        while len(values) < ticks:
            value = random.uniform(*(-1.0, 1.0) if command.signed else rotors)
            values += [value] * int(random.integers(8, 125))
        columns.append(values[:ticks])
    return np.array(columns).T


@dataclass(frozen=True)
class PlaneFlight:
    """A flight of a plane from trim, changed by `start`."""

    vehicle: Vehicle
    commands: Float64
    start: Mapping[int, float] = field(default_factory=dict)
    wind: Wind = CALM

    @cached_property
    def start_state(self) -> Float64:
        """State from which the flight begins: p, q, v, w, propeller, deflections."""
        airframe = Airframe(self.vehicle)
        trim = airframe.trim(airframe.cruise_mps)
        state = np.zeros(13 + len(self.vehicle.commands))
        state[:7] = (0.0, 0.0, HEIGHT_M, 1.0, 0.0, 0.0, 0.0)
        state[7:10] = trim.v_B_mps
        state[13] = trim.throttle * self.vehicle.rotor_constants.max_speed_radps
        for place, value in self.start.items():
            state[place] = value
        state[3:7] /= np.linalg.norm(state[3:7])
        return state

    def fly(self, integration: Integration | None = None, *, record: bool = True) -> tuple[Float64, Float64]:
        """Return states and winds of all ticks; without `record` those of the first."""
        physics = VehiclePhysics(
            self.vehicle,
            load_scene("airfield"),
            TICK_NS,
            start=FlightStart(p_WB=(0.0, 0.0, HEIGHT_M)),
            effects=Effects(),
            disturbances=Disturbances(self.wind, seed=4),
            integration=integration or Integration(),
        )
        physics.state[: len(self.start_state)] = self.start_state  # wheels have states beyond, at rest
        physics.advance(0, self.commands[0].tolist())
        states, winds = [physics.state.copy()], [physics.wind_W_mps]
        for tick, controls in enumerate(self.commands.tolist(), start=1):
            if physics.advance(tick, controls).in_contact:
                raise ValueError(f"the flight reaches the ground in tick {tick}")
            if record:
                states.append(physics.state.copy())
                winds.append(physics.wind_W_mps)
        return np.array(states), np.array(winds)

    def exact(self, start: Float64, winds: Float64) -> Float64:
        """Return the states of the reference."""
        scene = load_scene("airfield")
        inputs = reference.PlaneInputs(self.commands, winds, scene.site)
        return reference.fly(self.vehicle, start, inputs, tick_s=TICK_S, gravity_mps2=scene.gravity_mps2)


def errors_of(vehicle: Vehicle, flown: Float64, exact: Float64) -> Errors:
    """Return the greatest errors of a flight."""
    own = 13 + len(vehicle.rotors)
    return Errors(
        float(np.max(np.linalg.norm(flown[:, :3] - exact[:, :3], axis=1))),
        max(attitude_error_rad(a, b) for a, b in zip(flown[:, 3:7], exact[:, 3:7], strict=True)),
        float(np.max(np.abs(flown[:, own:] - exact[:, own:]), initial=0.0)),
    )


def measured(case: str, flight: PlaneFlight, *, quick: bool) -> tuple[list[Row], float]:
    """Return the rows of a case, and the position error of the bench's own integration [m]."""
    first, winds = flight.fly()
    exact = flight.exact(first[0], winds)
    runs: dict[str, Any] = {m: partial(flight.fly, step, record=False) for m, step in _METHODS.items()}
    times = best_times(runs, rounds=1 if quick else 3)
    rows = []
    for method, step in _METHODS.items():
        found = errors_of(flight.vehicle, flight.fly(step)[0], exact)
        per_s = times[method] / (len(flight.commands) * TICK_S)
        details = {"attitude_error_rad": found.attitude_rad, "deflection_error_rad": found.deflection_rad}
        rows.append(Row(case, method, found.position_m, "m", per_s, details))
    return rows, rows[0].error


def plane_rows(status: ShowStatus, *, quick: bool) -> tuple[list[Row], list[Check]]:
    """Measure all cases."""
    rows: list[Row] = []
    worst = 0.0
    for name in _PLANES:
        vehicle = prompt_engine(load_vehicle(name))
        for case, (start, seed, wind) in _CASES.items():
            status(f"{name}: {case}")
            flight = PlaneFlight(vehicle, random_commands(vehicle, 2.0 if quick else SECONDS, seed), start, wind)
            more, error = measured(f"{name}: {case}", flight, quick=quick)
            rows += more
            worst = max(worst, error)
    status("cost of a plane's tick")
    costs = [
        Check(f"{name}: processor time of a tick over a quadrotor's", _cost(name, quick=quick), "<=", 2.0, "x", "speed")
        for name in _PLANES
    ]
    return rows, [Check("planes, random commands, gusts, stall, spin: position error", worst, "<=", 1e-6, "m"), *costs]


def _cost(name: str, *, quick: bool) -> float:
    vehicle = load_vehicle(name)
    plane, quad = PlaneFlight(vehicle, random_commands(vehicle, 5.0, 1)), vigorous(5.0)
    runs: dict[str, Any] = {
        "plane": partial(plane.fly, record=False),
        "quad": partial(ThisProject(4.0).fly, quad, record=False),
    }
    times = best_times(runs, rounds=2 if quick else 7)
    return times["plane"] / times["quad"]
