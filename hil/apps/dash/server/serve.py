"""Runs the page's server: within `hil dash`, or as a separate process for `hil run --dash`."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import secrets
import socket
import sys
from pathlib import Path

import uvicorn

from firmware_bridge.transports.loopback_host import is_loopback
from hil.apps.dash.server.app import Dashboard
from signals.errors import ConfigError

_LARGEST_SOCKET_MESSAGE = 65_536
_UNREAD_LIMIT_MS = 30_000  # a connection whose peer reads nothing for so long is closed
_LINGER_S = 2.0  # wait for a page that is only being reloaded


def open_port(host: str, port: int, option: str) -> socket.socket:
    """Return a listening socket. Raises ConfigError that names the option of the port."""
    name = f"{host}:{port}"
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError) as error:
        raise ConfigError.at(name, f"no such address ({error})") from error
    try:
        listening = socket.create_server((str(address[0]), int(address[1])), family=family, backlog=64)
    except OSError as error:
        reason = error.strerror or str(error)
        message, hint = f"the dashboard cannot listen there ({reason})", f"choose another with {option}; 0 takes any"
        raise ConfigError.at(name, message, hint) from error
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux; connections inherit it
        listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNREAD_LIMIT_MS)
    return listening


def new_token(host: str) -> str | None:
    """Return a random token, or None if only this machine can reach the page."""
    return None if is_loopback(host) else secrets.token_urlsafe(24)


def address_of(listening: socket.socket, token: str | None) -> str:
    """Return the address of the page for a browser, with the token."""
    host, port = listening.getsockname()[:2]
    if host in ("0.0.0.0", "::"):  # noqa: S104 (compared only)
        host = socket.gethostname()
    host_text = f"[{host}]" if ":" in host else host
    return f"http://{host_text}:{port}/" + ("" if token is None else f"?token={token}")


async def serve(
    dashboard: Dashboard,
    listening: socket.socket,
    token: str | None,
    *,
    run_link: socket.socket | None = None,
) -> None:
    """Serve until stopped. With `run_link`, follow that run, and stop when it is over and no page is open."""
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
    if run_link is not None:
        following = asyncio.create_task(_follow(dashboard, run_link, server))
    try:
        await server.serve(sockets=[listening])
    finally:
        if following is not None:
            following.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await following
        await dashboard.end()


async def _follow(dashboard: Dashboard, run_link: socket.socket, server: uvicorn.Server) -> None:
    await dashboard.hub.follow(run_link)
    idle_s = 0.0
    while idle_s < _LINGER_S:
        await asyncio.sleep(0.25)
        idle_s = 0.0 if dashboard.hub.pages or dashboard.run.running else idle_s + 0.25
    server.should_exit = True


def main() -> int:
    """Serve for `hil run --dash`, with a listening socket and a link to the run that this process inherits."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--listen-fd", type=int, required=True)
    parser.add_argument("--run-fd", type=int, required=True)
    parser.add_argument("--runs", type=Path, required=True)
    parser.add_argument("--config", type=Path)
    options = parser.parse_args()
    token = sys.stdin.readline().strip() or None  # not in the arguments, which every user of the machine can see
    listening = socket.socket(fileno=options.listen_fd)
    run_link = socket.socket(fileno=options.run_fd)
    dashboard = Dashboard(config=options.config, runs=options.runs)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(serve(dashboard, listening, token, run_link=run_link))
    return 0


if __name__ == "__main__":
    sys.exit(main())
