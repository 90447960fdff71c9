"""The growing tables of a data set: a data.csv for each sensor.

Rows wait until what they speak of is safe on the disk (`write_out` comes after a sync), so a table never names a file
that a power cut could have taken away. Times rise from row to row.

A checkpoint is: sync the file system, then append to the tables the rows of what was written before the sync. One is
under way at a time, on a thread of its own.
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

from hil.dataset.flight import FlightPart
from hil.dataset.formats import euroc
from hil.dataset.journal import BatchRecord
from hil.dataset.tree import Written, make_folder, unwritable
from hil.recorder.topics import Columns
from hil.signals.errors import RecordingError
from hil.signals.samples import BaroSample, FlowSample, GpsSample, ImuSample, MagSample, RangeSample

PERIOD_S = 2.0  # of wall-clock time: about what a power cut can take from the tables
TABLE = "data.csv"
TRUTH = "state_groundtruth_estimate0"
MAG_HEADER = "#timestamp [ns],m_S_x [T],m_S_y [T],m_S_z [T]"
BARO_HEADER = "#timestamp [ns],pressure [Pa],pressure_altitude [m],temperature [degC]"
RANGE_HEADER = "#timestamp [ns],distance [m],quality []"
FLOW_HEADER = "#timestamp [ns],integration [ns],flow_x [rad],flow_y [rad],quality []"

HEADERS: Mapping[type, str] = {
    ImuSample: euroc.IMU_HEADER,
    GpsSample: euroc.GPS_HEADER,
    MagSample: MAG_HEADER,
    BaroSample: BARO_HEADER,
    RangeSample: RANGE_HEADER,
    FlowSample: FLOW_HEADER,
}

COLUMNS: Mapping[type, euroc.TableColumns] = {
    ImuSample: euroc.IMU_COLUMNS,
    GpsSample: euroc.GPS_COLUMNS,
    MagSample: ("field_tesla",),
    BaroSample: ("pressure_pa", "pressure_altitude_m", "temperature_degc"),
    RangeSample: ("distance_m", "quality"),
    FlowSample: ("integration_ns", "flow_rad", "quality"),
}


class Table:
    """One data.csv."""

    def __init__(self, path: str, header: str) -> None:
        self.path = path
        self.rows = 0
        self.size = 0
        self.crc32 = 0
        self.waiting = [header + "\n"]
        self._last_ns = -1

    def add(self, t_ns: int, row: str) -> None:
        if t_ns <= self._last_ns:
            raise RecordingError(f"{self.path}: time must rise from row to row, but {t_ns} ns follows {self._last_ns}")
        self._last_ns = t_ns
        self.rows += 1
        self.waiting.append(row)

    def add_samples(self, columns: Columns, names: euroc.TableColumns) -> None:
        """Rows of samples as `columns_of` gives them."""
        texts: list[Iterable[str]] = []
        for name in names:
            if isinstance(name, str):
                array = columns[name]
                texts += [map(repr, column.tolist()) for column in (array.T if array.ndim == 2 else [array])]
            else:
                texts.append(repeat(",".join(map(repr, name))))
        for t_ns, row in zip(columns["stamp_ns"].tolist(), zip(*texts, strict=False), strict=False):
            self.add(t_ns, f"{t_ns},{','.join(row)}\n")


class Tables:
    """All of them, below `root`."""

    def __init__(self, root: Path, headers: Mapping[str, str], flight_folders: Mapping[str, str]) -> None:
        """`headers`: by folder in mav0; `flight_folders`: of the sensors sampled in the flight."""
        self._root = root
        self._flight_folders = flight_folders
        self._tables = {folder: Table(f"{euroc.ROOT}/{folder}/{TABLE}", text) for folder, text in headers.items()}
        for table in self._tables.values():
            path = root / table.path
            make_folder(path.parent)
            try:
                path.unlink(missing_ok=True)
            except OSError as error:
                raise unwritable(path, error) from error

    @property
    def rows(self) -> dict[str, int]:
        """So far, by folder."""
        return {folder: table.rows for folder, table in self._tables.items()}

    def add_flight(self, part: FlightPart) -> None:
        """Rows of truth and of the sensors sampled in the flight."""
        self._tables[TRUTH].add_samples(part.truths, euroc.TRUTH_COLUMNS)
        for port, samples in part.samples.items():
            self._tables[self._flight_folders[port]].add_samples(samples.columns, COLUMNS[samples.kind])

    def add_files(self, record: BatchRecord) -> None:
        """Rows of the files in data/ folders."""
        for file in record.files:
            root, _, rest = file.path.partition("/")
            folder, _, rest = rest.partition("/")
            data, _, name = rest.partition("/")
            if root == euroc.ROOT and data == "data":
                stem, _, _ = name.partition(".")
                self._tables[folder].add(int(stem), f"{stem},{name}\n")

    def take(self) -> dict[str, str]:
        """What waits, by path, for `write_out`; it waits no longer."""
        taken = {}
        for table in self._tables.values():
            if table.waiting:
                taken[table.path] = "".join(table.waiting)
                table.waiting.clear()
        return taken

    def write_out(self, texts: Mapping[str, str]) -> None:
        """Append. A row is there whole or not at all, unless the disk's power is cut."""
        by_path = {table.path: table for table in self._tables.values()}
        for name, text in texts.items():
            table, data = by_path[name], text.encode()
            path = self._root / name
            try:
                file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
                try:
                    if os.write(file, data) != len(data):
                        os.ftruncate(file, table.size)
                        raise OSError("the file system took no more bytes")
                finally:
                    os.close(file)
            except OSError as error:
                raise unwritable(path, error) from error
            table.size += len(data)
            table.crc32 = zlib.crc32(data, table.crc32)

    def written(self) -> list[Written]:
        """The tables as files, in order."""
        return [Written(table.path, table.size, table.crc32) for table in self._tables.values()]


def sync_file_system(folder: Path) -> None:
    """Everything on the file system that `folder` is on. RecordingError where the disk says no."""
    try:
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
    except OSError as error:
        raise unwritable(folder, error) from error


class Checkpoints:
    """Call `maybe` after every batch, `finish` at the end. Both raise RecordingError of what an earlier one met."""

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

    def maybe(self) -> None:
        """Begin one, if it is time and none is under way."""
        if time.monotonic() < self._next_s or (self._under_way is not None and not self._under_way.done()):
            return
        self._join()
        self._under_way = self._thread.submit(self._run, self._tables.take())
        self._next_s = time.monotonic() + self._period_s

    def finish(self) -> None:
        """A last one, waited for."""
        self._join()
        self._run(self._tables.take())

    def close(self) -> None:
        """End the thread; idempotent."""
        self._thread.shutdown()

    def _run(self, rows: Mapping[str, str]) -> None:
        self._sync(self._folder)
        self._tables.write_out(rows)

    def _join(self) -> None:
        if self._under_way is not None:
            under_way, self._under_way = self._under_way, None
            under_way.result()
