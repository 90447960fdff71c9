"""CURVE key pairs of the bench and its clients: makes and reads them, and lists the authorized clients.

A folder holds `bench.key` and `bench.pub`, and `NAME.key` and `NAME.pub` of each client. A file is a comment line and
the key as 40 characters of Z85 (ZeroMQ RFC 32). A secret file is refused if other users may read it. A client is
authorized if its public key lies in the bench's folder; removing NAME.pub revokes it. The client's own folder needs
only its key and `bench.pub`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import zmq
from zmq.utils import z85

from signals.errors import ConfigError, Problem

BENCH = "bench"
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,64}")
_HINT = "make keys: hil keys DIR NAME"


@dataclass(frozen=True)
class KeyPair:
    public: bytes
    secret: bytes


def make_keys(folder: Path, names: Sequence[str] = ()) -> list[Path]:
    """Make key pairs for the bench, if it has none, and for `names`. Return the new files. Overwrites nothing."""
    problems = [
        Problem(name, "is not a valid client name", "use 1 to 64 of A-Z a-z 0-9 _ . -") for name in names if _bad(name)
    ]
    if len(set(names)) != len(names):
        problems.append(Problem(str(folder), "a name is given twice"))
    wanted = [name for name in names if not _bad(name)]
    has_bench_keys = _file(folder, BENCH, "key").exists() and _file(folder, BENCH, "pub").exists()
    if not has_bench_keys:
        wanted.insert(0, BENCH)
    elif not names:
        problems.append(Problem(str(folder), "has the bench's keys already", "name a client, or remove the files"))
    for name in wanted:
        problems += [
            Problem(str(file), "exists already", "remove it first; programs that use it will then need the new key")
            for file in (_file(folder, name, "key"), _file(folder, name, "pub"))
            if file.exists()
        ]
    if problems:
        raise ConfigError(problems)
    made = []
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        for name in wanted:
            public, secret = zmq.curve_keypair()
            made.append(_write(_file(folder, name, "key"), f"# secret key of {name}: keep it to yourself", secret))
            made.append(_write(_file(folder, name, "pub"), f"# public key of {name}", public, mode=0o644))
    except OSError as error:
        raise ConfigError.at(str(folder), f"keys cannot be written ({error.strerror or error})") from error
    return made


def read_bench_keys(folder: Path) -> KeyPair:
    """Read the bench's own pair. ConfigError if it is missing, damaged, or readable by others."""
    return read_pair(folder, BENCH)


def read_pair(folder: Path, name: str) -> KeyPair:
    """Read the pair of `name`. ConfigError if it is missing, damaged, or its secret readable by others."""
    file = _file(folder, name, "key")
    secret = _read(file)
    if file.stat().st_mode & 0o077:
        raise ConfigError.at(str(file), "can be read by other users", f"chmod 600 {file}")
    public = _read(_file(folder, name, "pub"))
    if zmq.curve_public(secret) != public:
        raise ConfigError.at(str(file), f"does not belong to {name}.pub", _HINT)
    return KeyPair(public, secret)


def read_allowed(folder: Path) -> dict[bytes, str]:
    """Return public key -> name of every client whose .pub lies in the folder."""
    allowed = {_read(file): file.stem for file in sorted(folder.glob("*.pub")) if file.stem != BENCH}
    if not allowed:
        raise ConfigError.at(str(folder), "holds no client's public key: no client could connect", _HINT)
    return allowed


def _bad(name: str) -> bool:
    return not _NAME.fullmatch(name) or name == BENCH or name.startswith(".")


def _file(folder: Path, name: str, kind: str) -> Path:
    return folder / f"{name}.{kind}"


def _write(file: Path, comment: str, key: bytes, *, mode: int = 0o600) -> Path:
    descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    try:
        with os.fdopen(descriptor, "w", encoding="ascii") as out:
            out.write(f"{comment}\n{key.decode('ascii')}\n")
    except OSError:
        with suppress(OSError):
            file.unlink()
        raise
    return file


def _read(file: Path) -> bytes:
    try:
        lines = file.read_text(encoding="ascii").splitlines()
    except FileNotFoundError:
        raise ConfigError.at(str(file), "is missing", _HINT) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError.at(str(file), f"cannot be read ({error})", _HINT) from error
    keys = [line.strip() for line in lines if line.strip() and not line.startswith("# ")]
    with suppress(ValueError, KeyError):
        if len(keys) == 1 and len(keys[0]) == 40 and len(z85.decode(keys[0].encode("ascii"))) == 32:
            return keys[0].encode("ascii")
    raise ConfigError.at(str(file), "holds no key: expected one line of 40 characters (Z85)", _HINT)
