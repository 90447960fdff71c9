"""Checks that a log's numbers are in the units and axes that they claim, against each other and the vehicle file.

    accel      its median norm over the flight is g
    rate       equals the derivative of the attitude: slope 1 about each axis
    velocity   equals the derivative of the position: slope 1
    motors     the summed thrust of the vehicle's model equals the mean weight, within a factor
    order      torques of the vehicle's model turn it the way the gyro shows
    voltage    2.5 to 4.4 V per cell

A slope that is nearer to a known confusion of units (57.3 for degrees, 100 for cm) than to 1 is refused by that name.
Everything is judged by medians and regressions over whole flights: a bad moment decides nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hil.apps.identify.rates_of_change import at, attitude_at, attitude_rate, derivative, grid_s, rotated, smoothed
from hil.run.flight_logs.flight_log import FlightLog
from hil.run.flight_logs.log_format import LogFile
from hil.run.flight_logs.rotor_model import steady_speeds_radps, wrench
from signals.errors import ConfigError
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics.vehicle import Vehicle

Rows = NDArray[np.float64]
Interval = tuple[float, float]

_STEP_S = 0.02
_CUTOFF_HZ = 4.0
_LEAST_RATE_RADPS = 0.03  # rms below which a slope says nothing
_LEAST_SPEED_MPS = 0.03
_AGREES = 0.6  # correlation of two measurements of the same motion that leaves no doubt
_CONTRADICTS = 0.3  # and the one below which they are not of the same motion; between both it may be noise
_GAIN_NOTED, _GAIN_REFUSED = 1.5, 4.0  # times the weight, or its inverse
_SCALE_REFUSED = 4.0  # two measurements of one motion that differ by more, or by less than its inverse
_MIXED = 1.4  # ratio of two flights' gains: a battery that empties, or payload, stays below
_VOLTS_PER_CELL = (2.5, 4.4)

_ACCEL_UNITS = {"g": 1.0 / STANDARD_GRAVITY_MPS2, "mg": 1e3 / STANDARD_GRAVITY_MPS2, "cm/s2": 100.0, "mm/s2": 1e3}
_RATE_UNITS = {"deg/s": 180.0 / math.pi, "mrad/s": 1e3}
_LENGTH_UNITS = {"cm": 100.0, "mm": 1e3, "ft": 1.0 / 0.3048}
_SPEED_UNITS = {"cm/s": 100.0, "mm/s": 1e3, "km/h": 3.6, "ft/s": 1.0 / 0.3048}
_MOTOR_UNITS = {"rpm": 30.0 / math.pi, "rev/s": 0.5 / math.pi, "electrical rpm, of 7 pole pairs": 7.0 * 30.0 / math.pi}


def check_accel(log: FlightLog, file: LogFile, up: Sequence[Interval]) -> None:
    """Refuse accelerometer values that are not m/s2 in B, with z up. Before crashes are looked for."""
    if log.accel is None:
        return
    parts = [log.accel.between(*interval).values for interval in up]
    values = np.concatenate([part for part in parts if len(part)] or [np.zeros((0, 3))])
    if not len(values):
        return
    norm = float(np.median(np.linalg.norm(values, axis=1)))
    topic, when = file.topic("accel"), f"from {up[0][0]:.2f} s"
    unit = _unit_of(norm / STANDARD_GRAVITY_MPS2, _ACCEL_UNITS)
    if unit:
        message = f"has a median of {norm:.4g} in flight {when}: it looks like {unit}, not m/s2"
        raise file.refuse(message, f"say so: unit {unit}", topic=topic)
    if not 0.6 < norm / STANDARD_GRAVITY_MPS2 < 1.7:
        message = f"has a median norm of {norm:.4g} m/s2 in flight {when}, where gravity alone makes 9.8"
        raise file.refuse(message, "specific force is wanted, with gravity in it", topic=topic)
    if float(np.median(values[:, 2])) < 0.0:
        message = f"points down in flight ({float(np.median(values[:, 2])):.3g} m/s2 along z {when})"
        raise file.refuse(message, "its axes are those of FRD: body: frd", topic=topic)


def check_flight(log: FlightLog, file: LogFile) -> None:
    """Refuse a flight whose series contradict each other. Raises ConfigError."""
    t_s = grid_s(log.start_s, log.end_s, _STEP_S)
    if len(t_s) < 50:
        return
    _check_gravity(log, file, t_s)
    _check_rate(log, file, t_s)
    _check_velocity(log, file, t_s)
    _check_voltage(log, file)
    _check_motors(log, file)
    _check_order(log, file, t_s)


def gain_of(log: FlightLog, vehicle: Vehicle) -> float:
    """Return mean specific force along the body's z axis over that of the vehicle's model: 1 for the right vehicle."""
    thrust_mps2 = float(np.mean(wrench(steady_speeds_radps(log, vehicle), vehicle)[:, 2])) / vehicle.mass_kg
    measured = STANDARD_GRAVITY_MPS2
    if log.accel is not None and len(log.accel):
        measured = float(np.mean(log.accel.values[:, 2]))
    return measured / thrust_mps2 if thrust_mps2 > 0.0 else math.inf


def check_one_vehicle(flights: Sequence[FlightLog], vehicle: Vehicle) -> None:
    """Refuse flights of which two cannot be of one vehicle, or have other motor outputs. Raises ConfigError."""
    if len(flights) < 2:
        return
    other = next((flight for flight in flights if flight.motors_kind != flights[0].motors_kind), None)
    if other is not None:
        kinds = {"command": "commands", "speed_radps": "measured speeds"}
        message = (
            f"has {kinds[other.motors_kind]} of its motors from {other.start_s:.2f} s, and {flights[0].source} has "
            f"{kinds[flights[0].motors_kind]}"
        )
        raise ConfigError.at(str(other.source), message, "fit each kind of log by itself")
    gains = [(gain_of(flight, vehicle), flight) for flight in flights]
    low, high = min(gains, key=lambda g: g[0]), max(gains, key=lambda g: g[0])
    if high[0] > _MIXED * low[0]:
        message = (
            f"motors from {high[1].start_s:.2f} s lift {high[0] / low[0]:.2f} times as much as those of "
            f"{low[1].source} from {low[1].start_s:.2f} s for the same outputs: two vehicles are mixed"
        )
        raise ConfigError.at(str(high[1].source), message, "give only logs of one vehicle and one payload")


def _unit_of(ratio: float, units: Mapping[str, float]) -> str:
    """Return the unit whose factor the ratio is nearer to than to 1, within 35 %; "" if there is none."""
    for name, factor in units.items():
        if abs(math.log(max(ratio, 1e-12) / factor)) < math.log(1.35) and abs(math.log(factor)) > math.log(1.5):
            return name
    return ""


def _slope(of: Rows, on: Rows) -> tuple[float, float]:
    """Return the slope of all columns together, and their correlation; means are taken off. 0, 0 for a constant."""
    a, b = of - of.mean(axis=0), on - on.mean(axis=0)
    cross, aa, bb = float((a * b).sum()), float((a * a).sum()), float((b * b).sum())
    if not aa * bb > 0.0:
        return 0.0, 0.0
    # A ratio of norms with the sign of the product: noise on either side shifts it less than a one-sided regression.
    return math.copysign(math.sqrt(aa / bb), cross), cross / math.sqrt(aa * bb)


def _check_rate(log: FlightLog, file: LogFile, t_s: Rows) -> None:
    if log.rate is None or log.pose is None:
        return
    turned = smoothed(attitude_rate(attitude_at(log.pose, t_s), _STEP_S), _STEP_S, _CUTOFF_HZ)
    measured = smoothed(at(log.rate, t_s), _STEP_S, _CUTOFF_HZ)
    topic, when = file.topic("rate"), f"from {log.start_s:.2f} s"
    if float(np.sqrt(np.mean(turned * turned))) < _LEAST_RATE_RADPS:
        return
    if not measured.any():
        message = f"is 0 {when}, while the attitude turns"
        raise file.refuse(message, "leave it out of the map, or log the gyro", topic=topic)
    slope, agreement = _slope(measured, turned)
    unit = _unit_of(abs(slope), _RATE_UNITS)
    if unit and abs(agreement) > _AGREES:
        message = f"turns {abs(slope):.4g} times as fast as the attitude does {when}: it looks like {unit}, not rad/s"
        raise file.refuse(message, f"say so: unit {unit}", topic=topic)
    taken_for = _unit_of(1.0 / max(abs(slope), 1e-12), _RATE_UNITS)
    if taken_for and abs(agreement) > _AGREES:
        message = f"turns {abs(slope):.4g} times as fast as the attitude does {when}: rad/s were taken for {taken_for}"
        raise file.refuse(message, "say so: unit rad/s", topic=topic)
    if agreement < _CONTRADICTS:
        axes = [f"{name} {_slope(measured[:, [k]], turned[:, [k]])[1]:+.2f}" for k, name in enumerate("xyz")]
        message = f"does not turn as the attitude does {when} (correlations {', '.join(axes)})"
        hint = "check the axes (flu or frd), the order of the quaternion (w first) and its direction (body to world)"
        raise file.refuse(message, hint, topic=topic)
    if not 1.0 / _SCALE_REFUSED < slope < _SCALE_REFUSED:
        message = f"turns {slope:.3g} times as fast as the attitude does {when}"
        raise file.refuse(message, "check its unit and scale", topic=topic)
    if agreement < _AGREES or not 0.7 < slope < 1.4:
        message = f"turns {slope:.3g} times as fast as the attitude does {when} (correlation {agreement:.2f})"
        file.note(message, "check its scale, and both for jumps", topic=topic)


def _check_velocity(log: FlightLog, file: LogFile, t_s: Rows) -> None:
    if log.velocity is None or log.pose is None:
        return
    moved = smoothed(derivative(at(log.pose, t_s)[:, :3], _STEP_S), _STEP_S, _CUTOFF_HZ)
    measured = smoothed(at(log.velocity, t_s), _STEP_S, _CUTOFF_HZ)
    if min(float(np.sqrt(np.mean(x * x))) for x in (moved, measured)) < _LEAST_SPEED_MPS:
        return
    slope, agreement = _slope(measured, moved)
    when = f"from {log.start_s:.2f} s"
    speed_unit, length_unit = _unit_of(abs(slope), _SPEED_UNITS), _unit_of(1.0 / max(abs(slope), 1e-12), _LENGTH_UNITS)
    if abs(agreement) > _AGREES and speed_unit:
        message = f"is {abs(slope):.4g} times the positions' derivative {when}: it looks like {speed_unit}, not m/s"
        raise file.refuse(message, f"say so: unit {speed_unit}", topic=file.topic("velocity"))
    if abs(agreement) > _AGREES and length_unit:
        message = f"changes by {1.0 / abs(slope):.4g} times the velocity {when}: it looks like {length_unit}, not m"
        raise file.refuse(message, f"say so: unit {length_unit}", topic=file.topic("pose"))
    message = f"does not follow the positions {when} (slope {slope:.3g}, correlation {agreement:.2f})"
    if agreement < _CONTRADICTS:
        hint = "check the frame: the velocity is that in the world (enu or ned), not in the body"
        raise file.refuse(message, hint, topic=file.topic("velocity"))
    if not 1.0 / _SCALE_REFUSED < slope < _SCALE_REFUSED:
        topic = f"{file.topic('velocity')} and {file.topic('pose')}"
        raise file.refuse(message, "check the units of both", topic=topic)
    if agreement < _AGREES or not 0.7 < slope < 1.4:
        file.note(message, "check its scale, and both for jumps", topic=file.topic("velocity"))


def _check_gravity(log: FlightLog, file: LogFile, t_s: Rows) -> None:
    """Refuse an attitude that does not turn the mean specific force upright, as a wrong order of a quaternion."""
    if log.accel is None or log.pose is None:
        return
    upward = rotated(attitude_at(log.pose, t_s), at(log.accel, t_s)).mean(axis=0)
    cosine = float(upward[2] / np.linalg.norm(upward))
    if cosine < 0.8:
        message = (
            f"turns the mean specific force {math.degrees(math.acos(max(cosine, -1.0))):.0f} degrees away from the "
            f"vertical in the flight from {log.start_s:.2f} s"
        )
        hint = "check the order of the quaternion (w first), its direction (body to world) and the frames"
        raise file.refuse(message, hint, topic=file.topic("pose"))


def _check_motors(log: FlightLog, file: LogFile) -> None:
    gain = gain_of(log, file.vehicle)
    topic, when = file.topic("motors"), f"from {log.start_s:.2f} s"
    ratio = math.sqrt(1.0 / gain) if gain > 0.0 else math.inf  # of speeds
    if log.motors_kind == "speed_radps":
        unit = _unit_of(ratio, _MOTOR_UNITS)
        if unit:
            median = float(np.median(log.motors.values))
            message = (
                f"has a median of {median:.4g} {when}, {ratio:.3g} times the vehicle's: it looks like {unit}, not rad/s"
            )
            raise file.refuse(
                message, "say so: its unit, with scale: 1 / (pole pairs) for electrical speeds", topic=topic
            )
    if not 1.0 / _GAIN_REFUSED < gain < _GAIN_REFUSED:
        message = f"lifts {1.0 / gain:.3g} times the weight of {file.vehicle.name!r} {when}"
        hint = "check range or unit of the motors; start from the file of a vehicle of this size"
        raise file.refuse(message, hint, topic=topic)
    if not 1.0 / _GAIN_NOTED < gain < _GAIN_NOTED:
        message = f"lifts {1.0 / gain:.2f} times the weight of {file.vehicle.name!r} {when}"
        file.note(message, "check mass_kg; the fit changes the thrust accordingly", topic=topic)


def _check_order(log: FlightLog, file: LogFile, t_s: Rows) -> None:
    """Refuse motors that turn the vehicle against what the vehicle file says, as another order of motors does."""
    if log.rate is None:
        return
    vehicle = file.vehicle
    torque = np.stack(
        [np.interp(t_s, log.motors.t_s, c) for c in wrench(steady_speeds_radps(log, vehicle), vehicle)[:, 3:].T], axis=1
    )
    turn = derivative(smoothed(at(log.rate, t_s), _STEP_S, 8.0), _STEP_S)
    wrong = []
    for k, name in enumerate(("roll", "pitch")):
        best = max((_lagged_correlation(torque[:, k], turn[:, k], lag) for lag in range(8)), key=abs)
        if best < -0.35:
            wrong.append(f"{name} {best:+.2f}")
    if wrong:
        message = f"turns the vehicle against its file from {log.start_s:.2f} s (correlations {', '.join(wrong)})"
        hint = "put the motors in the order of the vehicle file's rotors"
        raise file.refuse(message, hint, topic=file.topic("motors"))


def _lagged_correlation(cause: Rows, effect: Rows, lag: int) -> float:
    a, b = cause[: len(cause) - lag], effect[lag:]
    a, b = a - a.mean(), b - b.mean()
    norm = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / norm if norm > 0.0 else 0.0


def _check_voltage(log: FlightLog, file: LogFile) -> None:
    battery = file.vehicle.battery
    if log.voltage is None or battery is None or not len(log.voltage):
        return
    per_cell = float(np.median(log.voltage.values)) / battery.cells
    if not _VOLTS_PER_CELL[0] < per_cell < _VOLTS_PER_CELL[1]:
        message = (
            f"has a median of {per_cell * battery.cells:.4g} V from {log.start_s:.2f} s, {per_cell:.3g} V per cell"
        )
        milli = 1e3 * _VOLTS_PER_CELL[0] < per_cell < 1e3 * _VOLTS_PER_CELL[1]
        hint = "it looks like mV: unit mV" if milli else f"the vehicle file has {battery.cells} cells"
        raise file.refuse(message, hint, topic=file.topic("voltage"))
