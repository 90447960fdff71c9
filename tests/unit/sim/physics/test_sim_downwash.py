"""Downwash against the closed form of its jet: speed, momentum flux, skew, edges; in a group, and switched off."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from signals.samples import Vec3
from sim._kernels import write_downwash
from sim.physics import multirotor
from sim.physics.disturbances import Disturbances
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_group import VehicleGroup
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from sim.scene.wind import Wind

TICK_NS = 4_000_000
DENSITY_KGPM3 = 1.225
AIRFIELD = load_scene("airfield")
X500 = load_vehicle("x500")
THRUST_N = X500.mass_kg * 9.80665
DISCS_M2 = 4.0 * math.pi * X500.rotor_constants.radius_m**2
FAR_WAKE_MPS = 2.0 * math.sqrt(THRUST_N / (2.0 * DENSITY_KGPM3 * DISCS_M2))
B0_M = math.sqrt(DISCS_M2 / math.pi)
HEIGHT_M = 100.0


def hovering(p_W: Vec3, wind_W_mps: Vec3 = (0.0, 0.0, 0.0), kind: str = "x500") -> VehiclePhysics:
    """Return a vehicle in the air with its rotors at hover speed."""
    vehicle = load_vehicle(kind)
    physics = VehiclePhysics(
        vehicle,
        AIRFIELD,
        TICK_NS,
        start=FlightStart(p_WB=(p_W[0], p_W[1], p_W[2] + HEIGHT_M)),
        disturbances=Disturbances(wind=Wind(steady_W_mps=wind_W_mps)),
    )
    physics.state[13:] = multirotor.speed_radps(vehicle, multirotor.hover_control(vehicle))
    return physics


def wind_below(upper: VehiclePhysics, offset_W: Vec3) -> NDArray[np.float64]:
    """Return the wind of the upper vehicle's wake at an offset from it."""
    probe = VehiclePhysics(X500, AIRFIELD, TICK_NS, start=FlightStart(p_WB=(0.0, 0.0, HEIGHT_M)))
    probe.state[:3] = upper.state[:3] + offset_W
    wind_W = np.zeros((2, 3))
    write_downwash([upper.body, probe.body], wind_W)
    assert not wind_W[0].any()
    return wind_W[1]


@pytest.mark.parametrize("z_m", [0.3, 1.0, 5.0])
@pytest.mark.parametrize("r_m", [0.0, 0.2])
def test_speed_of_a_hovering_vehicles_jet(z_m: float, r_m: float) -> None:
    b_m = B0_M + 0.107 * z_m
    u_mps = FAR_WAKE_MPS * B0_M / b_m * math.exp(-((r_m / b_m) ** 2))
    assert wind_below(hovering((0.0, 0.0, 0.0)), (0.6 * r_m, -0.8 * r_m, -z_m)) == pytest.approx(
        [0.0, 0.0, -u_mps], rel=1e-9
    )


@pytest.mark.parametrize("z_m", [0.5, 4.0, 20.0])
def test_the_jet_carries_the_thrust(z_m: float) -> None:
    upper = hovering((0.0, 0.0, 0.0))
    r_m = np.linspace(0.0, 3.1 * (B0_M + 0.107 * z_m), 400)
    u_mps = np.array([wind_below(upper, (r, 0.0, -z_m))[2] for r in r_m.tolist()])
    flux_n = DENSITY_KGPM3 * np.trapezoid(u_mps**2 * 2.0 * math.pi * r_m, r_m)
    assert flux_n == pytest.approx(THRUST_N, rel=1e-3)


def test_a_moving_vehicle_leaves_its_jet_behind() -> None:
    """Air past the vehicle moves the jet's axis: by flight through still air, or by wind past a vehicle that stays."""
    flying = hovering((0.0, 0.0, 0.0))
    flying.state[7:10] = (5.0, 0.0, 0.0)
    behind = (-5.0 * 0.1, 0.0, -FAR_WAKE_MPS * 0.1)
    expected = FAR_WAKE_MPS * B0_M / (B0_M + 0.107 * math.hypot(*behind))
    assert wind_below(flying, behind) == pytest.approx([0.0, 0.0, -expected], rel=1e-9)
    assert wind_below(hovering((0.0, 0.0, 0.0), (-5.0, 0.0, 0.0)), behind) == pytest.approx(
        [0.0, 0.0, -expected], rel=1e-9
    )


def test_no_wind_above_or_outside_or_without_thrust() -> None:
    upper = hovering((0.0, 0.0, 0.0))
    edge_m = 3.0 * (B0_M + 0.107)
    assert wind_below(upper, (0.999 * edge_m, 0.0, -1.0)).any()
    assert not wind_below(upper, (1.001 * edge_m, 0.0, -1.0)).any()
    assert not wind_below(upper, (0.0, 0.0, 0.1)).any()
    upper.state[13:] = 0.0
    assert not wind_below(upper, (0.0, 0.0, -1.0)).any()


def test_a_coaxial_pair_has_one_disc() -> None:
    upper = hovering((0.0, 0.0, 0.0), kind="x8")
    c, speeds = upper.vehicle.rotor_constants, upper.state[13:]
    thrust_n = 0.0
    for rotor, speed in zip(upper.vehicle.rotors, speeds.tolist(), strict=True):
        above = 0.0 if rotor.coaxial_below is None else float(speeds[rotor.coaxial_below])
        thrust_n += c.thrust_coefficient_n_per_radps2 * speed * (speed - (1.0 - c.coaxial_thrust_ratio) * above)
    discs_m2 = 4.0 * math.pi * c.radius_m**2
    b0_m = math.sqrt(discs_m2 / math.pi)
    expected = 2.0 * math.sqrt(thrust_n / (2.0 * DENSITY_KGPM3 * discs_m2)) * b0_m / (b0_m + 0.107 * 2.0)
    assert wind_below(upper, (0.0, 0.0, -2.0))[2] == pytest.approx(-expected, rel=1e-9)


def test_in_a_group_the_lower_vehicle_is_pushed_down() -> None:
    hover = (multirotor.hover_control(X500),) * 4

    def end(*, downwash: bool, apart_m: float = 0.0) -> list[VehiclePhysics]:
        vehicles = [hovering((0.0, 0.0, 0.0)), hovering((apart_m, 0.0, -1.5))]
        group = VehicleGroup(dict(zip("ab", vehicles, strict=True)), downwash=downwash)
        for tick in range(126):
            group.advance(tick, [hover, hover])
        return vehicles

    still, blown, apart = end(downwash=False), end(downwash=True), end(downwash=True, apart_m=5.0)
    assert blown[1].wind_W_mps[2] == pytest.approx(-FAR_WAKE_MPS * B0_M / (B0_M + 0.107 * 1.5), rel=0.1)
    assert blown[1].state[2] < still[1].state[2] - 0.05
    assert np.array_equal(blown[0].state, still[0].state)
    assert np.array_equal(apart[0].state, still[0].state)
    assert np.array_equal(apart[1].state[2:], still[1].state[2:])  # it began at another x
    assert still[1].wind_W_mps == (0.0, 0.0, 0.0)
