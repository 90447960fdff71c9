"""Wings by panels: lifting-line and flat-plate limits, symmetry, glide, energy, ground and slipstream."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pydantic
import pytest

from signals.rotation import matrix_of
from sim import _kernels
from sim.physics.fixed_wing import Airframe
from sim.physics.flight_start import FlightStart
from sim.physics.forces.airfoil import flap_of, lift_of, plate_drag, stall_of
from sim.physics.forces.force import Effects
from sim.physics.forces.panels import Panels
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

_AIRFOIL = {"lift_slope_per_rad": 2.0 * math.pi, "cl_max": 1.3, "cl_min": -1.2, "cd0": 0.01}
_CLEAN: list[float] = []


def _wing(**changes: Any) -> dict[str, Any]:
    given = {"name": "wing", "root_m": (0, 0, 0), "span_m": 6.0, "root_chord_m": 1.0, "tip_chord_m": 1.0, "panels": 6}
    return given | {"airfoil": _AIRFOIL} | changes


def _panels(*wings: dict[str, Any], **parts: Any) -> Panels:
    return Panels(kind="panels", wings=wings, **parts)  # type: ignore[arg-type]


def _force(part: Panels) -> _kernels.Panels:
    made = part.make(Effects())
    assert isinstance(made, _kernels.Panels)
    return made


def _polar(part: Panels, alpha_rad: float, speed_mps: float = 20.0) -> tuple[float, float, float]:
    """Return C_L, C_D and C_m, nose up, over area and mean chord of the first wing."""
    air = (speed_mps * math.cos(alpha_rad), 0.0, -speed_mps * math.sin(alpha_rad))
    deflections = [0.0] * len(part.surfaces)
    force, torque = _force(part).wrench(air, (0.0, 0.0, 0.0), deflections)
    area = part.wings[0].area_m2
    q = 0.5 * 1.225 * speed_mps**2 * area
    lift = force[2] * math.cos(alpha_rad) + force[0] * math.sin(alpha_rad)
    drag = force[2] * math.sin(alpha_rad) - force[0] * math.cos(alpha_rad)
    return lift / q, drag / q, -torque[1] / q / (area / part.wings[0].span_m)


@pytest.mark.parametrize("aspect_ratio", [10.0, 20.0, 40.0])
def test_lift_slope_and_induced_drag_near_those_of_an_elliptic_wing(aspect_ratio: float) -> None:
    """A taper of 0.4 is within 2 % of elliptic loading (Glauert; Katz and Plotkin, 8.1): a = 2 pi / (1 + 2 / A).

    A lattice has the lift of a lifting surface: Helmbold's 2 pi A / (2 + sqrt(A^2 + 4)), which has the same limit.
    """
    mean = 6.0 / aspect_ratio
    root = 2.0 * mean / 1.4
    part = _panels(_wing(root_chord_m=root, tip_chord_m=0.4 * root, panels=16))
    step = 0.01
    slope = (_polar(part, step)[0] - _polar(part, -step)[0]) / (2.0 * step)
    line = 2.0 * math.pi / (1.0 + 2.0 / aspect_ratio)
    surface = 2.0 * math.pi * aspect_ratio / (2.0 + math.sqrt(aspect_ratio**2 + 4.0))
    assert slope == pytest.approx(surface, rel=0.04)
    assert slope == pytest.approx(line, rel=0.05)
    lift, drag, _ = _polar(part, 0.08)
    assert drag - 0.01 == pytest.approx(lift**2 / (math.pi * aspect_ratio), rel=0.06)


def test_few_panels_are_enough() -> None:
    coarse, fine = (_polar(_panels(_wing(panels=n)), 0.1) for n in (4, 16))
    assert coarse[0] == pytest.approx(fine[0], rel=0.005)
    assert coarse[1] == pytest.approx(fine[1], rel=0.01)


def test_section_of_a_long_wing_is_its_airfoil() -> None:
    """Aspect ratio 1000: induced velocities vanish, lift and drag are those of the section in all directions."""
    part = _panels(_wing(span_m=48.0, root_chord_m=0.048, tip_chord_m=0.048, panels=4))
    plate = plate_drag(1000.0)
    stall = stall_of(2.0 * math.pi, 1.3, -1.2, plate)
    for deg in (-60, -20, -8, 3, 10, 25, 50, 80):
        sine = np.array([math.sin(math.radians(deg))])
        assert _polar(part, math.radians(deg))[0] == pytest.approx(
            float(lift_of(sine, 2 * math.pi, stall, plate)[0]), abs=0.012
        )
    assert _polar(part, 0.5 * math.pi)[1] == pytest.approx(plate + 0.01, rel=1e-3)


def test_greatest_and_least_lift_are_those_given() -> None:
    stall = stall_of(6.0, 1.3, -0.9, 1.2)
    sines = np.linspace(-0.5, 0.5, 20001)
    lift = lift_of(sines, 6.0, stall, 1.2)
    assert lift.max() == pytest.approx(1.3, abs=1e-3)
    assert lift.min() == pytest.approx(-0.9, abs=1e-3)
    assert stall.middle > 0.0


@pytest.mark.parametrize(
    ("chord_ratio", "angle", "moment"), [(1.0, 1.0, 0.0), (0.5, 0.8183, -0.5), (0.25, 0.6090, -0.6495)]
)
def test_flap_by_thin_airfoil_theory(chord_ratio: float, angle: float, moment: float) -> None:
    """Glauert's tau; a flap of the whole chord is the wing itself."""
    flap = flap_of(chord_ratio)
    assert flap.angle == pytest.approx(angle, abs=1e-4)
    assert flap.moment == pytest.approx(moment, abs=1e-4)


def test_centre_of_pressure_moves_from_a_quarter_to_three_quarters() -> None:
    part = _panels(_wing(span_m=48.0, root_chord_m=0.048, tip_chord_m=0.048))
    quarter = 0.048 / 4.0  # the root's quarter chord is at the centre of mass

    def behind(deg: float) -> float:
        angle = math.radians(deg)
        force, torque = _force(part).wrench((20 * math.cos(angle), 0.0, -20 * math.sin(angle)), (0.0, 0.0, 0.0), _CLEAN)
        return torque[1] / force[2] / quarter

    assert behind(2.0) == pytest.approx(0.0, abs=0.01)
    assert behind(90.0) == pytest.approx(1.0, abs=0.01)
    assert behind(178.0) == pytest.approx(2.0, abs=0.01)


def test_a_symmetric_plane_has_no_force_to_the_side() -> None:
    part = load_vehicle("trainer").forces[0]
    assert isinstance(part, Panels)
    for deg in range(-180, 181, 15):
        alpha = math.radians(deg)
        force, torque = _force(part).wrench(
            (15 * math.cos(alpha), 0.0, -15 * math.sin(alpha)), (0.0, 1.0, 0.0), [0, 0.2, 0, 0.3]
        )
        assert max(abs(force[1]), abs(torque[0]), abs(torque[2])) < 1e-12


@pytest.mark.parametrize("seed", range(10))
def test_mirrored_flow_has_mirrored_loads(seed: int) -> None:
    part = load_vehicle("trainer").forces[0]
    assert isinstance(part, Panels)
    random = np.random.default_rng(seed)
    air, w, d = random.normal(0, 10, 3), random.normal(0, 3, 3), random.uniform(-0.5, 0.5, 4)
    polar, axial = np.array([1, -1, 1]), np.array([-1, 1, -1])
    f, t = _force(part).wrench(tuple(air), tuple(w), list(d))
    f2, t2 = _force(part).wrench(tuple(air * polar), tuple(w * axial), list(d * [-1, 1, -1, 1]))
    assert np.abs(np.array(f) - np.array(f2) * polar).max() < 1e-10
    assert np.abs(np.array(t) - np.array(t2) * axial).max() < 1e-10


def test_rates_are_damped_and_sideslip_turns_the_nose_into_the_wind() -> None:
    part = load_vehicle("trainer").forces[0]
    assert isinstance(part, Panels)
    made, neutral = _force(part), [0.0] * 4
    for axis in range(3):
        w = [0.0, 0.0, 0.0]
        w[axis] = 0.5
        assert made.wrench((15.0, 0.0, 0.0), tuple(w), neutral)[1][axis] < 0.0
    _, torque = made.wrench((15.0, 1.0, 0.0), (0.0, 0.0, 0.0), neutral)  # to the left: wind from the left
    assert torque[2] > 0.0
    for surface, axis, sign in ((0, 0, 1.0), (1, 1, 1.0), (2, 2, 1.0)):  # roll right, nose down, nose left
        d = list(neutral)
        d[surface] = 0.1
        assert sign * made.wrench((15.0, 0.0, 0.0), (0.0, 0.0, 0.0), d)[1][axis] > 0.0


def test_sweep_dihedral_and_downwash() -> None:
    """Dihedral and sweep make a wing roll away from sideslip; a tail behind a wing has less than its own lift slope."""

    def roll(lift_rad: float, **shape: float) -> float:
        air = (20 * math.cos(lift_rad) * math.cos(0.1), 20 * math.sin(0.1), -20 * math.sin(lift_rad))
        return float(_force(_panels(_wing(**shape))).wrench(air, (0.0, 0.0, 0.0), _CLEAN)[1][0])

    flat = abs(roll(0.0))
    assert flat < 1e-9
    assert roll(0.0, dihedral_deg=5.0) > 10.0  # moving left: the left wing rises
    assert roll(0.1, sweep_deg=30.0) > roll(0.1) + 10.0
    tail = _wing(name="tail", root_m=(-4.0, 0.0, 0.0), span_m=2.0, root_chord_m=0.5, tip_chord_m=0.5)
    alone = _polar(_panels(tail), 0.05)[0]
    wing = _polar(_panels(_wing()), 0.05)[0]
    both = _polar(_panels(_wing(), tail), 0.05)[0]
    share = (both - wing) * 6.0 / alone
    assert 0.3 < share < 0.75  # 1 - d epsilon / d alpha; 2 a / (pi A) = 0.44 far behind an elliptic wing


def _without_engine(name: str = "trainer") -> Vehicle:
    vehicle = load_vehicle(name)
    constants = vehicle.rotor_constants.model_copy(
        update={"thrust_coefficient_n_per_radps2": 1e-12, "dead_time_s": 0.0}
    )
    return vehicle.model_copy(
        update={
            "rotor_constants": constants,
            "rotor_model": "quadratic",
            "battery": None,
            "forces": tuple(force for force in vehicle.forces if force.is_wing),  # no wheels
        }
    )


def _glide(vehicle: Vehicle, start: dict[int, float], commands: list[float], seconds: float) -> np.ndarray[Any, Any]:
    physics = VehiclePhysics(
        vehicle,
        load_scene("airfield"),
        4_000_000,
        effects=Effects(air_density=False),
        start=FlightStart(p_WB=(0.0, 0.0, 600.0)),
    )
    for place, value in start.items():
        physics.state[place] = value
    physics.state[3:7] /= np.linalg.norm(physics.state[3:7])
    physics.advance(0, commands)
    states = [physics.state.copy()]
    for tick in range(1, round(seconds / 0.004) + 1):
        physics.advance(tick, commands)
        states.append(physics.state.copy())
    return np.array(states)


def test_a_trimmed_glide_descends_by_lift_over_drag() -> None:
    vehicle = _without_engine()
    trim = Airframe(vehicle).glide(15.0)
    half = 0.5 * trim.pitch_rad
    start = {
        3: math.cos(half),
        5: -math.sin(half),
        7: 15.0 * math.cos(trim.climb_rad),
        9: 15.0 * math.sin(trim.climb_rad),
    }
    part = vehicle.forces[0]
    assert isinstance(part, Panels)
    deflections = [s.deflection_rad(c) for s, c in zip(part.surfaces, trim.controls[1:], strict=True)]
    start |= {14 + i: d for i, d in enumerate(deflections)}
    flown = _glide(vehicle, start, list(trim.controls), 8.0)
    way = flown[-1, :3] - flown[0, :3]
    ratio = math.hypot(way[0], way[1]) / -way[2]
    alpha = trim.alpha_rad
    air = (15.0 * math.cos(alpha), 0.0, -15.0 * math.sin(alpha))
    f, _ = _force(part).wrench(air, (0.0, 0.0, 0.0), deflections)
    lift, drag = f[2] * math.cos(alpha) + f[0] * math.sin(alpha), f[2] * math.sin(alpha) - f[0] * math.cos(alpha)
    assert 5.0 < ratio < 15.0
    assert ratio == pytest.approx(lift / drag, rel=0.01)


@pytest.mark.parametrize("case", ["glide", "spin", "tumble", "tail slide"])
def test_energy_never_grows_without_an_engine(case: str) -> None:
    starts: dict[str, dict[int, float]] = {
        "glide": {7: 15.0},
        "spin": {7: 6.0, 9: -9.0, 10: 2.0, 12: -4.0},
        "tumble": {7: 8.0, 8: 5.0, 10: 6.0, 11: 8.0, 12: -4.0},
        "tail slide": {3: 0.7071, 5: -0.7071, 7: 0.0, 9: -4.0},
    }
    vehicle = _without_engine()
    flown = _glide(vehicle, starts[case], [0.0, 0.3, -0.5, 0.4, 0.0], 8.0)
    inertia = np.array(vehicle.inertia_kgm2)
    energy = 0.5 * vehicle.mass_kg * (flown[:, 7:10] ** 2).sum(axis=1) + 0.5 * (inertia * flown[:, 10:13] ** 2).sum(
        axis=1
    )
    energy += vehicle.mass_kg * 9.81 * flown[:, 2]
    assert np.diff(energy).max() < 1e-5 * vehicle.mass_kg
    assert energy[-1] < energy[0] - 10.0
    assert np.isfinite(np.array([matrix_of(q) for q in flown[-1:, 3:7]])).all()


def _body(vehicle: Vehicle, height_m: float, speed_mps: float = 0.0) -> tuple[_kernels.RigidBody, _kernels.Panels]:
    forces = vehicle.make_forces(Effects())
    truth = np.zeros(13 + sum(f.states for f in forces) + 6)
    truth[2], truth[3], truth[7] = height_m, 1.0, speed_mps
    body = _kernels.RigidBody(
        truth=truth, mass_kg=vehicle.mass_kg, inertia_kgm2=vehicle.inertia_kgm2, forces=forces, gravity_mps2=9.81,
        wind_W_mps=(0.0, 0.0, 0.0), tick_s=0.004, substeps=1, contact_substeps=4,
    )  # fmt: skip
    return body, next(f for f in forces if isinstance(f, _kernels.Panels))


def test_the_ground_takes_from_the_induced_velocity_as_mccormick_has_it() -> None:
    """At 0.1 spans (16 z / b)^2 / (1 + (16 z / b)^2) = 0.719 of it is left; all from 4 spans on."""
    vehicle = _without_engine()
    part = _panels(_wing(span_m=1.2, root_chord_m=0.2, tip_chord_m=0.2, incidence_deg=5.0))
    vehicle = vehicle.model_copy(update={"forces": (part,)})

    def flow(height_m: float) -> tuple[float, float, float]:
        body, panels = _body(vehicle, height_m, 15.0)
        fx, _, fz, *_ = body.steady_wrench((0.0,))
        return panels.induced_mps[0], fx, fz

    lower_m = 0.05 * math.sin(math.radians(5.0))  # middle of the chord, nose up about its quarter
    near, aloft = flow(0.12 + lower_m), flow(100.0)
    assert near[0] / aloft[0] == pytest.approx(1.6**2 / (1.0 + 1.6**2), rel=0.01)
    assert near[2] > 1.05 * aloft[2]
    drag = {"near": -near[1] / near[2] ** 2, "aloft": -aloft[1] / aloft[2] ** 2}
    assert drag["near"] < 0.9 * drag["aloft"]
    assert flow(4.81 + 0.61) == flow(50.0)


def test_a_propeller_blows_over_the_tail_and_not_over_the_tips() -> None:
    """At rest the far stream has twice the induced velocity of momentum theory, v = sqrt(T / 2 rho A)."""
    vehicle = load_vehicle("trainer")
    c = vehicle.rotor_constants
    body, part = _body(vehicle, 500.0)
    body.steady_wrench((1.0, *[0.0] * (len(vehicle.commands) - 1)))
    thrust = c.thrust_coefficient_n_per_radps2 * c.max_speed_radps**2
    induced = math.sqrt(thrust / (2.0 * 1.225 * math.pi * c.radius_m**2))
    flow, middle = np.array(part.along_mps), np.array(part.middle_m)
    fin = [i for i, m in enumerate(middle) if m[0] < -0.5 and abs(m[1]) < 0.01]
    tips = [i for i, m in enumerate(middle) if abs(m[1]) > 0.4]
    # The stream at rest fades with its own slowness: v^2 / (v^2 + 2^2 m2/s2).
    fade = induced**2 / (induced**2 + 4.0)
    across_the_sweep = math.cos(math.radians(35.6))  # along the chords of the fin's panels
    assert max(flow[fin]) == pytest.approx(2.0 * induced * fade * across_the_sweep, rel=0.02)
    assert max(flow[tips]) < 0.01 * induced


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"surfaces": [{"name": "a", "wing": "win", "span": (0, 1), "chord_ratio": 0.2}]}, "surface a is on win"),
        (
            {"surfaces": [{"name": n, "wing": "wing", "span": (0.2, 0.6), "chord_ratio": 0.2} for n in ("a", "b")]},
            "share a part of the span",
        ),
        ({"surfaces": [{"name": "a", "wing": "wing", "span": (0.6, 0.2), "chord_ratio": 0.2}]}, "inner one first"),
    ],
)
def test_what_cannot_be(changes: dict[str, Any], words: str) -> None:
    for surface in changes["surfaces"]:
        surface |= {"max_deg": 20, "min_deg": -20, "time_constant_s": 0.05}
    with pytest.raises(pydantic.ValidationError, match=words):
        _panels(_wing(), **changes)


def test_an_airfoil_that_cannot_stall_there() -> None:
    with pytest.raises(pydantic.ValidationError, match="cl_max 3"):
        _panels(_wing(airfoil=_AIRFOIL | {"cl_max": 3.0, "lift_slope_per_rad": 2.5}))


def test_too_many_panels() -> None:
    with pytest.raises(pydantic.ValidationError, match="at most 40"):
        _panels(*(_wing(name=f"w{i}", root_m=(0, 0, i), panels=16) for i in range(2)))
