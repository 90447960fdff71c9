"""Clients under test that the bench starts itself, each a process of its own, as on a companion computer."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from firmware_bridge.links.child_process import ChildProcess
from hil.signals.errors import LinkClosed, RecordingError

CLIENT_PATH = Path(__file__).resolve().parents[2] / "rigs" / "jetson"  # where the client's package lies
OUT_VARIABLE = "HIL_COMPANION_OUT"
_END_S = 3.0  # wall clock, that clients get to end by themselves once they have been told


class StartedClient:
    """`python -m hil_companion NAME`; what it prints goes to `companion_NAME.log` in the run's folder, and what it
    wants to leave there to `companion_NAME/`, which its environment names (HIL_COMPANION_OUT).

    It never outlives the bench, and Ctrl-C is the bench's: it tells its clients.
    """

    def __init__(self, cut: str, address: str, out: Path, settings: Mapping[str, Any], keys: Path | None) -> None:
        self.name = client_name(cut)
        argv = [sys.executable, "-m", "hil_companion", cut, "--connect", address]
        for key, value in settings.items():
            argv += ["--set", f"{key}={json.dumps(value)}"]
        if keys is not None:
            argv += ["--key", str(keys / f"{self.name}.key"), "--bench-key", str(keys / "bench.pub")]
        path = os.pathsep.join(filter(None, (str(CLIENT_PATH), os.environ.get("PYTHONPATH", ""))))
        log = out / f"companion_{self.name}.log"
        room = out.resolve() / f"companion_{self.name}"  # for what it wants to leave; it makes the folder
        env = {"PYTHONPATH": path, OUT_VARIABLE: str(room)}
        self._process = ChildProcess(argv, stderr_path=log, env=env, log_output=True, own_group=True)
        try:
            self._process.start()
        except OSError as error:
            raise RecordingError(f"{log}: cannot be written ({error.strerror or error})") from error

    def check(self) -> None:
        """LinkClosed with its last words if it has ended."""
        ended = self.how_it_ended()
        if ended is not None:
            raise LinkClosed(f"companion {self.name}", ended, cause="companion")

    def how_it_ended(self) -> str | None:
        """With its last words; None while it runs."""
        return None if self._process.running() else self._process.describe_end()

    @property
    def running(self) -> bool:
        return self._process.running()

    def close(self) -> None:
        """Make it end."""
        self._process.close()


def close_all(clients: Sequence[StartedClient]) -> None:
    """Let them end, and see that they do."""
    deadline_s = time.monotonic() + _END_S
    while any(client.running for client in clients) and time.monotonic() < deadline_s:
        time.sleep(0.01)
    for client in clients:
        client.close()


def client_name(cut: str) -> str:
    """How a shipped client, or MODULE:NAME of somebody's own, is called on the wire."""
    return cut.rpartition(":")[2]


def use_client() -> None:
    """From here on its package can be imported."""
    if str(CLIENT_PATH) not in sys.path:
        sys.path.insert(0, str(CLIENT_PATH))


def known_clients() -> tuple[str, ...]:
    """Names that `hil companion` knows."""
    use_client()
    from hil_companion.catalog import SHIPPED

    return tuple(SHIPPED)


def unknown_clients(names: Iterable[str]) -> list[str]:
    """Of the names, those that are neither shipped nor MODULE:NAME of somebody's own."""
    return [name for name in names if name not in known_clients() and ":" not in name]
