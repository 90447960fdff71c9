"""From log files to flights that may be fitted: read, cut, checked, and their excitation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hil.apps.identify.delays import Delays, delays_of
from hil.apps.identify.excitation import PITCH, ROLL, THRUST, Excitation, excitation_of
from hil.apps.identify.plausibility import check_accel, check_flight, check_one_vehicle
from hil.run.flight_logs.airborne import find_flights, motors_up, note_saturation
from hil.run.flight_logs.flight_log import FlightLog
from hil.run.flight_logs.log_format import LogFile, read_log
from signals.errors import ConfigError, Problem
from sim.physics.multirotor import uneven, unfit
from sim.physics.vehicle import Vehicle

LEAST_FLIGHT_S = 20.0  # of free flight in all: fewer windows of half a second leave no part to hold out
_SHORTEST_USED_S = 2.0  # of one stretch
_LEAST_VOLTAGE_CHANGE_V = 2e-3
_WANTED_TURN_RADPS, _WANTED_SPEED_MPS, _WANTED_CLIMB_MPS = 0.3, 3.0, 1.0  # rms; greatest; greatest


@dataclass(frozen=True)
class Prepared:
    """Flights to fit, in the order of the logs, what was noticed, and what they show."""

    flights: Sequence[FlightLog]
    whole: Sequence[FlightLog]  # the logs they are cut from
    notes: Sequence[Problem]
    delays: Sequence[Delays]  # of each flight
    excitation: Excitation


def prepare(
    paths: Sequence[Path],
    vehicle: Vehicle,
    *,
    columns: Path | None,
    of: str,
    progress: Callable[[float, str], None],
) -> Prepared:
    """Read and check logs. Raises ConfigError with the problems of all of them."""
    refuse_other_vehicles(vehicle)
    _refuse_twice_named(paths)
    flights: list[FlightLog] = []
    whole: list[FlightLog] = []
    notes: list[Problem] = []
    problems: list[Problem] = []
    for number, path in enumerate(paths):
        progress(number / len(paths), f"reading {path.name}")
        file = LogFile(path, vehicle, columns, of)
        try:
            log, found = flights_of(file)
            whole.append(log)
            flights += found
        except ConfigError as error:
            problems += error.problems
        notes += file.notes
    if problems:
        raise ConfigError(problems + [note for note in notes if note.where.split(": ")[0] in _files(problems)])
    used = [flight for flight in flights if flight.duration_s >= _SHORTEST_USED_S]
    check_one_vehicle(used, vehicle)
    flown_s = sum(flight.duration_s for flight in used)
    if flown_s < LEAST_FLIGHT_S:
        raise ConfigError([_too_short(whole, flights), *notes])
    progress(1.0, "what the flights show")
    excitation = excitation_of(used, vehicle)
    if not any(excitation.parameters[i].excited for i in (THRUST, ROLL, PITCH)):
        raise ConfigError([_too_quiet(used, excitation), *notes])
    return Prepared(used, whole, notes, [delays_of(flight, vehicle) for flight in used], excitation)


def refuse_other_vehicles(vehicle: Vehicle) -> None:
    """Raise ConfigError for a vehicle that the fit's model does not describe: a plane, or rotors that tilt."""
    wrong = unfit(vehicle) or uneven(vehicle)
    if wrong is not None:
        raise ConfigError.at(f"vehicle {vehicle.name!r}", f"{wrong[0]} {wrong[1]}")


def _files(problems: Sequence[Problem]) -> set[str]:
    return {problem.where.split(": ")[0] for problem in problems}


def _refuse_twice_named(paths: Sequence[Path]) -> None:
    seen: set[Path] = set()
    for path in paths:
        resolved = path.resolve()
        if resolved in seen:
            raise ConfigError.at(str(path), "is named twice; its flight would count twice")
        seen.add(resolved)


def flights_of(file: LogFile) -> tuple[FlightLog, list[FlightLog]]:
    """Return a log and its checked flights. Raises ConfigError."""
    log = with_measured_voltage(read_log(file), file)
    if log.rate is None and log.pose is None:
        raise file.refuse("has neither gyro nor attitude and position: nothing shows how the vehicle moved")
    flights = checked_flights(log, file)
    note_saturation(flights, file)
    return log, flights


def checked_flights(log: FlightLog, file: LogFile) -> list[FlightLog]:
    """Return the flights of a log, in units and axes that agree with each other. Raises ConfigError."""
    up = motors_up(log, file)
    if not up:
        at = f"from {log.start_s:.2f} to {log.end_s:.2f} s"
        hint = "the motors are never up for half a second; check the unit of time and the motors' range"
        raise file.refuse(f"contains no flight {at}", hint)
    check_accel(log, file, up)
    flights = find_flights(log, file, up)
    for flight in flights:
        check_flight(flight, file)
    return flights


def with_measured_voltage(log: FlightLog, file: LogFile) -> FlightLog:
    """Return the log without a voltage that never changes: firmware in SITL reports one that is no battery's."""
    if log.voltage is None or len(log.voltage) < 2 or float(np.ptp(log.voltage.values)) > _LEAST_VOLTAGE_CHANGE_V:
        return log
    message = f"stays at {float(log.voltage.values[0, 0]):.2f} V from {log.start_s:.2f} to {log.end_s:.2f} s"
    file.note(message, "it is not used: no battery does that under load", topic=file.topic("voltage"))
    return replace(log, voltage=None)


def _too_short(whole: Sequence[FlightLog], flights: Sequence[FlightLog]) -> Problem:
    """Return how much flight there is, and how much of what a fit needs."""
    flown_s = sum(flight.duration_s for flight in flights)
    spans = ", ".join(f"{flight.start_s:.2f} to {flight.end_s:.2f} s" for flight in flights[:4])
    where = ", ".join(dict.fromkeys(str(log.source) for log in whole))
    message = f"has {flown_s:.1f} s of free flight" + (f" ({spans})" if spans else "")
    message += f", and a fit needs {LEAST_FLIGHT_S:g} s"
    return Problem(where, message, _wanted(flights))


def _too_quiet(flights: Sequence[FlightLog], excitation: Excitation) -> Problem:
    names = ", ".join(item.parameter.name for item in excitation.parameters if not item.excited)
    where = ", ".join(dict.fromkeys(str(flight.source) for flight in flights))
    start_s, end_s = flights[0].start_s, flights[-1].end_s
    return Problem(where, f"shows none of these from {start_s:.2f} to {end_s:.2f} s: {names}", _wanted(flights))


def _wanted(flights: Sequence[FlightLog]) -> str:
    """Return the remedy: what is wanted of a flight, and what there is of it."""
    parts = []
    rates = [flight.rate.values for flight in flights if flight.rate is not None and len(flight.rate)]
    if rates:
        rms = np.sqrt(np.mean(np.square(np.concatenate(rates)), axis=0))
        roll_pitch, yaw = float(min(rms[:2])), float(rms[2])
        parts.append(f"roll and pitch rates of {_WANTED_TURN_RADPS:g} rad/s rms (here {roll_pitch:.2g})")
        parts.append(f"yaw {_WANTED_TURN_RADPS:g} (here {yaw:.2g})")
    speeds = [flight.velocity.values for flight in flights if flight.velocity is not None and len(flight.velocity)]
    if speeds:
        v = np.concatenate(speeds)
        fast, climb = float(np.hypot(v[:, 0], v[:, 1]).max()), float(np.abs(v[:, 2]).max())
        parts.append(f"{_WANTED_SPEED_MPS:g} m/s in both directions (here {fast:.2g})")
        parts.append(f"climbs and descents of {_WANTED_CLIMB_MPS:g} m/s (here {climb:.2g})")
    return f"fly {', '.join(parts)}; `hil identify --excite` writes such a mission" if parts else "fly longer"
