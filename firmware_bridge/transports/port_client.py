"""The program that is connected to a TCP port of this machine, from Linux's tables in /proc."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

_TCP = Path("/proc/net/tcp")
_LOOPBACK = "0100007F"  # 127.0.0.1, as the table has it
_ESTABLISHED = "01"


def other_client(port: int) -> str | None:
    """Return name and process id of another program that is connected to 127.0.0.1:`port`.

    None: there is none, it belongs to another user, or the system has no such table.
    """
    inodes = {f"socket:[{inode}]" for inode in _clients(port)}
    if not inodes:
        return None
    for process in Path("/proc").iterdir():
        if process.name.isdigit() and int(process.name) != os.getpid():
            with suppress(OSError):  # it has ended, or is another user's
                if any(os.readlink(file) in inodes for file in (process / "fd").iterdir()):
                    return f"{_name(process)} (process {process.name})"
    return None


def _clients(port: int) -> list[str]:
    """Return the inodes of the sockets that are connected to the port."""
    remote = f"{_LOOPBACK}:{port:04X}"
    with suppress(OSError):
        rows = [line.split() for line in _TCP.read_text().splitlines()[1:]]
        return [row[9] for row in rows if row[2] == remote and row[3] == _ESTABLISHED]
    return []


def _name(process: Path) -> str:
    """Return the name of a program; of a script, that of its file."""
    words = (process / "cmdline").read_bytes().decode(errors="replace").split("\0")
    script = next((word for word in words[1:] if word and not word.startswith("-")), "")
    name = Path(words[0]).name
    return Path(script).name if name.startswith("python") and script.endswith(".py") else name
