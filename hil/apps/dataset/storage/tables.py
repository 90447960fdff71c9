"""Tables of a data set: one data.csv per sensor, appended to at checkpoints.

A row is held back until the file it names is on the disk (`write_out` follows a sync), so no table names a file that a
power cut has lost. Times rise strictly from row to row.

A checkpoint syncs the file system, then appends the rows of the files written before the sync. One runs at a time, on
its own thread.
"""

from __future__ import annotations

import ctypes
import os
import time
import zlib
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import repeat
from pathlib import Path

from hil.apps.dataset.flight import FlightData
from hil.apps.dataset.formats import euroc
from hil.apps.dataset.storage.journal import BatchRecord
from hil.apps.dataset.storage.tree import Written, make_folder, writes
from hil.run.recorder.mcap.topics import Columns
from signals.errors import RecordingError
from signals.samples import (
    BaroSample,
    DifferentialPressureSample,
    FlowSample,
    GpsSample,
    ImuSample,
    MagSample,
    OdometrySample,
    RangeSample,
    ScalarSample,
    SkySample,
    VaneSample,
)

PERIOD_S = 2.0  # wall-clock time between checkpoints; a power cut can lose the rows of one period
TABLE = "data.csv"
TRUTH = "state_groundtruth_estimate0"

# Of each sample type: the first line of its table, and its columns.
TABLES: Mapping[type, tuple[str, euroc.TableColumns]] = {
    ImuSample: (euroc.IMU_HEADER, euroc.IMU_COLUMNS),
    GpsSample: (euroc.GPS_HEADER, euroc.GPS_COLUMNS),
    MagSample: ("#timestamp [ns],m_S_x [T],m_S_y [T],m_S_z [T]", ("field_tesla",)),
    BaroSample: (
        "#timestamp [ns],pressure [Pa],pressure_altitude [m],temperature [degC]",
        ("pressure_pa", "pressure_altitude_m", "temperature_degc"),
    ),
    RangeSample: ("#timestamp [ns],distance [m],quality []", ("distance_m", "quality")),
    DifferentialPressureSample: (
        "#timestamp [ns],differential_pressure [Pa],temperature [degC]",
        ("differential_pressure_pa", "temperature_degc"),
    ),
    VaneSample: (
        "#timestamp [ns],angle_of_attack [rad],sideslip [rad]",
        ("angle_of_attack_rad", "sideslip_rad"),
    ),
    ScalarSample: ("#timestamp [ns],value", ("value",)),
    FlowSample: (
        "#timestamp [ns],integration [ns],flow_x [rad],flow_y [rad],quality []",
        ("integration_ns", "flow_rad", "quality"),
    ),
    OdometrySample: (
        "#timestamp [ns],p_OB_O_x [m],p_OB_O_y [m],p_OB_O_z [m],q_OB_w [],q_OB_x [],q_OB_y [],q_OB_z [],"
        "v_OB_B_x [m s^-1],v_OB_B_y [m s^-1],v_OB_B_z [m s^-1]",
        ("p_OB", "q_OB", "v_OB_B"),
    ),
    SkySample: (
        "#timestamp [ns],hdop [],vdop [],pdop [],in_view [],visible [],used [],reflected [],mean_cn0 [dB-Hz],"
        "jamming [dB],spoofed [],shift_x [m],shift_y [m],shift_z [m]",
        (
            *("hdop", "vdop", "pdop", "in_view", "visible", "used", "reflected", "mean_cn0_dbhz", "jamming_db"),
            *("spoofed", "shift_W_m"),
        ),
    ),
}


def other_truth(vehicle: str) -> str:
    """Return the folder in mav0 of another vehicle's true states."""
    return f"state_groundtruth_{vehicle}"


class Table:
    """One data.csv: number of rows, and size and checksum of the file so far.

    `path` is relative to the data set's root; `waiting` holds the rows not yet written.
    """

    def __init__(self, path: str, header: str) -> None:
        self.path = path
        self.rows = 0
        self.size = 0
        self.crc32 = 0
        self.waiting = [header + "\n"]
        self._last_ns = -1

    def add(self, t_ns: int, row: str) -> None:
        """Add a row of time `t_ns`, with its line end. Raises RecordingError if time does not rise."""
        if t_ns <= self._last_ns:
            raise RecordingError(f"{self.path}: time must rise from row to row, but {t_ns} ns follows {self._last_ns}")
        self._last_ns = t_ns
        self.rows += 1
        self.waiting.append(row)

    def add_samples(self, columns: Columns, names: euroc.TableColumns) -> None:
        """Add a row per sample; `columns` are those of `columns_of`, `names` selects and orders them."""
        texts: list[Iterable[str]] = []
        for name in names:
            if isinstance(name, str):
                array = columns[name]
                if array.dtype == bool:
                    array = array.astype("u1")  # 0 or 1
                texts += [map(repr, column.tolist()) for column in (array.T if array.ndim == 2 else [array])]
            else:
                texts.append(repeat(",".join(map(repr, name))))
        for t_ns, row in zip(columns["stamp_ns"].tolist(), zip(*texts, strict=False), strict=False):
            self.add(t_ns, f"{t_ns},{','.join(row)}\n")


class Tables:
    """All tables below `root`."""

    def __init__(self, root: Path, headers: Mapping[str, str], flight_folders: Mapping[str, str]) -> None:
        """Delete the tables of an earlier attempt. Raises RecordingError.

        `headers` maps a folder in mav0 to its table's first line, `flight_folders` a port of the flight to its folder.
        """
        self._root = root
        self._flight_folders = flight_folders
        self._tables = {folder: Table(f"{euroc.ROOT}/{folder}/{TABLE}", text) for folder, text in headers.items()}
        for table in self._tables.values():
            path = root / table.path
            make_folder(path.parent)
            with writes(path):
                path.unlink(missing_ok=True)

    @property
    def rows(self) -> dict[str, int]:
        """Number of rows so far, by folder."""
        return {folder: table.rows for folder, table in self._tables.items()}

    def add_flight(self, data: FlightData) -> None:
        """Add the rows of the true states and of the sensors sampled in the flight."""
        self._tables[TRUTH].add_samples(data.truths, euroc.TRUTH_COLUMNS)
        for name, truths in data.others.items():
            self._tables[other_truth(name)].add_samples(truths, euroc.TRUTH_COLUMNS)
        for port, samples in data.samples.items():
            self._tables[self._flight_folders[port]].add_samples(samples.columns, TABLES[samples.kind][1])

    def add_files(self, record: BatchRecord) -> None:
        """Add a row per file in a data/ folder."""
        for file in record.files:
            folders, _, name = file.path.rpartition("/")
            root, _, sensor_folders = folders.partition("/")
            folder, _, subfolder = sensor_folders.partition("/")
            if root == euroc.ROOT and subfolder == "data":
                stem, _, _ = name.partition(".")
                self._tables[folder].add(int(stem), f"{stem},{name}\n")

    def take(self) -> dict[str, str]:
        """Return and clear the waiting rows, by path, for `write_out`."""
        texts = {}
        for table in self._tables.values():
            if table.waiting:
                texts[table.path] = "".join(table.waiting)
                table.waiting.clear()
        return texts

    def write_out(self, texts: Mapping[str, str]) -> None:
        """Append rows to the files, each table whole or not at all (except for a power cut). Raises RecordingError."""
        by_path = {table.path: table for table in self._tables.values()}
        for name, text in texts.items():
            table, data = by_path[name], text.encode()
            path = self._root / name
            with writes(path):
                file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
                try:
                    if os.write(file, data) != len(data):
                        os.ftruncate(file, table.size)
                        raise OSError("the file system took no more bytes")
                finally:
                    os.close(file)
            table.size += len(data)
            table.crc32 = zlib.crc32(data, table.crc32)

    def written(self) -> list[Written]:
        """Return the tables as files of the tree."""
        return [Written(table.path, table.size, table.crc32) for table in self._tables.values()]


def sync_file_system(folder: Path) -> None:
    """Flush the file system of `folder` to the disk. Raises RecordingError if that fails."""
    with writes(folder):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            syncfs = getattr(ctypes.CDLL(None, use_errno=True), "syncfs", None)
            if syncfs is None:
                os.sync()
            elif syncfs(descriptor) != 0:
                error = ctypes.get_errno()
                raise OSError(error, os.strerror(error))
        finally:
            os.close(descriptor)


class Checkpoints:
    """Periodic checkpoints: call `start_if_due` after every batch and `finish` at the end.

    Both raise the RecordingError of an earlier checkpoint that failed.
    """

    def __init__(
        self,
        folder: Path,
        tables: Tables,
        *,
        period_s: float = PERIOD_S,
        sync: Callable[[Path], None] = sync_file_system,
    ) -> None:
        self._folder, self._tables, self._period_s, self._sync = folder, tables, period_s, sync
        self._next_s = time.monotonic() + period_s
        self._thread = ThreadPoolExecutor(1, "hil-dataset-sync")
        self._under_way: Future[None] | None = None

    def start_if_due(self) -> None:
        """Start a checkpoint if the period has passed and none is running."""
        if time.monotonic() < self._next_s or (self._under_way is not None and not self._under_way.done()):
            return
        self._join()
        self._under_way = self._thread.submit(self._run, self._tables.take())
        self._next_s = time.monotonic() + self._period_s

    def finish(self) -> None:
        """Make a checkpoint and wait for it."""
        self._join()
        self._run(self._tables.take())

    def close(self) -> None:
        """End the thread. Idempotent."""
        self._thread.shutdown()

    def _run(self, rows: Mapping[str, str]) -> None:
        self._sync(self._folder)
        self._tables.write_out(rows)

    def _join(self) -> None:
        if self._under_way is not None:
            under_way, self._under_way = self._under_way, None
            under_way.result()
