"""The dashboard of a run: served by this command, or by the process that started it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from hil.run.part import Part


@dataclass(frozen=True)
class DashboardLink:
    """Connection between a run and a dashboard; the default is a run without one.

    With `serve` a page is served at `host`:`port` for this run. Otherwise `fd`, if given, is the socket of the
    dashboard that started this process; `pace` and `paused` are the initial settings of the run.
    """

    serve: bool = False
    host: str = "127.0.0.1"
    port: int = 0
    fd: int | None = None
    pace: float | None = None
    paused: bool = False

    @contextlib.contextmanager
    def parts(self, config: Path | None, folder: Path, console: Console) -> Iterator[list[Part]]:
        """Open the run's side of the connection and yield the parts to add to the run. Raises ConfigError, PortBusy."""
        if self.serve:
            from hil.apps.dash.command import dashboard_beside
            from hil.apps.dash.part import DashboardPart

            runs = folder.resolve().parent
            with dashboard_beside(config, console, host=self.host, port=self.port, runs=runs) as live:
                yield [DashboardPart(live)]
        elif self.fd is not None:
            from hil.apps.dash.command import live_on_fd
            from hil.apps.dash.part import DashboardPart

            live = live_on_fd(self.fd, paused=self.paused, pace=self.pace)
            try:
                yield [DashboardPart(live)]
            finally:
                live.close()
        else:
            yield []
