"""Strapdown inertial measurement unit. Equations: sim/native/imu.hpp.

    f = R_WB^T (a - g) + alpha x r + w x (w x r)      specific force at the sensor, in B [m/s2]
    out = Q(M (f + vibration) + turn-on bias + temperature drift + walk + flicker + white)

Motion and vibration enter as their mean over the physics step just taken, like the output of an IMU that integrates at
a high internal rate. The mean rate comes from the attitudes at both ends of the step; a first sample, or one after a
gap, takes the mean of the end rates. Vibration above half the output rate aliases, with the attenuation of a boxcar
filter.

The Allan deviation over tau follows the line that a datasheet (or a long log of the part at rest) gives:

    sigma^2(tau) = N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3

N white noise density, B bias instability, K random walk of the bias. N^2 is the two-sided power spectral density; the
variance of a sample is N^2 F with F the sample rate. A datasheet's noise density is one-sided if its RMS noise in a
bandwidth b is density sqrt(b): then N = density / sqrt(2). N is the density at the output (sim/sensors/rounding.py),
whose word has steps of q = word / m, as a sample is the mean of m internal readings.

With `vibration: estimated` in the bench file, the airframe vibrates with its rotors (rotor_lines.py), and the sensor's
own chain is modelled (sim/native/imu_readings.hpp): low-pass with its delay, internal readings, rectification of
vibration, sensitivity of the gyroscope to acceleration, and saturation of single readings.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from signals._kernel import det_cos, det_sin
from signals.documents.validate import StrictModel
from signals.noise import NoiseStream, noise_key
from signals.samples import ImuSample, TruthState
from signals.time import NS_PER_S
from signals.units import TURN_RAD
from sim._kernels import Imu as ImuKernel
from sim.sensors.flicker import flicker_processes
from sim.sensors.rotor_lines import vibration_arguments
from sim.sensors.rounding import drawn_sigma, noise_with_rounding
from sim.sensors.sensor import Installation, InstalledSensor, Kind, Position

_ROTORS = 8  # number of phases that are drawn; a vehicle with fewer rotors uses the first ones

Amplitude = Annotated[float, Field(ge=0.0, le=1000.0)]
Fraction = Annotated[float, Field(ge=0.0, le=0.2)]


class Harmonic(StrictModel):
    """Vibration by one rotor at a multiple of its speed: amplitudes along x, y, z at the reference speed."""

    order: Annotated[float, Field(gt=0.0, le=50.0)]  # 1: imbalance; the number of blades: blade passing
    accel_mps2: tuple[Amplitude, Amplitude, Amplitude] = (0.0, 0.0, 0.0)
    gyro_radps: tuple[Amplitude, Amplitude, Amplitude] = (0.0, 0.0, 0.0)


_new_tuple = tuple.__new__  # without the calls of a NamedTuple's own


class ImuParameters(StrictModel):
    """Errors of one IMU, SI units. Noise densities are Allan's N, 1/sqrt(2) of a one-sided one; deviations 1 sigma."""

    accel_noise_mps2_per_rthz: Annotated[float, Field(ge=0.0, le=1.0)]
    gyro_noise_radps_per_rthz: Annotated[float, Field(ge=0.0, le=1.0)]
    accel_bias_instability_mps2: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    gyro_bias_instability_radps: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    accel_walk_mps3_per_rthz: Annotated[float, Field(ge=0.0, le=1.0)]
    gyro_walk_radps2_per_rthz: Annotated[float, Field(ge=0.0, le=1.0)]
    accel_turn_on_bias_mps2: Annotated[float, Field(ge=0.0, le=5.0)]
    gyro_turn_on_bias_radps: Annotated[float, Field(ge=0.0, le=1.0)]
    accel_scale_error: Fraction = 0.0
    gyro_scale_error: Fraction = 0.0
    accel_misalignment_rad: Fraction = 0.0  # each of the six cross terms
    gyro_misalignment_rad: Fraction = 0.0
    accel_range_mps2: Annotated[float, Field(gt=0.0, le=10_000.0)]
    gyro_range_radps: Annotated[float, Field(gt=0.0, le=1_000.0)]
    accel_bits: Annotated[int, Field(ge=8, le=32)] = 16
    gyro_bits: Annotated[int, Field(ge=8, le=32)] = 16
    # Rate of the internal readings that are averaged into a sample; 0: one reading per sample.
    accel_output_rate_hz: Annotated[float, Field(ge=0.0, le=100_000.0)] = 0.0
    gyro_output_rate_hz: Annotated[float, Field(ge=0.0, le=100_000.0)] = 0.0
    temperature_degc: Annotated[float, Field(ge=-40.0, le=125.0)]  # once warm
    temperature_noise_degc: Annotated[float, Field(ge=0.0, le=10.0)]
    warm_up_degc: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0  # rise of temperature after the start
    warm_up_time_constant_s: Annotated[float, Field(gt=0.0, le=1e5)] = 60.0
    # Temperature at which the autopilot calibrated it; null: `temperature_degc`.
    reference_temperature_degc: Annotated[float, Field(ge=-40.0, le=125.0)] | None = None
    accel_temperature_drift_mps2_per_degc: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    gyro_temperature_drift_radps_per_degc: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    # The chain of a sensor that vibrates; without vibration these have no effect. 0: no low-pass.
    accel_low_pass_hz: Annotated[float, Field(ge=0.0, le=50_000.0)] = 0.0  # -3 dB
    gyro_low_pass_hz: Annotated[float, Field(ge=0.0, le=50_000.0)] = 0.0
    gyro_g_sensitivity_radps_per_mps2: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0  # each of nine terms
    accel_rectification_s2pm: Annotated[float, Field(ge=-1.0, le=1.0)] = 0.0  # bias per square of vibration
    lever_arm_m: Position = (0.0, 0.0, 0.0)  # from the centre of mass, in B
    vibration: tuple[Harmonic, ...] = ()
    vibration_reference_radps: Annotated[float, Field(gt=0.0, le=1e5)] = 1000.0
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class Imu(InstalledSensor):
    """IMU whose samples are means over one physics tick, at any rate of its own."""

    sample_type = ImuSample

    def __init__(self, installation: Installation, parameters: ImuParameters) -> None:
        p, name, seed = parameters, installation.name, installation.seed
        period_s = installation.period_ns / NS_PER_S
        accel_word = 2.0 * p.accel_range_mps2 / (1 << p.accel_bits)
        gyro_word = 2.0 * p.gyro_range_radps / (1 << p.gyro_bits)
        accel_lsb = accel_word / _readings(p.accel_output_rate_hz, period_s)
        gyro_lsb = gyro_word / _readings(p.gyro_output_rate_hz, period_s)
        resolution = {"accel_mps2": accel_word, "gyro_radps": gyro_word, "temperature_degc": 0.125}
        super().__init__(installation, p.latency_s, resolution)
        per_sample = 1.0 / math.sqrt(period_s)
        self.white_sigma = [drawn_sigma(p.accel_noise_mps2_per_rthz * per_sample, accel_lsb)] * 3
        self.white_sigma += [drawn_sigma(p.gyro_noise_radps_per_rthz * per_sample, gyro_lsb)] * 3
        self.step = [accel_lsb] * 3 + [gyro_lsb] * 3
        self.deviations = {
            "accel_mps2": noise_with_rounding(self.white_sigma[0], accel_lsb),
            "gyro_radps": noise_with_rounding(self.white_sigma[3], gyro_lsb),
            "temperature_degc": p.temperature_noise_degc,
        }

        def drawn(what: str, accel: float, gyro: float) -> list[float]:
            """Return one value per channel, drawn once."""
            n = NoiseStream(seed, f"{name}.{what}", lanes=6).normal(0)
            return [accel * x for x in n[:3]] + [gyro * x for x in n[3:]]

        walk = math.sqrt(period_s)
        flicker = flicker_processes(period_s) if p.accel_bias_instability_mps2 or p.gyro_bias_instability_radps else ()
        instability = [p.accel_bias_instability_mps2] * 3 + [p.gyro_bias_instability_radps] * 3
        reference = p.temperature_degc if p.reference_temperature_degc is None else p.reference_temperature_degc
        self._kernel = ImuKernel(
            white_key=noise_key(seed, f"{name}.white"),
            walk_key=noise_key(seed, f"{name}.walk"),
            flicker_key=noise_key(seed, f"{name}.flicker"),
            accel_gain=_gain(seed, f"{name}.accel_gain", p.accel_scale_error, p.accel_misalignment_rad),
            gyro_gain=_gain(seed, f"{name}.gyro_gain", p.gyro_scale_error, p.gyro_misalignment_rad),
            bias=drawn("turn_on", p.accel_turn_on_bias_mps2, p.gyro_turn_on_bias_radps),
            white=[*self.white_sigma, p.temperature_noise_degc],
            walk_step=[p.accel_walk_mps3_per_rthz * walk] * 3 + [p.gyro_walk_radps2_per_rthz * walk] * 3,
            temperature_gain=drawn(
                "temperature", p.accel_temperature_drift_mps2_per_degc, p.gyro_temperature_drift_radps_per_degc
            ),
            temperature=[p.temperature_degc, p.warm_up_degc, reference, p.warm_up_time_constant_s],
            lsb=self.step,
            word=[accel_word] * 3 + [gyro_word] * 3,
            limit=[p.accel_range_mps2] * 3 + [p.gyro_range_radps] * 3,
            lever_arm_B_m=p.lever_arm_m,
            step_s=installation.step_ns / NS_PER_S,
            gravity_mps2=installation.scene.gravity_mps2,
            flicker_phi=[x.phi for x in flicker],
            flicker_start=[b * x.start for b in instability for x in flicker],
            flicker_step=[b * x.step for b in instability for x in flicker],
            **_vibration(seed, name, p),
        )
        if installation.shaken_by is not None:
            step_s = installation.step_ns / NS_PER_S
            sensitivity = p.gyro_g_sensitivity_radps_per_mps2
            self._kernel.take_readings(
                readings=[_readings(p.accel_output_rate_hz, step_s), _readings(p.gyro_output_rate_hz, step_s)],
                low_pass_radps=[TURN_RAD * p.accel_low_pass_hz, TURN_RAD * p.gyro_low_pass_hz],
                g_sensitivity=[sensitivity * n for n in NoiseStream(seed, f"{name}.g_sensitivity", lanes=9).normal(0)],
                rectification_s2pm=p.accel_rectification_s2pm,
                step_s=step_s,
                **vibration_arguments(installation.shaken_by, seed, p.lever_arm_m),
            )

    @property
    def clipped_readings(self) -> tuple[int, ...]:
        """Internal readings cut at full scale so far: accel x, y, z, gyro x, y, z. Counted while it vibrates."""
        return self._kernel.clipped()

    def sample(self, truth: TruthState, seq: int) -> ImuSample:
        """Return sample `seq`. Specific force at rest, level: (0, 0, +g)."""
        t_ns = truth.t_ns
        accel, gyro, temperature = self._kernel.sample(truth[3], truth[6], truth[5], truth[7], truth[8], t_ns, seq)
        return _new_tuple(ImuSample, (seq, t_ns, t_ns + self.latency_ns, accel, gyro, temperature))

    def noise(self, first: int, count: int) -> NDArray[np.float64]:
        """Return walk, flicker and white noise of samples `first` .. `first + count - 1`, before rounding.

        Shape (count, 7): accel [m/s2], gyro [rad/s], temperature [degC]. It runs the code of `sample` without motion, a
        million samples in a second or two, so that Allan deviations over hours of flight can be tested.
        """
        out = np.empty((count, 7))
        self._kernel.noise(first, out)
        return out


def _readings(output_rate_hz: float, period_s: float) -> int:
    """Return the number of internal readings averaged into one sample, at least one."""
    return max(1, math.floor(output_rate_hz * period_s + 1e-9))


def _gain(seed: int, name: str, scale_error: float, misalignment_rad: float) -> list[float]:
    """Return, row by row, the identity + scale errors on the diagonal + misalignments off it."""
    n = NoiseStream(seed, name, lanes=9).normal(0)
    return [1.0 + scale_error * n[i] if i % 4 == 0 else misalignment_rad * n[i] for i in range(9)]


def _vibration(seed: int, name: str, p: ImuParameters) -> dict[str, Any]:
    """Return the harmonics as arguments of the kernel; every rotor, harmonic and channel has its own phase."""
    count = _ROTORS * len(p.vibration) * 6
    phases = NoiseStream(seed, f"{name}.vibration", lanes=count).uniform_block(0)[0].tolist() if count else []
    return {
        "order": [h.order for h in p.vibration],
        "amplitude": [a for h in p.vibration for a in (*h.accel_mps2, *h.gyro_radps)],
        "phase_cos": [det_cos(TURN_RAD * u) for u in phases],
        "phase_sin": [det_sin(TURN_RAD * u) for u in phases],
        "reference_speed_radps": p.vibration_reference_radps,
    }


KIND = Kind(Imu, ImuParameters)
