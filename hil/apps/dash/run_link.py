"""The dashboard of a run: served by this command, or by the process that started it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

if TYPE_CHECKING:
    from hil.run.bench_run import MoreParts


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
    def parts(self, config: Path | None, runs: Path, console: Console) -> Iterator[MoreParts]:
        """Open the run's side of the connection and yield the maker of its parts. Raises ConfigError.

        `runs`: folder of the runs that the page lists.
        """
        if self.serve:
            from hil.apps.dash.command import dashboard_beside
            from hil.apps.dash.part import DashboardPart

            with dashboard_beside(config, console, host=self.host, port=self.port, runs=runs.resolve()) as live:
                yield lambda vehicle: [DashboardPart(live, vehicle)]
        elif self.fd is not None:
            from hil.apps.dash.command import live_on_fd
            from hil.apps.dash.part import DashboardPart

            live = live_on_fd(self.fd, paused=self.paused, pace=self.pace)
            try:
                yield lambda vehicle: [DashboardPart(live, vehicle)]
            finally:
                live.close()
        else:
            yield lambda vehicle: []  # noqa: ARG005
