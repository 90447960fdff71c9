"""Past runs on disk: the list, the result of each, and its recording as columns for a replay.

Run folders are only read. Of a recording that was cut off, the readable part is shown.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from hil.apps.dash.past.moments import Moments, stream_of_topic
from hil.apps.dash.past.served_folders import ServedFolders
from hil.apps.dash.past.summary import read_summary
from hil.run.recorder.reading import RecordedMessage, Recording
from hil.run.report.run_folder import is_under_way
from hil.run_files import BENCH_NAME, MCAP_NAME, PAGE_NAME
from signals.errors import HilError, RecordingError
from signals.time import NS_PER_S

_MAX_POINTS = 3000  # of a replay's track
_MAX_EVENTS = 500
_CACHED_TRACKS = 4
_MOTORS = 8  # motors shown, of the sixteen controls
_FIELDS = ("status", "digest", "deterministic", "seed", "rig", "scene", "sim_s", "wall_s", "realtime_factor")


class PastRuns(ServedFolders):
    """The runs in one folder. Its methods read files: call them in a thread."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._tracks = lru_cache(_CACHED_TRACKS)(self._tracks_of)
        self._damaged: dict[str, tuple[int, str]] = {}  # run -> time of its recording, and what is wrong with it
        self._lock = threading.Lock()
        self._ends = threading.Event()
        self.moments = Moments(self.folder)

    def end(self) -> None:
        """Let recordings that are being read be left: the process waits for its threads before it ends."""
        self._ends.set()

    def listed(self) -> list[dict[str, Any]]:
        """Return the runs, newest first. Folders without a run.json are left out; `broken` says what is damaged."""
        runs: list[dict[str, Any]] = []
        for folder in self.folders():
            try:
                summary = _result(folder)
            except RecordingError as error:
                runs.append({"name": folder.name, "status": "broken", "broken": str(error)})
                continue
            if summary is not None:
                mission = summary.get("mission") or {}
                error_of = summary.get("error") or {}
                runs.append(
                    {
                        "name": folder.name,
                        **{name: summary.get(name) for name in _FIELDS},
                        "mission": mission.get("file"),
                        "by_hand": len(summary.get("by_hand") or ()),
                        "error": error_of.get("type"),
                        "recording": (folder / MCAP_NAME).is_file(),
                        "report": (folder / PAGE_NAME).is_file(),
                        "broken": self._damage(folder),
                    }
                )
        return runs

    def _damage(self, folder: Path) -> str | None:
        """Return what is wrong with a recording, as far as that is known without reading all of it."""
        path = folder / MCAP_NAME
        known_ns, text = self._damaged.get(folder.name, (0, ""))
        try:
            if not path.is_file():
                return None
            if path.stat().st_mtime_ns == known_ns:
                return text
            Recording(path)
        except (OSError, RecordingError) as error:
            return str(error)
        return None

    def summary(self, name: str, vehicle: str = "") -> dict[str, Any] | None:
        """Return run.json of a run or of one of its vehicles; None if there is none. Raises RecordingError."""
        folder = self.folder(name)
        return None if folder is None else _result(folder, vehicle)

    def track(self, name: str, vehicle: str = "") -> dict[str, Any]:
        """Return the flight as columns of at most 3000 rows, its events and recorded streams. Raises RecordingError.

        Of a run with several vehicles: the flight of one, by default the first, its name, and the others' poses.
        """
        folder = self.folder(name)
        if folder is None:
            raise RecordingError(f"{name}: there is no such run")
        path = folder / MCAP_NAME
        if not path.is_file():
            raise RecordingError(f"{name}: nothing was recorded (record.mcap was off), so there is nothing to replay")
        with self._lock:
            written_ns = path.stat().st_mtime_ns
            try:
                tracks = self._tracks(path, written_ns)
            except RecordingError as error:
                self._damaged[name] = (written_ns, str(error))
                raise
        vehicle = vehicle if vehicle in tracks else next(iter(tracks))
        others = {other: {key: track[key] for key in ("p", "q")} for other, track in tracks.items() if other != vehicle}
        return tracks[vehicle] | {"vehicle": vehicle, "vehicles": list(filter(None, tracks)), "others": others}

    def _tracks_of(self, path: Path, _written_ns: int) -> dict[str, dict[str, Any]]:
        tracks = _read_tracks(path, self._ends)
        for vehicle, track in tracks.items():
            home_W = track["p"][0] if track["p"] else (0.0, 0.0, 0.0)
            track["streams"] += self.moments.maps(path.parent.name, vehicle)
            track["path"] = _path_of(path.parent / vehicle, home_W)
        return tracks


def _result(folder: Path, vehicle: str = "") -> dict[str, Any] | None:
    """Return run.json of a run or of one of its vehicles; of one that goes on with the status "running"."""
    summary = read_summary(folder / vehicle)
    error = (summary or {}).get("error") or {}
    if summary is not None and error.get("type") == "Killed" and is_under_way(folder):
        return {**summary, "status": "running", "error": None}
    return summary


def _path_of(folder: Path, home_W: Sequence[float]) -> list[list[float]]:
    """Return the planned path; an empty one if this version cannot load the saved bench."""
    from hil.config import load_bench
    from hil.config.missions.path import planned_path

    try:
        bench = load_bench(folder / BENCH_NAME, flown=False)
    except HilError:
        return []
    if bench.mission is None:
        return []
    x, y, z = home_W
    return [list(leg.end_W) for leg in planned_path(bench.mission, bench.scene, home_W=(x, y, z))]


def _read_tracks(path: Path, ends: threading.Event) -> dict[str, dict[str, Any]]:
    """Return the track of each vehicle by name; of a run of one, under the empty name.

    Raises RecordingError for a damaged recording, or once `ends` is set.
    """
    recording = Recording(path).scan()
    stride_ns = recording.last_ns // _MAX_POINTS
    rows = {name: _TrackRows(stride_ns) for name in recording.vehicles or [""]}
    try:
        for message in recording.messages():
            if ends.is_set():
                raise RecordingError(f"{path}: the dashboard ends")
            if "" in rows:
                rows[""].add(message)
                continue
            _, name, topic = f"{message.topic}/".split("/", 2)
            if name in rows:
                rows[name].add(message._replace(topic=f"/{topic[:-1]}"))
        tracks = {name: of_one.columns() | {"complete": recording.complete} for name, of_one in rows.items()}
        json.dumps(tracks, allow_nan=False)
    except (KeyError, ValueError) as error:
        raise RecordingError(f"{path}: damaged: its flight cannot be read ({error})") from error
    return tracks


class _TrackRows:
    """Rows of a recording, at least `stride_ns` apart."""

    def __init__(self, stride_ns: int) -> None:
        self._stride_ns = max(stride_ns, NS_PER_S // 25)
        self._next_ns = 0  # time from which the next row is taken
        self._row: dict[str, Any] | None = None
        self._controls: list[float] = []
        self._rows: list[dict[str, Any]] = []
        self._events: list[list[Any]] = []
        self._streams: set[str] = set()

    def add(self, message: RecordedMessage) -> None:
        """Add one message; call it in the order of the recording."""
        topic = message.topic
        if topic == "/truth/pose":
            self._row = None
            if message.log_time_ns >= self._next_ns:
                self._next_ns = message.log_time_ns + self._stride_ns
                v = message.decode()
                self._row = {
                    "t": message.log_time_ns / NS_PER_S,
                    "p": [v[f"pose.position.{axis}"] for axis in "xyz"],
                    "q": [v[f"pose.orientation.{axis}"] for axis in "wxyz"],
                    "v": [0.0, 0.0, 0.0],
                    "controls": self._controls,
                }
                self._rows.append(self._row)
        elif topic == "/truth/velocity" and self._row is not None:
            v = message.decode()
            self._row["v"] = [v[f"vector.{axis}"] for axis in "xyz"]
        elif topic == "/actuators" and message.log_time_ns + self._stride_ns >= self._next_ns:
            v = message.decode()
            self._controls = [round(float(v[f"controls[{n}]"]), 4) for n in range(_MOTORS)]
        elif topic == "/events" and len(self._events) < _MAX_EVENTS:
            v = message.decode()
            self._events.append([message.log_time_ns, v.get("name", ""), v.get("msg", "")])
        elif (stream := stream_of_topic(topic, message.type_name)) is not None:
            self._streams.add(stream)

    def columns(self) -> dict[str, Any]:
        """Return the columns by name, with one entry per row."""
        names = ("t", "p", "q", "v", "controls")
        return {name: [row[name] for row in self._rows] for name in names} | {
            "events": sorted(self._events, key=lambda event: event[0]),
            "streams": sorted(self._streams),
        }
