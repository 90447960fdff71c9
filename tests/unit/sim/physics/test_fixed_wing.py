"""Facts of planes: trims that fly steadily, speeds, glide and stability against closed forms, and what has no trim."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim.physics.fixed_wing import Airframe, NoTrimError, engines, is_plane, unfit
from sim.physics.flight_start import FlightStart
from sim.physics.forces.aero_table import AeroTable
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

RHO, G = 1.225, 9.80665
PLANES = ("skywalker_x8", "aerosonde")


def table_of(vehicle: Vehicle) -> AeroTable:
    (table,) = vehicle.forces
    assert isinstance(table, AeroTable)
    return table


def with_table(vehicle: Vehicle, **change: object) -> Vehicle:
    return vehicle.model_copy(update={"forces": (table_of(vehicle).model_copy(update=change),)})


@pytest.mark.parametrize("name", PLANES)
@pytest.mark.parametrize(("climb_deg", "bank_deg"), [(0.0, 0.0), (6.0, 0.0), (-4.0, 0.0), (0.0, 35.0), (0.0, -20.0)])
def test_a_trim_flies_steadily(name: str, climb_deg: float, bank_deg: float) -> None:
    """In the physics of a flight, in the air of its site: after 2 s speed, climb and bank are as they were."""
    vehicle, scene = load_vehicle(name), load_scene("airfield")
    airframe = Airframe(vehicle, scene.site, scene.gravity_mps2)
    V = airframe.cruise_mps
    trim = airframe.trim(V, climb_rad=math.radians(climb_deg), bank_rad=math.radians(bank_deg))
    physics = VehiclePhysics(vehicle, scene, 4_000_000, start=FlightStart(p_WB=(0.0, 0.0, 0.5 + 200.0)))
    # At the height of the site the density is that of the trim but for what 200 m make: 2 %.
    physics.body.set_air(scene.site.altitude_m - 200.5, scene.site.warmer_k)
    a, b = -0.5 * trim.pitch_rad, 0.5 * trim.bank_rad
    q = (math.cos(a) * math.cos(b), math.cos(a) * math.sin(b), math.sin(a) * math.cos(b), -math.sin(a) * math.sin(b))
    truth = physics.place((0.0, 0.0, 200.5), q)
    up = np.array([math.sin(trim.pitch_rad), math.cos(trim.pitch_rad) * math.sin(trim.bank_rad), 0.0])
    up[2] = math.cos(trim.pitch_rad) * math.cos(trim.bank_rad)
    R = _matrix(q)
    assert R[2] == pytest.approx(up, abs=1e-12)
    physics.state[7:10], physics.state[10:13] = R @ trim.v_B_mps, trim.w_B_radps
    physics.state[13] = trim.throttle * vehicle.rotor_constants.max_speed_radps
    for i, (place, surface) in enumerate(zip(airframe.surfaces, vehicle.surfaces, strict=True)):
        physics.state[14 + i] = surface.deflection_rad(trim.controls[place])
    for tick in range(500):
        truth = physics.advance(tick, trim.controls)
    v = np.array(truth.v_WB_W)
    assert np.linalg.norm(v) == pytest.approx(V, rel=2e-3)
    assert math.degrees(math.asin(v[2] / np.linalg.norm(v))) == pytest.approx(climb_deg, abs=0.1)
    assert truth.w_WB_B == pytest.approx(trim.w_B_radps, abs=2e-3)


def _matrix(q: tuple[float, ...]) -> np.ndarray:
    w, x, y, z = q
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * skew + 2 * skew @ skew


def test_a_level_turn_is_coordinated() -> None:
    airframe = Airframe(load_vehicle("aerosonde"))
    trim = airframe.trim(35.0, bank_rad=math.radians(30.0))
    assert trim.turn_radps == pytest.approx(G * math.tan(math.radians(30.0)) / 35.0, rel=0.01)
    assert abs(math.degrees(trim.beta_rad)) < 0.1  # it has a rudder


def test_stall_speed_and_glide_of_a_bare_polar() -> None:
    """No propeller, no moments but those in balance: V_s by the greatest lift, the best glide where drag is least.

    C_D = C_D0 + k C_L^2: greatest C_L / C_D is 1 / (2 sqrt(k C_D0)), and tan of the glide its inverse.
    """
    vehicle = load_vehicle("aerosonde")
    table = table_of(vehicle)
    pitch = table.pitch.model_copy(update={"zero": 0.0, "alpha": -1e-9})
    none = {"thrust_coefficient_n_per_radps2": 1e-30, "drag_kg_per_rad": 0.0, "inertia_kgm2": 0.0}
    bare = with_table(vehicle, pitch=pitch).model_copy(
        update={"rotor_model": "quadratic", "rotor_constants": vehicle.rotor_constants.model_copy(update=none)}
    )
    airframe = Airframe(bare)
    k = 1.0 / (math.pi * 0.9 * 2.8956**2 / 0.55)
    glide = airframe.best_glide
    assert math.tan(-glide.climb_rad) == pytest.approx(2.0 * math.sqrt(k * 0.0437), rel=2e-3)
    best = math.sqrt(0.0437 / k)  # C_L of it
    assert glide.airspeed_mps == pytest.approx(math.sqrt(13.5 * G / (0.5 * RHO * 0.55 * best)), rel=0.01)
    alpha, border = np.radians(np.linspace(5.0, 35.0, 6001)), math.radians(27.0)
    attached = 1.0 / ((1 + np.exp(50 * (alpha - border))) * (1 + np.exp(-50 * (alpha + border))))
    lift = attached * (0.28 + 3.45 * alpha) + (1 - attached) * 2.0 * np.sin(alpha) ** 2 * np.cos(alpha)
    expected = math.sqrt(13.5 * G / (0.5 * RHO * 0.55 * float(lift.max())))
    assert airframe.stall_speed_mps == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("name", PLANES)
def test_static_margin_is_that_of_the_derivatives(name: str) -> None:
    """-C_m_alpha / C_L_alpha, but for drag and the propeller's normal force."""
    vehicle = load_vehicle(name)
    table = table_of(vehicle)
    found = Airframe(vehicle).static_margin(vehicle.cruise_mps or 0.0)
    assert found == pytest.approx(-table.pitch.alpha / table.lift.alpha, rel=0.35)
    bare = vehicle.model_copy(
        update={
            "rotor_model": "quadratic",
            "rotor_constants": vehicle.rotor_constants.model_copy(update={"drag_kg_per_rad": 0.0}),
        }
    )
    exact = -table.pitch.alpha / (table.lift.alpha + 0.05)  # drag is some 1 % of the slope
    assert Airframe(bare).static_margin(vehicle.cruise_mps or 0.0) == pytest.approx(exact, rel=0.03)


def test_effectiveness_and_damping_are_those_of_the_derivatives() -> None:
    vehicle = load_vehicle("aerosonde")
    airframe = Airframe(vehicle)
    trim = airframe.trim(35.0)
    pressure = 0.5 * RHO * 35.0**2 * 0.55
    effect = airframe.effectiveness_nm(trim)  # aileron, elevator, rudder
    full = math.radians(25.0)
    assert effect[0] == pytest.approx(pressure * 2.8956 * full * np.array([0.08, 0.0, 0.105]), rel=0.01, abs=1e-6)
    assert effect[1] == pytest.approx(pressure * 0.18994 * full * np.array([0.0, 0.5, 0.0]), rel=0.01, abs=1e-6)
    assert effect[2] == pytest.approx(pressure * 2.8956 * full * np.array([-0.06, 0.0, 0.032]), rel=0.01, abs=1e-6)
    damping = airframe.damping_nms(trim)
    assert damping[0, 0] == pytest.approx(-0.26 * pressure * 2.8956**2 / 70.0, rel=0.05)
    assert np.all(np.diag(damping) < 0.0)


def test_thrust_range_of_the_published_motor() -> None:
    """PyFly's: 21.65 N standing, none at k_motor."""
    airframe = Airframe(load_vehicle("skywalker_x8"))
    assert airframe.thrust_range_n(0.01)[1] == pytest.approx(21.65, rel=0.01)
    assert airframe.thrust_range_n(37.42)[1] == pytest.approx(0.0, abs=0.1)
    slowest, fastest = airframe.speed_range_mps
    assert slowest < airframe.cruise_mps < fastest


def test_what_cannot_fly_says_why() -> None:
    vehicle = load_vehicle("skywalker_x8")
    with pytest.raises(NoTrimError, match=r"the wings carry 33 N from"):
        Airframe(vehicle).trim(6.0)
    with pytest.raises(NoTrimError, match="more thrust than the engines have"):
        Airframe(vehicle).trim(60.0)
    heavy = with_table(vehicle, pitch=table_of(vehicle).pitch.model_copy(update={"zero": -0.4}))
    with pytest.raises(NoTrimError, match="of its range"):
        Airframe(heavy).trim(18.0)


def test_kinds_of_vehicles() -> None:
    x8, x500 = load_vehicle("skywalker_x8"), load_vehicle("x500")
    assert is_plane(x8)
    assert not is_plane(x500)
    assert engines(x8) == [0]
    assert unfit(x8) is None
    assert unfit(x500) == ("forces", "holds no wings (such as aero_table)")
    assert unfit(x8.model_copy(update={"rotors": ()})) == (
        "rotors",
        "holds no engine: a rotor with the axis [1, 0, 0]",
    )
    assert unfit(with_table(x8, surfaces=())) == ("forces", "holds no control surfaces")


def test_wheels_change_no_fact_of_a_flight() -> None:
    """Facts are computed at a height of 0, where wheels would stand on the ground."""
    trainer = load_vehicle("trainer")
    bare = trainer.model_copy(update={"forces": trainer.forces[:1]})
    rolls, flies = Airframe(trainer), Airframe(bare)
    assert rolls.stall_speed_mps == flies.stall_speed_mps
    a, b = rolls.trim(14.4), flies.trim(14.4)
    assert a.throttle == b.throttle
    assert a.controls == (*b.controls, 0.0, 0.0)


def test_wheels_before_the_wings_are_unfit() -> None:
    trainer = load_vehicle("trainer")
    assert unfit(trainer) is None
    reason = unfit(trainer.model_copy(update={"forces": trainer.forces[::-1]}))
    assert reason is not None
    assert "wheels before the control surfaces" in reason[1]
