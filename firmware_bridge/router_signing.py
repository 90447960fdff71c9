"""Signing at the router's two sides, and the key files.

Clients' side (`ClientSide`, router.signing_key_file): what clients say must be signed with this key, or it goes no
further; what the autopilot says unsigned is signed for them.
Autopilot's side (`AutopilotSide`, autopilot.signing_key_file): what the bench itself says is signed. What clients say
is signed anew only where the router has checked it, with another key; otherwise every frame stays as its sender made
it, signature included.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

from firmware_bridge.codecs.mavlink_frame import Frame, split_frames
from firmware_bridge.codecs.signing import (
    ACCEPTED_UNSIGNED,
    Check,
    Signer,
    SigningClock,
    SigningKey,
    Verifier,
    is_signed,
    matches,
    strip_signature,
)
from hil.signals.errors import ConfigError, Problem

# Link ids count up from 0 at clients and autopilots; these are unlikely to be anybody else's.
LINK_TO_CLIENTS = 201
LINK_TO_AUTOPILOT = 202

_READABLE_BY_OTHERS = 0o077


class KeyFile(NamedTuple):
    key: SigningKey
    warning: str  # "" if there is nothing to warn about


def read_key(path: Path) -> KeyFile:
    """The key in `path` (see `SigningKey.from_text`). ConfigError where there is none."""
    try:
        mode = path.stat().st_mode
        key = SigningKey.from_text(path.read_bytes())
    except OSError as error:
        raise ConfigError([Problem(str(path), f"this signing key cannot be read ({error.strerror})")]) from error
    except ValueError as error:
        hint = "64 hexadecimal digits, 32 raw bytes, or a passphrase"
        raise ConfigError([Problem(str(path), f"holds no signing key: {error}", hint)]) from error
    warning = ""
    if mode & _READABLE_BY_OTHERS:
        warning = f"{path}: others on this machine can read this signing key; chmod 600 it"
    return KeyFile(key, warning)


class ClientSide:
    """Who may speak, and how clients know that it is the bench that speaks."""

    def __init__(self, key: SigningKey, clock: SigningClock | None = None) -> None:
        clock = clock if clock is not None else SigningClock()
        self.key = key
        self._verifier = Verifier(key, clock)
        self._signer = Signer(key, LINK_TO_CLIENTS, clock)

    def check(self, frame: Frame) -> Check:
        """GOOD: it may go on."""
        found = self._verifier.check(frame)
        if found is Check.UNSIGNED and frame.msgid in ACCEPTED_UNSIGNED:
            return Check.GOOD
        return found

    def sign(self, raw: bytes) -> bytes:
        """For clients: signed, unless the autopilot has done so itself."""
        return raw if is_signed(raw) else self._signer.sign(raw)


class AutopilotSide:
    """What the bench says to an autopilot that wants signatures."""

    def __init__(self, key: SigningKey, clock: SigningClock | None = None) -> None:
        clock = clock if clock is not None else SigningClock()
        self.key = key
        self._verifier = Verifier(key, clock)
        self._signer = Signer(key, LINK_TO_AUTOPILOT, clock)

    def heard(self, frames: Sequence[Frame]) -> None:
        """The autopilot's clock may be ahead (of a simulated GPS, say): follow it, or be refused as too old."""
        for frame in frames:
            if is_signed(frame.raw):
                self._verifier.check(frame)

    def sign(self, raw: bytes) -> bytes:
        return self._signer.sign(raw)

    def sign_all(self, data: bytes) -> bytes:
        """Whole frames one behind the other, each signed."""
        return b"".join(self._signer.sign(frame) for _, frame in split_frames(data))


class Commands(Protocol):
    """Whatever of the bench talks to the autopilot."""

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes: ...


class SignedCommands:
    """The bench's own words, such as its ground station's, signed."""

    def __init__(self, source: Commands, side: AutopilotSide) -> None:
        self._source, self._side = source, side

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        self._side.heard(frames)
        data = self._source.step(t_ns, frames)
        return self._side.sign_all(data) if data else data


def for_autopilot(raw: bytes, clients: ClientSide | None, autopilot: AutopilotSide | None) -> bytes:
    """A client's frame as it goes on: as it is, unless both sides sign and with different keys."""
    if clients is None or autopilot is None or clients.key == autopilot.key:
        return raw
    return autopilot.sign(raw)


def copy_for_autopilot(raw: bytes, clients: ClientSide | None, autopilot: AutopilotSide | None) -> bytes:
    """A repeated frame: the same signature again would be refused as a replay, so it is made anew where that can be.

    Only what was signed, or checked here, is signed: a repetition lends nobody an authority that the original lacked.
    """
    if autopilot is None:
        return strip_signature(raw)
    if is_signed(raw) and (clients is not None or matches(autopilot.key, raw)):
        return autopilot.sign(raw)
    return raw
