"""The process of a run that the page's Start button starts."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path

import pytest

from hil.apps.dash.server import run_process
from hil.apps.dash.server.hub import Hub
from hil.apps.dash.server.run_process import RunProcess


def test_after_a_run_that_does_not_end_another_can_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_process, "_STOP_S", 0.1)

    async def reset() -> None:
        hub = Hub()
        run = RunProcess(hub)
        run.start(["--out", str(tmp_path)])
        while run._process is None or not hub.running:
            await asyncio.sleep(0.01)
        os.kill(run._process.pid, signal.SIGSTOP)
        await run.stop()
        assert not run.running

    asyncio.run(reset())
