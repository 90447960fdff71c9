"""The options of a client: what it asks the bench for and how it connects."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Sequence

from hil_companion.errors import OptionError
from hil_companion.link.connection import Keys, PathLike
from hil_companion.link.protocol import MAX_CREDIT

MAX_MESSAGE_BYTES = 256 << 20
DEFAULT_WAIT_S = 30.0
MAX_PATTERN = 128  # characters
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,64}\Z")


@dataclass(frozen=True)
class ClientOptions:
    """Keyword arguments of `Client.connect`, checked. Raises OptionError."""

    name: str  # under which the bench knows this client
    topics: Sequence[str] = ("*",)  # shell patterns of the topics to receive
    control: bool = False  # ask for permission to command
    hold: bool = False  # send every desired state with `hold`: the bench does not extrapolate it
    credit: int = 1  # frames that may be on the way at once
    shared_memory: bool = True  # receive arrays by shared memory where the bench runs on this machine
    key: PathLike | None = None  # file with this client's secret key
    bench_key: PathLike | None = None  # file with the bench's public key
    wait_s: float = DEFAULT_WAIT_S  # timeout for the bench's answer
    max_message_bytes: int = MAX_MESSAGE_BYTES

    def __post_init__(self) -> None:
        if not _NAME.match(self.name):
            raise OptionError(f"name {self.name!r}: 1 to 64 of letters, digits, _ . - are needed")
        if type(self.credit) is not int or not 1 <= self.credit <= MAX_CREDIT:
            raise OptionError(f"credit {self.credit!r}: 1 to {MAX_CREDIT} is needed")
        patterns = self.topics
        if isinstance(patterns, str) or not patterns or not all(_is_pattern(pattern) for pattern in patterns):
            raise OptionError(f"topics {patterns!r}: a list of patterns is needed, such as ['front/*', 'imu']")
        if (self.key is None) != (self.bench_key is None):
            raise OptionError("key and bench_key go together: give both or neither")

    def keys(self) -> Keys | None:
        """Read the key files; None for a connection without keys. Raises OptionError."""
        return None if self.key is None or self.bench_key is None else Keys(self.key, self.bench_key)


def _is_pattern(pattern: object) -> bool:
    return isinstance(pattern, str) and 0 < len(pattern) <= MAX_PATTERN
