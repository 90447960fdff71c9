"""Free flight of planes against the CasADi model solved by CVODES: ordinary flight, stall, spin, tail slide, wind."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.bench_suite.physics.multirotor_reference import attitude_error_rad
from hil.apps.bench_suite.physics.plane_reference import PlaneInputs, fly
from sim.physics.disturbances import Disturbances
from sim.physics.fixed_wing import Airframe
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from sim.scene.wind import GustEvent, Turbulence, Wind

Float64 = NDArray[np.float64]
TICK_NS = 4_000_000
GUSTY = Wind(
    steady_W_mps=(4.0, -3.0, 0.0),
    turbulence=Turbulence(level="moderate"),
    gusts=(GustEvent(at_s=1.3, velocity_W_mps=(-6.0, 4.0, 3.0), rise_s=0.5, hold_s=0.7, fall_s=0.3),),
)
CALM = Wind(steady_W_mps=(0.0, 0.0, 0.0))


def random_commands(vehicle: Vehicle, seconds: float, seed: int) -> Float64:
    """Return commands that jump every 0.03 to 0.5 s, each by itself, over the whole range of each."""
    random = np.random.default_rng(seed)
    ticks = round(seconds / 0.004)
    columns = []
    for command in vehicle.commands:
        values: list[float] = []
        while len(values) < ticks:
            value = random.uniform(-1.0 if command.signed else 0.0, 1.0)
            values += [value] * int(random.integers(8, 125))
        columns.append(values[:ticks])
    return np.array(columns).T


def errors(
    vehicle: Vehicle,
    commands: Float64,
    start: dict[int, float],
    wind: Wind,
    tick_ns: int = TICK_NS,
) -> tuple[float, float, float, Float64]:
    """Return the greatest error of position [m], attitude [rad] and deflection [rad], and the states."""
    scene = load_scene("airfield")
    physics = VehiclePhysics(
        vehicle, scene, tick_ns, start=FlightStart(p_WB=(0.0, 0.0, 900.0)), disturbances=Disturbances(wind, seed=4)
    )
    trim = Airframe(vehicle).trim(vehicle.cruise_mps or 20.0)
    physics.state[7:10] = trim.v_B_mps
    physics.state[13] = trim.throttle * vehicle.rotor_constants.max_speed_radps
    for place, value in start.items():
        physics.state[place] = value
    physics.state[3:7] /= np.linalg.norm(physics.state[3:7])
    physics.advance(0, commands[0].tolist())
    states, winds = [physics.state.copy()], [physics.wind_W_mps]
    for tick, controls in enumerate(commands.tolist(), start=1):
        assert not physics.advance(tick, controls).in_contact
        states.append(physics.state.copy())
        winds.append(physics.wind_W_mps)
    flown = np.array(states)
    exact = fly(
        vehicle,
        flown[0],
        PlaneInputs(commands, np.array(winds), scene.site),
        tick_s=tick_ns / 1e9,
        gravity_mps2=scene.gravity_mps2,
    )
    position = float(np.max(np.linalg.norm(flown[:, :3] - exact[:, :3], axis=1)))
    attitude = max(attitude_error_rad(a, b) for a, b in zip(flown[:, 3:7], exact[:, 3:7], strict=True))
    surfaces = float(np.max(np.abs(flown[:, 14:] - exact[:, 14:])))
    return position, attitude, surfaces, flown


LEVEL: dict[int, float] = {}
SPIN = {7: 6.0, 9: -9.0, 10: 2.0, 11: 0.5, 12: -4.0}
INVERTED = {3: 0.02, 4: 1.0, 11: -1.0}
TAIL_SLIDE = {3: 0.7071, 4: 0.0, 5: -0.7071, 6: 0.0, 7: 0.0, 9: -4.0, 13: 60.0}
SIDEWAYS = {7: 1.0, 8: 14.0, 9: -2.0, 12: 3.0}


@pytest.mark.parametrize("name", ["skywalker_x8", "aerosonde"])
@pytest.mark.parametrize(
    ("start", "seed", "wind"),
    [
        pytest.param(LEVEL, 1, GUSTY, id="random, gusty"),
        pytest.param(SPIN, 2, GUSTY, id="spin, gusty", marks=pytest.mark.slow),
        pytest.param(INVERTED, 3, CALM, id="inverted", marks=pytest.mark.slow),
        pytest.param(TAIL_SLIDE, 4, CALM, id="tail slide"),
        pytest.param(SIDEWAYS, 5, GUSTY, id="sideways", marks=pytest.mark.slow),
    ],
)
def test_ten_seconds_of_any_commands(name: str, start: dict[int, float], seed: int, wind: Wind) -> None:
    vehicle = load_vehicle(name)
    position, attitude, surfaces, flown = errors(vehicle, random_commands(vehicle, 10.0, seed), start, wind)
    assert position < 1e-6
    assert attitude < 1e-6
    assert surfaces < 1e-12
