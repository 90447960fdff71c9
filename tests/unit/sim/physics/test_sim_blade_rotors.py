"""Rotors by blade-element momentum theory against closed forms. tests/reference compares whole flights."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from sim import _kernels
from sim.physics.flight_start import FlightStart
from sim.physics.forces import rotor_equations
from sim.physics.forces.blade_element import BladeElement, Blades, lumps_of
from sim.physics.forces.force import Effects
from sim.physics.forces.rotors import Rotor, rotors_force
from sim.physics.integration import TickSteps
from sim.physics.multirotor import multirotor_names
from sim.physics.vehicle import Vehicle, load_vehicle, rigid_body
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.atmosphere import density_kgpm3
from sim.scene.scene import Site, load_scene

RHO, G = 1.225, 9.80665
X500 = load_vehicle("x500")
LUMPS = lumps_of(X500.rotor_constants, X500.rotor_constants.blade_element or BladeElement(inflow_thrust_kg_per_rad=1.0))
SPEED = 770.0
V_H = math.sqrt(LUMPS.kappa_m2) * SPEED
K = X500.rotor_constants.thrust_coefficient_n_per_radps2
IN_HOVER = RHO * 2.0 * math.pi * LUMPS.radius_m**2 * V_H**2


def at(u_n: float = 0.0, across: float = 0.0, speed: float = SPEED, **options: Any) -> rotor_equations.RotorLoads:
    return rotor_equations.loads(LUMPS, speed, u_n, across * across, **options)


def on_hub(
    vehicle: Vehicle,
    *,
    u: tuple[float, float, float] = (0.0, 0.0, 0.0),
    speed: float = SPEED,
    height_m: float = 300.0,
    air: tuple[float, float] | None = None,
    effects: Effects = Effects(),  # noqa: B008 (frozen)
) -> tuple[np.ndarray, np.ndarray, _kernels.BladeRotors]:
    """Return force and torque of the kernel on a level body that moves with `u` through the air, over a microsecond."""
    rotors = rotors_force(
        vehicle.rotors, vehicle.rotor_constants, effects, blades=vehicle.rotor_constants.blade_element
    )
    steps = TickSteps(tick_s=1e-6, free=1)
    truth = np.zeros(13 + len(vehicle.rotors) + 6)
    truth[:10], truth[13 : 13 + len(vehicle.rotors)] = (0, 0, height_m, 1, 0, 0, 0, *u), speed
    body = rigid_body(vehicle, truth, forces=[rotors], gravity_mps2=0.0, wind_W_mps=(0, 0, 0), steps=steps, air=air)
    c = vehicle.rotor_constants
    share, f = (speed / c.max_speed_radps) ** 2, c.thrust_model_factor
    u0 = share if f == 0.0 else (math.sqrt((1 - f) ** 2 + 4 * f * share) - (1 - f)) / (2 * f)
    body.command([u0] * len(vehicle.rotors))
    body.fly()
    body.finish()
    means = truth[-6:]
    return means[:3] * vehicle.mass_kg, means[3:] * np.array(vehicle.inertia_kgm2), rotors


def single(axis: tuple[float, float, float] = (0.0, 0.0, 1.0), spin: str = "ccw", **constants: Any) -> Vehicle:
    """The x500 with one rotor at its centre of mass."""
    rotor = Rotor(position_m=(0, 0, 0), spin=spin, axis=axis)
    c = X500.rotor_constants.model_copy(update={"inertia_kgm2": 0.0} | constants)
    return X500.model_copy(update={"rotors": (rotor,), "rotor_constants": c})


@pytest.mark.parametrize("name", multirotor_names())
def test_hover_is_that_of_the_file(name: str) -> None:
    c = load_vehicle(name).rotor_constants
    assert c.blade_element is not None
    found = lumps_of(c, c.blade_element)
    o = 0.6 * c.max_speed_radps
    hover = rotor_equations.loads(found, o, 0.0, 0.0)
    thrust = c.thrust_coefficient_n_per_radps2 * o * o
    assert hover.thrust_n == pytest.approx(thrust, rel=1e-14)
    assert hover.torque_nm == pytest.approx(c.moment_ratio_m * thrust, rel=1e-14)
    assert hover.induced_mps == pytest.approx(math.sqrt(thrust / (2 * RHO * math.pi * c.radius_m**2)), rel=1e-14)
    assert hover.power_w == pytest.approx(hover.torque_nm * o, rel=1e-14)


@pytest.mark.parametrize("climb", [0.5, 1.0, 2.0, 4.0])
def test_climb_is_momentum_theory(climb: float) -> None:
    """T = 2 rho A v (u + v), v = -u / 2 + sqrt(u^2 / 4 + T / 2 rho A)."""
    u = climb * math.sqrt(at(climb * V_H).thrust_n / IN_HOVER) * V_H if climb < 2 else climb * V_H / 2
    load = at(u)
    v = -u / 2 + math.sqrt(u * u / 4 + load.thrust_n / LUMPS.disc_kg_per_m)
    assert load.induced_mps == pytest.approx(v, rel=5e-3)
    assert load.thrust_n == pytest.approx(LUMPS.c_t * SPEED**2 - LUMPS.c_l * SPEED * (u + load.induced_mps), rel=1e-12)
    ideal = load.thrust_n * (u + 1.15 * load.induced_mps) + LUMPS.c_q * SPEED**3
    assert load.power_w == pytest.approx(ideal, rel=1e-12)


def test_thrust_ends_at_the_advance_ratio_of_the_tables() -> None:
    model = X500.rotor_constants.blade_element
    assert model is not None
    assert model.zero_thrust_advance_ratio is not None
    u = model.zero_thrust_advance_ratio * SPEED / (2 * math.pi) * 2 * LUMPS.radius_m
    load = at(u)
    assert abs(load.thrust_n) < 1e-10
    assert abs(load.induced_mps) < 1e-9
    beyond = at(1.2 * u)
    assert beyond.thrust_n < 0
    assert beyond.induced_mps < 0


@pytest.mark.parametrize("sink", [2.3, 3.0, 5.0])
def test_windmill_state_is_momentum_theory(sink: float) -> None:
    """T = -2 rho A v (u + v) for a fast descent."""
    load = at(-2.0 * sink * V_H)
    u, v = -2.0 * sink * V_H, load.induced_mps
    assert load.thrust_n == pytest.approx(-LUMPS.disc_kg_per_m * v * (u + v), rel=5e-3)
    assert load.torque_nm < 0 or sink < 3


@pytest.mark.parametrize("x", [-0.5, -0.75, -1.0, -1.25, -1.5, -1.75, -1.9])
def test_vortex_ring_is_the_published_curve(x: float) -> None:
    """Leishman's polynomial of v / v_h over x = u / v_h, at the same thrust."""

    def excess(v: float) -> float:
        return v * rotor_equations.flux2(x, 0.0, v)[0] ** 0.5 - 1.0

    published = 1 - 1.125 * x - 1.372 * x**2 - 1.718 * x**3 - 0.655 * x**4
    assert brentq(excess, 0.1, 5.0) == pytest.approx(published, rel=0.08 if x < -1.8 else 0.02)


@pytest.mark.parametrize("advance", [0.5, 1.0, 3.0])
def test_forward_flight_is_glauert(advance: float) -> None:
    """T = 2 rho A v sqrt(V^2 + (u + v)^2) for a rotor tilted against the wind."""
    across, u = advance * 2 * V_H, 0.3 * V_H
    load = at(u, across)
    flux = math.hypot(across, u + load.induced_mps)
    assert load.thrust_n == pytest.approx(LUMPS.disc_kg_per_m * load.induced_mps * flux, rel=2e-3)


def test_translational_lift_and_the_power_bucket() -> None:
    """The power for the same thrust falls with speed across, and rises again by the profile drag."""

    def power_at(across: float) -> float:
        def excess(o: float) -> float:
            return float(at(0.0, across, o).thrust_n - K * SPEED**2)

        bare = LUMPS._replace(k_d=0.0)
        o = float(brentq(excess, 300.0, 1200.0))
        return float(rotor_equations.loads(bare, o, 0.0, across**2).power_w)

    powers = [power_at(v) for v in (0.0, 4.0, 8.0, 12.0)]
    assert at(0.0, 8.0).thrust_n > 1.1 * K * SPEED**2
    assert powers[0] > powers[1] > powers[2]
    assert at(3.0).power_w / at(3.0).thrust_n > at().power_w / at().thrust_n  # climb costs more


@pytest.mark.parametrize(("u_n", "across"), [(0, 0), (5, 3), (-4, 1), (-12, 6), (3, 14), (-25, 0), (20, 4)])
def test_shaft_power_is_work_and_losses(u_n: float, across: float) -> None:
    """The losses are never negative: the model is no source of energy."""
    load = at(u_n, across)
    work = load.thrust_n * u_n - load.across_kg_per_s * across**2
    losses = load.power_w - work
    assert losses >= 1.0 * load.thrust_n * load.induced_mps >= 0.0


@pytest.mark.parametrize("radii", [1.0, 2.0, 4.0])
def test_ground_takes_the_inflow_that_hayden_found(radii: float) -> None:
    """Induced power at the same thrust over that aloft: 1 / (0.9926 + 0.0379 (2 / (z / R))^2), without its 0.9926."""
    gamma = rotor_equations.ground_inflow_loss(LUMPS, SPEED, 0.0, radii * LUMPS.radius_m, 1.0)
    bound = 16 * 4 * 0.0379 / 0.6
    z = 4 * radii
    fade = (1 - (radii / 32) ** 2) ** 4
    assert gamma == pytest.approx(4 * 0.0379 / radii**2 * fade * z**2 / (z**2 + bound), rel=1e-12)
    assert rotor_equations.ground_inflow_loss(LUMPS, SPEED, 0.0, 0.0, 1.0) == pytest.approx(0.6)
    low, high = on_hub(single(), height_m=radii * LUMPS.radius_m), on_hub(single())
    assert low[0][2] == pytest.approx(at(gamma=gamma).thrust_n, rel=1e-6)
    assert low[0][2] > high[0][2]
    assert -low[1][2] < -high[1][2]  # less torque for more thrust


def test_blades_give_the_slope_of_blade_element_theory() -> None:
    """Integral of a blade's lift over the radius by quadrature, at zero pitch and uniform inflow."""
    blades = Blades(count=2, mean_chord_m=0.02, lift_slope_per_rad=5.0)
    model = BladeElement(blades=blades)
    r = (np.arange(1000) + 0.5) / 1000 * X500.rotor_constants.radius_m
    lift = 0.5 * RHO * 2 * 0.02 * 5.0 * SPEED * r * 1.0  # rho / 2 N c a (O r) w, w = 1
    c_l = lumps_of(X500.rotor_constants, model).c_l
    assert c_l * SPEED == pytest.approx(float(np.mean(lift)) * X500.rotor_constants.radius_m, rel=1e-6)


def test_moments_are_those_of_blade_element_theory() -> None:
    """Lift of a blade integrated over radius and azimuth, untwisted blades, inflow of White and Blake."""
    across, u_n, R = 6.0, 1.0, LUMPS.radius_m
    rigid = LUMPS._replace(hub_moment_share=1.0)
    load = rotor_equations.loads(rigid, SPEED, u_n, across**2)
    v, through = load.induced_mps, u_n + load.induced_mps
    theta = 1.5 * LUMPS.c_t / (LUMPS.c_l * R)
    radius = (np.arange(400) + 0.5) / 400 * R
    azimuth = (np.arange(360) + 0.5) / 360 * 2 * np.pi  # 0 to the rear, pi / 2 the advancing side
    r, psi = np.meshgrid(radius, azimuth)
    flux = rotor_equations.flux2(u_n, across**2, v)[0] ** 0.5
    speed = SPEED * r + across * np.sin(psi)
    inflow = through + v * np.sqrt(2) * across / flux * r / R * np.cos(psi)
    half_slope = 4 * LUMPS.c_l / R**2 / 2  # rho / 2 a N c
    lift = half_slope * (theta * speed**2 - inflow * speed) * R
    thrust, roll, pitch = (float(np.mean(x)) for x in (lift, lift * r * np.sin(psi), -lift * r * np.cos(psi)))
    counts = (SPEED * R) ** 2 / ((SPEED * R) ** 2 + across**2)  # p, 1 in that theory
    assert load.thrust_n == pytest.approx(thrust, rel=2e-3)
    assert load.roll_kg_m_per_s * across == pytest.approx(roll, rel=2 * (1 - counts))
    # The theory's second-order term: the advancing blade meets more of the rising inflow.
    assert load.pitch_kg_m_per_s * across == pytest.approx(pitch, rel=1e-2)


@pytest.mark.parametrize("spin", ["ccw", "cw"])
def test_directions_of_force_and_moment(spin: str) -> None:
    sign = 1.0 if spin == "ccw" else -1.0
    force, torque, _ = on_hub(single(spin=spin), u=(8.0, 0.0, 0.0))
    load = at(0.0, 8.0)
    assert force[0] == pytest.approx(-8.0 * load.across_kg_per_s, rel=1e-6)
    assert force[2] == pytest.approx(load.thrust_n, rel=1e-6)
    # Counter-clockwise, flying to +x: the right side advances, lifts more and rolls the vehicle to the left (-x).
    assert torque[0] == pytest.approx(-sign * 8.0 * load.roll_kg_m_per_s, rel=1e-6)
    assert torque[1] == pytest.approx(-8.0 * load.pitch_kg_m_per_s, rel=1e-6)  # nose up
    assert torque[2] == pytest.approx(-sign * load.torque_nm, rel=1e-6)


def test_kernel_and_equations_agree_everywhere() -> None:
    rng = np.random.default_rng(5)
    vehicle = single(axis=(0.2, -0.1, 1.0))
    n = np.array(vehicle.rotors[0].axis)
    for _ in range(300):
        u = tuple(rng.normal(0.0, 9.0, 3).tolist())
        speed, height = float(rng.uniform(20.0, 1000.0)), float(rng.uniform(0.05, 3.0))
        u_n = float(np.dot(u, n))
        across = np.array(u) - u_n * n
        across2 = float(across @ across)
        gamma = rotor_equations.ground_inflow_loss(LUMPS, speed, across2, height, n[2])
        load = rotor_equations.loads(LUMPS, speed, u_n, across2, gamma=gamma)
        force, torque, rotors = on_hub(vehicle, u=u, speed=speed, height_m=height)
        scale = K * speed**2 + float(np.dot(u, u)) * 1e-2
        assert rotors.induced_mps[0] == pytest.approx(load.induced_mps, rel=2e-5, abs=1e-6)
        assert force == pytest.approx(load.thrust_n * n - load.across_kg_per_s * across, abs=1e-5 * scale)
        moment = -load.roll_kg_m_per_s * across - load.pitch_kg_m_per_s * np.cross(n, across) - load.torque_nm * n
        assert torque == pytest.approx(moment, abs=1e-6 * scale)


def test_newton_reaches_its_bound_for_every_flow() -> None:
    rng = np.random.default_rng(0)
    speed = np.exp(rng.uniform(math.log(0.5), math.log(1500.0), 20_000))
    u_n, across2 = (
        rng.normal(0.0, 12.0, speed.size),
        rng.normal(0.0, 12.0, speed.size) ** 2 * rng.integers(0, 2, speed.size),
    )
    v = rotor_equations.induced_velocity(LUMPS, speed, u_n, across2)
    far = rotor_equations.induced_velocity(LUMPS, speed, u_n, across2, steps=40)
    v_h = math.sqrt(LUMPS.kappa_m2) * speed
    assert np.max(np.abs(v - far) / np.maximum(v_h, np.abs(far))) < 1e-13


def test_the_equation_of_the_inflow_has_one_solution() -> None:
    """v W rises with v, W^2 is above 0: for every ratio of the flow's parts."""
    v = np.linspace(-6.0, 6.0, 200_001)
    for across2 in (0.0, 0.01, 0.1, 1.0, 10.0):
        square = rotor_equations.flux2(-1.0, across2, v)[0]
        assert square.min() > 0.09
        assert np.diff(v * np.sqrt(square)).min() > 0.0


def test_equations_take_symbols() -> None:
    flow = ca.SX.sym("flow", 3)
    load = rotor_equations.loads(LUMPS, flow[0], flow[1], flow[2])
    function = ca.Function("load", [flow], [load.thrust_n, load.torque_nm, ca.jacobian(load.thrust_n, flow)])
    thrust, torque, slope = function([SPEED, -3.0, 25.0])
    assert float(thrust) == pytest.approx(at(-3.0, 5.0).thrust_n, rel=1e-13)
    assert float(torque) == pytest.approx(at(-3.0, 5.0).torque_nm, rel=1e-13)
    step = 1e-5
    numeric = (at(-3.0 + step, 5.0).thrust_n - at(-3.0 - step, 5.0).thrust_n) / (2 * step)
    assert float(slope[1]) == pytest.approx(numeric, rel=1e-7)


@pytest.mark.parametrize("left", [0.0, 0.5, 0.8])
def test_a_damaged_rotor_keeps_its_share_in_hover(left: float) -> None:
    vehicle = single()
    rotors = rotors_force(vehicle.rotors, vehicle.rotor_constants, Effects(), blades=X500.rotor_constants.blade_element)
    rotors.set_rotor(0, left, -1.0, 0.0)
    truth = np.zeros(20)
    truth[3], truth[2], truth[13] = 1.0, 300.0, SPEED
    body = rigid_body(
        vehicle, truth, forces=[rotors], gravity_mps2=0.0, wind_W_mps=(0, 0, 0), steps=TickSteps(tick_s=1e-6, free=1)
    )
    body.command([SPEED / vehicle.rotor_constants.max_speed_radps])
    body.fly()
    body.finish()
    assert truth[16] * vehicle.mass_kg == pytest.approx(left * K * SPEED**2, rel=1e-6, abs=1e-9)
    assert rotors.torque_nm[0] == pytest.approx(left * 0.016 * K * SPEED**2, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", ["x8", "y6"])
def test_a_coaxial_pair_keeps_the_ratio_of_its_file(name: str) -> None:
    """The lower rotor has the share t of the upper one's thrust at equal speeds, for about equal torques."""
    vehicle = load_vehicle(name)
    c = vehicle.rotor_constants
    assert c.blade_element is not None
    pair = tuple(r for i, r in enumerate(vehicle.rotors) if i == 0 or r.coaxial_below == 0)
    lower = pair[1].model_copy(update={"coaxial_below": 0})
    both = vehicle.model_copy(update={"rotors": (pair[0], lower)})
    speed = 0.6 * c.max_speed_radps
    force, _, rotors = on_hub(both, speed=speed)
    assert force[2] == pytest.approx(
        (1 + c.coaxial_thrust_ratio) * c.thrust_coefficient_n_per_radps2 * speed**2, rel=1e-6
    )
    assert rotors.torque_nm[1] == pytest.approx(rotors.torque_nm[0], rel=0.08)
    chi = rotor_equations.coaxial_wake(c, lumps_of(c, c.blade_element))
    assert 0.8 < chi < 2.0  # about the flow through the upper disc, up to its far wake


def test_a_vehicle_in_a_wake_loses_thrust() -> None:
    """A wind from above of w costs dT/du of thrust, not only the body's drag."""
    still, down = on_hub(X500), on_hub(X500, u=(0.0, 0.0, 5.0))
    assert down[0][2] == pytest.approx(4 * at(5.0).thrust_n, rel=1e-6)
    assert still[0][2] - down[0][2] > 4 * 0.4 * LUMPS.c_l * SPEED * 5.0


def test_full_throttle_climb_is_that_of_such_vehicles() -> None:
    """An X500 climbs at 10 to 12 m/s, not at 19."""
    scene = load_scene("airfield").model_copy(update={"site": Site(latitude_deg=0, longitude_deg=0, altitude_m=0)})
    physics = VehiclePhysics(X500, scene, 4_000_000, start=FlightStart(p_WB=(0, 0, 100)))
    physics.advance(0, (1.0,) * 4)
    for tick in range(1, 2501):
        truth = physics.advance(tick, (1.0,) * 4)
    assert 9.0 < truth.v_WB_W[2] < 12.0
    climb = physics.state[13:].mean()
    assert climb == pytest.approx(1000.0)


@pytest.mark.parametrize(("altitude", "degc"), [(0.0, None), (2500.0, None), (2500.0, 30.0), (4000.0, -20.0)])
def test_density_scales_every_force(altitude: float, degc: float | None) -> None:
    site = Site(latitude_deg=0, longitude_deg=0, altitude_m=altitude, temperature_degc=degc)
    z = 300.0
    ratio = density_kgpm3(altitude + z, site.warmer_k) / RHO
    assert site.density_ratio == pytest.approx(density_kgpm3(altitude, site.warmer_k) / RHO)
    here = on_hub(single(), u=(4.0, -3.0, 2.0), air=(altitude, site.warmer_k), height_m=z)
    there = on_hub(single(), u=(4.0, -3.0, 2.0), height_m=z)
    assert here[0] == pytest.approx(ratio * there[0], rel=1e-6)
    assert here[1] == pytest.approx(ratio * there[1], rel=1e-6)
    assert here[2].induced_mps == pytest.approx(there[2].induced_mps, rel=1e-6)


def test_density_is_the_standard_atmosphere() -> None:
    truth = np.zeros(19)
    truth[3] = 1.0
    body = rigid_body(
        X500.model_copy(update={"rotors": ()}),
        truth,
        forces=[],
        gravity_mps2=0.0,
        wind_W_mps=(0, 0, 0),
        steps=TickSteps(tick_s=0.004, free=1),
        air=(488.0, 7.0),
    )
    for z in (-400.0, 0.0, 63.999, 64.001, 1000.0, 9000.0, 12_000.0):
        truth[2] = z
        assert body.density_ratio() == pytest.approx(density_kgpm3(488.0 + z, 7.0) / RHO, rel=1e-10)
    assert density_kgpm3(0.0) == pytest.approx(1.225, rel=1e-5)
    assert density_kgpm3(2500.0) == pytest.approx(0.9569, rel=1e-3)  # ISO 2533, table


def test_battery_delivers_the_work_of_the_shafts() -> None:
    """The charge drawn over two seconds is the integral of torque times speed, also in climb."""
    physics = VehiclePhysics(
        X500, load_scene("airfield"), 4_000_000, start=FlightStart(p_WB=(0, 0, 100)), effects=Effects(battery=True)
    )
    assert X500.battery is not None
    physics.state[9], physics.state[13:] = 3.0, 780.0
    physics.advance(0, (0.8,) * 4)
    work = drawn = 0.0
    for tick in range(1, 251):
        truth = physics.advance(tick, (0.8,) * 4)
        assert physics.battery is not None
        drawn += physics.battery.current_a * physics.battery.voltage_v * 0.004
        u, o = truth.v_WB_W[2], truth.rotor_speed_radps[0]
        ratio = density_kgpm3(488.0 + truth.p_WB[2]) / RHO
        work += 4 * ratio * float(at(u, 0.0, o).power_w) * 0.004
    assert drawn == pytest.approx(work / X500.battery.efficiency + X500.battery.auxiliary_w, rel=2e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"zero_thrust_advance_ratio": 0.2}, "too small"),
        ({"zero_thrust_advance_ratio": None}, "needs exactly one of"),
        ({"inflow_thrust_kg_per_rad": 1e-3}, "needs exactly one of"),
        ({"induced_power_factor": 2.0}, "moment_ratio_m 0.016 is below"),
    ],
)
def test_constants_that_contradict_each_other_are_named(change: dict[str, Any], message: str) -> None:
    data = X500.model_dump()
    data["rotor_constants"]["blade_element"] |= change
    with pytest.raises(ValueError, match=message):
        Vehicle.model_validate(data)


def test_the_model_needs_its_lumps() -> None:
    data = X500.model_dump()
    data["rotor_constants"]["blade_element"] = None
    with pytest.raises(ValueError, match=r"rotor_model blade_element needs rotor_constants\.blade_element"):
        Vehicle.model_validate(data)
    assert lumps_of(X500.rotor_constants, BladeElement(inflow_thrust_kg_per_rad=1e-4)).c_l == 1e-4
