"""Message signing on the router's two sides, and the key files.

Clients (`ClientSigning`, router.signing_key_file): frames of clients must be signed with this key, or the router drops
them; unsigned frames of the autopilot are signed for them.
Autopilot (`AutopilotSigning`, autopilot.signing_key_file): the bench's own frames are signed. A client's frame is
signed anew only if the router has verified it with another key; otherwise it stays as its sender made it.
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
from signals.errors import ConfigError

# Clients and autopilots count their link ids up from 0, so that these are unlikely to collide.
LINK_TO_CLIENTS = 201
LINK_TO_AUTOPILOT = 202

_READABLE_BY_OTHERS = 0o077


class KeyFile(NamedTuple):
    key: SigningKey
    warning: str  # "" if none


def read_key(path: Path) -> KeyFile:
    """Read the key in `path` (see `SigningKey.from_text`). ConfigError if there is none."""
    try:
        mode = path.stat().st_mode
        key = SigningKey.from_text(path.read_bytes())
    except OSError as error:
        raise ConfigError.at(
            str(path), f"this signing key cannot be read ({error.strerror})", "check the path and its permissions"
        ) from error
    except ValueError as error:
        hint = "write 64 hexadecimal digits, 32 raw bytes, or a passphrase"
        raise ConfigError.at(str(path), f"holds no signing key: {error}", hint) from error
    warning = ""
    if mode & _READABLE_BY_OTHERS:
        warning = f"{path}: other users of this machine can read this signing key; chmod 600 it"
    return KeyFile(key, warning)


class ClientSigning:
    """Verifies the frames of clients, and signs those that go to them."""

    def __init__(self, key: SigningKey) -> None:
        self.key, clock = key, SigningClock()
        self._verifier = Verifier(key, clock)
        self._signer = Signer(key, LINK_TO_CLIENTS, clock)

    def check(self, frame: Frame) -> Check:
        """Return GOOD if the frame may pass, otherwise the reason against it."""
        found = self._verifier.check(frame)
        if found is Check.UNSIGNED and frame.msgid in ACCEPTED_UNSIGNED:
            return Check.GOOD
        return found

    def sign(self, raw: bytes) -> bytes:
        """Return the frame signed for clients, or unchanged if the autopilot has signed it."""
        return raw if is_signed(raw) else self._signer.sign(raw)


class AutopilotSigning:
    """Signs the frames that go to an autopilot that requires signatures."""

    def __init__(self, key: SigningKey) -> None:
        self.key, clock = key, SigningClock()
        self._verifier = Verifier(key, clock)
        self._signer = Signer(key, LINK_TO_AUTOPILOT, clock)

    def follow_clock(self, frames: Sequence[Frame]) -> None:
        """Follow the autopilot's signing clock. It may be ahead, and refuses frames with older timestamps."""
        for frame in frames:
            if is_signed(frame.raw):
                self._verifier.check(frame)

    def sign(self, raw: bytes) -> bytes:
        return self._signer.sign(raw)

    def sign_all(self, data: bytes) -> bytes:
        """Return the frames in `data`, each signed."""
        return b"".join(self._signer.sign(frame) for _, frame in split_frames(data))


class Commands(Protocol):
    """A source of commands within the bench."""

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes: ...


class SignedCommands:
    """A source of commands within the bench, such as its ground station, with its frames signed."""

    def __init__(self, source: Commands, signing: AutopilotSigning) -> None:
        self._source, self._signing = source, signing

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        self._signing.follow_clock(frames)
        data = self._source.step(t_ns, frames)
        return self._signing.sign_all(data) if data else data


def for_autopilot(raw: bytes, clients: ClientSigning | None, autopilot: AutopilotSigning | None) -> bytes:
    """Return a client's frame for the autopilot: unchanged, unless both sides sign with different keys."""
    if clients is None or autopilot is None or clients.key == autopilot.key:
        return raw
    return autopilot.sign(raw)


def copy_for_autopilot(raw: bytes, clients: ClientSigning | None, autopilot: AutopilotSigning | None) -> bytes:
    """Return a repeated frame, signed anew where possible: the autopilot refuses the same signature as a replay.

    Only a frame that was signed, or verified here, is signed, so that a copy has no authority that the original lacked.
    """
    if autopilot is None:
        return strip_signature(raw)
    if is_signed(raw) and (clients is not None or matches(autopilot.key, raw)):
        return autopilot.sign(raw)
    return raw
