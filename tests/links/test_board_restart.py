"""A board that has flown since its boot is restarted before the next flight, over a pseudo-terminal."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable

import pytest
from rich.console import Console

from firmware_bridge.links.autopilot_link import LinkCaps, LinkTimeouts
from firmware_bridge.links.px4 import hitl_setup
from firmware_bridge.links.px4.free_running import FreeRunningLink
from firmware_bridge.mock_pixhawk.estimate.sensors import ACCEL
from firmware_bridge.mock_pixhawk.ids import Result
from firmware_bridge.mock_pixhawk.services.commands import Commands
from firmware_bridge.mock_pixhawk.vehicle import Home
from firmware_bridge.transports.serial import SerialTransport
from hil.apps.devices.timing_test import check_timing
from signals.errors import HandshakeError
from tests.worlds.hitl_board import HitlBoard
from tests.worlds.patience import PATIENT

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")

CAPS = LinkCaps("px4_hitl", lockstep=False, deterministic=False, boot_sensors=0)
HOME = Home(47.0, 8.0, 400.0, 0.0, 0.0, 0.0)


def open_link(far: HitlBoard) -> list[tuple[str, str]]:
    """Open and close a link to the board; return what it said."""
    said: list[tuple[str, str]] = []
    link = FreeRunningLink(
        SerialTransport(far.port),
        CAPS,
        motors=4,
        period_ns=4_000_000,
        timeouts=PATIENT,
        say=lambda kind, text: said.append((kind, text)),
    )
    try:
        link.open()
    finally:
        link.close()
    return said


def test_a_fresh_board_is_not_restarted(board: Callable[..., HitlBoard]) -> None:
    far = board()
    assert open_link(far) == []
    assert far.mock.boots == 1


@pytest.mark.parametrize("left_armed", [False, True])
def test_a_board_that_has_flown_is_restarted(board: Callable[..., HitlBoard], *, left_armed: bool) -> None:
    far = board()
    far.mock.vehicle.home = HOME
    far.mock.vehicle.armed = left_armed
    said = open_link(far)
    assert far.mock.boots == 2
    assert far.mock.vehicle.home is None
    assert [kind for kind, _ in said] == ["restart", "restart"]
    assert "has flown since it was started" in said[0][1]
    assert "has restarted" in said[1][1]


def test_a_board_that_cannot_be_restarted_ends_the_run_before_take_off(
    board: Callable[..., HitlBoard], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Commands, "_reboot_shutdown", lambda *_: Result.UNSUPPORTED)
    far = board()
    far.mock.vehicle.home = HOME
    with pytest.raises(HandshakeError, match=r"MAV_RESULT_UNSUPPORTED\. Restart it \(unplug it") as caught:
        open_link(far)
    assert caught.value.cause == "restart"


def test_a_board_that_is_not_in_hitl_is_never_restarted(
    board: Callable[..., HitlBoard], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hitl_setup, "_LISTEN_S", 0.3)
    far = board(params=["SYS_HITL=0"])
    far.mock.vehicle.home = HOME
    with pytest.raises(HandshakeError, match="SYS_HITL is 0"):
        open_link(far)
    assert far.mock.boots == 1


def test_a_silent_port_is_named_before_the_limit(board: Callable[..., HitlBoard]) -> None:
    far = board(mute=["all"])
    said: list[tuple[str, str]] = []
    link = FreeRunningLink(
        SerialTransport(far.port),
        CAPS,
        period_ns=4_000_000,
        timeouts=LinkTimeouts(connect_s=2.0),
        say=lambda kind, text: said.append((kind, text)),
    )
    with pytest.raises(HandshakeError, match="no heartbeat within 2 s"):
        link.open()
    assert [kind for kind, _ in said] == ["waiting"]
    assert f"on {far.port} for 1.5 s (0 other messages and 0 bytes" in said[0][1]


def test_the_timing_test_feeds_nothing_to_the_estimator(board: Callable[..., HitlBoard]) -> None:
    far, out = board(), io.StringIO()
    good = check_timing(Console(file=out, width=300), far.port, baud=921_600, seconds=1.5)
    text = out.getvalue()
    assert far.wait_for(lambda: far.mock.steps > 0)
    assert far.mock.firmware.sensors.last_us[ACCEL] is None
    assert "samples" in text
    assert "commands" in text
    assert ("yes" in text) == good
    assert good or "warning" in text or "error" in text
