"""Distributes the newest values of one run to any number of pages.

Updates are not queued. A page requests an update when it is ready for one and gets the newest values, so a slow page
gets fewer updates. Each page has its own sender, and a page that does not read an update within a time limit is
disconnected, so no page delays another one or the run. The run is asked for an update only while a page waits for one,
and only for streams of open panes.
All storage is bounded, so a page can stay open for weeks.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections import deque
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil.run.feed.messages import UINT32, StreamFrame, Unpacker, packed, packed_update
from hil.run.feed.streams import PREVIEW_PREFIX, PREVIEW_STREAMS
from hil.run_files import BENCH_NAME
from signals.classes import Classes
from signals.errors import HilError

if TYPE_CHECKING:  # imported later at run time: OpenCV and the scene take half a second
    from hil.apps.dash.views.preview_sensors import PreviewSensors
    from signals.geodesy import Site
    from signals.samples import Vec3

_EVENTS = 300
_READ = 1 << 18
_MAX_STREAMS = 16  # of one page
# Pose of the previews on a page without a run: at rest 2 m above the origin, looking north.
_BEFORE_THE_FIRST_RUN = {"p": (0.0, 0.0, 2.0), "q": (0.5**0.5, 0.0, 0.0, 0.5**0.5), "t_ns": 0}
_RUN_COMMANDS = frozenset({"pause", "resume", "step", "stop", "pace", "inject", "wind"})
_OF_OTHERS = ("home", "rotor_positions")  # facts of every vehicle that each page gets
_MAX_STREAM_CHARS = 200  # of a stream's name
_SEND_LIMIT_S = 10.0  # for one update to one page
_MAX_UNSENT = 1 << 18  # bytes to the run; above it every message but a stop is dropped


class Page:
    """State of one open page."""

    def __init__(self, send: Callable[[bytes], Awaitable[None]]) -> None:
        self.send = send
        self.sender: asyncio.Task[None] | None = None  # sends one update
        self.lost = asyncio.Event()  # set when an update could not be sent
        self.streams: tuple[str, ...] = ()  # named as in a run of one vehicle
        self.vehicle = ""  # chosen on the page; see `Hub._vehicle_of`
        self.ready = False
        # What was sent last:
        self.version = -1  # version of the hub's state
        self.slow = -1  # version of the slowly changing values
        self.run = -1  # number of the run whose description was sent
        self.events = 0  # number of events
        self.frames: dict[str, int] = {}  # stream -> version


class Hub:
    """Connection of a run to its pages. It runs in one event loop, and renders and encodes in threads."""

    def __init__(self, bench_file: Callable[[], Path | None] = lambda: None) -> None:
        """`bench_file`: the bench whose scene is shown before the first run."""
        self.pages: set[Page] = set()
        self.state: dict[str, Any] = {}
        self.about: dict[str, Any] = {}
        self.result: dict[str, Any] | None = None  # run.json of the run that ended
        self.running = False  # a run is connected
        self.begun = False  # that run flies, so it reads messages
        self.message = ""  # why the last start failed
        self.run_ended = asyncio.Event()
        self.run_ended.set()
        self._bench_file = bench_file
        self._version = 0
        self._run = 0  # number of runs so far
        self._frames: dict[str, tuple[int, StreamFrame]] = {}
        self._events: deque[tuple[Any, ...]] = deque(maxlen=_EVENTS)
        self._event_count = 0
        # Not of a lower priority than the event loop's: a thread that waits for a processor with the lock of the
        # interpreter, or of an import, holds up every page, on a busy machine for a minute.
        self._threads = ThreadPoolExecutor(2, "page")
        self._slow: dict[str, dict[str, Any]] = {}  # by vehicle; "" in a run of one
        self._slow_version = 0
        self._run_link: asyncio.StreamWriter | None = None
        self._requested = False  # an update is under way
        self._preview_sensors: type[PreviewSensors] | None = None  # None until it is imported
        self._previews: PreviewSensors | None = None
        self._previews_of: Path | None = None
        self._rendering: asyncio.Task[None] | None = None
        self._pilot: Page | None = None  # the page that steers the vehicle

    # -- the run --------------------------------------------------------------------------------------------------

    async def follow(self, link: socket.socket) -> None:
        """Follow the run at the other end of `link` until it is over or its process has ended."""
        reader, writer = await asyncio.open_connection(sock=link)
        self._run_link, self._requested = writer, False
        self.running, self.begun, self.result, self.message = True, False, None, ""
        self.run_ended.clear()
        unpacker = Unpacker()
        try:
            while data := await reader.read(_READ):
                for message in unpacker.feed(data):
                    await self._handle(message)
        except (OSError, ValueError):
            pass  # the run's process has ended
        finally:
            self.running, self._run_link = False, None
            self._state_changed()
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()
            self.run_ended.set()
            self._send_updates()

    async def _handle(self, message: dict[str, Any]) -> None:
        kind = message.pop("kind", None)
        if kind == "begin":
            self.begun = True
            self.about = message
            self._run += 1
            self.state = {}
            self._slow, self._slow_version = {}, self._slow_version + 1
            self._frames.clear()
            self._events.clear()
            self._state_changed()
        elif kind == "state":
            self._requested = False
            for event in message.pop("events", ()):
                self._events.append(tuple(event))
                self._event_count += 1
            for name, vehicle in message.get("vehicles", {"": message}).items():
                if "slow" in vehicle:
                    self._slow[name] = vehicle.pop("slow")
                    self._slow_version += 1
            frames = message.pop("frames", {})
            message["actors"] = [] if self._previews is None else self._previews.places(message["t_ns"])
            self.state = message
            self._state_changed()
            if frames:
                # The run makes its next update while these frames are encoded, so that panes do not lower the rate.
                self.request_update()
                await self._encode_frames(frames)
        elif kind == "end":
            self.result = message.get("run")
            self._state_changed()
        self._send_updates()
        self.request_update()

    async def _encode_frames(self, payloads: dict[str, Any]) -> None:
        previews = await self._current_previews()
        classes = None if previews is None else previews.classes
        self._store(await asyncio.get_running_loop().run_in_executor(self._threads, _encoded, payloads, classes))

    def _store(self, frames: dict[str, StreamFrame]) -> None:
        for stream, frame in frames.items():
            self._frames[stream] = (self._version + 1, frame)
        self._version += 1

    def request_update(self) -> None:
        """Request the next update from the run, if a page waits for one."""
        if self._run_link is None or self._requested or not any(page.ready for page in self.pages):
            return
        pages = [(page, self._prefix(page)) for page in self.pages]
        wanted = sorted({prefix + s for page, prefix in pages for s in page.streams if s not in PREVIEW_STREAMS})
        message: dict[str, Any] = {"kind": "next", "streams": wanted}
        if "vehicles" in self.about:
            message["vehicles"] = sorted({self._vehicle_of(page) for page in self.pages})
        self._send_to_run(message)
        self._requested = True

    def _vehicle_of(self, page: Page) -> str:
        """Return the vehicle that a page shows: the chosen one, else the first; empty in a run of one."""
        vehicles = self.about.get("vehicles", {})
        return page.vehicle if page.vehicle in vehicles else next(iter(vehicles), "")

    def _prefix(self, page: Page) -> str:
        """Return what stands before the names of the page's streams in this run."""
        vehicle = self._vehicle_of(page)
        return f"{vehicle}/" if vehicle else ""

    def _send_to_run(self, message: dict[str, Any]) -> None:
        if self._run_link is not None:
            self._run_link.write(packed(message))

    def _command_run(self, message: dict[str, Any]) -> None:
        """Pass a page's message on to the run. Drop one that cannot be encoded or finds the buffer full."""
        link = self._run_link
        full = link is not None and link.transport.get_write_buffer_size() > _MAX_UNSENT
        if message.get("kind") == "stop" or not full:
            with contextlib.suppress(ValueError, OverflowError):
                self._send_to_run(message)

    # -- pages ----------------------------------------------------------------------------------------------------

    def receive(self, page: Page, message: dict[str, Any]) -> None:
        """Handle a message of a page, except those that start a run."""
        kind = message.get("kind")
        if kind == "next":
            page.ready = True
            self._send_updates()
            self.request_update()
        elif kind == "streams":
            wanted = message.get("streams")
            if message.get("vehicle", page.vehicle) != page.vehicle:
                if self._pilot is page:  # release the dead-man switch of the vehicle before
                    self._pass_on_sticks(page, {"kind": "sticks", "held": False})
                page.vehicle, page.run = str(message["vehicle"]), -1
            if isinstance(wanted, list):
                page.streams = tuple(s for s in wanted if _is_stream(s))[:_MAX_STREAMS]
                shown = {self._prefix(page) + s for s in page.streams}
                page.frames = {stream: version for stream, version in page.frames.items() if stream in shown}
            page.version = -1  # frames of the new streams may be here already
            self._start_previews()
            self._send_updates()
        elif kind == "sticks":
            self._pass_on_sticks(page, message)
        elif kind in _RUN_COMMANDS:
            self._command_run(self._for_vehicle(page, message))

    def _pass_on_sticks(self, page: Page, message: dict[str, Any]) -> None:
        """Pass on the sticks of one page at a time: the first that holds its dead-man switch, until release."""
        if self._pilot is not None and self._pilot is not page:
            return
        self._pilot = page if message.get("held") is True else None
        self._command_run(self._for_vehicle(page, message))

    def _for_vehicle(self, page: Page, message: dict[str, Any]) -> dict[str, Any]:
        """Return the message with the name of the page's vehicle, in a run of several."""
        vehicle = self._vehicle_of(page)
        return message | {"vehicle": vehicle} if vehicle else message

    def remove(self, page: Page) -> None:
        """Remove a page that was closed, and release its dead-man switch."""
        self.pages.discard(page)
        if page.sender is not None:
            page.sender.cancel()
        if self._pilot is page:
            self._pass_on_sticks(page, {"kind": "sticks", "held": False})

    def _state_changed(self) -> None:
        self._version += 1
        self._start_previews()

    def publish(self) -> None:
        """Send updates after another object has changed `message` or `result`."""
        self._state_changed()
        self._send_updates()

    def _send_updates(self) -> None:
        """Start to send every waiting page the changes that it has not received yet."""
        for page in self.pages:
            if page.ready and page.version != self._version and page.sender is None:
                page.sender = asyncio.get_running_loop().create_task(self._send(page))

    async def _send(self, page: Page) -> None:
        """Send one page its update, and another one if the page has asked for it meanwhile."""
        try:
            while page.ready and page.version != self._version:
                page.ready, page.version = False, self._version
                await asyncio.wait_for(page.send(self._encode_update(page)), _SEND_LIMIT_S)
            page.sender = None
        except Exception:  # noqa: BLE001 (whatever fails here ends this page only)
            page.lost.set()

    def _encode_update(self, page: Page) -> bytes:
        vehicle, prefix = self._vehicle_of(page), self._prefix(page)
        new_run = page.run != self._run
        new_events = len(self._events) if new_run else min(self._event_count - page.events, len(self._events))
        head: dict[str, Any] = {
            "kind": "update",
            "going": self.running,
            "message": self.message,
            "state": self._state_of(vehicle),
            "events": list(self._events)[len(self._events) - new_events :] if new_events else [],
            "result": self.result,
        }
        if new_run:
            head["about"] = self._about(vehicle)
            head["run"] = self._run
        if new_run or page.slow != self._slow_version:
            head["slow"] = self._slow.get(vehicle, {})
        sent = {} if new_run else dict(page.frames)
        frames = []
        for stream in page.streams:
            version, frame = self._frames.get(prefix + stream, (-1, None))
            if frame is not None and sent.get(prefix + stream) != version:
                sent[prefix + stream] = version
                frames.append(frame._replace(head=frame.head | {"stream": stream}))
        data = packed_update(head, frames)
        page.run, page.slow, page.events, page.frames = self._run, self._slow_version, self._event_count, sent
        return data

    def _state_of(self, vehicle: str) -> dict[str, Any]:
        """Return the newest state as a page that shows this vehicle gets it."""
        if not vehicle:
            return self.state
        own = self.state.get("vehicles", {}).get(vehicle, {})
        return {key: value for key, value in self.state.items() if key != "vehicles"} | own

    def _about(self, vehicle: str) -> dict[str, Any]:
        """Return the description of the run as a page that shows this vehicle gets it."""
        if not vehicle:
            return self.about
        all_vehicles = self.about["vehicles"]
        shown = {name: {key: about[key] for key in _OF_OTHERS} for name, about in all_vehicles.items()}
        of_run = {"out": self.about["out"], "lockstep": self.about["lockstep"], "vehicles": shown, "vehicle": vehicle}
        return all_vehicles[vehicle] | of_run

    # -- previews -------------------------------------------------------------------------------------------------

    def bench_file(self) -> Path | None:
        """Return the bench whose scene is shown: that of the run, or the default bench before the first run."""
        out = self.about.get("out")
        return Path(out) / BENCH_NAME if out else self._bench_file()

    async def _current_previews(self) -> PreviewSensors | None:
        if self._preview_sensors is None:
            loop = asyncio.get_running_loop()
            self._preview_sensors = await loop.run_in_executor(self._threads, _preview_sensors)
        file = self.bench_file()
        if file is None:
            return None
        if file != self._previews_of:
            self._previews, self._previews_of = self._preview_sensors(file), file
        return self._previews

    async def scene(self) -> bytes:
        """Return the triangles of the scene. Raises HilError if it cannot be loaded."""
        previews = await self._current_previews()
        if previews is None:
            return UINT32.pack(0)
        return await asyncio.get_running_loop().run_in_executor(self._threads, previews.triangles)

    async def site_and_start(self) -> tuple[Site, Vec3] | None:
        """Return the site of the scene that is shown and where the vehicle starts in it; None without a scene.

        Raises HilError if the scene cannot be loaded.
        """
        previews = await self._current_previews()
        if previews is None:
            return None
        return await asyncio.get_running_loop().run_in_executor(self._threads, previews.site_and_start)

    def _seen_from(self) -> dict[str, Any]:
        """Return the state from which previews are rendered: the run's; before the first run `_BEFORE_THE_FIRST_RUN`.

        Empty if the run has not sent its first state.
        """
        flying = "p" in self.state or any(self.state.get("places", {}).values())
        return self.state if flying else {} if self.about else _BEFORE_THE_FIRST_RUN

    def _start_previews(self) -> None:
        """Start to render the previews of open panes, unless they are being rendered."""
        if (self._rendering is None or self._rendering.done()) and self._open_previews() and self._seen_from():
            self._rendering = asyncio.get_running_loop().create_task(self._render_previews())

    def _open_previews(self) -> list[str]:
        previews = f"{PREVIEW_PREFIX}/"
        if self.about.get("previews") == []:  # a run that offers none
            return []
        return sorted({self._prefix(page) + s for page in self.pages for s in page.streams if s.startswith(previews)})

    async def _render_previews(self) -> None:
        loop = asyncio.get_running_loop()
        rendered: tuple[Any, ...] = ()  # streams, run and time of the last rendering
        while True:
            previews = await self._current_previews()
            wanted, state = self._open_previews(), self._seen_from()
            due = (*wanted, self._run, state.get("t_ns"))
            if not wanted or previews is None or not state or due == rendered:
                return
            rendered = due
            began = loop.time()
            try:
                frames = await loop.run_in_executor(self._threads, self._render, previews, wanted, state)
            except HilError:
                return  # the scene cannot be loaded; the run reports why
            if self._seen_from() and previews is self._previews:
                self._store(frames)
                if self._run_link is None or not self._requested:  # else they are sent with the run's next update
                    self._send_updates()
            # A pause of four times the rendering time uses a fifth of a processor. It is limited to 0.1 s, so that
            # previews are not old; slow rendering then uses up to half a processor.
            took_s = loop.time() - began
            await asyncio.sleep(max(0.05, min(4.0 * took_s, 0.1), took_s))

    @staticmethod
    def _render(previews: PreviewSensors, wanted: list[str], state: dict[str, Any]) -> dict[str, StreamFrame]:
        payloads: dict[str, Any] = {}
        places = state.get("places") or {"": (state["p"], state["q"])}
        for name in places if None not in places.values() else ():
            prefix = f"{name}/" if name else ""
            own = [stream.removeprefix(prefix) for stream in wanted if stream.startswith(prefix)]
            if own:
                rendered = previews.render(own, places, state["t_ns"], name)
                payloads |= {prefix + stream: payload for stream, payload in rendered.items()}
        return _encoded(payloads, previews.classes)


def _is_stream(name: Any) -> bool:
    """Return True for text that may name a stream: printable, and not too long."""
    return isinstance(name, str) and name.isprintable() and len(name) <= _MAX_STREAM_CHARS


def _preview_sensors() -> type[PreviewSensors]:
    """Import what the scene and the previews need: a second of work, so not for the event loop."""
    import hil.config.files  # noqa: F401 (for `bench_file`)
    from hil.apps.dash.views.preview_sensors import PreviewSensors

    return PreviewSensors


def _encoded(payloads: dict[str, Any], classes: Classes | None) -> dict[str, StreamFrame]:
    from hil.apps.dash.views.pictures import encoded_frame

    return {stream: encoded_frame(stream, payload, classes or Classes()) for stream, payload in payloads.items()}
