"""Settings of a companion link: addresses, arrangement, keys and limits. Validated when made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from firmware_bridge.transports.loopback_host import is_loopback
from signals.errors import ConfigError, Problem

Arrangement = Literal["shared_memory", "one_port", "ports"]
_MAX_CLIENTS = 32


@dataclass(frozen=True)
class CompanionSettings:
    """Address, arrangement, keys and limits.

    `bind` is the port where clients join: ipc:// for shared memory, tcp:// for several ports, either for one port.
    With several ports, the sensors' ports are on the same host: any free ones, or `first_sensor_port`, +1, +2, ... in
    the order of the sensors' names, so that a firewall can be configured.
    """

    bind: str = "tcp://127.0.0.1:5570"
    arrangement: Arrangement = "one_port"
    keys: Path | None = None  # folder made by `hil keys`; required unless `bind` is a loopback address
    first_sensor_port: int | None = None
    max_clients: int = _MAX_CLIENTS
    max_message_bytes: int = 128 << 10  # largest part of a client's message; a larger one ends its connection
    ring_bytes: int = 64 << 20  # size of the ring buffer in shared memory

    def __post_init__(self) -> None:
        problems = []
        if self.arrangement not in get_args(Arrangement):
            problems.append(self._problem(f"arrangement {self.arrangement!r}", f"one of {get_args(Arrangement)}"))
        scheme = self.bind.partition("://")[0]
        wanted = "ipc" if self.arrangement == "shared_memory" else "tcp"
        if scheme not in ("tcp", "ipc") or (scheme != wanted and self.arrangement != "one_port"):
            problems.append(self._problem(f"bind {self.bind!r}", f"{self.arrangement} needs {wanted}://"))
        elif scheme == "tcp" and self.port is None:
            problems.append(self._problem(f"bind {self.bind!r}", "tcp://HOST:PORT, or tcp://HOST:* for any port"))
        elif scheme == "tcp" and not self.loopback and self.keys is None:
            problems.append(
                self._problem(f"bind {self.bind!r} can be reached from other machines", "make keys: hil keys DIR NAME")
            )
        for name, low, high in (
            ("max_clients", 1, _MAX_CLIENTS),
            ("max_message_bytes", 4096, 1 << 30),
            ("ring_bytes", 4096, 1 << 36),
        ):
            if not low <= getattr(self, name) <= high:
                problems.append(self._problem(f"{name} {getattr(self, name)!r}", f"within {low}..{high}"))
        if problems:
            raise ConfigError(problems)

    @staticmethod
    def _problem(message: str, hint: str) -> Problem:
        return Problem("companion", message, hint)

    @property
    def host(self) -> str:
        """The host of a tcp address, as it is written there."""
        return self.bind.partition("://")[2].rpartition(":")[0]

    @property
    def port(self) -> str | None:
        """The port of a tcp address, digits or '*'; None if it has none."""
        port = self.bind.rpartition(":")[2]
        return port if port == "*" or (port.isdigit() and int(port) < 65536) else None

    @property
    def loopback(self) -> bool:
        """True if only this machine can reach `bind`."""
        if self.bind.startswith("ipc://"):
            return True
        return is_loopback(self.host)
