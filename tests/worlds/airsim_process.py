"""`hil airsim` in a process of its own, and scripts that run against it in the Python of a real client."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.worlds.airsim_clients import PYTHONS, client_python, package_of
from tests.worlds.bench_process import ROOT
from tests.worlds.patience import PATIENCE_S, until

SCRIPTS = Path(__file__).with_name("airsim_scripts")
_ADDRESS = re.compile(r"airsim: 127\.0\.0\.1:(\d+)")


class AirSimProcess:
    """`with AirSimProcess(out, "--clock", "calls") as server:`; its port is chosen by the system."""

    def __init__(self, out: Path, *options: str, settings: Any = None, core: int | None = None) -> None:
        """`core`: the only processor core that the server may use; None: all."""
        self._out, self._core = out, core
        text = json.dumps(settings if settings is not None else {"SettingsVersion": 1.2})
        self._command = [sys.executable, "-m", "hil.cli", "airsim", "--port", "0", "--settings", text]
        self._command += ["--out", str(out / "run"), *options]
        self.port = 0

    def __enter__(self) -> AirSimProcess:
        self._out.mkdir(parents=True, exist_ok=True)
        with (self._out / "log.txt").open("w") as log:
            self.process = subprocess.Popen(
                self._command,
                cwd=ROOT,
                stdout=log,
                stderr=log,
                env=os.environ | {"COLUMNS": "400", "PYTHONPATH": str(ROOT)},
            )
        if self._core is not None:
            os.sched_setaffinity(self.process.pid, {self._core})
        until(lambda: _ADDRESS.search(self.log()) or self.process.poll() is not None, "a server of AirSim's API")
        found = _ADDRESS.search(self.log())
        assert found is not None, self.log()
        self.port = int(found.group(1))
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()

    def log(self) -> str:
        """Return what the server has printed so far."""
        return (self._out / "log.txt").read_text()

    def finish(self) -> dict[str, Any]:
        """End the server and return its airsim.json."""
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(PATIENCE_S) == 0, self.log()
        return json.loads((self._out / "run" / "airsim.json").read_text())


def run_script(
    client: str,
    name: str,
    server: AirSimProcess,
    *arguments: str,
    python: str = PYTHONS[-1],
    limit_s: float = PATIENCE_S,
) -> str:
    """Run a script of `airsim_scripts` with a real client to its end and return what it printed."""
    script = str(SCRIPTS / f"{name}.py")
    command = [str(client_python(client, python)), script, package_of(client), str(server.port), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=limit_s)
    assert done.returncode == 0, f"{done.stderr[-3000:]}\nserver:\n{server.log()[-2000:]}"
    return done.stdout
