"""Start the page's server: for `hil dash`, and as a process of its own beside `hil run --dash`."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import secrets
import socket
import sys
from pathlib import Path

import uvicorn

from firmware_bridge.loopback_host import is_loopback
from hil.dashboard.app import Dashboard
from hil.signals.errors import PortBusy, PortNotFound

_LARGEST_SOCKET_MESSAGE = 65_536
_LINGER_S = 2.0  # a page that is being loaded again is not a page that was closed


def open_port(host: str, port: int) -> socket.socket:
    """A listening socket. PortBusy, PortNotFound."""
    name = f"{host}:{port}"
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError) as error:
        raise PortNotFound(name, f"no such address ({error})") from error
    try:
        return socket.create_server((str(address[0]), int(address[1])), family=family, backlog=64)
    except OSError as error:
        why = error.strerror or str(error)
        raise PortBusy(name, f"the dashboard cannot listen there ({why}); choose another with --port") from error


def new_token(host: str) -> str | None:
    """None where only this machine can reach the page."""
    return None if is_loopback(host) else secrets.token_urlsafe(24)


def address_of(listening: socket.socket, token: str | None) -> str:
    """What to open in a browser."""
    host, port = listening.getsockname()[:2]
    if host in ("0.0.0.0", "::"):  # noqa: S104 (every address of this machine: by its name)
        host = socket.gethostname()
    shown = f"[{host}]" if ":" in host else host
    return f"http://{shown}:{port}/" + ("" if token is None else f"?token={token}")


async def serve(
    dashboard: Dashboard,
    listening: socket.socket,
    token: str | None,
    *,
    wire: socket.socket | None = None,
) -> None:
    """Until it is stopped; with `wire`, the run at its other end, until that is over and no page is open."""
    server = uvicorn.Server(
        uvicorn.Config(
            dashboard.application(token),
            log_level="critical",
            access_log=False,
            lifespan="off",
            ws="websockets-sansio",
            ws_max_size=_LARGEST_SOCKET_MESSAGE,
            ws_per_message_deflate=False,
            server_header=False,
            timeout_graceful_shutdown=1,
        )
    )
    following = None
    if wire is not None:
        following = asyncio.create_task(_follow(dashboard, wire, server))
    try:
        await server.serve(sockets=[listening])
    finally:
        if following is not None:
            following.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await following
        await dashboard.run.stop()


async def _follow(dashboard: Dashboard, wire: socket.socket, server: uvicorn.Server) -> None:
    await dashboard.hub.follow(wire)
    alone_s = 0.0
    while alone_s < _LINGER_S:
        await asyncio.sleep(0.25)
        alone_s = 0.0 if dashboard.hub.pages or dashboard.run.going else alone_s + 0.25
    server.should_exit = True


def main() -> int:
    """Beside `hil run --dash`: the listening socket and the run's wire are inherited."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--listen-fd", type=int, required=True)
    parser.add_argument("--wire-fd", type=int, required=True)
    parser.add_argument("--runs", type=Path, required=True)
    parser.add_argument("--config", type=Path)
    options = parser.parse_args()
    token = sys.stdin.readline().strip() or None  # not in the arguments, which every user can see
    listening = socket.socket(fileno=options.listen_fd)
    wire = socket.socket(fileno=options.wire_fd)
    dashboard = Dashboard(config=options.config, runs=options.runs)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(serve(dashboard, listening, token, wire=wire))
    return 0


if __name__ == "__main__":
    sys.exit(main())
