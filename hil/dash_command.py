"""`hil dash`, and what `hil run --dash` has besides a run."""

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

from hil.signals.errors import ConfigError, Problem

if TYPE_CHECKING:
    from hil.dashboard.live_run import LiveRun


def serve_dashboard(config: Path | None, console: Console, *, host: str, port: int, runs: Path) -> None:
    """Serve the page until Ctrl-C. ConfigError, PortBusy, PortNotFound."""
    from hil.dashboard.app import Dashboard
    from hil.dashboard.serve import address_of, new_token, open_port, serve

    if config is not None and not config.is_file():
        raise ConfigError([Problem(str(config), "is not there", "name a bench file, or none for ./hil.yaml")])
    token = new_token(host)
    listening = open_port(host, port)
    dashboard = Dashboard(config=config, runs=runs)
    console.print(f"dashboard: {address_of(listening, token)}   (Ctrl-C ends it)", markup=False)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(serve(dashboard, listening, token))


def live_on_fd(fd: int, *, paused: bool, pace: float | None) -> LiveRun:
    """The run's end of a wire that a dashboard opened. ConfigError where there is none."""
    from hil.dashboard.live_run import LiveRun

    try:
        wire = socket.socket(fileno=fd)
    except OSError as error:
        raise ConfigError([Problem("--dash-fd", f"{fd} is no socket ({error.strerror or error})")]) from error
    return LiveRun(wire, paused=paused, pace=pace)


def server_process(
    listening: socket.socket, wire: socket.socket, *, config: Path | None, runs: Path, token: str | None
) -> subprocess.Popen[bytes]:
    """The page's server in a process of its own, which inherits both sockets. `wire`: its end of the run's."""
    command = [sys.executable, "-m", "hil.dashboard.serve", f"--runs={runs}"]
    command += [f"--listen-fd={listening.fileno()}", f"--wire-fd={wire.fileno()}"]
    command += [] if config is None else [f"--config={config}"]
    server = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        pass_fds=(listening.fileno(), wire.fileno()),
        start_new_session=True,  # Ctrl-C is for the run; the page then shows how it ended
    )
    assert server.stdin is not None
    server.stdin.write(((token or "") + "\n").encode())
    server.stdin.close()
    return server


@contextlib.contextmanager
def dashboard_beside(config: Path | None, console: Console, *, host: str, port: int, runs: Path) -> Iterator[LiveRun]:
    """A page in a process of its own for the run of this one. After the run it stays while somebody looks."""
    from hil.dashboard.live_run import LiveRun
    from hil.dashboard.serve import address_of, new_token, open_port

    token = new_token(host)
    with open_port(host, port) as listening:
        ours, theirs = socket.socketpair()
        with theirs:
            server = server_process(listening, theirs, config=config, runs=runs, token=token)
        console.print(f"dashboard: {address_of(listening, token)}", markup=False)
    live = LiveRun(ours)
    try:
        yield live
        live.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            server.wait(4.0)
        if server.poll() is None:
            console.print("dashboard: a page is open; it is served until it is closed, or Ctrl-C", markup=False)
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
