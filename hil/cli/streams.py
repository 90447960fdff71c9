"""Standard streams that never end a command: what nobody can receive is left out.

A command's exit status is its result. A pipe whose reader has gone (`hil run | head -1`), a closed stream (`>&-`), a
full disk or a terminal that was closed change neither the status nor the work: from the first write that fails on, the
stream leads nowhere, for every library and every program started later. Of any reason but a reader that has gone,
standard error is told once.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import select
import sys
from typing import Any

_STREAMS = {"stdin": (0, os.O_RDONLY), "stdout": (1, os.O_WRONLY), "stderr": (2, os.O_WRONLY)}


class _Output(io.FileIO):
    """File descriptor of a standard stream, which leads nowhere once a write has failed."""

    broken = False

    def write(self, data: Any) -> int:
        """Write all of `data`, or nothing more for ever."""
        left = memoryview(data).cast("B")
        count = len(left)
        try:
            while left and not self.broken:
                written = super().write(left)
                if written is None:  # the other end has made the pipe non-blocking, and it is full
                    select.select([], [self], [])
                left = left[written or 0 :]
        except OSError as error:
            self.broken = True
            with contextlib.suppress(OSError):  # no descriptor is left
                _lead_nowhere(self.fileno(), os.O_WRONLY)
            if error.errno != errno.EPIPE and self.fileno() == _STREAMS["stdout"][0]:
                sys.stderr.write(f"warning: standard output is left out from here on ({error.strerror})\n")
        return count


def nobody_reads() -> bool:
    """Return True if the reader of standard output has gone. A command that only prints may end then."""
    output = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    if not isinstance(output, _Output):
        return False
    reader = select.poll()
    reader.register(output, 0)  # errors alone
    return output.broken or any(event & select.POLLERR for _, event in reader.poll(0))


def _lead_nowhere(fd: int, flags: int) -> None:
    nowhere = os.open(os.devnull, flags)
    if nowhere != fd:
        os.dup2(nowhere, fd)
        os.close(nowhere)


def keep_streams() -> None:
    """Replace the standard streams. A closed one leads nowhere: else the next file opened would take its number."""
    for name, (fd, flags) in _STREAMS.items():
        stream = getattr(sys, name)
        if stream is None:
            with contextlib.suppress(OSError):
                os.fstat(fd)
                continue  # something else has this number already
            _lead_nowhere(fd, flags)
        if name == "stdin":
            continue
        is_terminal = os.isatty(fd)
        kept = io.TextIOWrapper(
            io.BufferedWriter(_Output(fd, "w", closefd=False)),
            encoding="utf-8" if stream is None else stream.encoding,
            errors="backslashreplace",  # a name that is not UTF-8 can be printed
            line_buffering=is_terminal or name == "stderr",
            write_through=stream is not None and stream.write_through,
        )
        setattr(sys, name, kept)
