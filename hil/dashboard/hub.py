"""Between one run and any number of pages: the newest of everything, and who wants what.

Nothing is queued towards a page. A page says when it can take an update and gets the newest then; a page that is slow
gets fewer. The run is asked for the next update only while a page waits for one, and only for what open panes show.
Whatever is kept here is bounded, so that a page may stay open for weeks.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import sys
import threading
from collections import deque
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil.dashboard.wire import UINT32, Unpacker, packed, packed_update
from hil.signals.classes import Classes
from hil.signals.errors import HilError

if TYPE_CHECKING:  # numbers and pictures take half a second to load: not before the page is up
    from hil.dashboard.own_views import OwnViews
    from hil.dashboard.pictures import Shown

# Streams that are drawn here, not in the run (`hil.dashboard.own_views`).
OWN_PREFIX = "view"
OWN_STREAMS = (
    "view/camera/rgb",
    "view/camera/depth",
    "view/camera/segmentation",
    "view/lidar/points",
    "view/radar/range_doppler",
    "view/radar/points",
)
_NICE = 10  # of the threads that draw and encode: the run goes first
_EVENTS = 300
_READ = 1 << 18
_MOST_STREAMS = 16  # of one page
_TO_RUN = frozenset({"pause", "resume", "step", "stop", "pace", "inject", "wind"})


class Page:
    """One open page."""

    def __init__(self, send: Callable[[bytes], Awaitable[None]]) -> None:
        self.send = send
        self.streams: tuple[str, ...] = ()
        self.ready = False
        self.version = -1  # of the hub's state that it has
        self.slow = -1  # of what changes slowly
        self.run = -1  # of the runs it knows about
        self.events = 0  # how many of all it has had
        self.frames: dict[str, int] = {}  # stream -> version
        self.sticks = False  # it holds the dead-man switch


class Hub:
    """All of it runs in one event loop; drawing and encoding in a thread."""

    def __init__(self, bench_file: Callable[[], Path | None] = lambda: None) -> None:
        """`bench_file`: whose scene is shown before there is a run."""
        self.pages: set[Page] = set()
        self.state: dict[str, Any] = {}
        self.about: dict[str, Any] = {}
        self.result: dict[str, Any] | None = None  # run.json of the run that ended
        self.going = False  # a run is connected
        self.message = ""  # why the last start came to nothing
        self.waits_to_end = asyncio.Event()
        self.waits_to_end.set()
        self._bench_file = bench_file
        self._version = 0
        self._run = 0  # how many there have been
        self._frames: dict[str, tuple[int, Shown]] = {}
        self._events: deque[tuple[Any, ...]] = deque(maxlen=_EVENTS)
        self._event_count = 0
        self._threads = ThreadPoolExecutor(2, "page", initializer=_lower_priority)
        self._slow: dict[str, Any] = {}
        self._slow_version = 0
        self._wire: asyncio.StreamWriter | None = None
        self._asked = False  # an update is under way
        self._views: OwnViews | None = None
        self._views_of: Path | None = None
        self._drawing: asyncio.Task[None] | None = None
        self._flyer: Page | None = None  # whose sticks count

    # -- the run --------------------------------------------------------------------------------------------------

    async def follow(self, wire: socket.socket) -> None:
        """Until the run at the other end is over or gone."""
        reader, writer = await asyncio.open_connection(sock=wire)
        self._wire, self._asked = writer, False
        self.going, self.result, self.message = True, None, ""
        self.waits_to_end.clear()
        unpacker = Unpacker()
        try:
            while data := await reader.read(_READ):
                for message in unpacker.feed(data):
                    await self._take(message)
        except (OSError, ValueError):
            pass  # the run's process is gone: what came of it is in its folder
        finally:
            self.going, self._wire = False, None
            self._bump()
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()
            self.waits_to_end.set()
            await self._offer()

    async def _take(self, message: dict[str, Any]) -> None:
        kind = message.pop("kind", None)
        if kind == "begin":
            self.about = message
            self._run += 1
            self.state = {}
            self._keep_slow({})
            self._frames.clear()
            self._events.clear()
            self._bump()
        elif kind == "state":
            self._asked = False
            for event in message.pop("events", ()):
                self._events.append(tuple(event))
                self._event_count += 1
            if "slow" in message:
                self._keep_slow(message.pop("slow"))
            frames = message.pop("frames", {})
            message["actors"] = [] if self._views is None else self._views.places(message["t_ns"])
            self.state = message
            self._bump()
            if frames:
                # The next one is made while these are encoded: else a pane costs a page its twenty a second.
                self.ask()
                await self._encode(frames)
        elif kind == "end":
            self.result = message.get("run")
            self._bump()
        await self._offer()
        self.ask()

    def _keep_slow(self, slow: dict[str, Any]) -> None:
        self._slow, self._slow_version = slow, self._slow_version + 1

    async def _encode(self, bodies: dict[str, Any]) -> None:
        views = self._views_now()
        classes = None if views is None else views.classes
        self._keep(await asyncio.get_running_loop().run_in_executor(self._threads, _encoded, bodies, classes))

    def _keep(self, made: dict[str, Shown]) -> None:
        for stream, picture in made.items():
            self._frames[stream] = (self._version + 1, picture)
        self._version += 1

    def ask(self) -> None:
        """Ask the run for its next update, if somebody waits for one."""
        if self._wire is None or self._asked or not any(page.ready for page in self.pages):
            return
        wanted = sorted({stream for page in self.pages for stream in page.streams} - set(OWN_STREAMS))
        self._asked = True
        self._to_run({"kind": "next", "streams": wanted})

    def _to_run(self, message: dict[str, Any]) -> None:
        if self._wire is not None:
            self._wire.write(packed(message))

    # -- pages ----------------------------------------------------------------------------------------------------

    async def hear(self, page: Page, message: dict[str, Any]) -> None:
        """What a page says, but for starting a run."""
        kind = message.get("kind")
        if kind == "next":
            page.ready = True
            await self._offer()
            self.ask()
        elif kind == "streams":
            wanted = message.get("streams")
            if isinstance(wanted, list):
                page.streams = tuple(s for s in wanted if isinstance(s, str))[:_MOST_STREAMS]
                for stream in [s for s in page.frames if s not in page.streams]:
                    del page.frames[stream]
            page.version = -1  # what it opened may be here already
            self._draw()
            await self._offer()
        elif kind == "sticks":
            self._sticks(page, message)
        elif kind in _TO_RUN:
            self._to_run(message)

    def _sticks(self, page: Page, message: dict[str, Any]) -> None:
        """One page flies at a time: the one that took the switch first, until it lets go."""
        if self._flyer is not None and self._flyer is not page:
            return
        self._flyer = page if message.get("held") is True else None
        self._to_run(message)

    async def leave(self, page: Page) -> None:
        """The page was closed. A switch that it held is let go."""
        self.pages.discard(page)
        if self._flyer is page:
            self._sticks(page, {"kind": "sticks", "held": False})

    def _bump(self) -> None:
        self._version += 1
        self._draw()

    async def changed(self) -> None:
        """Somebody else has put something here that pages should see."""
        self._bump()
        await self._offer()

    async def _offer(self) -> None:
        """To every page that is ready and lacks something, all that it lacks."""
        for page in list(self.pages):
            if page.ready and page.version != self._version:
                page.ready, page.version = False, self._version
                with contextlib.suppress(OSError, RuntimeError):
                    await page.send(self._update(page))

    def _update(self, page: Page) -> bytes:
        first = page.run != self._run
        if first:
            page.run, page.events = self._run, self._event_count - len(self._events)
            page.frames.clear()
            page.slow = -1
        new = min(self._event_count - page.events, len(self._events))
        head: dict[str, Any] = {
            "kind": "update",
            "going": self.going,
            "message": self.message,
            "state": self.state,
            "events": list(self._events)[len(self._events) - new :] if new else [],
            "result": self.result,
        }
        if first:
            head["about"] = self.about
            head["run"] = self._run
        if page.slow != self._slow_version:
            page.slow, head["slow"] = self._slow_version, self._slow
        page.events = self._event_count
        frames = []
        for stream in page.streams:
            version, made = self._frames.get(stream, (-1, None))
            if made is not None and page.frames.get(stream) != version:
                page.frames[stream] = version
                frames.append(made)
        return packed_update(head, frames)

    # -- views of our own -----------------------------------------------------------------------------------------

    def bench_file(self) -> Path | None:
        """Of the scene that is shown: that of the run, or the one that would be flown."""
        out = self.about.get("out")
        return Path(out) / "bench.yaml" if out else self._bench_file()

    def _views_now(self) -> OwnViews | None:
        file = self.bench_file()
        if file is None:
            return None
        if file != self._views_of:
            from hil.dashboard.own_views import OwnViews

            self._views, self._views_of = OwnViews(file), file
        return self._views

    async def scene(self) -> bytes:
        """Triangles. HilError where the scene cannot be loaded."""
        views = self._views_now()
        if views is None:
            return UINT32.pack(0)
        return await asyncio.get_running_loop().run_in_executor(self._threads, views.triangles)

    def _draw(self) -> None:
        """See to it that open panes are drawn, one drawing at a time."""
        if (self._drawing is None or self._drawing.done()) and self._own_wanted() and "p" in self.state:
            self._drawing = asyncio.get_running_loop().create_task(self._keep_drawing())

    def _own_wanted(self) -> list[str]:
        return sorted({s for page in self.pages for s in page.streams if s.startswith(f"{OWN_PREFIX}/")})

    async def _keep_drawing(self) -> None:
        loop = asyncio.get_running_loop()
        drawn_at: tuple[Any, ...] = ()
        while True:
            wanted, views, state = self._own_wanted(), self._views_now(), self.state
            at = (*wanted, self._run, state.get("t_ns"))
            if not wanted or views is None or "p" not in state or at == drawn_at:
                return
            drawn_at = at
            began = loop.time()
            try:
                made = await loop.run_in_executor(self._threads, self._draw_now, views, wanted, state)
            except HilError:
                return  # the scene cannot be loaded; the run itself says why
            if self.state and views is self._views:
                self._keep(made)
                if self._wire is None or not self._asked:  # else it goes with the run's next update
                    await self._offer()
            # Four times as long as it took, so that drawing takes a fifth of a processor; but what is seen should not
            # be much older than 0.1 s, and what takes longer to draw takes half a processor.
            took_s = loop.time() - began
            await asyncio.sleep(max(0.05, min(4.0 * took_s, 0.1), took_s))

    @staticmethod
    def _draw_now(views: OwnViews, wanted: list[str], state: dict[str, Any]) -> dict[str, Shown]:
        return _encoded(views.draw(wanted, state["p"], state["q"], state["t_ns"]), views.classes)


def _encoded(bodies: dict[str, Any], classes: Classes | None) -> dict[str, Shown]:
    from hil.dashboard.pictures import shown

    return {stream: shown(stream, body, classes or Classes()) for stream, body in bodies.items()}


def _lower_priority() -> None:
    """On Linux each thread has a niceness of its own; a run that this process starts does not inherit it."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
