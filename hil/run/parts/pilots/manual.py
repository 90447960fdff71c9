"""The section `manual`: a gamepad or the keyboard flies the vehicle by MANUAL_CONTROL."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from firmware_bridge.manual.hid_gamepad import HidGamepad, open_gamepad
from firmware_bridge.manual.keyboard import KeyboardSticks, Terminal
from firmware_bridge.manual.manual_control import (
    Control,
    ManualControlSource,
    buttons_of,
)
from firmware_bridge.manual.sticks import StickLost
from hil.config import Bench
from hil.run.part import Part, RunContext
from signals.samples import TruthState


class ManualPart(Part):
    """Manual control from one source of sticks. `make_source` opens it, when the run is built."""

    name = "manual"
    _run: RunContext  # from `build` on

    def __init__(self, make_source: Callable[[], ManualControlSource]) -> None:
        self._make_source = make_source
        self._source: ManualControlSource | None = None

    @property
    def flying(self) -> bool:
        """Return True while the sticks fly the vehicle."""
        return self._source is not None and self._source.control is Control.FLYING

    def build(self, run: RunContext) -> None:
        self._run, self._source = run, self._make_source()

    def command_sources(self) -> list[ManualControlSource]:
        return [] if self._source is None else [self._source]

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [self._record_events]

    def _record_events(self, truth: TruthState) -> None:  # noqa: ARG002 (called once a tick)
        assert self._source is not None
        for event in self._source.take_events():
            self._run.recorder.event(*event)

    def repeatable(self) -> bool:
        return self._source is None or self._source.sent == 0

    def close(self) -> None:
        if self._source is not None:
            self._source.close()


def manual_settings(bench: Bench) -> dict[str, Any]:
    """Return the settings that every source of MANUAL_CONTROL takes from a bench."""
    config = bench.config
    return {
        "modes": bench.firmware.manual_modes,
        "rate_hz": config.manual.rate_hz,
        "neutral_s": config.manual.neutral_s,
        "target_sysid": None,
    }


def mission_mode(bench: Bench) -> tuple[float, float]:
    """Return the main and sub mode that hand the vehicle back to its mission."""
    number = bench.firmware.modes["MISSION"]
    return float(number.main), float(number.sub)


def _open_device(bench: Bench) -> ManualControlSource:
    """Open the device that the bench names. Without a gamepad the run starts, and opens one when it is plugged in.

    Raises ManualControlError if stdin is not a terminal, or the gamepad lacks axes or buttons that are needed.
    """
    config = bench.config
    settings = manual_settings(bench)
    if config.manual.device == "keyboard":
        return ManualControlSource(KeyboardSticks(Terminal()), **settings)

    def reopen() -> HidGamepad:
        return open_gamepad(needs_dead_man=config.manual.needs_dead_man)

    try:
        pad = reopen()
    except StickLost:
        return ManualControlSource(None, reopen=reopen, **settings)
    return ManualControlSource(pad, reopen=reopen, buttons=buttons_of(pad.mapping), **settings)


def make(bench: Bench) -> Part:
    return ManualPart(lambda: _open_device(bench))
