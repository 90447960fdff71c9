"""Key files as `hil keys` makes them: one key of 40 Z85 characters on a line of its own, comment lines about it.

A Z85 key may itself begin with '#', so a line counts as a key by its length and characters, not by how it begins.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Union

import zmq

from hil_companion.errors import OptionError

KEY_CHARACTERS = 40
_Z85 = frozenset("0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ.-:+=^!/*?&<>()[]{}@%$#")

PathLike = Union[str, Path]


def read_key(path: PathLike, *, secret: bool) -> bytes:
    """The key in a file. A secret that others can read is refused, as ssh does. OptionError."""
    try:
        lines = Path(path).read_text(encoding="ascii").splitlines()
        mode = os.stat(path).st_mode
    except (OSError, UnicodeDecodeError) as error:
        raise OptionError(f"{path}: no key can be read there ({getattr(error, 'strerror', None) or error})") from error
    if secret and os.name == "posix" and mode & 0o077:
        raise OptionError(f"{path}: a secret key that others can read; chmod 600 {path}")
    found = [line.strip() for line in lines if len(line.strip()) == KEY_CHARACTERS and _Z85.issuperset(line.strip())]
    if len(found) != 1:
        raise OptionError(f"{path}: one key of {KEY_CHARACTERS} characters is needed, {len(found)} found")
    return found[0].encode("ascii")


class Keys:
    """What a client needs to speak to a bench that asks for keys."""

    def __init__(self, key: PathLike, bench_key: PathLike) -> None:
        self.secret = read_key(key, secret=True)
        self.bench_public = read_key(bench_key, secret=False)
        try:
            self.public: bytes = zmq.curve_public(self.secret)
        except (zmq.ZMQError, ValueError) as error:
            raise OptionError(f"{key}: not a secret key ({error})") from error

    def apply(self, socket: zmq.Socket[Any]) -> None:
        socket.curve_secretkey = self.secret
        socket.curve_publickey = self.public
        socket.curve_serverkey = self.bench_public
