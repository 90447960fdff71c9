"""Vibration in the IMU against closed forms: lines, isolator, low-pass, folding, broadband, clipping, rectification."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from signals.samples import ImuSample, TruthState
from sim.physics import multirotor
from sim.physics.vehicle import Vehicle, load_vehicle, vehicle_names
from sim.physics.vibration import OFFSET_M, Mount, Vibration
from sim.sensors.catalog import PRESETS, make_sensor
from sim.sensors.rotor_lines import vibration_arguments, vibration_of
from sim.sensors.sensor import Installation
from tests.unit.sim.sensors.test_sim_sensors_imu import DT, IDEAL, SCENE, TICK_NS, ZERO, G

ONE = Vibration(imbalance_kgm=2e-6, blades=2, blade_pass_thrust=(0.03,))
X500 = load_vehicle("x500")


def vehicle(vibration: Vibration | None = ONE, **changes: Any) -> Vehicle:
    return X500.model_copy(update={"vibration": vibration} | changes)


def imu(of: Vehicle | None, *, seed: int = 1, step_ns: int = TICK_NS, name: str = "imu", **changes: Any) -> Any:
    installation = Installation(name, rate_hz=1e9 / step_ns, seed=seed, scene=SCENE, step_ns=step_ns, shaken_by=of)
    return make_sensor(installation, kind="imu", overrides=IDEAL | changes)


def still(k: int, speeds: tuple[float, ...], step_ns: int = TICK_NS) -> TruthState:
    return TruthState(k, k * step_ns, ZERO, (1.0, 0.0, 0.0, 0.0), ZERO, ZERO, ZERO, ZERO, speeds, False)


def record(made: Any, speeds: tuple[float, ...], n: int, *, step_ns: int = TICK_NS) -> NDArray[np.float64]:
    samples = [made.sample(still(k, speeds, step_ns), k) for k in range(n)]
    return np.array([(*s.accel_mps2, *s.gyro_radps) for s in samples])


def tone(values: NDArray[np.float64], radps: float, step_s: float = DT) -> NDArray[np.float64]:
    """Return the amplitude of a tone of known frequency in each column, by least squares."""
    t = np.arange(len(values)) * step_s
    basis = np.column_stack([np.cos(radps * t), np.sin(radps * t), np.ones(len(t))])
    c, s, _ = np.linalg.lstsq(basis, values, rcond=None)[0]
    return np.hypot(c, s)


def mean_of_readings(radps: float, readings: int) -> float:
    """Gain of the mean of `readings` readings in a step: the boxcar's, periodic."""
    x = 0.5 * radps * DT / readings
    return abs(math.sin(readings * x) / (readings * math.sin(x)))


@pytest.mark.parametrize("readings", [1, 8, 32])
def test_the_line_of_an_imbalance_has_its_amplitude_and_frequency(readings: int) -> None:
    """b O^2 / m along x and y at the centre of mass, at O, folded by the sampling; one rotor alone turns."""
    speed = 700.0
    rate_hz = readings / DT
    values = record(
        imu(vehicle(), accel_output_rate_hz=rate_hz, gyro_output_rate_hz=rate_hz), (speed, 0.0, 0.0, 0.0), 4000
    )
    found = tone(values, speed)
    gain = mean_of_readings(speed, readings)
    force_n = ONE.imbalance_kgm * speed * speed
    assert found[0] == pytest.approx(gain * force_n / X500.mass_kg, rel=1e-4)
    assert found[1] == pytest.approx(gain * force_n / X500.mass_kg, rel=1e-4)
    assert found[2] == pytest.approx(0.0, abs=1e-4)
    # Rates: torque r x F over inertia and frequency. About x and y the arm is the height of the rotor.
    (x_m, y_m, z_m), (I_x, I_y, I_z) = X500.rotors[0].position_m, X500.inertia_kgm2
    assert found[3] == pytest.approx(gain * force_n * z_m / (I_x * speed), rel=1e-4)
    assert found[4] == pytest.approx(gain * force_n * z_m / (I_y * speed), rel=1e-4)
    assert found[5] == pytest.approx(gain * force_n * math.hypot(x_m, y_m) / (I_z * speed), rel=1e-4)
    # The largest bin of the spectrum is where folding puts the line.
    spectrum = np.abs(np.fft.rfft(values[:, 0] * np.hanning(len(values))))
    frequency_hz, rate = speed / (2 * math.pi), 1.0 / DT
    folded_hz = abs((frequency_hz + rate / 2) % rate - rate / 2)
    assert np.argmax(spectrum[1:]) + 1 == pytest.approx(folded_hz * len(values) * DT, abs=1.0)


def test_blades_pass_at_their_multiple_along_the_axis_of_the_rotor() -> None:
    speed = 600.0
    thrust_n = X500.rotor_constants.thrust_coefficient_n_per_radps2 * speed * speed
    found = tone(record(imu(vehicle()), (0.0, speed, 0.0, 0.0), 4000), 2.0 * speed)
    assert found[2] == pytest.approx(0.03 * thrust_n / X500.mass_kg, rel=1e-4)
    assert found[:2] == pytest.approx([0.0, 0.0], abs=1e-3)  # what leaks from the other line
    x_m, y_m, _ = X500.rotors[1].position_m
    assert found[3] == pytest.approx(0.03 * thrust_n * abs(y_m) / (X500.inertia_kgm2[0] * 2 * speed), rel=5e-3)
    assert found[4] == pytest.approx(0.03 * thrust_n * abs(x_m) / (X500.inertia_kgm2[1] * 2 * speed), rel=5e-3)


def test_a_sensor_off_the_centre_feels_the_angular_acceleration() -> None:
    """f = F / m + alpha x p: with the sensor at the height of the hub, along x, F (1/m + z^2 / I_y)."""
    speed, z_m = 700.0, X500.rotors[0].position_m[2]
    found = tone(record(imu(vehicle(), lever_arm_m=(0.0, 0.0, z_m)), (speed, 0.0, 0.0, 0.0), 4000), speed)
    force_n = ONE.imbalance_kgm * speed * speed
    assert found[0] == pytest.approx(force_n * (1 / X500.mass_kg + z_m * z_m / X500.inertia_kgm2[1]), rel=1e-4)


@pytest.mark.parametrize("speed", [200.0, 376.0, 900.0])
def test_a_mount_passes_the_share_of_a_damped_oscillator(speed: float) -> None:
    mount = Mount(frequency_hz=60.0, damping_ratio=0.15)
    rigid = tone(record(imu(vehicle()), (speed, 0.0, 0.0, 0.0), 4000), speed)
    soft = tone(record(imu(vehicle(ONE.model_copy(update={"mount": mount}))), (speed, 0.0, 0.0, 0.0), 4000), speed)
    u = speed / (2 * math.pi * 60.0)
    z = 2 * 0.15 * u
    transmitted = math.sqrt((1 + z * z) / ((1 - u * u) ** 2 + z * z))
    assert soft[[0, 1, 3, 4, 5]] == pytest.approx(transmitted * rigid[[0, 1, 3, 4, 5]], rel=1e-3)
    assert (transmitted > 1.0) == (u < math.sqrt(2.0))


def test_the_low_pass_takes_amplitude_and_phase_of_a_line() -> None:
    speed, corner_hz = 700.0, 90.0
    plain = record(imu(vehicle()), (speed, 0.0, 0.0, 0.0), 4000)
    passed = record(imu(vehicle(), accel_low_pass_hz=corner_hz), (speed, 0.0, 0.0, 0.0), 4000)
    t = np.arange(4000) * DT
    phasors = [np.linalg.lstsq(np.column_stack([np.cos(speed * t), np.sin(speed * t), np.ones(4000)]), v, rcond=None)[0]
               for v in (plain[:, 0], passed[:, 0])]  # fmt: skip
    ratio = complex(phasors[1][0], -phasors[1][1]) / complex(phasors[0][0], -phasors[0][1])
    u = speed / (2 * math.pi * corner_hz)
    expected = 1.0 / complex(1 - u * u, math.sqrt(2) * u)
    assert ratio == pytest.approx(expected, rel=1e-3)
    assert passed[:, 3:] == pytest.approx(plain[:, 3:], abs=1e-9)  # the gyroscope has none here


def test_slow_motion_is_late_by_the_group_delay() -> None:
    """A ramp of specific force: the output is the input sqrt(2) / W ago, once the filter has settled."""
    slope, corner_hz = 3.0, 20.0
    made = imu(vehicle(Vibration(imbalance_kgm=0.0, blade_pass_thrust=())), accel_low_pass_hz=corner_hz)
    plain = imu(None)
    late = []
    for k in range(400):
        truth = still(k, (0.0,) * 4)._replace(a_WB_W=(slope * k * DT, 0.0, 0.0))
        late.append((plain.sample(truth, k).accel_mps2[0] - made.sample(truth, k).accel_mps2[0]) / slope)
    # Plain holds the step's mean; the filtered one the mean of its response to it, a ramp of steps.
    assert np.mean(late[200:]) == pytest.approx(math.sqrt(2.0) / (2 * math.pi * corner_hz), rel=1e-3)


def test_the_phase_is_the_integral_of_a_changing_speed() -> None:
    """A rotor that speeds up: what remains after the chirp of known phase is fitted is small."""
    made = imu(vehicle(), accel_output_rate_hz=0.0)
    start, slope, n = 300.0, 120.0, 1500
    values = []
    for k in range(n):
        speed = start + slope * k * DT
        values.append(made.sample(still(k, (speed, 0.0, 0.0, 0.0)), k).accel_mps2[0])
    t = np.arange(n) * DT
    theta, size = start * t + 0.5 * slope * t * t, (start + slope * t) ** 2 * ONE.imbalance_kgm / X500.mass_kg
    basis = np.column_stack([size * np.cos(theta), size * np.sin(theta)])
    fitted, *_ = np.linalg.lstsq(basis, np.array(values), rcond=None)
    assert math.hypot(*fitted) == pytest.approx(1.0, rel=2e-3)
    assert np.std(values - basis @ fitted) < 5e-3 * np.std(values)


def test_the_sum_of_lines_has_the_rms_of_its_parts() -> None:
    """Four rotors at four speeds: x gets the square root of the sum of a_r^2 / 2."""
    speeds = (610.0, 655.0, 702.0, 748.0)
    values = record(imu(vehicle()), speeds, 20_000)
    parts = [ONE.imbalance_kgm * speed * speed / X500.mass_kg for speed in speeds]
    assert np.std(values[:, 0]) == pytest.approx(math.sqrt(sum(a * a for a in parts) / 2), rel=0.01)


def broadband(**changes: Any) -> Vibration:
    return Vibration(
        imbalance_kgm=0.0,
        blade_pass_thrust=(),
        broadband_accel_mps2=(1.0, 0.5, 2.0),
        broadband_gyro_radps=(0.1, 0.0, 0.2),
        **changes,
    )


def test_the_broadband_part_has_its_rms_and_a_flat_spectrum_within_its_band() -> None:
    """Read once a millisecond, with nothing in the way; at the reference speed, the declared RMS."""
    step_ns, n = 1_000_000, 60_000
    hover = multirotor.speed_radps(X500, multirotor.hover_control(X500))
    made = imu(vehicle(broadband(broadband_hz=(100.0, 300.0))), step_ns=step_ns)
    values = record(made, (hover,) * 4, n, step_ns=step_ns)
    assert np.std(values, axis=0) == pytest.approx([1.0, 0.5, 2.0, 0.1, 0.0, 0.2], rel=0.03, abs=1e-8)
    power = (np.abs(np.fft.rfft(values[:, 2].reshape(-1, 500) * np.hanning(500), axis=1)) ** 2).mean(axis=0)
    hz = np.fft.rfftfreq(500, 1e-3)
    inside = power[(hz > 115) & (hz < 285)]
    assert np.std(inside) < 0.25 * np.mean(inside)
    assert power[(hz > 5) & (hz < 80)].max() < 0.02 * np.mean(inside)
    assert power[hz > 320].max() < 0.02 * np.mean(inside)


def test_the_broadband_part_grows_with_the_square_of_speed_and_stops_with_the_rotors() -> None:
    hover = multirotor.speed_radps(X500, multirotor.hover_control(X500))
    values = [record(imu(vehicle(broadband())), (speed,) * 4, 500) for speed in (hover, 0.5 * hover, 0.0)]
    assert values[1][1:, 0] == pytest.approx(0.25 * values[0][1:, 0], abs=1e-6)
    assert values[2] == pytest.approx(np.tile([0, 0, G, 0, 0, 0], (500, 1)), abs=1e-6)


def test_readings_are_clipped_one_by_one() -> None:
    """Share of readings beyond full scale L of a sine of amplitude a: arccos(L / a) / pi on either side."""
    speed, readings, n = 700.0, 32, 3000
    limit = 0.25
    a = ONE.imbalance_kgm * speed * speed / X500.mass_kg
    made = imu(vehicle(), accel_range_mps2=limit, accel_output_rate_hz=readings / DT)
    values = record(made, (speed, 0.0, 0.0, 0.0), n)
    counts = made.clipped_readings
    share = 2.0 * math.acos(limit / a) / math.pi
    assert counts[0] / (n * readings) == pytest.approx(share, rel=2e-3)
    assert counts[1] / (n * readings) == pytest.approx(share, rel=2e-3)
    assert counts[2] == n * readings  # gravity alone is beyond it
    assert counts[3:] == (0, 0, 0)
    assert np.abs(values[:, 0]).max() < limit  # means of readings, some of which are not cut
    # First harmonic of a clipped sine: a 2/pi (asin(u) + u sqrt(1 - u^2)), u = L / a.
    u = limit / a
    clipped = a * 2 / math.pi * (math.asin(u) + u * math.sqrt(1 - u * u))
    assert tone(values, speed)[0] == pytest.approx(clipped * mean_of_readings(speed, readings), rel=5e-3)


def test_one_sided_clipping_shifts_the_mean() -> None:
    """Vibration across full scale along gravity: the accelerometer reads less than g, as estimators fear."""
    shaking = Vibration(imbalance_kgm=0.0, blade_pass_thrust=(0.5,))
    speed = 900.0
    a = 0.5 * X500.rotor_constants.thrust_coefficient_n_per_radps2 * speed * speed / X500.mass_kg
    limit = G + 0.5 * a
    made = imu(vehicle(shaking), accel_range_mps2=limit, accel_output_rate_hz=16 / DT)
    mean = record(made, (speed, 0.0, 0.0, 0.0), 8000)[:, 2].mean()
    # E max(0, x - h) of a sine: (a sin(p) - h p) / pi with p = arccos(h / a)
    p = math.acos(0.5)
    assert mean == pytest.approx(G - (a * math.sin(p) - 0.5 * a * p) / math.pi, abs=2e-3)


def test_rectification_adds_the_mean_square() -> None:
    speed, k = 700.0, 0.05
    a = ONE.imbalance_kgm * speed * speed / X500.mass_kg
    mean = record(imu(vehicle(), accel_rectification_s2pm=k), (speed, 0.0, 0.0, 0.0), 8000).mean(axis=0)
    assert mean[:2] == pytest.approx([k * a * a / 2] * 2, rel=0.01, abs=1e-4)


def test_the_gyroscope_feels_acceleration_beyond_rest() -> None:
    """At rest and level nothing is added (the autopilot has calibrated it); a steady 1 m/s2 along x adds a column."""
    calm = vehicle(Vibration(imbalance_kgm=0.0, blade_pass_thrust=()))
    made = imu(calm, gyro_g_sensitivity_radps_per_mps2=0.01, seed=5)
    rest = made.sample(still(0, (0.0,) * 4), 0).gyro_radps
    pushed = made.sample(still(1, (0.0,) * 4)._replace(a_WB_W=(1.0, 0.0, 0.0)), 1).gyro_radps
    doubled = made.sample(still(2, (0.0,) * 4)._replace(a_WB_W=(2.0, 0.0, 0.0)), 2).gyro_radps
    assert rest == pytest.approx(ZERO, abs=1e-7)
    assert 1e-4 < max(map(abs, pushed)) < 0.05
    assert doubled == pytest.approx([2 * x for x in pushed], abs=1e-7)
    shaken = record(imu(vehicle(), gyro_g_sensitivity_radps_per_mps2=0.01, seed=5), (700.0, 0, 0, 0), 2000)
    plain = record(imu(vehicle(), seed=5), (700.0, 0, 0, 0), 2000)
    assert np.std(shaken[:, 3:] - plain[:, 3:]) > 1e-4


def test_no_vibration_costs_and_changes_nothing() -> None:
    """Without `shaken_by` the chain's parameters have no effect: the same samples to the bit."""
    chain = {"accel_low_pass_hz": 50.0, "gyro_low_pass_hz": 50.0, "gyro_g_sensitivity_radps_per_mps2": 0.01}
    a, b = imu(None, accel_noise_mps2_per_rthz=0.001), imu(None, accel_noise_mps2_per_rthz=0.001, **chain)
    assert (record(a, (700.0,) * 4, 50) == record(b, (700.0,) * 4, 50)).all()
    assert b.clipped_readings == (0,) * 6


@pytest.mark.parametrize("preset", sorted(name for name, preset in PRESETS.items() if preset.kind == "imu"))
def test_same_seed_same_bits_and_other_seeds_other_phases(preset: str) -> None:
    def made(seed: int, name: str = "imu") -> Any:
        installation = Installation(name, rate_hz=250.0, seed=seed, scene=SCENE, step_ns=TICK_NS, shaken_by=X500)
        return make_sensor(installation, preset=preset)

    speeds = (700.0, 710.0, 720.0, 730.0)
    first, again, other = (record(made(seed), speeds, 60) for seed in (1, 1, 2))
    assert (first == again).all()
    assert (first[:, :3] != other[:, :3]).any(axis=0).all()


def test_two_sensors_feel_one_airframe() -> None:
    """The vibration belongs to the vehicle: sensors with other names get the same, with noise of their own."""
    a = record(imu(vehicle(), name="imu"), (700.0, 0, 0, 0), 200)
    b = record(imu(vehicle(), name="imu2"), (700.0, 0, 0, 0), 200)
    assert a == pytest.approx(b, abs=1e-9)


def test_a_sample_depends_on_speeds_and_times_alone() -> None:
    """With rotors at a constant speed, a sensor that skips samples has the same later ones."""
    speeds = (700.0, 0.0, 0.0, 0.0)
    every, some = imu(vehicle(broadband())), imu(vehicle(broadband()))
    whole = [every.sample(still(k, speeds), k) for k in range(300)]
    for k in range(0, 300, 3):
        sample: ImuSample = some.sample(still(k, speeds), k)
        assert sample.accel_mps2 == whole[k].accel_mps2


@pytest.mark.parametrize("name", vehicle_names())
def test_every_shipped_vehicle_vibrates_within_what_autopilots_call_good(name: str) -> None:
    """A motion below 5 um; in hover, a plane at full throttle, x shakes with less than ArduPilot's 30 m/s2 (VIBE)."""
    made = load_vehicle(name)
    v = vibration_of(made)
    assert 1e-7 < v.imbalance_kgm < 5e-6 * made.mass_kg
    hover = multirotor.speed_radps(made, min(1.0, multirotor.hover_control(made)))
    installation = Installation("imu", rate_hz=250.0, seed=1, scene=SCENE, step_ns=TICK_NS, shaken_by=made)
    sensor: Any = make_sensor(installation, preset="icm20689")
    speeds = tuple(hover * (1.0 + 0.01 * k) for k in range(len(made.rotors)))
    rms = np.std(record(sensor, speeds, 2000), axis=0)
    lifts = multirotor.unfit(made) is None
    assert (rms[:3] > (0.2 if lifts else 0.1)).all()  # along a propeller ahead there is no imbalance
    assert (rms[:3] < 15.0).all()
    assert (rms[3:] < 0.3).all()
    assert sensor.clipped_readings == (0,) * 6
    if made.vibration is None:
        c = made.rotor_constants
        assert v.imbalance_kgm == pytest.approx(3 * c.inertia_kgm2 / c.radius_m**2 * OFFSET_M)


def test_a_vehicle_without_rotors_is_refused() -> None:
    with pytest.raises(ValueError, match="'x500' has none"):
        imu(vehicle(rotors=()))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"readings": [0, 8]}, "at least 1"),
        ({"cosine": [0.0] * 7}, "6 values"),
        ({"order": []}, "6 values"),
        ({"g_sensitivity": [0.0] * 8}, "g_sensitivity"),
        ({"broadband": [0.0] * 3}, "broadband"),
    ],
)
def test_the_kernel_refuses_arguments_that_do_not_fit(changes: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {
        "readings": [8, 8],
        "low_pass_radps": [0.0, 0.0],
        "g_sensitivity": [0.0] * 9,
        "rectification_s2pm": 0.0,
        "step_s": DT,
        **vibration_arguments(vehicle(), 1, ZERO),
    }
    kernel = imu(None)._kernel
    kernel.take_readings(**arguments)
    with pytest.raises(ValueError, match=message):
        kernel.take_readings(**arguments | changes)
