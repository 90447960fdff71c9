"""Rotor faults: what each does, when it takes hold, what it tells, and what is refused."""

from __future__ import annotations

import math

import pydantic
import pytest

from signals.samples import TruthState
from sim.physics import multirotor
from sim.physics.disturbances import Disturbances
from sim.physics.faults import RotorFault, misfits
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from tests.worlds.rotor_models import quadratic

TICK_NS = 4_000_000


def hovering(*faults: RotorFault, tick_ns: int = TICK_NS) -> VehiclePhysics:
    vehicle = quadratic("x500")
    physics = VehiclePhysics(
        vehicle,
        load_scene("airfield"),
        tick_ns,
        start=FlightStart(p_WB=(0.0, 0.0, 500.0)),
        disturbances=Disturbances(faults=faults),
    )
    physics.state[13:] = multirotor.speed_radps(vehicle, multirotor.hover_control(vehicle))
    return physics


def fly(physics: VehiclePhysics, ticks: int) -> list[TruthState]:
    controls = (multirotor.hover_control(physics.vehicle),) * 4
    return [physics.advance(tick, controls) for tick in range(ticks + 1)]


def test_efficiency_takes_thrust_and_torque_at_its_tick() -> None:
    physics = hovering(RotorFault(kind="efficiency", rotor=0, at_s=0.0401, factor=0.6))
    track = fly(physics, 13)
    # 40.1 ms: tick 11 is the first at or after it, so tick 12 is the first to feel it.
    for truth in track[1:12]:
        assert truth.a_WB_W[2] == pytest.approx(0.0, abs=1e-9)
    assert track[12].a_WB_W[2] == pytest.approx(-0.1 * 9.80665, rel=1e-3)
    vehicle = physics.vehicle
    lost = 0.4 * vehicle.mass_kg * 9.80665 / 4
    # Front right, counter-clockwise: its reaction was clockwise, so less of it turns the body counter-clockwise.
    x, y, _ = vehicle.rotors[0].position_m
    expected = [
        -y * lost / vehicle.inertia_kgm2[0],
        x * lost / vehicle.inertia_kgm2[1],
        vehicle.rotor_constants.moment_ratio_m * lost / vehicle.inertia_kgm2[2],
    ]
    assert track[12].alpha_WB_B == pytest.approx(expected, rel=0.02)
    assert track[13].rotor_speed_radps[0] == pytest.approx(track[0].rotor_speed_radps[0])


def test_stuck_rotor_ignores_commands() -> None:
    physics = hovering(RotorFault(kind="stuck", rotor=3, at_s=0.0, speed_radps=200.0))
    track = fly(physics, 25)
    start = track[0].rotor_speed_radps[3]
    tau = physics.vehicle.rotor_constants.time_constant_down_s
    assert track[25].rotor_speed_radps[3] == pytest.approx(200.0 + (start - 200.0) * math.exp(-0.1 / tau), rel=1e-9)
    assert track[25].rotor_speed_radps[0] == pytest.approx(start)


def test_a_later_fault_replaces_the_earlier_and_all_are_reported() -> None:
    physics = hovering(
        RotorFault(kind="stuck", rotor=2, at_s=0.02, speed_radps=0.0),
        RotorFault(kind="efficiency", rotor=2, at_s=0.01, factor=0.5),
        RotorFault(kind="efficiency", rotor=0, at_s=0.02, factor=0.9),
    )
    told = []
    for tick in range(10):
        physics.advance(tick, (multirotor.hover_control(physics.vehicle),) * 4)
        told += [(tick, event) for event in physics.take_events()]
    assert [(tick, event.t_ns, event.kind) for tick, event in told] == [
        (3, 12_000_000, "fault"),
        (5, 20_000_000, "fault"),
        (5, 20_000_000, "fault"),
    ]
    assert [event.text for _, event in told] == [
        "rotor 2: efficiency falls to 50 %",
        "rotor 2: stuck at 0 rad/s",
        "rotor 0: efficiency falls to 90 %",
    ]
    assert physics.take_events() == []


def test_no_fault_no_change() -> None:
    assert fly(hovering(), 30) == fly(hovering(RotorFault(kind="stuck", rotor=0, at_s=60.0)), 30)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"kind": "jammed", "rotor": 0, "at_s": 1.0}, "efficiency"),
        ({"kind": "efficiency", "rotor": 0, "at_s": 1.0}, "needs factor"),
        ({"kind": "efficiency", "rotor": 0, "at_s": 1.0, "factor": 1.5}, "less than or equal to 1"),
        ({"kind": "stuck", "rotor": 0, "at_s": 1.0, "factor": 0.5}, "factor has no meaning for the kind 'stuck'"),
        ({"kind": "stuck", "rotor": 9, "at_s": 1.0}, "rotor"),
        ({"kind": "stuck", "rotor": 0, "at_s": -1.0}, "at_s"),
        ({"kind": "stuck", "rotor": 0, "at_s": 1.0, "speed": 3.0}, "speed"),
    ],
)
def test_wrong_faults_are_refused_by_name(data: dict[str, object], said: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=said):
        RotorFault.model_validate(data)


def test_a_rotor_that_is_not_there() -> None:
    fault = RotorFault(kind="stuck", rotor=5, at_s=1.0)
    assert misfits([fault], load_vehicle("x500")) == [(0, "rotor", "names rotor 5, but the vehicle has rotors 0 to 3")]
    with pytest.raises(ValueError, match="names rotor 5"):
        hovering(fault)


def test_an_imbalance_beyond_that_of_a_blade_is_refused() -> None:
    """The X500's rotor has 16 g: 1000 g cm would be its whole weight 62 cm from the axis."""
    fault = RotorFault(kind="lost_blade", rotor=0, at_s=1.0, imbalance_gcm=1000.0)
    [(_, key, message)] = misfits([fault], load_vehicle("x500"))
    assert key == "imbalance_gcm"
    assert message.startswith("must be at most 31.3 g cm, not 1000: one of 2 blades of a rotor with 2.64986e-05 kg m2")
    with pytest.raises(ValueError, match=r"at most 31\.3 g cm"):
        hovering(fault)
    assert misfits([fault.model_copy(update={"imbalance_gcm": 30.0})], load_vehicle("x500")) == []
