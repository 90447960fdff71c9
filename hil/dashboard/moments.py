"""One moment of a past run: what its streams had shown last by then, and where its people were.

Pictures, point clouds and radar detections come from the recording, maps from what companions showed, people from the
scene: where they are is a function of time. A stream is named as the live page names it: `front/rgb`, `lidar/points`.
"""

from __future__ import annotations

import json
import threading
from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from numpy.typing import NDArray

from firmware_bridge.codecs.companion_view import View
from hil.companion.view_log import VIEWS_NAME, read_views
from hil.dashboard.client_views import boxes_of, client_of, stream_of, view_body
from hil.dashboard.own_views import OwnViews
from hil.dashboard.pictures import Shown, shown
from hil.dashboard.snapshot import CLOUD_PART, MOST_POINTS, array_body, thinned
from hil.dashboard.wire import packed_update
from hil.recorder.reading import RecordedMessage
from hil.recorder.reading_frames import CLOUD, DETECTIONS, IMAGE, cloud, detections, image
from hil.recorder.recorder import MCAP_NAME
from hil.signals.errors import HilError
from hil.signals.time import NS_PER_S

_WINDOW_NS = 2 * NS_PER_S  # a picture or a sweep is looked for so far back
_MOST_STREAMS = 16
_KEPT = 2  # runs whose scene and maps are in memory
_POSE = "geometry_msgs/PoseStamped"


def stream_of_topic(topic: str, type_name: str) -> str | None:
    """How a recorded topic is called as a stream; None where it is nothing that is shown."""
    if type_name not in (IMAGE, CLOUD):
        return None
    name = topic.lstrip("/")
    return name if "/" in name else f"{name}/{CLOUD_PART}"


class _Past:
    """What is kept of one run."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.views = OwnViews(folder / "bench.yaml")
        self.maps: dict[str, list[View]] = {}
        for client, view in read_views(folder / VIEWS_NAME):
            self.maps.setdefault(client, []).append(view)
        self.clients = _clients(folder)


class Moments:
    """Of the runs that a page looks back at. Its methods take their time, and their turn."""

    def __init__(self, folder_of: Callable[[str], Path | None]) -> None:
        self._folder_of = folder_of
        self._kept = lru_cache(_KEPT)(_Past)
        self._lock = threading.Lock()

    def triangles(self, name: str) -> bytes | None:
        """The run's scene, None where there is no such run. HilError where it cannot be loaded (any more)."""
        with self._lock:
            past = self._past(name)
            return None if past is None else past.views.triangles()

    def maps(self, name: str) -> list[str]:
        """Streams of companions that showed a map."""
        with self._lock:
            past = self._past(name)
            return [] if past is None else [stream_of(client) for client in sorted(past.maps)]

    def at(self, name: str, t_ns: int, streams: Sequence[str]) -> bytes | None:
        """As `hil.dashboard.wire.packed_update` makes it; None where there is no such run."""
        with self._lock:
            past = self._past(name)
            if past is None:
                return None
            wanted = list(dict.fromkeys(streams))[:_MOST_STREAMS]
            newest = _newest(past.folder / MCAP_NAME, t_ns, wanted, past.clients)
            frames = [*_frames(newest, wanted, past.views), *_maps(past, t_ns, wanted)]
            head = {"t_ns": t_ns, "actors": past.views.places(t_ns), "boxes": _boxes(newest, past.clients, wanted)}
            return packed_update(head, frames)

    def _past(self, name: str) -> _Past | None:
        folder = self._folder_of(name)
        return None if folder is None else self._kept(folder)


def _maps(past: _Past, t_ns: int, wanted: Iterable[str]) -> list[Shown]:
    found = []
    for stream in wanted:
        client = client_of(stream)
        views = [] if client is None else past.maps.get(client, [])
        at = bisect_right(views, t_ns, key=lambda view: view.t_ns)
        if at:
            found.append(shown(stream, view_body(views[at - 1])))
    return found


def _clients(folder: Path) -> list[str]:
    """Companions of a run."""
    try:
        run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        return sorted(map(str, run["companion"]["clients"]))
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _ports(wanted: Iterable[str]) -> dict[str, str]:
    """Stream -> topic of its port, of those that a recording may have."""
    return {stream: f"/{stream.rpartition('/')[0]}" for stream in wanted if client_of(stream) is None}


def _newest(path: Path, t_ns: int, wanted: Sequence[str], clients: Sequence[str]) -> dict[str, RecordedMessage]:
    """The last message by then of each topic that matters; none of a file that cannot be read."""
    ports = _ports(wanted)
    topics = {f"/{stream}" for stream in ports} | set(ports.values()) | {f"{port}/pose" for port in ports.values()}
    topics |= {_detections_of(client) for client in clients}
    newest: dict[str, RecordedMessage] = {}
    try:
        with path.open("rb") as file:
            begin = max(0, t_ns - _WINDOW_NS)
            found = make_reader(file).iter_messages(sorted(topics), begin, t_ns + 1, log_time_order=True, reverse=True)
            for schema, channel, message in found:
                if schema is not None and channel.topic not in newest:
                    newest[channel.topic] = RecordedMessage(
                        channel.topic,
                        schema.name.replace("/msg/", "/"),
                        message.sequence,
                        message.log_time,
                        message.publish_time,
                        message.data,
                    )
                complete = all(
                    _here(stream, port, newest) and f"{port}/pose" in newest for stream, port in ports.items()
                )
                if complete and all(_detections_of(client) in newest for client in clients):
                    break
    except (OSError, McapError):
        return {}
    return newest


def _boxes(newest: dict[str, RecordedMessage], clients: Iterable[str], wanted: Sequence[str]) -> dict[str, Any]:
    """What companions had made out in the pictures that are shown."""
    messages = (newest.get(_detections_of(client)) for client in clients)
    found = [detections(message) for message in messages if message is not None and message.type_name == DETECTIONS]
    return boxes_of({one.topic: one for one in found}, wanted)


def _detections_of(client: str) -> str:
    return f"/companion/{client}/detections"


def _frames(newest: dict[str, RecordedMessage], wanted: Sequence[str], views: OwnViews) -> list[Shown]:
    """The newest of each stream."""
    made = []
    for stream, port in _ports(wanted).items():
        message_of = _here(stream, port, newest)
        if message_of is not None:
            try:
                body = _body(stream, message_of) | _place(newest.get(f"{port}/pose"))
                made.append(shown(stream, body, views.classes))
            except HilError:
                continue  # not of this bench
    return made


def _here(stream: str, port: str, newest: dict[str, RecordedMessage]) -> RecordedMessage | None:
    """A LiDAR's cloud goes by the name of its port."""
    found = newest.get(f"/{stream}")
    if found is None and stream.endswith(f"/{CLOUD_PART}"):
        found = newest.get(port)
    return found if found is not None and found.type_name in (IMAGE, CLOUD) else None


def _body(stream: str, message: RecordedMessage) -> dict[str, Any]:
    if message.type_name == IMAGE:
        t_ns, array = image(message)
        return {"t_ns": t_ns} | array_body(array if stream.endswith("range_doppler") else thinned(array))
    t_ns, points = cloud(message)
    names = points.dtype.names or ()
    if "ring" in names:  # a sweep
        step = -(-len(points) // MOST_POINTS) or 1
        xyz: NDArray[np.float32] = np.stack([points[axis][::step] for axis in "xyz"], axis=-1, dtype=np.float32)
        return {"t_ns": t_ns, "points": xyz.tobytes()}
    return {"t_ns": t_ns, "records": [{_ROW.get(name, name): row[name].item() for name in names} for row in points]}


_ROW = {"x": "x_R", "y": "y_R", "z": "z_R"}  # as the live page has them


def _place(pose: RecordedMessage | None) -> dict[str, Any]:
    if pose is None or pose.type_name != _POSE:
        return {"p": (0.0, 0.0, 0.0), "q": (1.0, 0.0, 0.0, 0.0)}
    v = pose.decode()
    p = [v[f"pose.position.{axis}"] for axis in "xyz"]
    return {"p": p, "q": [v[f"pose.orientation.{axis}"] for axis in "wxyz"]}
