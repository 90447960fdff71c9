"""What every service of the ground station needs: whom it talks to, and how to say something."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder
from firmware_bridge.codecs.messages import MSGID, pack, unpack
from hil.signals.errors import HandshakeError

GCS_SYSID = 255
GCS_COMPID = 190  # MAV_COMP_ID_MISSIONPLANNER: what ground stations use
_HEARTBEAT = MSGID["HEARTBEAT"]


class Wire:
    """The ground station's outgoing half: addresses, sequence numbers, and the bytes of this tick.

    `target_sysid` None: the first autopilot heard. `compid`: which component of the ground station speaks here. Answers
    to two are never confused.
    """

    target_compid = 1  # MAV_COMP_ID_AUTOPILOT1

    def __init__(self, *, target_sysid: int | None, compid: int = GCS_COMPID) -> None:
        self.target_sysid = target_sysid or 0
        self._compid = compid
        self._encoder = FrameEncoder(GCS_SYSID, compid)
        self._out: list[bytes] = []

    def say(self, message: Any) -> None:
        """Send `message` with this tick's bytes."""
        self._out.append(self._encoder.frame(message.MSGID, pack(message)))

    def for_us(self, message: Any) -> bool:
        """Is an answer meant for us, and not for another component or an SDK on the same vehicle?

        A zero is an autopilot that does not say whom it answers.
        """
        return message.target_system in (0, GCS_SYSID) and message.target_component in (0, self._compid)

    def hand_on(self, frames: Sequence[Frame], handlers: Mapping[int, Callable[[Any], None]]) -> bool:
        """Give the vehicle's messages to the handlers of their ids; whether there was any.

        Where no vehicle was named, it is the first autopilot that is heard.
        """
        if not self.target_sysid:
            self.target_sysid = first_autopilot(frames, self.target_compid)
        sysid, compid = self.target_sysid, self.target_compid
        heard = False
        for frame in frames:
            handler = handlers.get(frame[0])
            if handler is not None and frame[1] == sysid and frame[2] == compid:
                handler(unpack(frame))
                heard = True
        return heard

    def take(self) -> bytes:
        """Bytes of this tick, and forget them."""
        data = b"".join(self._out)
        self._out.clear()
        return data


def first_autopilot(frames: Iterable[Frame], compid: int) -> int:
    """System id of the first autopilot among the senders of these heartbeats; 0 if there is none."""
    for frame in frames:
        if frame[0] == _HEARTBEAT and frame[2] == compid and frame[1] != GCS_SYSID:
            return frame[1]
    return 0


def refused(message: str) -> HandshakeError:
    """The one error of the ground station, named after it."""
    return HandshakeError("ground station", message)


def enum_name(enum: str, value: int) -> str:
    """Name of an enum's value in the dialect, such as MAV_MISSION_NO_SPACE; the number if it has none."""
    from pymavlink.dialects.v20 import common

    entry = common.enums[enum].get(value)
    return f"{enum} {value}" if entry is None else entry.name


_REAL32 = 9  # MAV_PARAM_TYPE; below it the integers


def param_as_held(value: float, kind: int) -> float | None:
    """The value as a parameter of MAV_PARAM_TYPE `kind` holds it, 32 bits wide; None where it cannot."""
    if kind >= _REAL32:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    return float(value) if value == int(value) and abs(value) < 2**31 else None


def param_as_sent(value: float, kind: int, *, bytewise: bool = True) -> float:
    """The float that carries a value: PX4 puts an integer's bits there (`bytewise`), ArduPilot its nearest float."""
    if kind >= _REAL32 or not bytewise:
        return value
    return float(struct.unpack("<f", struct.pack("<i", int(value)))[0])


def param_as_read(carried: float, kind: int, *, bytewise: bool = True) -> float:
    if kind >= _REAL32 or not bytewise:
        return carried
    return float(struct.unpack("<i", struct.pack("<f", carried))[0])
