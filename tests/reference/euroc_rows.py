"""Rows of EuRoC's tables one by one, as `sim._kernels.number_rows` must make them by the hundred."""

from __future__ import annotations

from hil.signals.samples import GpsSample, ImuSample, TruthState

_NO_BIAS = (0.0, 0.0, 0.0)


def imu_row(sample: ImuSample) -> str:
    return _row(sample.t_capture_ns, sample.gyro_radps, sample.accel_mps2)


def truth_row(truth: TruthState) -> str:
    return _row(truth.t_ns, truth.p_WB, truth.q_WB, truth.v_WB_W, _NO_BIAS, _NO_BIAS)


def gps_row(sample: GpsSample) -> str:
    place = (sample.latitude_deg, sample.longitude_deg, sample.altitude_m)
    accuracy = (sample.horizontal_accuracy_m, sample.vertical_accuracy_m)
    numbers = _row(sample.t_capture_ns, place, sample.v_W, accuracy).rstrip("\n")
    return f"{numbers},{sample.fix_type},{sample.satellites}\n"


def _row(t_ns: int, *values: tuple[float, ...]) -> str:
    numbers = [repr(float(x)) for part in values for x in part]
    return ",".join([str(t_ns), *numbers]) + "\n"
