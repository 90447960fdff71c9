"""MAVLink message signing towards the autopilot (`autopilot.signing_key_file`)."""

from __future__ import annotations

from pathlib import Path

from firmware_bridge.codecs.signing import SigningKey
from firmware_bridge.router.signing import AutopilotSigning, SignedCommands, read_key
from hil.config import Bench
from hil.run.loop.scheduler import CommandSource
from hil.run.part import Part, RunContext
from hil.run.recorder.recorder import Recorder


class SigningPart(Part):
    name = "signing"

    def __init__(self, key_file: str) -> None:
        self._key_file = key_file
        self.autopilot_signing: AutopilotSigning | None = None  # also used by the router

    def build(self, run: RunContext) -> None:
        self.autopilot_signing = AutopilotSigning(signing_key(self._key_file, run.recorder))

    def wrap_commands(self, sources: list[CommandSource]) -> list[CommandSource]:
        assert self.autopilot_signing is not None
        return [SignedCommands(source, self.autopilot_signing) for source in sources]

    def repeatable(self) -> bool:
        return False  # signatures contain the wall-clock time


def signing_key(path: str, recorder: Recorder) -> SigningKey:
    """Read a key file, and record a warning about it."""
    key, warning = read_key(Path(path))
    if warning:
        recorder.event(0, "warning", warning)
    return key


def make(bench: Bench) -> Part:
    key_file = bench.config.autopilot.signing_key_file
    assert key_file is not None
    return SigningPart(key_file)
