"""The page's server: static files, one socket for what is live, and past runs to be read."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from hil.dashboard.guard import Guard
from hil.dashboard.hub import Hub, Page
from hil.dashboard.run_process import RunProcess
from hil.signals.errors import HilError

if TYPE_CHECKING:
    from hil.dashboard.past_runs import PastRuns

PAGE_FOLDER = Path(__file__).resolve().parent / "page"
_LARGEST_WORD = 16_384  # bytes of one message of a page
_MOST_PAGES = 24
_BYTES = "application/octet-stream"
# A report holds its own style and pictures, and no scripts; it is shown in a box from which nothing gets out.
_REPORT_POLICY = "default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'; sandbox; frame-ancestors 'none'"


class Dashboard:
    """One server: its hub, the run it started, the past runs of one folder."""

    def __init__(self, *, config: Path | None, runs: Path) -> None:
        """`config`: the bench file that runs are started with; None: the default one."""
        self.hub = Hub(self._default_bench)
        self.run = RunProcess(self.hub)
        self._config = config
        self._runs_folder = runs.resolve()
        self._again: list[str] | None = None  # arguments of the last start
        self._warming: asyncio.Future[None] | None = None

    @cached_property
    def _past(self) -> PastRuns:
        from hil.dashboard.past_runs import PastRuns

        return PastRuns(self._runs_folder)

    def _default_bench(self) -> Path | None:
        from hil.config.files import default_bench

        return self._config or default_bench()

    def _warm(self) -> None:
        """The bench's own modules take a second to load: after the page is there, and before anybody needs them."""
        import hil.dashboard.choices
        import hil.dashboard.own_views
        import hil.dashboard.pictures  # noqa: F401

        _ = self._past

    def application(self, token: str | None) -> ASGIApp:
        """The ASGI application, guarded."""
        routes = [
            Route("/", self._index),
            Route("/api/choices", self._choices),
            Route("/api/scene", self._scene),
            Route("/api/runs", self._runs),
            Route("/api/runs/{name}/summary", self._summary),
            Route("/api/runs/{name}/track", self._track),
            Route("/api/runs/{name}/moment", self._moment),
            Route("/runs/{name}/{path:path}", self._file),
            WebSocketRoute("/live", self._live),
            Mount("/page", StaticFiles(directory=PAGE_FOLDER)),
        ]
        return Guard(Starlette(routes=routes), token=token)

    async def _index(self, _request: Request) -> Response:
        if self._warming is None:
            self._warming = asyncio.ensure_future(_in_thread(self._warm))
        return FileResponse(PAGE_FOLDER / "index.html", media_type="text/html")

    async def _choices(self, _request: Request) -> Response:
        return JSONResponse(await _in_thread(self._lists))

    def _lists(self) -> dict[str, Any]:
        from hil.dashboard.choices import choices

        return choices(self._config)

    async def _scene(self, request: Request) -> Response:
        name = request.query_params.get("run")
        try:
            made = self.hub.scene() if name is None else _in_thread(lambda: self._past.moments.triangles(name))
            triangles = await made
        except HilError as error:
            return PlainTextResponse(str(error), 422)
        return PlainTextResponse("no such run", 404) if triangles is None else Response(triangles, media_type=_BYTES)

    async def _runs(self, _request: Request) -> Response:
        return JSONResponse(await _in_thread(lambda: self._past.listed()))

    async def _summary(self, request: Request) -> Response:
        found = await _in_thread(lambda: self._past.summary(request.path_params["name"]))
        return PlainTextResponse("no such run", 404) if found is None else JSONResponse(found)

    async def _track(self, request: Request) -> Response:
        try:
            return JSONResponse(await _in_thread(lambda: self._past.track(request.path_params["name"])))
        except HilError as error:
            return PlainTextResponse(str(error), 422)

    async def _moment(self, request: Request) -> Response:
        query, name = request.query_params, request.path_params["name"]
        try:
            t_ns = int(query.get("t_ns", ""))
        except ValueError:
            return PlainTextResponse("t_ns must be a whole number", 400)
        if not 0 <= t_ns < 1 << 62:
            return PlainTextResponse("t_ns must lie within a run", 400)
        streams = [stream for stream in query.get("streams", "").split(",") if stream]
        found = await _in_thread(lambda: self._past.moments.at(name, t_ns, streams))
        return PlainTextResponse("no such run", 404) if found is None else Response(found, media_type=_BYTES)

    async def _file(self, request: Request) -> Response:
        path = await _in_thread(lambda: self._past.file(request.path_params["name"], request.path_params["path"]))
        if path is None:
            return PlainTextResponse("no such file", 404)
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
        if kind == "start" and self.run.going:
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


async def _in_thread(call: Callable[..., Any], *arguments: Any) -> Any:
    return await asyncio.get_running_loop().run_in_executor(None, call, *arguments)
