"""Files that clients have the server write, below one folder."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path

from hil.apps.airsim.rpc.methods import RpcError


class ClientFiles:
    """Files of one server. `folder` returns the folder that holds them all; a name of a client counts from there."""

    def __init__(self, folder: Callable[[], Path]) -> None:
        self.folder = folder

    def place(self, name: str) -> Path:
        """Return the path of a file that may be written: a new one, or one that is neither a link nor a device.

        Raises RpcError for any other.
        """
        shown = name[:200]
        try:
            root = self.folder().resolve()
            path = root / name
            path = path.parent.resolve() / path.name
            if not path.parent.is_relative_to(root):
                raise RpcError(
                    f"clients have files written below {root} alone, and '{shown}' is elsewhere; give a name without a "
                    "folder, or start `hil airsim --files FOLDER`"
                )
            if path.parent != root and not path.parent.is_dir():
                raise RpcError(f"'{shown}' cannot be written: there is no folder {path.parent}")
            state = path.lstat()
        except FileNotFoundError:
            return path
        except (OSError, ValueError) as error:  # a name with a zero
            raise RpcError(f"'{shown}' cannot be written: {getattr(error, 'strerror', '') or error}") from None
        if not stat.S_ISREG(state.st_mode) or state.st_nlink > 1:
            raise RpcError(f"'{shown}' cannot be written: it is a link, a folder or a device; remove it first")
        return path

    def write(self, name: str, data: bytes) -> None:
        """Write a file, in place of one that is there. Raises RpcError."""
        path = self.place(name)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            # Neither follows a link nor waits for a reader, whatever has come there since.
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
            with os.fdopen(os.open(path, flags, 0o644), "wb") as file:
                file.write(data)
        except OSError as error:
            raise RpcError(f"'{name[:200]}' cannot be written: {error.strerror or error}") from None
