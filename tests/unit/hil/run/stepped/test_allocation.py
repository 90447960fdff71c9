"""Allocation to the rotors: exact where it fits, priorities where it does not."""

from __future__ import annotations

import numpy as np
import pytest

from hil.run.stepped.allocation import Allocation
from sim.physics import multirotor
from sim.physics.forces.rotors import Spin
from sim.physics.multirotor import multirotor_names
from sim.physics.vehicle import load_vehicle

NAMES = multirotor_names()


def produced(name: str, thrust_n: list[float]) -> np.ndarray:
    """Return roll, pitch, yaw torque and thrust of the rotors, by the vehicle's own matrix."""
    return np.asarray(multirotor.effectiveness(load_vehicle(name)))[[3, 4, 5, 2]] @ np.array(thrust_n)


@pytest.mark.parametrize("name", NAMES)
def test_what_fits_is_produced_exactly(name: str) -> None:
    vehicle = load_vehicle(name)
    weight_n = 9.8 * vehicle.mass_kg
    wanted = np.array([0.03 * weight_n, -0.02 * weight_n, 0.001 * weight_n, weight_n])
    thrusts = Allocation(vehicle, least_n=0.0).thrusts(*wanted)
    np.testing.assert_allclose(produced(name, thrusts), wanted, atol=1e-9 * weight_n)
    inverse = np.linalg.pinv(np.asarray(multirotor.effectiveness(vehicle))[[3, 4, 5, 2]])
    np.testing.assert_allclose(thrusts, inverse @ wanted, rtol=1e-9, atol=1e-9 * weight_n)  # the least sum of squares


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("share", [0.02, 0.97])
def test_roll_and_pitch_go_before_the_thrust(name: str, share: float) -> None:
    allocation = Allocation(load_vehicle(name), least_n=0.0)
    full_n = sum(allocation.rows[3]) * allocation.most_n
    wanted = np.array([0.02 * full_n, 0.01 * full_n, 0.0, share * full_n])
    thrusts = allocation.thrusts(*wanted)
    assert min(thrusts) >= 0.0
    assert max(thrusts) <= allocation.most_n
    np.testing.assert_allclose(produced(name, thrusts)[:3], wanted[:3], atol=1e-9 * full_n)
    assert abs(produced(name, thrusts)[3] - wanted[3]) > 0.001 * full_n


@pytest.mark.parametrize("name", NAMES)
def test_torques_raise_the_thrust_up_to_the_bound(name: str) -> None:
    allocation = Allocation(load_vehicle(name), least_n=0.0)
    full_n = sum(allocation.rows[3]) * allocation.most_n
    allocation.raised_n = 0.2 * full_n
    for share in (0.0, 0.1, 0.3):
        thrusts = allocation.thrusts(10.0 * full_n, 0.0, 0.0, share * full_n)
        roll, _, _, thrust_n = produced(name, thrusts)
        assert roll > 0.0
        assert thrust_n < max(0.2, share) * full_n * (1.0 + 1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_yaw_goes_after_roll_and_pitch(name: str) -> None:
    allocation = Allocation(load_vehicle(name), least_n=0.0)
    full_n = sum(allocation.rows[3]) * allocation.most_n
    wanted = np.array([0.03 * full_n, 0.01 * full_n, 10.0 * full_n, 0.4 * full_n])
    thrusts = allocation.thrusts(*wanted)
    assert min(thrusts) >= 0.0
    assert max(thrusts) <= allocation.most_n
    result = produced(name, thrusts)
    np.testing.assert_allclose(result[:2], wanted[:2], atol=1e-9 * full_n)
    assert 0.0 < result[2] < wanted[2]


@pytest.mark.parametrize("name", NAMES)
def test_too_much_roll_keeps_its_direction(name: str) -> None:
    allocation = Allocation(load_vehicle(name), least_n=0.0)
    full_n = sum(allocation.rows[3]) * allocation.most_n
    thrusts = allocation.thrusts(10.0 * full_n, 5.0 * full_n, full_n, 0.5 * full_n)
    assert min(thrusts) >= 0.0
    assert max(thrusts) <= allocation.most_n
    roll, pitch, yaw, _ = produced(name, thrusts)
    assert roll > 0.0
    if name in ("iris", "x500", "hexa_x", "octa_x", "x8"):  # rotors that all carry the same share of the weight
        assert pitch == pytest.approx(0.5 * roll, rel=1e-6)
        assert yaw == pytest.approx(0.0, abs=1e-6 * full_n)


def test_rotors_that_all_turn_one_way_cannot_be_controlled() -> None:
    vehicle = load_vehicle("iris")
    rotors = tuple(rotor.model_copy(update={"spin": Spin.CCW}) for rotor in vehicle.rotors)
    with pytest.raises(ValueError, match=r"cannot be controlled: .* check positions, spins and moment_ratio_m"):
        Allocation(vehicle.model_copy(update={"rotors": rotors}), least_n=0.0)


@pytest.mark.parametrize("name", NAMES)
def test_yaw_torque_of_a_change_moves_one_rotor_by_it_and_none_further(name: str) -> None:
    allocation = Allocation(load_vehicle(name), least_n=0.0)
    changes = allocation.mix[:, 2] * allocation.yaw_torque_nm(0.5)
    assert np.abs(changes).max() == pytest.approx(0.5)
