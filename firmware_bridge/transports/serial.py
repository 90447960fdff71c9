"""A serial port: a USB or UART flight controller, or the far end of a pseudo-terminal.

pyserial opens and configures it (raw, 8 data bits, no parity, 1 stop bit, no flow control, locked for this process);
reads and writes then use the descriptor directly, because pyserial's own read costs two more system calls.
"""

from __future__ import annotations

import errno
import os
import stat
from typing import Any, NamedTuple

import serial
from serial.tools import list_ports

from firmware_bridge.transports.fd_stream import FdStream, StreamTransport
from signals.errors import LinkError, PortBusy, PortNotFound

# PX4 ignores HIL messages on links slower than 5000 B/s, so 57600 baud is too slow; its docs use this value.
DEFAULT_BAUD = 921600


def serial_ports() -> list[str]:
    """Return the device paths of this machine's serial ports, sorted."""
    return sorted(port.device for port in list_ports.comports())


def check_port(path: str) -> None:
    """Raise the error of `SerialTransport.open` for a path that is not a serial port or may not be used.

    The port is not opened: that could reset a board, or hang up a pseudo-terminal.
    """
    if os.name != "posix":
        return
    try:
        status = os.stat(path)
    except OSError as error:
        raise _refusal(path, error) from error
    subsystem = f"/sys/dev/char/{os.major(status.st_rdev)}:{os.minor(status.st_rdev)}/subsystem"
    if not stat.S_ISCHR(status.st_mode) or os.path.basename(os.path.realpath(subsystem)) not in ("tty", "subsystem"):
        raise _refusal(path, OSError(errno.ENOTTY, "not a serial device"))
    if not os.access(path, os.R_OK | os.W_OK):
        raise _refusal(path, OSError(errno.EACCES, os.strerror(errno.EACCES)))


class _UsbIdentity(NamedTuple):
    """The identity of a USB device, independent of the path of its port."""

    vid: int
    pid: int
    serial_number: str
    interface: str | None

    def path(self) -> str | None:
        """Return its present path, or None if it is not plugged in."""
        return next((port.device for port in list_ports.comports() if _identity_of(port) == self), None)


def _identity_of(port: Any) -> _UsbIdentity | None:
    if port.vid is None or not port.serial_number:
        return None
    return _UsbIdentity(port.vid, port.pid, port.serial_number, port.interface)


def _usb_identity(path: str) -> _UsbIdentity | None:
    return next((_identity_of(port) for port in list_ports.comports() if port.device == path), None)


class SerialTransport(StreamTransport):
    """The serial port at `path`, held exclusively while open.

    With `follow`, `open` finds a USB device that was opened before by its USB identity: a board that was unplugged
    while its port was open comes back under another path.
    """

    def __init__(self, path: str, *, baud: int = DEFAULT_BAUD, follow: bool = False) -> None:
        self._path = path
        self._baud = baud
        self._follow = follow
        self._identity: _UsbIdentity | None = None
        self._port: serial.Serial | None = None

    @property
    def name(self) -> str:
        return self._path

    def open(self) -> None:
        """Open and configure.

        PortNotFound (with the ports there are), PortBusy, or LinkError (not a serial port).
        """
        if self._identity is not None:
            self._path = self._identity.path() or self._path
        try:
            self._port = serial.Serial(
                self._path,
                self._baud,
                bytesize=serial.EIGHTBITS,
                parity=serial.PARITY_NONE,
                stopbits=serial.STOPBITS_ONE,
                timeout=0,
                exclusive=True,
            )
        except serial.SerialException as error:
            raise _refusal(self._path, error) from error
        except (ValueError, OverflowError) as error:
            raise LinkError(self._path, f"cannot be set to {self._baud} baud: {error}") from error
        if self._follow:
            self._identity = _usb_identity(self._path) or self._identity
        self._stream = FdStream(self._port.fileno(), self._path)

    def close(self) -> None:
        port, self._port, self._stream = self._port, None, None
        if port is not None:
            port.close()

    def fileno(self) -> int | None:
        return None if self._port is None else self._port.fileno()


def _refusal(path: str, error: OSError) -> LinkError:
    """Return the named error for a port that cannot be opened."""
    ports = ", ".join(serial_ports()) or "none"
    if error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return PortNotFound(
            path, f"there is no such serial port. Ports here: {ports}. Is it plugged in? See `hil devices`."
        )
    if error.errno in (errno.EAGAIN, errno.EBUSY):
        return PortBusy(path, "another program holds this port; close it (QGroundControl, ModemManager, another run?)")
    if error.errno in (errno.EACCES, errno.EPERM):
        return LinkError(
            path,
            "no permission to open this port; on Linux, add yourself to the group `dialout` and log in again",
        )
    return LinkError(path, f"is not a serial port ({error}). Ports here: {ports}.")
