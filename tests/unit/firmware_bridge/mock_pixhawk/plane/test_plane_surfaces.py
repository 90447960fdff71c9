"""Allocation to surfaces: every arrangement gives the torque asked for, and saturation keeps roll."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.plane.surfaces import SurfaceMixer, allocation

ELEVONS = [[0.5, -0.5], [-0.5, -0.5], [0.0, 0.0]]
CONVENTIONAL = [[-0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
V_TAIL = [[-0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.5], [0.0, 0.0, 0.5, -0.5]]
ARRANGEMENTS = {"elevons": ELEVONS, "conventional": CONVENTIONAL, "v_tail": V_TAIL}


def mixer(effect):
    table = ParamTable.of_firmware(plane=True)
    table.set("CA_SV_CS_COUNT", len(effect[0]))
    for axis, row in zip("RPY", effect, strict=True):
        for i, value in enumerate(row):
            assert table.set(f"CA_SV_CS{i}_TRQ_{axis}", value) is None
    return SurfaceMixer(table)


@pytest.mark.parametrize("name", ARRANGEMENTS)
def test_it_is_the_pseudo_inverse(name):
    effect = np.array(ARRANGEMENTS[name])
    assert np.array(allocation(effect.tolist())) == pytest.approx(np.linalg.pinv(effect), abs=1e-12)


@pytest.mark.parametrize("name", ARRANGEMENTS)
@given(demand=st.tuples(*[st.floats(-0.3, 0.3)] * 3))
def test_small_demands_are_met_exactly(name, demand):
    effect = np.array(ARRANGEMENTS[name])
    served = np.abs(effect).max(axis=1) > 0.0
    got = effect @ np.array(mixer(ARRANGEMENTS[name]).commands(*demand))
    assert got[served] == pytest.approx(np.array(demand)[served], abs=1e-6)


@given(demand=st.tuples(*[st.floats(-50.0, 50.0)] * 3))
def test_commands_stay_within_range_and_roll_comes_first(demand):
    commands = mixer(ELEVONS).commands(*demand)
    assert all(-1.0 <= value <= 1.0 for value in commands)
    roll = np.array(ELEVONS[0]) @ commands
    assert roll == pytest.approx(min(max(demand[0], -1.0), 1.0), abs=1e-6)


def test_a_surface_without_effect_is_not_moved():
    assert allocation([[0.0], [0.0], [0.0]]) == [[0.0, 0.0, 0.0]]
    assert mixer([[], [], []]).commands(1.0, 1.0, 1.0) == []


def test_one_surface_that_should_do_all_does_what_it_can():
    """A single elevon: roll and pitch cannot be told apart; pitch and yaw are given up."""
    mix = allocation([[0.5], [0.5], [0.1]])
    assert mix[0][0] == pytest.approx(2.0)
    assert mix[0][1:] == [0.0, 0.0]


def test_a_steering_wheel_and_a_brake_take_no_part_in_the_allocation_and_get_their_own_commands():
    with_wheels = [[*row, 0.0, 0.0] for row in CONVENTIONAL]
    with_wheels[2][4] = -1.0  # turns to the left at a positive command
    table = ParamTable.of_firmware(plane=True)
    table.set("CA_SV_CS_COUNT", 6)
    for axis, row in zip("RPY", with_wheels, strict=True):
        for i, value in enumerate(row):
            table.set(f"CA_SV_CS{i}_TRQ_{axis}", value)
    table.set("CA_SV_CS4_TYPE", 16)
    table.set("CA_SV_CS5_TYPE", 20)
    plane = SurfaceMixer(table)
    commands = plane.commands(0.2, -0.1, 0.3)
    assert commands == [*mixer(CONVENTIONAL).commands(0.2, -0.1, 0.3), 0.0, 0.0]
    plane.set_wheels(commands, steering=0.4, brake=2.0)
    assert commands[4:] == [-0.4, 1.0]
