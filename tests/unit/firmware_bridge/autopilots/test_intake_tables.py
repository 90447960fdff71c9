"""The tables of what each autopilot takes of the sensors: names that exist, and the barometer's conversion."""

from __future__ import annotations

from typing import get_args

import pytest

from firmware_bridge.autopilots.ardupilot.sensors import altitude_offset_m
from firmware_bridge.autopilots.catalog import PROFILES, SENSOR_KINDS
from firmware_bridge.autopilots.intake import Samples, Simulated
from hil.config.schema import Autopilot
from sim.scene.atmosphere import pressure_altitude_m, pressure_pa
from sim.sensors.catalog import KINDS
from sim.sensors.faults import FAULT_FIELDS


def test_every_kind_of_autopilot_has_a_table_of_sensors_and_fields_that_exist() -> None:
    assert set(PROFILES) == set(get_args(Autopilot.model_fields["kind"].annotation))
    for profile in PROFILES.values():
        assert "imu" in profile.sensors
        for kind, intake in profile.sensors.items():
            assert kind in SENSOR_KINDS
            fields = FAULT_FIELDS[KINDS[kind].sample_type]
            assert set(intake.fields if isinstance(intake, Samples) else intake.offset) <= set(fields)
            assert isinstance(intake, Simulated) or set(intake.whole) <= {
                "dropout",
                "freeze",
                "blocked",
                "jammer",
                "spoofer",
            }


def test_parameters_of_a_fault_fit_mavlink_and_belong_to_one_kind_of_change() -> None:
    changes = [
        change
        for profile in PROFILES.values()
        for kind, intake in profile.sensors.items()
        if isinstance(intake, Simulated)
        for fault in ("dropout", "freeze", "offset", "drift", "stuck_bit")
        for field in (None, *FAULT_FIELDS[KINDS[kind].sample_type])
        for change in intake.changes(fault, field)
    ]
    assert len(changes) > 30
    for change in changes:
        assert len({type(spelling) for spelling in change}) == 1
        assert all(len(spelling.name) <= 16 for spelling in change)


@pytest.mark.parametrize("altitude_m", [0.0, 488.0, 3000.0])
@pytest.mark.parametrize("offset_pa", [-500.0, -1.0, 0.0, 100.0, 5000.0])
def test_an_offset_of_the_pressure_is_the_offset_of_the_altitude_at_which_it_is_measured(
    altitude_m: float, offset_pa: float
) -> None:
    """Geopotential and geometric altitude differ by 1 in 2000 at 3 km."""
    pressure = pressure_pa(altitude_m)
    expected_m = pressure_altitude_m(pressure + offset_pa) - pressure_altitude_m(pressure)
    assert altitude_offset_m(offset_pa, altitude_m) == pytest.approx(expected_m, rel=1e-3, abs=1e-6)
