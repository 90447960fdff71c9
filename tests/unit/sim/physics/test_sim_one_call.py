"""A tick that one call of the kernel flies has the bits, the events and the errors of a tick flown in steps."""

from __future__ import annotations

import math

import pytest

from signals.errors import ModelRangeError
from sim.physics.disturbances import Disturbances
from sim.physics.faults import RotorFault
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

TICK_NS = 4_000_000


def dropped(height_m: float = 1.0) -> VehiclePhysics:
    """Return a vehicle in the air, which loses thrust twice."""
    faults = (
        RotorFault(kind="efficiency", rotor=1, at_s=0.05, factor=0.5),
        RotorFault(kind="efficiency", rotor=1, at_s=0.35, factor=0.9),
    )
    start = FlightStart(p_WB=(0.0, 0.0, height_m))
    scene = load_scene("airfield")
    return VehiclePhysics(
        load_vehicle("x500"), scene, TICK_NS, start=start, disturbances=Disturbances(faults=faults, seed=3)
    )


def fall(physics: VehiclePhysics, *, steps: bool) -> None:
    for tick in range(1, 20_000):
        if steps:
            physics.finish(physics.fly(tick, (0.0,) * 4))
        else:
            physics.advance(tick, (0.0,) * 4)


def test_a_fall_with_faults_and_touch_down_has_the_same_bits_in_one_call_and_in_steps() -> None:
    whole, stepped = dropped(), dropped()
    touched = False
    for tick in range(300):
        controls = (0.4 + 0.001 * (tick % 50),) * 4
        truth = whole.advance(tick, controls)
        assert truth == stepped.finish(stepped.fly(tick, controls))
        assert whole.take_events() == stepped.take_events()
        touched = touched or truth.in_contact
    assert touched
    assert whole.skips == stepped.skips
    assert whole.skips.skipped > 50


def test_a_command_that_is_not_finite_is_named() -> None:
    physics = dropped(height_m=100.0)
    physics.advance(0, (0.5,) * 4)
    physics.advance(1, (0.5,) * 4)
    with pytest.raises(ModelRangeError, match=r"controls\[2\]"):
        physics.advance(2, (0.5, 0.5, math.nan, 0.5))


def test_a_vehicle_that_leaves_the_range_of_the_model_ends_the_flight_in_the_same_tick() -> None:
    whole, stepped = dropped(height_m=100.0), dropped(height_m=100.0)
    ended = []
    for physics, steps in ((whole, False), (stepped, True)):
        physics.advance(0, (0.0,) * 4)
        physics.place((0.0, 0.0, 40_000.0), v_WB_W=(0.0, 0.0, -199.99), rotor_speed_radps=(0.0,) * 4)
        with pytest.raises(ModelRangeError) as error:
            fall(physics, steps=steps)
        ended.append(str(error.value))
    assert ended[0] == ended[1]


def test_a_tick_out_of_turn_is_refused() -> None:
    physics = dropped()
    physics.advance(0, (0.0,) * 4)
    with pytest.raises(ValueError, match="ticks must come in order"):
        physics.advance(2, (0.0,) * 4)
