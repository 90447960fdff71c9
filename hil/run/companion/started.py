"""Clients under test that the bench starts, each as a process, like on a companion computer."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from firmware_bridge.links.child_process import ChildProcess
from hil.config.companion.clients import CLIENT_PATH, client_name
from signals.errors import LinkClosed, file_errors

OUT_VARIABLE = "HIL_COMPANION_OUT"
END_S = 3.0  # wall clock in which clients may end by themselves after the session


class StartedClient:
    """Process `python -m hil_companion NAME`. Its output goes to `companion_NAME.log` in the run's folder.

    Its environment names the folder for its files, `companion_NAME/` (HIL_COMPANION_OUT). The process never outlives
    the bench. It does not receive Ctrl-C; the bench does, and ends the session of each client.
    """

    def __init__(self, cut: str, address: str, out: Path, settings: Mapping[str, Any], keys: Path | None) -> None:
        self.name = client_name(cut)
        argv = [sys.executable, "-P", "-m", "hil_companion", cut, "--connect", address]
        for key, value in settings.items():
            argv += ["--set", f"{key}={json.dumps(value)}"]
        if keys is not None:
            argv += ["--key", str(keys / f"{self.name}.key"), "--bench-key", str(keys / "bench.pub")]
        path = os.pathsep.join(filter(None, (str(CLIENT_PATH), os.environ.get("PYTHONPATH", ""))))
        log = out / f"companion_{self.name}.log"
        folder = out.resolve() / f"companion_{self.name}"  # the client makes it when it writes a file
        env = {"PYTHONPATH": path, OUT_VARIABLE: str(folder)}
        self._process = ChildProcess(argv, stderr_path=log, env=env, log_output=True, own_group=True)
        with file_errors(log):
            self._process.start()

    def check(self) -> None:
        """Raise LinkClosed if the process has ended, with a description of its end."""
        end = self.process_end()
        if end is not None:
            raise LinkClosed(f"companion {self.name}", end, cause="companion")

    def process_end(self) -> str | None:
        """Describe the end of the process with its last output; None while it runs."""
        return None if self._process.running() else self._process.describe_end()

    def bad_end(self) -> str | None:
        """Describe an end of its own that is none of success; None while it runs, or after exit status 0."""
        return self._process.describe_end() if self._process.exit_status else None

    @property
    def running(self) -> bool:
        return self._process.running()

    def close(self) -> None:
        """Terminate the process."""
        self._process.close()


class Ends(NamedTuple):
    """Ends of the started clients after the session."""

    bad: dict[str, str]  # by name, those with an exit status other than 0: what it was, and their last output
    terminated: list[str]  # a line on each that did not end by itself


def close_all(clients: Sequence[StartedClient]) -> Ends:
    """Wait for the clients to end by themselves, then terminate the others."""
    deadline_s = time.monotonic() + END_S
    while any(client.running for client in clients) and time.monotonic() < deadline_s:
        time.sleep(0.01)
    bad: dict[str, str] = {}
    terminated: list[str] = []
    for client in clients:
        if client.running:
            text = f"the companion {client.name} had not ended {END_S:g} s after the flight and was terminated"
            terminated.append(f"{text}: what it writes in stop() may be incomplete")
        elif (end := client.bad_end()) is not None:
            bad[client.name] = end
        client.close()
    return Ends(bad, terminated)
