"""One moment of a past run: the newest frame of each stream at that time, and the poses of people and vehicles.

Pictures, point clouds and radar detections come from the recording, and maps from the companions' view log. People and
vehicles come from the scene, where their poses are a function of time. Streams have the names of the live page
(`hil.run.feed.streams`).
"""

from __future__ import annotations

import contextlib
import threading
from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from numpy.typing import NDArray

from firmware_bridge.codecs.companion_view import View
from hil.apps.dash.past.summary import read_summary
from hil.apps.dash.views.pictures import encoded_frame
from hil.apps.dash.views.preview_sensors import PreviewSensors
from hil.run.companion.view_log import read_views
from hil.run.feed.companion_views import boxes_of, view_payload
from hil.run.feed.messages import StreamFrame, packed_update
from hil.run.feed.payloads import MAX_POINTS, array_payload, thinned
from hil.run.feed.streams import CLOUD_CHANNEL, map_client, map_stream
from hil.run.recorder.reading import DAMAGE_ERRORS, RecordedMessage
from hil.run.recorder.reading_frames import CLOUD, DETECTIONS, IMAGE, cloud, detections, image
from hil.run_files import BENCH_NAME, MCAP_NAME, VIEWS_NAME
from signals.errors import HilError
from signals.time import NS_PER_S

_WINDOW_NS = 2 * NS_PER_S  # older pictures and sweeps are not shown
_MAX_STREAMS = 16
_CACHED_RUNS = 2  # runs whose scene and maps are in memory
_POSE = "geometry_msgs/PoseStamped"


def stream_of_topic(topic: str, type_name: str) -> str | None:
    """Return the stream of a recorded topic; None for a topic that the page does not show."""
    if type_name not in (IMAGE, CLOUD):
        return None
    name = topic.lstrip("/")
    return name if "/" in name else f"{name}/{CLOUD_CHANNEL}"


class _PastRun:
    """Cached parts of one run, or of one vehicle of it: its scene, companion maps and companion names."""

    def __init__(self, run: Path, vehicle: str) -> None:
        self.recording = run / MCAP_NAME
        self.prefix = f"/{vehicle}" if vehicle else ""  # of the vehicle's topics
        folder = run / vehicle
        self.previews = PreviewSensors(folder / BENCH_NAME)
        self.maps: dict[str, list[View]] = {}
        for client, view in read_views(folder / VIEWS_NAME):
            self.maps.setdefault(client, []).append(view)
        self.clients = _clients(folder)


class Moments:
    """Moments of past runs. The methods read files: call them in a thread. They are thread-safe."""

    def __init__(self, folder_of: Callable[[str], Path | None]) -> None:
        self._folder_of = folder_of
        self._runs = lru_cache(_CACHED_RUNS)(_PastRun)
        self._lock = threading.Lock()

    def triangles(self, name: str) -> bytes | None:
        """Return the scene of a run; None if there is no such run. Raises HilError if it cannot be loaded."""
        with self._lock:
            past = self._past(name)
            return None if past is None else past.previews.triangles()

    def maps(self, name: str, vehicle: str = "") -> list[str]:
        """Return the streams of companions that published a map."""
        with self._lock:
            past = self._past(name, vehicle)
            return [] if past is None else [map_stream(client) for client in sorted(past.maps)]

    def at(self, name: str, t_ns: int, streams: Sequence[str], vehicle: str = "") -> bytes | None:
        """Return the moment as `hil.run.feed.messages.packed_update` encodes it; None if there is no such run.

        `vehicle`: whose streams, in a run of several.
        """
        with self._lock:
            past = self._past(name, vehicle)
            if past is None:
                return None
            wanted = list(dict.fromkeys(streams))[:_MAX_STREAMS]
            newest = _newest(past, t_ns, wanted)
            frames = [*_frames(newest, wanted, past.previews), *_maps(past, t_ns, wanted)]
            head = {"t_ns": t_ns, "actors": past.previews.places(t_ns), "boxes": _boxes(newest, past.clients, wanted)}
            return packed_update(head, frames)

    def _past(self, name: str, vehicle: str = "") -> _PastRun | None:
        folder = self._folder_of(name)
        return None if folder is None or not (folder / vehicle).is_dir() else self._runs(folder, vehicle)


def _maps(past: _PastRun, t_ns: int, wanted: Iterable[str]) -> list[StreamFrame]:
    frames = []
    for stream in wanted:
        client = map_client(stream)
        views = [] if client is None else past.maps.get(client, [])
        count = bisect_right(views, t_ns, key=lambda view: view.t_ns)
        if count:
            frames.append(encoded_frame(stream, view_payload(views[count - 1])))
    return frames


def _clients(folder: Path) -> list[str]:
    """Return the names of a run's companions."""
    try:
        return sorted(map(str, (read_summary(folder) or {})["companion"]["clients"]))
    except (HilError, KeyError, TypeError):
        return []


def _ports(wanted: Iterable[str]) -> dict[str, str]:
    """Return stream -> topic of its port, for the streams that a recording may hold."""
    return {stream: f"/{stream.rpartition('/')[0]}" for stream in wanted if map_client(stream) is None}


def _newest(past: _PastRun, t_ns: int, wanted: Sequence[str]) -> dict[str, RecordedMessage]:
    """Return the newest message of each relevant topic at a time; none if the file cannot be read.

    Topics are without the name of the vehicle.
    """
    clients = past.clients
    ports = _ports(wanted)
    topics = {f"/{stream}" for stream in ports} | set(ports.values()) | {f"{port}/pose" for port in ports.values()}
    topics |= {_detections_topic(client) for client in clients}
    newest: dict[str, RecordedMessage] = {}
    try:
        with past.recording.open("rb") as file:
            begin = max(0, t_ns - _WINDOW_NS)
            messages = make_reader(file).iter_messages(
                sorted(past.prefix + topic for topic in topics),
                starting_at=begin,
                ending_at=t_ns,
                log_time_order=True,
                reverse=True,
            )
            for schema, channel, message in messages:
                topic = channel.topic.removeprefix(past.prefix)
                if schema is not None and topic not in newest:
                    newest[topic] = RecordedMessage(
                        topic,
                        schema.name.replace("/msg/", "/"),
                        message.sequence,
                        message.log_time,
                        message.publish_time,
                        message.data,
                    )
                complete = all(
                    _newest_message(stream, port, newest) and f"{port}/pose" in newest for stream, port in ports.items()
                )
                if complete and all(_detections_topic(client) in newest for client in clients):
                    break
    except (OSError, *DAMAGE_ERRORS):
        return {}
    return newest


def _boxes(newest: dict[str, RecordedMessage], clients: Iterable[str], wanted: Sequence[str]) -> dict[str, Any]:
    """Return the newest detections in the wanted pictures."""
    messages = (newest.get(_detections_topic(client)) for client in clients)
    decoded = []
    for message in messages:
        if message is not None and message.type_name == DETECTIONS:
            with contextlib.suppress(HilError):  # recorded in a format of another version
                decoded.append(detections(message))
    return boxes_of({boxes.topic: boxes for boxes in decoded}, wanted)


def _detections_topic(client: str) -> str:
    return f"/companion/{client}/detections"


def _frames(newest: dict[str, RecordedMessage], wanted: Sequence[str], previews: PreviewSensors) -> list[StreamFrame]:
    """Return the newest frame of each wanted stream."""
    frames = []
    for stream, port in _ports(wanted).items():
        message = _newest_message(stream, port, newest)
        if message is not None:
            try:
                payload = _payload(stream, message) | _pose(newest.get(f"{port}/pose"))
                frames.append(encoded_frame(stream, payload, previews.classes))
            except (HilError, *DAMAGE_ERRORS):
                continue  # damaged, or recorded in a format of another version
    return frames


def _newest_message(stream: str, port: str, newest: dict[str, RecordedMessage]) -> RecordedMessage | None:
    """Return the newest message of a stream. A LiDAR's cloud has the topic of its port."""
    message = newest.get(f"/{stream}")
    if message is None and stream.endswith(f"/{CLOUD_CHANNEL}"):
        message = newest.get(port)
    return message if message is not None and message.type_name in (IMAGE, CLOUD) else None


def _payload(stream: str, message: RecordedMessage) -> dict[str, Any]:
    if message.type_name == IMAGE:
        t_ns, array = image(message)
        return {"t_ns": t_ns} | array_payload(array if stream.endswith("range_doppler") else thinned(array))
    t_ns, points = cloud(message)
    names = points.dtype.names or ()
    if "ring" in names:  # a sweep
        step = -(-len(points) // MAX_POINTS) or 1
        xyz: NDArray[np.float32] = np.stack([points[axis][::step] for axis in "xyz"], axis=-1, dtype=np.float32)
        return {"t_ns": t_ns, "points": xyz.tobytes()}
    return {
        "t_ns": t_ns,
        "records": [{_RECORD_KEYS.get(name, name): row[name].item() for name in names} for row in points],
    }


_RECORD_KEYS = {"x": "x_R", "y": "y_R", "z": "z_R"}  # column of a cloud -> key of a live record


def _pose(pose: RecordedMessage | None) -> dict[str, Any]:
    if pose is None or pose.type_name != _POSE:
        return {"p": (0.0, 0.0, 0.0), "q": (1.0, 0.0, 0.0, 0.0)}
    v = pose.decode()
    p = [v[f"pose.position.{axis}"] for axis in "xyz"]
    return {"p": p, "q": [v[f"pose.orientation.{axis}"] for axis in "wxyz"]}
