"""Vehicles without forces, with one, and with others than a multirotor's, against closed forms."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from signals.errors import ConfigError
from sim import _kernels
from sim.physics.flight_start import FlightStart
from sim.physics.forces.buoyancy import Buoyancy
from sim.physics.forces.force import Effects, ForceParameters, kinds
from sim.physics.forces.push import Push
from sim.physics.vehicle import VEHICLE_DIR, Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from tests.worlds.rotor_models import quadratic

TICK_NS = 4_000_000
X500 = quadratic("x500")
ALOFT = FlightStart(p_WB=(0.0, 0.0, 500.0))


def bare(**changes: object) -> Vehicle:
    """Return the x500's body without anything that acts on it."""
    nothing = {
        "rotors": (),
        "body_drag_linear_n_per_mps": (0.0, 0.0, 0.0),
        "body_drag_quadratic_n_per_m2ps2": (0.0, 0.0, 0.0),
        "battery": None,
    }
    return X500.model_copy(update=nothing | changes)


def flown(vehicle: Vehicle, ticks: int) -> VehiclePhysics:
    physics = VehiclePhysics(vehicle, load_scene("airfield"), TICK_NS, start=ALOFT)
    for tick in range(ticks + 1):
        physics.advance(tick, [])
    return physics


def test_a_body_without_forces_falls_freely() -> None:
    physics = flown(bare(), 500)
    g, t = physics.scene.gravity_mps2, 2.0
    truth = physics.truth
    assert truth.p_WB[2] == pytest.approx(500.0 - 0.5 * g * t * t, abs=1e-9)
    assert truth.v_WB_W[2] == pytest.approx(-g * t, abs=1e-11)
    assert truth.rotor_speed_radps == ()


def test_drag_alone_gives_the_closed_form_of_a_fall() -> None:
    d = 0.5
    physics = flown(bare(body_drag_quadratic_n_per_m2ps2=(d, d, d)), 1000)
    g, m, t = physics.scene.gravity_mps2, X500.mass_kg, 4.0
    end = math.sqrt(m * g / d)
    assert physics.truth.v_WB_W[2] == pytest.approx(-end * math.tanh(g * t / end), rel=1e-10)


def test_drag_of_a_slanting_flow_is_along_each_axis_with_the_whole_airspeed() -> None:
    """F = -(l_j + q_j |u|) u_j, over a tick that hardly slows the body."""
    linear, quadratic, v = (0.02, 0.03, 0.05), (0.01, 0.02, 0.04), np.array([3.0, -4.0, 12.0])
    body = bare(body_drag_linear_n_per_mps=linear, body_drag_quadratic_n_per_m2ps2=quadratic)
    physics = VehiclePhysics(body, load_scene("airfield"), TICK_NS, start=ALOFT)
    physics.state[7:10] = v
    for tick in range(2):
        physics.advance(tick, [])
    force_n = -(np.array(linear) + np.array(quadratic) * np.linalg.norm(v)) * v
    expected = force_n / X500.mass_kg - (0.0, 0.0, physics.scene.gravity_mps2)
    assert physics.truth.a_WB_W == pytest.approx(expected, rel=5e-3)


def test_buoyancy_lifts_and_swings_the_body_like_a_pendulum() -> None:
    arm = 0.3
    cell = Buoyancy(kind="buoyancy", volume_m3=0.5, centre_m=(0.0, 0.0, arm))
    physics = VehiclePhysics(bare(forces=(cell,)), load_scene("airfield"), TICK_NS, start=ALOFT)
    lift_n = 1.225 * 9.80665 * 0.5
    tilt = 1e-4  # small: the pendulum's equation is linear
    physics.state[3:7] = (math.cos(0.5 * tilt), math.sin(0.5 * tilt), 0.0, 0.0)
    ticks = 400
    for tick in range(ticks + 1):
        physics.advance(tick, [])
    truth, t = physics.truth, ticks * TICK_NS / 1e9
    climb = lift_n / X500.mass_kg - physics.scene.gravity_mps2
    omega = math.sqrt(lift_n * arm / X500.inertia_kgm2[0])
    assert truth.v_WB_W[2] == pytest.approx(climb * t, rel=1e-7)
    assert 2.0 * truth.q_WB[1] == pytest.approx(tilt * math.cos(omega * t), abs=1e-10)


def test_a_push_accelerates_a_turning_body_along_the_axes_of_the_world() -> None:
    physics = VehiclePhysics(
        bare(forces=(Push(kind="push", force_W_n=(3.0, 0.0, 0.0)),)), load_scene("airfield"), TICK_NS, start=ALOFT
    )
    physics.state[10:13] = (1.0, 2.0, 3.0)
    m, g = X500.mass_kg, physics.scene.gravity_mps2
    for tick in range(251):
        physics.advance(tick, [])
    assert physics.truth.v_WB_W == pytest.approx((3.0 / m, 0.0, -g), abs=1e-9)
    physics.set_push((0.0, -5.0, 1.0))
    for tick in range(251, 501):
        physics.advance(tick, [])
    assert physics.truth.v_WB_W == pytest.approx((3.0 / m, -5.0 / m, 1.0 / m - 2.0 * g), abs=1e-9)
    assert physics.restart(1).v_WB_W == (0.0, 0.0, 0.0)
    for tick in range(1, 251):
        physics.advance(tick, [])
    assert physics.truth.v_WB_W == pytest.approx((3.0 / m, 0.0, -g), abs=1e-9)  # the force of the vehicle's file again
    with pytest.raises(ValueError, match="no force of kind push"):
        flown(bare(), 0).set_push((1.0, 0.0, 0.0))


def test_the_last_push_is_set_and_what_a_file_declares_before_it_stays() -> None:
    forces = (Push(kind="push", force_W_n=(3.0, 0.0, 0.0)), Push(kind="push"))
    physics = VehiclePhysics(bare(forces=forces), load_scene("airfield"), TICK_NS, start=ALOFT)
    physics.set_push((0.0, -5.0, 0.0))
    for tick in range(251):
        physics.advance(tick, [])
    m, g = X500.mass_kg, physics.scene.gravity_mps2
    assert physics.truth.v_WB_W == pytest.approx((3.0 / m, -5.0 / m, -g), abs=1e-9)


def test_one_rotor_and_a_gas_cell_is_a_vehicle() -> None:
    cell = Buoyancy(kind="buoyancy", volume_m3=1.0)
    vehicle = bare(rotors=X500.rotors[:1], forces=(cell,))
    physics = VehiclePhysics(vehicle, load_scene("airfield"), TICK_NS, start=ALOFT)
    for tick in range(10):
        physics.advance(tick, [0.5])
    assert len(physics.truth.rotor_speed_radps) == 1
    assert physics.truth.rotor_speed_radps[0] > 0.0


def test_a_vehicle_of_forces_comes_from_its_file(tmp_path: Path) -> None:
    text = (VEHICLE_DIR / "x500.yaml").read_text()
    path = tmp_path / "airship.yaml"
    path.write_text(text + "\nforces:\n  - {kind: buoyancy, volume_m3: 0.4, centre_m: [0, 0, 0.2]}\n")
    assert load_vehicle(path).forces == (Buoyancy(kind="buoyancy", volume_m3=0.4, centre_m=(0.0, 0.0, 0.2)),)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("{kind: bouyancy, volume_m3: 0.4}", ["forces[0]", "bouyancy"]),
        ("{kind: buoyancy, volume: 0.4}", ["forces[0].volume", "unknown key", "volume_m3"]),
        ("{kind: buoyancy, volume_m3: -1}", ["forces[0].volume_m3", "above 0 m3"]),
    ],
)
def test_a_wrong_entry_is_told_with_its_line(tmp_path: Path, entry: str, words: list[str]) -> None:
    path = tmp_path / "airship.yaml"
    path.write_text((VEHICLE_DIR / "x500.yaml").read_text() + f"\nforces:\n  - {entry}\n")
    with pytest.raises(ConfigError) as caught:
        load_vehicle(path)
    line = len(path.read_text().splitlines())
    assert f"{path.name}:{line}" in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_rotors_without_their_constants_are_told(tmp_path: Path) -> None:
    lines = (VEHICLE_DIR / "x500.yaml").read_text().splitlines()
    first = lines.index("rotor_constants:")
    last = next(i for i in range(first + 1, len(lines)) if lines[i] and not lines[i].startswith(" "))
    path = tmp_path / "bare.yaml"
    path.write_text("\n".join(lines[:first] + lines[last:]))
    with pytest.raises(ConfigError, match="rotors need rotor_constants"):
        load_vehicle(path)


def test_a_force_belongs_to_one_body() -> None:
    forces = X500.make_forces(Effects())
    truth = np.zeros(13 + 4 + 6)
    truth[3] = 1.0
    kernel = {
        "truth": truth,
        "mass_kg": 1.0,
        "inertia_kgm2": (1.0, 1.0, 1.0),
        "gravity_mps2": 9.8,
        "wind_W_mps": (0.0, 0.0, 0.0),
        "tick_s": 0.004,
        "substeps": 1,
        "contact_substeps": 4,
    }
    _kernels.RigidBody(forces=forces, **kernel)
    with pytest.raises(ValueError, match="one body only"):
        _kernels.RigidBody(forces=forces, **kernel)


def test_every_kind_is_named_like_its_file_and_its_kernel() -> None:
    assert kinds()
    for kind in kinds():
        module = kind.__module__.rpartition(".")[2]
        assert kind.model_fields["kind"].annotation.__args__ == (module,)  # type: ignore[union-attr]
        assert hasattr(_kernels, kind.__name__)
        assert issubclass(kind, ForceParameters)
        source = Path(__file__).resolve().parents[4] / "sim" / "native" / "forces" / f"{module}.cpp"
        assert source.is_file()
