"""Manual flight from a terminal: W A S D is the left stick (climb, yaw), the arrows are the right one (pitch, roll).

A terminal reports keys pressed but not released; a key that is held repeats. So a stick stays deflected for as long as
its key may still repeat, and then returns to the centre. Only one key repeats at a time: with two held, the first stick
returns. Any key renews the dead-man switch, and Escape releases it at once.
"""

from __future__ import annotations

import os
import select
import sys
import time
from collections.abc import Callable
from typing import Protocol

from firmware_bridge.manual.sticks import ManualControlError, StickLost, Sticks, StickState
from signals.time import NS_PER_S

# Keys -> (axis of Sticks, direction). Terminals send arrows in one of two forms.
_STICK_KEYS = {
    b"w": ("throttle", 1.0),
    b"s": ("throttle", -1.0),
    b"a": ("yaw", -1.0),
    b"d": ("yaw", 1.0),
    b"\x1b[A": ("pitch", 1.0),
    b"\x1b[B": ("pitch", -1.0),
    b"\x1b[C": ("roll", 1.0),
    b"\x1b[D": ("roll", -1.0),
    b"\x1bOA": ("pitch", 1.0),
    b"\x1bOB": ("pitch", -1.0),
    b"\x1bOC": ("roll", 1.0),
    b"\x1bOD": ("roll", -1.0),
}
_ESCAPE = b"\x1b"
_PRESS_NS = 120_000_000  # a digit key counts as a pressed button for so long


class Keys(Protocol):
    """A source of key presses."""

    def read(self) -> bytes:
        """Return the keys typed since the last call, b"" if none. OSError after the end of input."""
        ...

    def close(self) -> None: ...


class KeyboardSticks:
    """Stick positions from keys.

    `first_hold_s` covers the pause before a held key repeats, `repeat_hold_s` the pause between repeats. `deflection`
    is the stick position of a pressed key. `clock_ns` is wall time, as key presses are.
    """

    name = "keyboard"

    def __init__(
        self,
        keys: Keys,
        *,
        deflection: float = 0.5,
        first_hold_s: float = 0.55,
        repeat_hold_s: float = 0.12,
        dead_man_s: float = 10.0,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        if not 0.0 < deflection <= 1.0:
            raise ManualControlError(f"deflection {deflection} must be above 0 and at most 1")
        self._keys, self._clock_ns = keys, clock_ns
        self._deflection = deflection
        self._first_ns, self._repeat_ns = round(first_hold_s * NS_PER_S), round(repeat_hold_s * NS_PER_S)
        self._dead_man_ns = round(dead_man_s * NS_PER_S)
        self._axes: dict[str, tuple[float, int]] = {}  # axis -> (direction, until)
        self._buttons: dict[int, int] = {}  # button -> until
        self._dead_man_until_ns = 0
        self._pending = b""
        self._waited = False

    def poll(self) -> StickState | None:
        try:
            typed = self._keys.read()
        except OSError as error:
            raise StickLost(f"keyboard: the terminal is gone ({error}); start the run in a terminal") from error
        now_ns = self._clock_ns()
        for key in self._split(typed):
            self._press(key, now_ns)
        position = {axis: direction for axis, (direction, until) in self._axes.items() if now_ns < until}

        def value(axis: str) -> float:
            return position.get(axis, 0.0) * self._deflection

        return StickState(
            Sticks(value("pitch"), value("roll"), value("throttle"), value("yaw")),
            now_ns < self._dead_man_until_ns,
            frozenset(button for button, until in self._buttons.items() if now_ns < until),
        )

    def close(self) -> None:
        self._keys.close()

    def _press(self, key: bytes, now_ns: int) -> None:
        if key == _ESCAPE:
            self._axes.clear()
            self._dead_man_until_ns = now_ns
            return
        self._dead_man_until_ns = now_ns + self._dead_man_ns
        key = key.lower() if len(key) == 1 else key
        if key == b" ":
            self._axes.clear()
        elif key in _STICK_KEYS:
            axis, direction = _STICK_KEYS[key]
            before = self._axes.get(axis)
            repeats = before is not None and before[0] == direction and now_ns < before[1]
            hold_ns = self._repeat_ns if repeats else self._first_ns
            self._axes[axis] = (direction, now_ns + hold_ns)
        elif key.isdigit() and key != b"0":
            self._buttons[int(key)] = now_ns + _PRESS_NS

    def _split(self, typed: bytes) -> list[bytes]:
        """Split into single keys. An escape at the end may begin an arrow: it waits one poll for the rest."""
        data, self._pending = self._pending + typed, b""
        keys: list[bytes] = []
        at = 0
        while at < len(data):
            if data[at : at + 1] != _ESCAPE:
                keys.append(data[at : at + 1])
                at += 1
            elif data[at + 1 : at + 2] in (b"[", b"O"):
                end = at + 2
                while end < len(data) and not 0x40 <= data[end] <= 0x7E:
                    end += 1  # parameters, as of Shift+arrow
                if end >= len(data):
                    break
                keys.append(data[at : end + 1] if end == at + 2 else data[at : at + 2] + data[end : end + 1])
                at = end + 1
            elif at + 1 < len(data):
                keys.append(_ESCAPE)
                at += 1
            else:
                break
        rest = data[at:]
        if rest and (self._waited and not typed):
            keys.append(_ESCAPE)
            rest = b""
        self._pending, self._waited = rest[:16], bool(rest)
        return keys


class Terminal:
    """The program's terminal, with keys delivered at once and without echo. `close` restores its settings.

    Ctrl-C still ends the program.
    """

    def __init__(self, fd: int | None = None) -> None:
        try:
            import termios
            import tty
        except ImportError as error:
            raise ManualControlError("flying from the keyboard needs a POSIX terminal; use a gamepad") from error
        self._fd = sys.stdin.fileno() if fd is None else fd
        self._termios = termios
        try:
            self._before = termios.tcgetattr(self._fd)
            tty.setcbreak(self._fd, termios.TCSANOW)
        except termios.error as error:
            raise ManualControlError(
                "standard input is not a terminal: use a gamepad, or start the run in a terminal"
            ) from error
        self._open = True

    def read(self) -> bytes:
        if not self._open:
            raise OSError("closed")
        if not select.select([self._fd], [], [], 0.0)[0]:
            return b""
        data = os.read(self._fd, 1024)
        if not data:
            raise OSError("end of input")
        return data

    def close(self) -> None:
        if self._open:
            self._open = False
            # The terminal may be gone already.
            try:
                self._termios.tcsetattr(self._fd, self._termios.TCSANOW, self._before)
            except (OSError, self._termios.error):
                return

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
