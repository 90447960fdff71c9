"""Clients under test that the bench starts itself, each a process of its own, as on a companion computer."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from hil.signals.errors import LinkClosed, RecordingError

CLIENT_PATH = Path(__file__).resolve().parents[2] / "rigs" / "jetson"  # where the client's package lies
_END_S = 3.0  # wall clock, that a client gets to end by itself


class StartedClient:
    """`python -m hil_companion NAME`; what it prints goes to `companion_NAME.log` in the run's folder."""

    def __init__(self, name: str, address: str, out: Path, settings: Mapping[str, Any], keys: Path | None) -> None:
        self.name = name
        self.log = out / f"companion_{name.replace(':', '_').replace('/', '_')}.log"
        argv = [sys.executable, "-m", "hil_companion", name, "--connect", address]
        for key, value in settings.items():
            argv += ["--set", f"{key}={json.dumps(value)}"]
        if keys is not None:
            argv += ["--key", str(keys / f"{name}.key"), "--bench-key", str(keys / "bench.pub")]
        path = os.pathsep.join(filter(None, (str(CLIENT_PATH), os.environ.get("PYTHONPATH", ""))))
        try:
            self._log: IO[bytes] = self.log.open("wb")
        except OSError as error:
            raise RecordingError(f"{self.log}: cannot be written ({error.strerror or error})") from error
        self._process = subprocess.Popen(
            argv,
            env=os.environ | {"PYTHONPATH": path},
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            start_new_session=True,  # Ctrl-C is the bench's: it tells its clients
        )

    def check(self) -> None:
        """LinkClosed if it has ended."""
        status = self._process.poll()
        if status is not None:
            said = self.log.read_text(errors="replace").strip().splitlines()[-1:] or ["nothing"]
            raise LinkClosed(
                f"companion {self.name}", f"ended with status {status}; it said: {said[0]}", cause="companion"
            )

    def close(self) -> None:
        """Let it end, and see that it does."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(_END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._log.close()


def known_clients() -> tuple[str, ...]:
    """Names that `hil companion` knows."""
    if str(CLIENT_PATH) not in sys.path:
        sys.path.append(str(CLIENT_PATH))
    from hil_companion.catalog import SHIPPED

    return tuple(SHIPPED)


def unknown_clients(names: Iterable[str]) -> list[str]:
    """Of the names, those that are neither shipped nor MODULE:NAME of somebody's own."""
    return [name for name in names if name not in known_clients() and ":" not in name]
