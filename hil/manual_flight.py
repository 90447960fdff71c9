"""From a bench's `manual` section to the sticks that fly it."""

from __future__ import annotations

from typing import Any

from firmware_bridge.manual.hid_gamepad import HidGamepad, open_gamepad
from firmware_bridge.manual.keyboard import KeyboardSticks, Terminal
from firmware_bridge.manual.manual_control import ARDUCOPTER_MODES, PX4_MODES, ManualControlSource, buttons_of
from firmware_bridge.manual.sticks import StickLost
from hil.config import BenchConfig


def make_manual(config: BenchConfig) -> ManualControlSource:
    """The source of MANUAL_CONTROL. A gamepad that is not there yet is waited for in flight.

    ManualControlError: the keyboard is no terminal, or the gamepad cannot be flown with.
    """
    manual = config.manual
    modes = ARDUCOPTER_MODES if config.autopilot.kind.startswith("ardupilot") else PX4_MODES
    settings: dict[str, Any] = {
        "modes": modes,
        "rate_hz": manual.rate_hz,
        "neutral_s": manual.neutral_s,
        "target_sysid": None,
    }
    if manual.device == "keyboard":
        return ManualControlSource(KeyboardSticks(Terminal()), **settings)

    def reopen() -> HidGamepad:
        return open_gamepad(needs_dead_man=manual.needs_dead_man)

    try:
        pad = reopen()
    except StickLost:
        return ManualControlSource(None, reopen=reopen, **settings)
    return ManualControlSource(pad, reopen=reopen, buttons=buttons_of(pad.mapping), **settings)
