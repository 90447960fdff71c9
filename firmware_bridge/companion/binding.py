"""Where a bench socket listens: TCP, or a file of the user who runs the bench, which nobody else can open."""

from __future__ import annotations

import errno
import os
import socket
import tempfile
from contextlib import suppress
from pathlib import Path

import zmq

from hil.signals.errors import PortBusy, PortNotFound

_IPC = "ipc://"


class Binding:
    """A bound socket's address. `ipc://*` is a file in a new folder of its own."""

    def __init__(self, s: zmq.Socket[bytes], address: str, any_free: str) -> None:
        """`any_free`: the setting by which the bench takes any free port. PortBusy, PortNotFound."""
        self._folder: Path | None = None
        self._file: Path | None = None
        if address == f"{_IPC}*":
            try:
                self._folder = Path(tempfile.mkdtemp(prefix="hil-companion-")).absolute()
            except OSError as error:
                text = f"cannot be had in {tempfile.gettempdir()} ({error.strerror or error})"
                raise PortNotFound("a socket's file", text) from error
            address = f"{_IPC}{self._folder / 'socket'}"
        busy = PortBusy(
            address, f"another program listens there (a second bench?); --set {any_free} takes any free one"
        )
        try:
            if address.startswith(_IPC) and _somebody_listens(address.removeprefix(_IPC)):
                raise busy
            try:
                s.bind(address)
            except zmq.ZMQError as error:
                if error.errno == errno.EADDRINUSE:
                    raise busy from error
                raise PortNotFound(address, f"cannot be listened on ({error.strerror})") from error
            if address.startswith(_IPC):
                self._file = Path(address.removeprefix(_IPC))
                with suppress(OSError):  # an abstract name has no file
                    self._file.chmod(0o600)
        except BaseException:
            self.remove()
            raise
        self.endpoint = s.getsockopt_string(zmq.LAST_ENDPOINT)

    def remove(self) -> None:
        """Take away what ZeroMQ leaves: while the socket still listens, no other bench can have taken the path over."""
        with suppress(OSError):
            if self._file is not None:
                self._file.unlink()
        with suppress(OSError):
            if self._folder is not None:
                self._folder.rmdir()


def _somebody_listens(path: str) -> bool:
    """ZeroMQ would take the path of a living listener away."""
    if not os.path.exists(path):
        return False
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe, suppress(OSError):
        probe.settimeout(0.2)
        probe.connect(path)
        return True
    return False
