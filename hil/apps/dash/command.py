"""Serves the dashboard: for `hil dash`, and for one run of `hil run --dash`."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from signals.errors import ConfigError

if TYPE_CHECKING:
    from hil.run.feed.live_run import LiveRun


def serve_dashboard(config: Path | None, console: Console, *, host: str, port: int, runs: Path) -> None:
    """Serve the page until Ctrl-C. Raises ConfigError."""
    from hil.apps.dash.server.app import Dashboard
    from hil.apps.dash.server.serve import address_of, new_token, open_port, serve

    if config is not None and not config.is_file():
        raise ConfigError.at(str(config), "does not exist", "give the path of a bench file, or none for ./hil.yaml")
    token = new_token(host)
    listening = open_port(host, port, "--port")
    dashboard = Dashboard(config=config, runs=runs)
    console.print(f"dashboard: {address_of(listening, token)}   (Ctrl-C ends it)", markup=False)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(serve(dashboard, listening, token))


def live_on_fd(fd: int, *, paused: bool, pace: float | None) -> LiveRun:
    """Return the LiveRun of an inherited socket to the page's server. Raises ConfigError if `fd` is not a socket."""
    from hil.run.feed.live_run import LiveRun

    try:
        link = socket.socket(fileno=fd)
    except OSError as error:
        raise ConfigError.at("--dash-fd", f"{fd} is not a socket ({error.strerror or error})") from error
    return LiveRun(link, paused=paused, pace=pace)


def server_process(
    listening: socket.socket, run_link: socket.socket, *, config: Path | None, runs: Path, token: str | None
) -> subprocess.Popen[bytes]:
    """Start the page's server as a process that inherits both sockets. `run_link`: socket to the run."""
    command = [sys.executable, "-P", "-m", "hil.apps.dash.server.serve", f"--runs={runs}"]
    command += [f"--listen-fd={listening.fileno()}", f"--run-fd={run_link.fileno()}"]
    command += [] if config is None else [f"--config={config}"]
    server = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        pass_fds=(listening.fileno(), run_link.fileno()),
        start_new_session=True,  # Ctrl-C ends the run only; the page then shows the result
    )
    assert server.stdin is not None
    server.stdin.write(((token or "") + "\n").encode())
    server.stdin.close()
    return server


@contextlib.contextmanager
def dashboard_beside(
    config: Path | None, console: Console, runs: Path, *, host: str, port: int, lingers: bool = True
) -> Iterator[LiveRun]:
    """Serve a page for a run in this process, and for those in `runs`.

    With `lingers` the server stays until all pages are closed.
    """
    from hil.apps.dash.server.serve import address_of, new_token, open_port
    from hil.config.files import default_bench
    from hil.run.feed.live_run import LiveRun

    token = new_token(host)
    config = config or default_bench()
    with open_port(host, port, "--dash-port") as listening:
        run_end, server_end = socket.socketpair()
        with server_end:
            server = server_process(listening, server_end, config=config, runs=runs, token=token)
        console.print(f"dashboard: {address_of(listening, token)}", markup=False)
    live = LiveRun(run_end)
    try:
        yield live
        live.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            server.wait(4.0 if lingers else 0.0)
        if lingers and server.poll() is None:
            console.print("dashboard: a page is still open; close it or press Ctrl-C to end", markup=False)
            server.wait()
    finally:
        live.close()
        if server.poll() is None:
            server.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                server.wait(3.0)
        if server.poll() is None:
            server.kill()
            server.wait()
