"""A vehicle that leaves the model's range names the figure of its file that takes it there."""

from __future__ import annotations

from typing import Any

import pytest

from signals.errors import ModelRangeError
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import Vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from tests.worlds.rotor_models import quadratic

X500 = quadratic("x500")


def fly(vehicle: Vehicle, control: float) -> None:
    physics = VehiclePhysics(vehicle, load_scene("airfield"), 4_000_000, start=FlightStart(p_WB=(0.0, 0.0, 1000.0)))
    for tick in range(1500):
        physics.advance(tick, (control, control, control * 1.01, control))


def changed(**figures: Any) -> Vehicle:
    data = X500.model_dump(mode="json")
    rotor = data["rotor_constants"]
    for key, value in figures.items():
        (rotor if key in rotor else data)[key] = value
    return Vehicle.model_validate(data)


@pytest.mark.parametrize(
    ("figures", "cause"),
    [
        ({"body_drag_quadratic_n_per_m2ps2": [100.0, 100.0, 100.0], "mass_kg": 0.0011}, "body_drag_quadratic_n_per_m2"),
        ({"thrust_coefficient_n_per_radps2": 1.0}, "rotor_constants.thrust_coefficient_n_per_radps2 1"),
    ],
)
def test_the_cause_is_named(figures: dict[str, Any], cause: str) -> None:
    with pytest.raises(ModelRangeError) as caught:
        fly(changed(**figures), 1.0)
    assert cause in caught.value.cause
    assert str(caught.value).endswith(f": {caught.value.cause}")


def test_an_ordinary_vehicle_that_is_too_fast_has_no_such_cause() -> None:
    physics = VehiclePhysics(X500, load_scene("airfield"), 4_000_000, start=FlightStart(p_WB=(0.0, 0.0, 1000.0)))
    physics.state[7] = 250.0
    physics.advance(0, (0.5,) * 4)
    with pytest.raises(ModelRangeError, match=r"speed_mps = .* \(<= 200 m/s\)$"):
        physics.advance(1, (0.5,) * 4)
