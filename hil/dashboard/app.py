"""The page's server: static files, one socket for what is live, and past runs to be read."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import socket
import sys
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from hil.dashboard.guard import Guard
from hil.dashboard.hub import Hub, Page
from hil.signals.errors import HilError

if TYPE_CHECKING:
    from hil.dashboard.past_runs import PastRuns

T = TypeVar("T")
PAGE_FOLDER = Path(__file__).resolve().parent / "page"
_LARGEST_WORD = 16_384  # bytes of one message of a page
_MOST_PAGES = 24
_BYTES = "application/octet-stream"
# A report holds its own style and pictures, and no scripts; it is shown in a box from which nothing gets out.
_REPORT_POLICY = "default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'; sandbox; frame-ancestors 'none'"


_LAST_BYTES = 4000  # of what the run printed as errors
_STOP_S = 10.0


class RunProcess:
    """At most one at a time; the hub follows it."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._process: asyncio.subprocess.Process | None = None
        self._task: asyncio.Task[None] | None = None
        self._following: asyncio.Task[None] | None = None  # what the run says

    @property
    def going(self) -> bool:
        return self._hub.going or (self._task is not None and not self._task.done())

    def start(self, arguments: Sequence[str]) -> None:
        """`hil run` with these arguments. Nothing happens while another run goes."""
        if not self.going:
            self._following = None
            self._task = asyncio.get_running_loop().create_task(self._run(list(arguments)))

    async def exited(self) -> bool:
        """True once a run that has said its last is gone; False at once while it still flies or starts."""
        if self._task is None or self._following is None or not self._following.done():
            return False
        await asyncio.wait([self._task])
        return True

    async def stop(self) -> None:
        """End the run as Ctrl-C does, and wait for it."""
        process, task = self._process, self._task
        if process is not None and process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGINT)
        if task is not None:
            done, _ = await asyncio.wait([task], timeout=_STOP_S)
            if not done and process is not None and process.returncode is None:
                process.kill()

    async def _run(self, arguments: list[str]) -> None:
        ours, theirs = socket.socketpair()
        hub = self._hub
        try:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "hil.entry",
                "run",
                "--quiet",
                f"--dash-fd={theirs.fileno()}",
                *arguments,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE,
                pass_fds=(theirs.fileno(),),
            )
        except OSError as error:
            ours.close()
            hub.message = f"the run cannot be started ({error.strerror or error})"
            return
        finally:
            theirs.close()
        self._following = asyncio.get_running_loop().create_task(hub.follow(ours))
        assert self._process.stderr is not None
        said = b""
        while piece := await self._process.stderr.read(4096):
            said = (said + piece)[-_LAST_BYTES:]
        status = await self._process.wait()
        await self._following
        if hub.result is None:  # it never got so far as to say itself how it went
            hub.message = said.decode(errors="replace").strip() or f"the run ended with status {status}"
        await hub.changed()


class Dashboard:
    """One server: its hub, the run it started, the past runs of one folder."""

    def __init__(self, *, config: Path | None, runs: Path) -> None:
        """`config`: the bench file that runs are started with; None: the default one."""
        self.hub = Hub(self._default_bench)
        self.run = RunProcess(self.hub)
        self._config = config
        self._runs_folder = runs.resolve()
        self._again: list[str] | None = None  # arguments of the last start
        self._warming: asyncio.Task[None] | None = None

    @cached_property
    def _past(self) -> PastRuns:
        from hil.dashboard.past_runs import PastRuns

        return PastRuns(self._runs_folder)

    def _default_bench(self) -> Path | None:
        from hil.config.files import default_bench

        return self._config or default_bench()

    def _warm(self) -> None:
        """The bench's own modules take a second to load: after the page is there, and before anybody needs them."""
        import cv2

        import hil.dashboard.choices
        import hil.dashboard.own_views  # noqa: F401

        # Waking others for a small picture costs more than they save, and the run wants their processor.
        cv2.setNumThreads(1)
        _ = self._past

    def application(self, token: str | None) -> ASGIApp:
        """The ASGI application, guarded."""
        routes = [
            Route("/", self._index),
            Route("/api/choices", self._choices),
            Route("/api/scene", self._scene),
            Route("/api/runs", self._runs),
            Route("/api/runs/{name}/scene", self._past_scene),
            Route("/api/runs/{name}/summary", self._summary),
            Route("/api/runs/{name}/track", self._track),
            Route("/api/runs/{name}/moment", self._moment),
            Route("/runs/{name}/{path:path}", self._file),
            WebSocketRoute("/live", self._live),
            Mount("/page", StaticFiles(directory=PAGE_FOLDER)),
        ]
        return Guard(Starlette(routes=routes, exception_handlers={HilError: _cannot_be_read}), token=token)

    async def _index(self, _request: Request) -> Response:
        if self._warming is None:
            self._warming = asyncio.create_task(run_in_threadpool(self._warm))
        return FileResponse(PAGE_FOLDER / "index.html", media_type="text/html")

    async def _scene(self, _request: Request) -> Response:
        return Response(await self.hub.scene(), media_type=_BYTES)

    # Starlette runs these, which are not asynchronous, in threads.

    def _choices(self, _request: Request) -> Response:
        from hil.dashboard.choices import choices

        return JSONResponse(choices(self._config))

    def _runs(self, _request: Request) -> Response:
        return JSONResponse(self._past.listed())

    def _past_scene(self, request: Request) -> Response:
        return Response(_there(self._past.moments.triangles(request.path_params["name"])), media_type=_BYTES)

    def _summary(self, request: Request) -> Response:
        return JSONResponse(_there(self._past.summary(request.path_params["name"])))

    def _track(self, request: Request) -> Response:
        return JSONResponse(self._past.track(request.path_params["name"]))

    def _moment(self, request: Request) -> Response:
        query = request.query_params
        try:
            t_ns = int(query.get("t_ns", ""))
        except ValueError:
            raise HTTPException(400, "t_ns must be a whole number") from None
        if not 0 <= t_ns < 1 << 62:
            raise HTTPException(400, "t_ns must lie within a run")
        streams = [stream for stream in query.get("streams", "").split(",") if stream]
        found = self._past.moments.at(request.path_params["name"], t_ns, streams)
        return Response(_there(found), media_type=_BYTES)

    def _file(self, request: Request) -> Response:
        path = _there(self._past.file(request.path_params["name"], request.path_params["path"]))
        return FileResponse(path, headers={"content-security-policy": _REPORT_POLICY})

    async def _live(self, socket: WebSocket) -> None:
        if len(self.hub.pages) >= _MOST_PAGES:
            await socket.close(1013, "too many pages are open")
            return
        await socket.accept()
        page = Page(socket.send_bytes)
        self.hub.pages.add(page)
        try:
            while True:
                text = await socket.receive_text()
                message = _message(text)
                if message is not None:
                    await self._hear(page, message)
        except (WebSocketDisconnect, KeyError, RuntimeError, OSError):
            pass  # closed, or bytes where text belongs
        finally:
            await self.hub.leave(page)
            with contextlib.suppress(RuntimeError, OSError):
                await socket.close()

    async def _hear(self, page: Page, message: dict[str, Any]) -> None:
        kind = message.get("kind")
        if kind not in ("start", "reset"):
            await self.hub.hear(page, message)
            return
        # A page shows a run as over when it has said its last; its process may take a moment more to exit.
        if kind == "start" and self.run.going and not await self.run.exited():
            return
        from hil.dashboard.choices import run_arguments

        try:
            arguments = run_arguments(message, self._config) if kind == "start" else self._again
        except ValueError as error:
            self.hub.message = str(error)
            await self.hub.changed()
            return
        if arguments is None:  # nothing was started from here: there is nothing to start again
            return
        if kind == "reset":
            await self.run.stop()
            await self.hub.waits_to_end.wait()
        self._again = arguments
        self.hub.message = ""  # of the start before
        self.run.start([*arguments, f"--dash-runs={self._runs_folder}"])


def _message(text: str) -> dict[str, Any] | None:
    """What a page said; None where it is nothing that a page says."""
    if len(text) > _LARGEST_WORD:
        return None
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) else None


def _there(found: T | None) -> T:
    if found is None:
        raise HTTPException(404, "no such run or file")
    return found


def _cannot_be_read(_request: Request, error: Exception) -> Response:
    return PlainTextResponse(str(error), 422)
