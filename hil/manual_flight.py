"""From a bench's `manual` section to the sticks that fly it."""

from __future__ import annotations

from typing import Any

from firmware_bridge.manual.hid_gamepad import HidGamepad, open_gamepad
from firmware_bridge.manual.keyboard import KeyboardSticks, Terminal
from firmware_bridge.manual.manual_control import ARDUCOPTER_MODES, PX4_MODES, ManualControlSource, buttons_of
from firmware_bridge.manual.sticks import StickLost
from hil.config import BenchConfig
from hil.dashboard.page_sticks import PageSticks, page_buttons

_MISSION = "mission"  # back to the mission that was taken over from
_PX4_MISSION, _COPTER_AUTO = (4.0, 4.0), (3.0, 0.0)


def make_page_manual(config: BenchConfig, sticks: PageSticks) -> ManualControlSource:
    """The source of MANUAL_CONTROL for the sticks of the dashboard. Silent until somebody holds their switch."""
    copter = config.autopilot.kind.startswith("ardupilot")
    modes = ARDUCOPTER_MODES | {_MISSION: _COPTER_AUTO} if copter else PX4_MODES | {_MISSION: _PX4_MISSION}
    manual = config.manual
    return ManualControlSource(
        sticks,
        buttons=page_buttons(modes),
        modes=modes,
        rate_hz=manual.rate_hz,
        neutral_s=manual.neutral_s,
        target_sysid=None,
    )


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
