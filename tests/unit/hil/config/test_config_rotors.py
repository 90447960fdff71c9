"""Vehicles that cannot be controlled, and rotors that an autopilot cannot be given, with file and line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from firmware_bridge.autopilots.ardupilot.copter import frame_for
from firmware_bridge.links.ardupilot.frames import frame_of
from hil.config import load_bench
from hil.config.multirotor_facts import multirotor_facts
from sim.physics.vehicle import VEHICLE_DIR, load_vehicle
from tests.worlds.bench_files import elsewhere, load, refused  # noqa: F401 (the fixture is for every test)
from tests.worlds.tilted_rotors import tilted

BENCHES = Path(__file__).parents[4] / "rigs" / "benches"


def write_vehicle(name: str, *replacements: tuple[str, str]) -> int:
    """Write mine.yaml, a changed copy of a vehicle; return the line of its rotors."""
    text = (VEHICLE_DIR / f"{name}.yaml").read_text()
    for pattern, new in replacements:
        text, count = re.subn(pattern, new, text)
        assert count
    Path("mine.yaml").write_text(text)
    return text.splitlines().index("rotors:") + 1


@pytest.mark.parametrize(
    ("name", "replacements", "axes"),
    [
        ("x500", [("spin: cw", "spin: ccw")], "yaw and thrust"),
        (
            "x500",
            [("moment_ratio_m: 0.016 ", "moment_ratio_m: 0.0 "), ("model: blade_element", "model: quadratic")],
            "yaw",
        ),
        ("hexa_x", [(r"(position_m: )\[[-0-9.]+, ([-0-9.]+), 0.1076\], spin", r"\1[0.0, \2, 0.1076], spin")], "pitch"),
    ],
)
def test_a_vehicle_that_cannot_be_controlled_is_named(
    name: str, replacements: list[tuple[str, str]], axes: str
) -> None:
    line = write_vehicle(name, *replacements)
    found = refused("vehicle: ./mine.yaml\n")
    assert len(found) == 1
    assert found[0].startswith(f"mine.yaml:{line}: rotors cannot control the vehicle: {axes} cannot be commanded alone")
    assert "(rank 3 of 4)" in found[0]


def test_three_rotors_are_too_few() -> None:
    line = write_vehicle("x500", (r"  - \{position_m: \[-0.174, -0.174, 0.058131\], spin: cw\}\n", ""))
    assert refused("vehicle: ./mine.yaml\n")[0].startswith(f"mine.yaml:{line}: rotors cannot control the vehicle: ")


def test_fewer_rotors_are_a_vehicle_but_not_a_multirotor() -> None:
    rotor = r"  - \{position_m: \[-?0.174, -0.174, 0.058131\], spin: \w+\}\n"
    line = write_vehicle("x500", (rotor, ""))
    assert len(load_vehicle("mine.yaml").rotors) == 2
    assert refused("vehicle: ./mine.yaml\n") == [
        f"mine.yaml:{line}: rotors holds 2 rotors, and a multirotor's controller needs at least 3"
    ]


def test_a_vehicle_too_heavy_to_hover_is_named() -> None:
    write_vehicle("x500", ("thrust_coefficient_n_per_radps2: 8.54858e-06", "thrust_coefficient_n_per_radps2: 4.0e-06"))
    (found,) = refused("vehicle: ./mine.yaml\n")
    assert "mass_kg makes it hover at 1.12 of full command: raise the thrust or lower the mass" in found


def test_an_airframe_of_four_rotors_does_not_fit_six() -> None:
    assert refused("vehicle: hexa_x\nautopilot: {airframe: x500}\n") == [
        "b.yaml:2: autopilot.airframe is 'x500', a quadrotor, but the vehicle 'hexa_x' has 6 rotors (leave it out: the "
        "vehicle's rotors are then taken)"
    ]
    assert load("vehicle: hexa_x\n").vehicle.name == "hexa_x"


def test_rotors_without_a_frame_of_arducopter_are_named() -> None:
    write_vehicle("hexa_x", (r"\[0.2102, 0.12135, 0.1076\]", "[0.02, 0.12135, 0.1076]"))
    head = "rig: ardupilot_sitl\nautopilot: {start: false}\n"
    assert refused(head + "vehicle: ./mine.yaml\n") == [
        "b.yaml:3: vehicle has rotors for which ArduCopter has no frame: 'hexa_x' with 6 (of so many motors it has "
        "HEXA X, HEXA PLUS, Y6 Y6B, with upright rotors)"
    ]
    for name in ("hexa_x", "octa_x", "x8", "y6", "racer"):
        load(head + f"vehicle: {name}\n")
    assert frame_for(multirotor_facts(tilted(load_vehicle("hexa_x"), 40.0))) is None


@pytest.mark.parametrize(
    ("name", "expected"),
    [("x500", (1, 1)), ("iris", (1, 1)), ("hexa_x", (2, 1)), ("octa_x", (3, 1)), ("x8", (4, 1)), ("y6", (5, 10))],
)
def test_frames_of_the_shipped_vehicles(name: str, expected: tuple[int, int]) -> None:
    frame = frame_for(multirotor_facts(load_vehicle(name)))
    assert frame is not None
    assert (frame.frame_class, frame.frame_type) == expected
    assert set(frame.parameters()) == {"FRAME_CLASS", "FRAME_TYPE"}  # the file has ArduPilot's order


def test_another_order_of_the_rotors_is_wired_by_servo_functions() -> None:
    rotors = [(r.position_m[0], r.position_m[1], r.spin.sign) for r in load_vehicle("hexa_x").rotors]
    turned = rotors[1:] + rotors[:1]  # output n drives the rotor of motor n + 1
    frame = frame_of(turned)
    assert frame is not None
    assert frame.parameters() == {
        "FRAME_CLASS": 2,
        "FRAME_TYPE": 1,
        **{f"SERVO{n}_FUNCTION": 33 + n % 6 for n in range(1, 7)},
    }


def test_plus_frames_are_told_from_x_frames() -> None:
    """Turning a hexa X by 30 degrees makes a PLUS; so does turning an octa X by 22.5."""
    x, y = 0.866, 0.5
    plus = [(1.0, 0.0, -1), (-1.0, 0.0, 1), (-y, x, -1), (y, -x, 1), (y, x, 1), (-y, -x, -1)]
    frame = frame_of([(a, b, float(s)) for a, b, s in plus])
    assert frame is not None
    assert frame.name == "HEXA PLUS"
    assert frame_of([(a, b, -1.0) for a, b, _ in plus]) is None


def test_the_shipped_bench_with_motors() -> None:
    """Its file of x500 stays; the autopilot is told the motor's hover command and thrust curve."""
    bench = load_bench(BENCHES / "x500_motors.yaml", flown=False)
    c = bench.vehicle.rotor_constants
    assert c.motor is not None
    assert c.max_speed_radps == pytest.approx(1197.0, abs=1.0)
    assert load_vehicle("x500").rotor_constants.max_speed_radps == 1000.0
    facts = multirotor_facts(bench.vehicle)
    assert facts.hover_control == pytest.approx(0.61, abs=0.005)
    assert facts.thrust_model_factor == pytest.approx(0.83, abs=0.005)
    assert facts.time_constant_s == pytest.approx(0.050, abs=0.001)


def test_a_desync_without_motors_is_refused_with_its_line() -> None:
    fault = "faults:\n  rotors:\n    - {kind: desync, rotor: 3, at_s: 40, for_s: 0.3}\n"
    [problem] = refused(f"vehicle: x500\n{fault}")
    assert "faults.rotors[0].kind is desync, and x500 has no rotor_constants.motor that could lose its rotor" in problem


def test_a_motor_for_another_voltage_than_the_battery_is_refused() -> None:
    motor = "{kv_rpm_per_v: 920, resistance_ohm: 0.12, no_load_current_a: 0.9, nominal_voltage_v: 22.2}"
    [problem] = refused(f"vehicle: x500\nvehicle_settings: {{rotor_constants: {{motor: {motor}}}}}\n")
    assert "rotor_constants.motor.nominal_voltage_v is 22.2 and battery.nominal_voltage_v 14.8" in problem
