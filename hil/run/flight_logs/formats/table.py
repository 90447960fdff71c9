"""Tables, CSV or parquet, read by a map of their columns (`hil/run/flight_logs/column_map.py`)."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.column_map import (
    ACCEL_UNITS,
    ANGLE_UNITS,
    LENGTH_UNITS,
    MOTOR_UNITS,
    RATE_UNITS,
    SPEED_UNITS,
    TIME_UNITS,
    VOLTAGE_UNITS,
    ColumnMap,
    Motors,
    SetPointColumns,
)
from hil.run.flight_logs.columns_of_time import pose_of, series_of
from hil.run.flight_logs.flight_log import FlightLog, Series
from hil.run.flight_logs.log_format import Format, LogFile
from hil.run.flight_logs.ned import enu_from_ned, flu_from_frd, q_WB_from_q_NF, quaternion_of_euler
from hil.run.flight_logs.set_points import Columns as SetPointRows
from hil.run.flight_logs.set_points import SetPoints, set_points_of
from signals.documents.validate import load_model, nearest

_PARQUET = b"PAR1"
_SHORTEST_PERIOD_S, _LONGEST_PERIOD_S = 2e-5, 2.0
_QUATERNION_NORM = 0.05  # deviation from 1 that rounding to two digits explains; more is another quantity
Columns = dict[str, NDArray[np.float64]]


def _recognises(head: bytes, path: Path) -> bool:
    return head.startswith(_PARQUET) or path.suffix.lower() in (".csv", ".tsv", ".txt")


def _read(file: LogFile) -> FlightLog:
    if file.columns is None:
        hint = "name the columns, units and frames in a YAML file: --columns MAP (docs/identify.md), "
        hint += "or --set follow.columns=MAP of a run"
        raise file.refuse("is a table, whose columns say nothing of units and frames", hint)
    columns_map = load_model(file.columns, ColumnMap)[0]
    count = len(file.vehicle.rotors)
    if len(columns_map.motors.columns) != count:
        message = f"has {len(columns_map.motors.columns)} motor columns in {file.columns.name}"
        raise file.refuse(message, f"the vehicle {file.vehicle.name!r} has {count} rotors, one column for each")
    file.topics.update(_topics(columns_map))
    wanted = _wanted(columns_map)
    with open(file.path, "rb") as opened:
        parquet = opened.read(len(_PARQUET)) == _PARQUET
    table = _parquet(file, wanted) if parquet else _csv(file, wanted)
    log = _log(file, columns_map, table)
    _note_empty(file, log, columns_map)
    return log


def _topics(m: ColumnMap) -> dict[str, str]:
    """Return the columns of each series."""
    parts = {"pose": m.position, "velocity": m.velocity, "rate": m.rate, "accel": m.accel, "motors": m.motors}
    found = {name: ", ".join(part.columns) for name, part in parts.items() if part is not None}
    return found | ({"voltage": m.voltage.column} if m.voltage is not None else {})


def _wanted(m: ColumnMap) -> list[str]:
    names = [m.time.column, *m.motors.columns]
    for part in (m.position, m.velocity, m.rate, m.accel):
        names += part.columns if part is not None else ()
    if m.attitude is not None:
        names += m.attitude.quaternion or m.attitude.euler or ()
    if m.voltage is not None:
        names.append(m.voltage.column)
    if m.set_points is not None:
        for part in (m.set_points.position, m.set_points.velocity):
            names += part.columns if part is not None else ()
        names += [m.set_points.yaw.column] if m.set_points.yaw is not None else []
    return list(dict.fromkeys(names))


def _refuse_missing(file: LogFile, wanted: Sequence[str], there: Sequence[str]) -> None:
    missing = [name for name in wanted if name not in there]
    if missing:
        message = f"has no column {', '.join(repr(name) for name in missing)}"
        raise file.refuse(message, nearest(missing[0], there), topic=str(file.columns))


def _parquet(file: LogFile, wanted: Sequence[str]) -> Columns:
    try:
        from pyarrow import ArrowException, parquet
    except ImportError as error:
        hint = 'pip install "hil-bench[identify]", or export it as CSV'
        raise file.refuse("is parquet, and pyarrow is not installed", hint) from error
    try:
        opened = parquet.ParquetFile(file.path)
        _refuse_missing(file, wanted, opened.schema_arrow.names)
        read = opened.read(columns=list(wanted))
        return {name: read.column(name).to_numpy().astype(np.float64) for name in wanted}
    except (ArrowException, OSError, ValueError, TypeError) as error:
        raise file.refuse(f"cannot be read as parquet ({error})", "copy or export it again") from error


def _csv(file: LogFile, wanted: Sequence[str]) -> Columns:
    try:
        text = file.path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise file.refuse(f"cannot be read as text ({error})", "export it as CSV in UTF-8") from error
    lines = text.splitlines()
    separator = max(",;\t", key=lines[0].count) if lines else ","
    rows = csv.reader(lines, delimiter=separator)
    cells = _rows(file, rows)
    header = [name.strip() for name in next(cells, [])]
    _refuse_missing(file, wanted, header)
    places = [header.index(name) for name in wanted]
    values: list[list[float]] = []
    for row in cells:
        if not row:
            continue
        try:
            values.append([_number(row[place]) for place in places])
        except IndexError:
            message = f"has {len(row)} cells in line {rows.line_num}, and {len(header)} columns"
            file.note(message, "the file is cut off there; what comes before is used")
            break
        except ValueError as error:
            message = f"has text in line {rows.line_num} where a number belongs ({error})"
            raise file.refuse(message, "remove the line, or leave the cell empty") from error
    array = np.array(values, np.float64).reshape(-1, len(wanted))
    return {name: array[:, i] for i, name in enumerate(wanted)}


def _rows(file: LogFile, rows: Any) -> Iterator[list[str]]:
    """Yield the rows of a `csv.reader`. Raises ConfigError where they are none."""
    try:
        yield from rows
    except csv.Error as error:
        raise file.refuse(f"is no table in line {rows.line_num} ({error})", "export it as CSV in UTF-8") from error


def _number(cell: str) -> float:
    cell = cell.strip()
    return float(cell) if cell else float("nan")


def _log(file: LogFile, m: ColumnMap, table: Columns) -> FlightLog:
    t_s = table[m.time.column] * TIME_UNITS[m.time.unit]
    t_s = t_s - t_s[0] if len(t_s) and abs(t_s[0]) > 1e6 else t_s  # an epoch's seconds leave too few digits
    _check_clock(file, m, t_s)
    motors = _motors(file, m.motors, t_s, table)

    def world(names: Sequence[str], factor: float) -> Series | None:
        rows = _stack(table, names) * factor
        return series_of(t_s, enu_from_ned(rows) if m.world == "ned" else rows)

    def body(names: Sequence[str], factor: float) -> Series | None:
        rows = _stack(table, names) * factor
        return series_of(t_s, flu_from_frd(rows) if m.body == "frd" else rows)

    velocity = world(m.velocity.columns, SPEED_UNITS[m.velocity.unit]) if m.velocity is not None else None
    position = world(m.position.columns, LENGTH_UNITS[m.position.unit]) if m.position is not None else None
    attitude = _attitude(file, m, t_s, table)
    voltage = None
    if m.voltage is not None:
        voltage = series_of(t_s, table[m.voltage.column] * VOLTAGE_UNITS[m.voltage.unit])
    return FlightLog(
        name=file.path.stem,
        source=file.path,
        motors=motors,
        motors_kind="command" if m.motors.kind == "command" else "speed_radps",
        pose=pose_of(attitude, position, velocity) if attitude is not None and position is not None else None,
        velocity=velocity,
        rate=body(m.rate.columns, RATE_UNITS[m.rate.unit]) if m.rate is not None else None,
        accel=body(m.accel.columns, ACCEL_UNITS[m.accel.unit]) if m.accel is not None else None,
        voltage=voltage,
        estimated=m.estimated,
        start_s=float(motors.t_s[0]),
        end_s=float(motors.t_s[-1]),
        set_points=_set_points(m.set_points, m.world, t_s, table) if m.set_points is not None else None,
        ground_m=m.ground_m,
    )


def _check_clock(file: LogFile, m: ColumnMap, t_s: NDArray[np.float64]) -> None:
    """Refuse times whose unit cannot be the map's: no log of a flight has rows so far apart, or so close together."""
    known_s = t_s[np.isfinite(t_s)]
    span_s = float(np.ptp(known_s)) if len(known_s) else 0.0
    period_s = span_s / (len(known_s) - 1) if len(known_s) > 1 else 0.0
    if span_s > 0.0 and not _SHORTEST_PERIOD_S < period_s < _LONGEST_PERIOD_S:
        message = f"has {len(known_s)} rows in {span_s:.3g} s, from {known_s.min():.6g} to {known_s.max():.6g} s"
        raise file.refuse(message, f"check the map's unit of time, {m.time.unit}", topic=m.time.column)


def _note_empty(file: LogFile, log: FlightLog, m: ColumnMap) -> None:
    """Tell which series of the map have not one row of numbers."""
    declared = {
        "pose": m.position is not None and m.attitude is not None,
        **{name: getattr(m, name) is not None for name in ("velocity", "rate", "accel", "voltage")},
    }
    for name in declared:
        if declared[name] and getattr(log, name) is None:
            file.note("has no row with a number in each", "it is not used", topic=file.topic(name))


def _stack(table: Columns, names: Sequence[str]) -> NDArray[np.float64]:
    return np.stack([table[name] for name in names], axis=1)


def _motors(file: LogFile, m: Motors, t_s: NDArray[np.float64], table: Columns) -> Series:
    values = _stack(table, m.columns)
    if m.range is not None:
        low, high = m.range
        values = (values - low) / (high - low)
        outside = np.flatnonzero((values < -0.02).any(axis=1) | (values > 1.02).any(axis=1))
        if len(outside):
            worst = table[m.columns[int(np.nanargmax(np.abs(values[outside[0]] - 0.5)))]][outside[0]]
            message = f"has {worst:g} at {t_s[outside[0]]:.2f} s, outside the range {low:g} to {high:g}"
            raise file.refuse(message, "correct motors.range in the map", topic=", ".join(m.columns))
        values = np.clip(values, 0.0, 1.0)
    elif m.unit is not None:
        values = np.abs(values) * MOTOR_UNITS[m.unit] * m.scale
    series = series_of(t_s - m.late_s, values)
    if series is None:
        raise file.refuse("has no motor outputs: no row holds a number in each", topic=", ".join(m.columns))
    return series


def _attitude(file: LogFile, m: ColumnMap, t_s: NDArray[np.float64], table: Columns) -> Series | None:
    if m.attitude is None:
        return None
    if m.attitude.euler is not None and m.attitude.unit is not None:
        q = quaternion_of_euler(_stack(table, m.attitude.euler) * ANGLE_UNITS[m.attitude.unit])
    else:
        assert m.attitude.quaternion is not None  # the model demands one of the two
        q = _stack(table, m.attitude.quaternion)
        norms = np.linalg.norm(q, axis=1)
        wrong = np.flatnonzero(np.abs(norms - 1.0) > _QUATERNION_NORM)
        if len(wrong):
            message = f"is no unit quaternion: its norm at {t_s[wrong[0]]:.2f} s is {norms[wrong[0]]:.3g}"
            topic = ", ".join(m.attitude.quaternion)
            raise file.refuse(message, "angles go under attitude.euler with their unit", topic=topic)
    return series_of(t_s, q_WB_from_q_NF(q) if m.world == "ned" else q)


def _set_points(m: SetPointColumns, world: str, t_s: NDArray[np.float64], table: Columns) -> SetPoints | None:
    none = np.full((len(t_s), 3), np.nan)
    p, v, yaw_rad = none, none, none[:, 0]
    topics: list[str] = []
    if m.position is not None:
        p = _stack(table, m.position.columns) * LENGTH_UNITS[m.position.unit]
        topics += m.position.columns
    if m.velocity is not None:
        v = _stack(table, m.velocity.columns) * SPEED_UNITS[m.velocity.unit]
        topics += m.velocity.columns
    if m.yaw is not None:
        yaw_rad = table[m.yaw.column] * ANGLE_UNITS[m.yaw.unit]
        topics.append(m.yaw.column)
    rows = SetPointRows(t_s, p, v, none, yaw_rad, none[:, 0])
    return set_points_of(", ".join(topics), rows, ned=world == "ned")


FORMAT = Format("CSV or parquet with --columns", _recognises, _read)
