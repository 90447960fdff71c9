"""Flying from a terminal: keys to sticks, and the terminal restored at the end."""

import os
import sys

import pytest

from firmware_bridge.manual.keyboard import KeyboardSticks, Terminal
from firmware_bridge.manual.sticks import NEUTRAL, ManualControlError, StickLost


class Typist:
    """Keys typed by the test, and the wall clock."""

    def __init__(self):
        self.now_ns = 0
        self.waiting = b""
        self.gone = False
        self.closed = False

    def read(self):
        if self.gone:
            raise OSError("end of input")
        data, self.waiting = self.waiting, b""
        return data

    def close(self):
        self.closed = True


@pytest.fixture
def typist():
    return Typist()


@pytest.fixture
def sticks(typist):
    return KeyboardSticks(
        typist,
        deflection=1.0,
        first_hold_s=0.5,
        repeat_hold_s=0.1,
        dead_man_s=10.0,
        clock_ns=lambda: typist.now_ns,
    )


def after(typist, sticks, seconds, keys=b""):
    typist.now_ns += round(seconds * 1e9)
    typist.waiting += keys
    return sticks.poll()


@pytest.mark.parametrize(
    ("keys", "stick", "value"),
    [
        (b"w", "throttle", 1.0),
        (b"S", "throttle", -1.0),
        (b"a", "yaw", -1.0),
        (b"d", "yaw", 1.0),
        (b"\x1b[A", "pitch", 1.0),
        (b"\x1b[B", "pitch", -1.0),
        (b"\x1b[C", "roll", 1.0),
        (b"\x1b[D", "roll", -1.0),
        (b"\x1bOA", "pitch", 1.0),
        (b"\x1b[1;2C", "roll", 1.0),  # with Shift
    ],
)
def test_keys_push_their_sticks(typist, sticks, keys, stick, value):
    assert after(typist, sticks, 0.0, keys).sticks == NEUTRAL._replace(**{stick: value})


def test_a_single_press_springs_back(typist, sticks):
    after(typist, sticks, 0.0, b"w")
    assert after(typist, sticks, 0.4).sticks.throttle == 1.0
    assert after(typist, sticks, 0.11).sticks == NEUTRAL


def test_a_held_key_holds_over_the_pause_before_it_repeats_and_lets_go_quickly_after(typist, sticks):
    after(typist, sticks, 0.0, b"w")
    assert after(typist, sticks, 0.45, b"w").sticks.throttle == 1.0
    for _ in range(30):
        assert after(typist, sticks, 0.03, b"w").sticks.throttle == 1.0
    assert after(typist, sticks, 0.09).sticks.throttle == 1.0
    assert after(typist, sticks, 0.02).sticks.throttle == 0.0


def test_the_other_direction_takes_over_and_space_centres(typist, sticks):
    after(typist, sticks, 0.0, b"w")
    assert after(typist, sticks, 0.1, b"s").sticks.throttle == -1.0
    assert after(typist, sticks, 0.1, b"d ").sticks == NEUTRAL


def test_the_deflection_is_the_configured_one(typist):
    half = KeyboardSticks(typist, deflection=0.25, clock_ns=lambda: typist.now_ns)
    assert after(typist, half, 0.0, b"w").sticks.throttle == 0.25
    for wrong in (0.0, 1.5, float("nan")):
        with pytest.raises(ManualControlError):
            KeyboardSticks(typist, deflection=wrong)


def test_any_key_holds_the_dead_man_switch_for_a_while_and_none_does_not(typist, sticks):
    assert not after(typist, sticks, 0.0).held
    assert after(typist, sticks, 0.0, b"q").held
    assert after(typist, sticks, 9.9).held
    assert after(typist, sticks, 0.05, b"q").held
    assert after(typist, sticks, 9.9).held
    assert not after(typist, sticks, 0.2).held


def test_escape_lets_go_at_the_next_poll(typist, sticks):
    after(typist, sticks, 0.0, b"w")
    after(typist, sticks, 0.01, b"\x1b")  # may still become an arrow
    state = after(typist, sticks, 0.01)
    assert not state.held
    assert state.sticks == NEUTRAL


def test_escape_followed_by_another_key_is_escape_and_that_key(typist, sticks):
    after(typist, sticks, 0.0, b"w")
    state = after(typist, sticks, 0.01, b"\x1bd")
    assert state.sticks == NEUTRAL._replace(yaw=1.0)
    assert after(typist, sticks, 0.01, b"\x1b\x1b[A").sticks == NEUTRAL._replace(pitch=1.0)


@pytest.mark.parametrize("cut", [1, 2])
def test_an_arrow_that_comes_in_pieces_is_an_arrow(typist, sticks, cut):
    arrow = b"\x1b[A"
    after(typist, sticks, 0.0, arrow[:cut])
    state = after(typist, sticks, 0.01, arrow[cut:])
    assert state.sticks.pitch == 1.0
    assert state.held


def test_digits_are_buttons_for_a_moment(typist, sticks):
    assert after(typist, sticks, 0.0, b"0").pressed == frozenset()
    assert after(typist, sticks, 0.0, b"3").pressed == {3}
    assert after(typist, sticks, 0.2).pressed == frozenset()


def test_bytes_that_are_no_keys_are_ignored(typist, sticks):
    for data in (bytes(range(256)), b"\x1b[" + b"9" * 500, b"\xff" * 100, b"\x1b[200~"):
        after(typist, sticks, 0.01, data)
    for _ in range(3):
        state = after(typist, sticks, 60.0)
    assert state.sticks == NEUTRAL
    assert not state.held


def test_a_terminal_that_is_gone_is_a_loss(typist, sticks):
    typist.gone = True
    with pytest.raises(StickLost, match="terminal is gone"):
        sticks.poll()
    sticks.close()
    assert typist.closed


# -- a real terminal --------------------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_a_real_terminal_gives_keys_at_once_and_is_put_back():
    import pty
    import termios

    far, near = pty.openpty()
    try:
        before = termios.tcgetattr(near)
        with Terminal(near) as terminal:
            assert terminal.read() == b""
            assert termios.tcgetattr(near)[3] & (termios.ICANON | termios.ECHO) == 0
            assert termios.tcgetattr(near)[3] & termios.ISIG  # Ctrl-C still works
            os.write(far, b"w")  # no return key
            got = b""
            while not got:
                got = terminal.read()
            assert got == b"w"
        assert termios.tcgetattr(near) == before
        terminal.close()
        with pytest.raises(OSError, match="closed"):
            terminal.read()
    finally:
        os.close(near)
        os.close(far)


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_a_file_is_refused_as_terminal_and_the_end_of_a_terminal_is_an_error():
    import pty

    near, far = os.pipe()
    os.close(far)
    with pytest.raises(ManualControlError, match="not a terminal"):
        Terminal(near)
    os.close(near)
    far, near = pty.openpty()
    terminal = Terminal(near)
    os.close(far)
    with pytest.raises(OSError):  # noqa: PT011 (the message is the system's)
        terminal.read()
    terminal.close()
    os.close(near)
