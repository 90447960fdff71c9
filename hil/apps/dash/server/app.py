"""The page's web application: static files, a web socket for the live run, and an API for past runs and campaigns."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from hil.apps.dash.server.authenticator import Authenticator
from hil.apps.dash.server.hub import Hub, Page
from hil.apps.dash.server.run_process import RunProcess
from hil.run_files import PAGE_NAME
from signals.errors import HilError

if TYPE_CHECKING:
    from hil.apps.dash.past.campaigns import Campaigns
    from hil.apps.dash.past.past_runs import PastRuns

T = TypeVar("T")
PAGE_FOLDER = Path(__file__).resolve().parents[1] / "page"
_MAX_MESSAGE_CHARS = 16_384  # of one message of a page
_VEHICLE = re.compile(r"[a-z][a-z0-9_]{0,31}")  # as in a bench; more than that is not a name of a folder
_MAX_PAGES = 24
_BYTES = "application/octet-stream"
# A report contains its style and pictures and no scripts. The sandbox gives it no access to the page.
_REPORT_POLICY = "default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'; sandbox; frame-ancestors 'none'"
# The page of a campaign also searches in its table, and links to its flights: links from another origin are refused.
_CAMPAIGN_POLICY = _REPORT_POLICY.replace(
    "sandbox", "script-src {script}; sandbox allow-scripts allow-same-origin allow-downloads"
)


class Dashboard:
    """The dashboard's hub, the run that it started, the past runs of one folder and the campaigns beside it."""

    def __init__(self, *, config: Path | None, runs: Path) -> None:
        """`config`: the bench file of new runs; None: the default bench."""
        self.hub = Hub(self._default_bench)
        self.run = RunProcess(self.hub)
        self._config = config
        self._runs_folder = runs.resolve()
        self._missions = self._runs_folder.parent / "missions"  # of pages
        self._last_arguments: list[str] | None = None  # of the last start
        self._loading: asyncio.Task[None] | None = None

    @cached_property
    def _past(self) -> PastRuns:
        from hil.apps.dash.past.past_runs import PastRuns

        return PastRuns(self._runs_folder)

    @cached_property
    def _past_campaigns(self) -> Campaigns:
        from hil.apps.dash.past.campaigns import Campaigns

        return Campaigns(self._runs_folder.parent / "campaigns")

    async def end(self) -> None:
        """End the run that was started, and what is being read for pages."""
        if "_past" in self.__dict__:
            self._past.end()
        await self.run.stop()

    def _default_bench(self) -> Path | None:
        from hil.config.files import dashboard_bench

        return self._config or dashboard_bench()

    def _load_modules(self) -> None:
        """Import the bench's modules after the page is loaded, because that takes a second: the form's first."""
        import hil.apps.dash.server.choices  # isort: split
        import cv2

        import hil.apps.dash.views.preview_sensors  # noqa: F401

        # For small pictures more threads save no time, and they would take processor time from the run.
        cv2.setNumThreads(1)
        _ = self._past

    def application(self, token: str | None) -> ASGIApp:
        """Return the ASGI application with its access control."""
        routes = [
            Route("/", self._index),
            Route("/api/choices", self._choices),
            Route("/api/missions/file", self._mission_file, methods=["POST"]),
            Route("/api/missions/drawn", self._mission_drawn, methods=["POST"]),
            Route("/api/scene", self._scene),
            Route("/api/runs", self._runs),
            Route("/api/runs/{name}/scene", self._past_scene),
            Route("/api/runs/{name}/summary", self._summary),
            Route("/api/runs/{name}/track", self._track),
            Route("/api/runs/{name}/moment", self._moment),
            Route("/api/runs/{name}/download", self._download),
            Route("/runs/{name}/{path:path}", self._file),
            Route("/api/campaigns", self._campaigns),
            Route("/campaigns/{name}/{path:path}", self._campaign_file),
            WebSocketRoute("/live", self._live),
            Mount("/page", StaticFiles(directory=PAGE_FOLDER)),
        ]
        return Authenticator(Starlette(routes=routes, exception_handlers={HilError: _unreadable}), token=token)

    async def _index(self, _request: Request) -> Response:
        if self._loading is None:
            self._loading = asyncio.create_task(run_in_threadpool(self._load_modules))
        return FileResponse(PAGE_FOLDER / "index.html", media_type="text/html")

    async def _scene(self, _request: Request) -> Response:
        return Response(await self.hub.scene(), media_type=_BYTES)

    async def _mission_file(self, request: Request) -> Response:
        from hil.apps.dash.server.missions import keep_file

        name = request.query_params.get("name", "")
        return await self._keep(keep_file, name, await _body(request), self._missions)

    async def _mission_drawn(self, request: Request) -> Response:
        from hil.apps.dash.server.missions import keep_drawn

        course = _message((await _body(request)).decode(errors="replace"))
        place = await self.hub.site_and_start()
        if course is None or place is None:
            raise HTTPException(400, "a course and a scene are needed")
        return await self._keep(keep_drawn, course, *place, self._missions)

    @staticmethod
    async def _keep(keep: Callable[..., Path], *arguments: Any) -> Response:
        try:
            path = await run_in_threadpool(keep, *arguments)
        except (ValueError, OSError) as error:
            return PlainTextResponse(str(error), 422)
        return JSONResponse({"mission": str(path)})

    # These are not asynchronous, so Starlette runs them in threads.

    def _choices(self, request: Request) -> Response:
        from hil.apps.dash.server.choices import choices

        lists = choices(self._config, self._missions, bench=request.query_params.get("bench"))
        return JSONResponse(_or_404(lists))

    def _runs(self, _request: Request) -> Response:
        return JSONResponse(self._past.listed())

    def _past_scene(self, request: Request) -> Response:
        return Response(_or_404(self._past.moments.triangles(request.path_params["name"])), media_type=_BYTES)

    def _summary(self, request: Request) -> Response:
        return JSONResponse(_or_404(self._past.summary(request.path_params["name"], _vehicle(request))))

    def _track(self, request: Request) -> Response:
        return JSONResponse(self._past.track(request.path_params["name"], _vehicle(request)))

    def _moment(self, request: Request) -> Response:
        query = request.query_params
        try:
            t_ns = int(query.get("t_ns", ""))
        except ValueError:
            raise HTTPException(400, "t_ns must be a whole number") from None
        if not 0 <= t_ns < 1 << 62:
            raise HTTPException(400, "t_ns must be from 0 to 2**62 - 1")
        streams = [stream for stream in query.get("streams", "").split(",") if stream]
        moment = self._past.moments.at(request.path_params["name"], t_ns, streams, _vehicle(request))
        return Response(_or_404(moment), media_type=_BYTES)

    def _file(self, request: Request) -> Response:
        path = _or_404(self._past.file(request.path_params["name"], request.path_params["path"]))
        return FileResponse(path, headers={"content-security-policy": _REPORT_POLICY})

    def _download(self, request: Request) -> Response:
        from hil.apps.dash.past.archive import zipped

        folder = _or_404(self._past.folder(request.path_params["name"]))
        headers = {"content-disposition": f'attachment; filename="{folder.name}.zip"'}
        return StreamingResponse(zipped(folder), media_type="application/zip", headers=headers)

    def _campaigns(self, _request: Request) -> Response:
        return JSONResponse(self._past_campaigns.listed())

    def _campaign_file(self, request: Request) -> Response:
        from hil.run.report.row_search import SCRIPT_SOURCE

        path = request.path_params["path"]
        file = _or_404(self._past_campaigns.file(request.path_params["name"], path))
        policy = _CAMPAIGN_POLICY.format(script=SCRIPT_SOURCE) if path == PAGE_NAME else _REPORT_POLICY
        return FileResponse(file, headers={"content-security-policy": policy})

    async def _live(self, socket: WebSocket) -> None:
        if len(self.hub.pages) >= _MAX_PAGES:
            await socket.close(1013, "too many pages are open")
            return
        await socket.accept()
        page = Page(socket.send_bytes)
        self.hub.pages.add(page)
        receiving = asyncio.create_task(self._receive_all(socket, page))
        losing = asyncio.create_task(page.lost.wait())
        try:
            await asyncio.wait([receiving, losing], return_when=asyncio.FIRST_COMPLETED)
        finally:
            self.hub.remove(page)
            receiving.cancel()
            losing.cancel()
        # A page that does not read its updates would not read the closing frame either.
        if not page.lost.is_set():
            with contextlib.suppress(RuntimeError, OSError, WebSocketDisconnect):
                await socket.close()

    async def _receive_all(self, socket: WebSocket, page: Page) -> None:
        with contextlib.suppress(WebSocketDisconnect, KeyError, RuntimeError, OSError):  # closed, or a binary message
            while True:
                message = _message(await socket.receive_text())
                if message is not None:
                    await self._receive(page, message)

    async def _receive(self, page: Page, message: dict[str, Any]) -> None:
        kind = message.get("kind")
        if kind not in ("start", "reset"):
            if kind == "stop" and not self.hub.begun:
                self.run.interrupt()
            self.hub.receive(page, message)
            return
        # When a page shows the result of a run, the run's process may not have exited yet.
        if kind == "start" and self.run.running and not await self.run.exited():
            return
        from hil.apps.dash.server.choices import run_arguments

        try:
            arguments = (
                run_arguments(message, self._config, self._missions) if kind == "start" else self._last_arguments
            )
        except ValueError as error:
            self.hub.message = str(error)
            self.hub.publish()
            return
        if arguments is None:  # this server has started no run that could be reset
            return
        if kind == "reset":
            await self.run.stop()
            await self.hub.run_ended.wait()
        self._last_arguments = arguments
        self.hub.message = ""  # clear the message of the last start
        self.run.start([*arguments, f"--dash-runs={self._runs_folder}"])


async def _body(request: Request) -> bytes:
    """Return the body of a request. Raises HTTPException for one that is larger than any mission."""
    from hil.apps.dash.server.missions import MAX_FILE_BYTES

    body = b""
    async for piece in request.stream():
        body += piece
        if len(body) > MAX_FILE_BYTES:
            raise HTTPException(413, f"more than {MAX_FILE_BYTES >> 20} MB, which no mission needs")
    return body


def _message(text: str) -> dict[str, Any] | None:
    """Decode a message of a page; None if it is too long or not a JSON object."""
    if len(text) > _MAX_MESSAGE_CHARS:
        return None
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) else None


def _vehicle(request: Request) -> str:
    """Return the vehicle that a request names; empty for none."""
    name = request.query_params.get("vehicle", "")
    if name and not _VEHICLE.fullmatch(name):
        raise HTTPException(404, "there is no such vehicle")
    return name


def _or_404(value: T | None) -> T:
    if value is None:
        raise HTTPException(404, "there is no such run or file")
    return value


def _unreadable(_request: Request, error: Exception) -> Response:
    return PlainTextResponse(str(error), 422)
