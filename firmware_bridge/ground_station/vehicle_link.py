"""Messages between the ground station and one vehicle: addresses, dispatch, and the tick's outgoing bytes."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder
from firmware_bridge.codecs.messages import MSGID, pack, unpack
from signals.errors import HandshakeError

GCS_SYSID = 255
GCS_COMPID = 190  # MAV_COMP_ID_MISSIONPLANNER, as ground stations use
_HEARTBEAT = MSGID["HEARTBEAT"]


class VehicleLink:
    """The messages to and from one vehicle, of one component of the ground station.

    `target_sysid` None: the first autopilot that sends a heartbeat. `compid`: the component's id; answers to different
    components cannot be confused.
    """

    target_compid = 1  # MAV_COMP_ID_AUTOPILOT1

    def __init__(self, *, target_sysid: int | None, compid: int = GCS_COMPID) -> None:
        self.target_sysid = target_sysid or 0
        self._compid = compid
        self._encoder = FrameEncoder(GCS_SYSID, compid)
        self._out: list[bytes] = []

    def send(self, message: Any) -> None:
        """Add `message` to this tick's bytes."""
        self._out.append(self._encoder.frame(message.MSGID, pack(message)))

    def is_for_us(self, message: Any) -> bool:
        """Return True if an answer is for this component, not for another client of the same vehicle.

        A zero comes from an autopilot that does not address its answers.
        """
        return message.target_system in (0, GCS_SYSID) and message.target_component in (0, self._compid)

    def dispatch(self, frames: Sequence[Frame], handlers: Mapping[int, Callable[[Any], None]]) -> bool:
        """Call the handlers of the vehicle's messages. Return True if one was called."""
        if not self.target_sysid:
            self.target_sysid = first_autopilot(frames, self.target_compid)
        sysid, compid = self.target_sysid, self.target_compid
        found = False
        for frame in frames:
            handler = handlers.get(frame[0])
            if handler is not None and frame[1] == sysid and frame[2] == compid:
                handler(unpack(frame))
                found = True
        return found

    def take(self) -> bytes:
        """Return the bytes of this tick, and clear them."""
        data = b"".join(self._out)
        self._out.clear()
        return data


def first_autopilot(frames: Iterable[Frame], compid: int) -> int:
    """Return the system id of the first autopilot among the senders of these heartbeats; 0 if there is none."""
    for frame in frames:
        if frame[0] == _HEARTBEAT and frame[2] == compid and frame[1] != GCS_SYSID:
            return frame[1]
    return 0


def refused(message: str) -> HandshakeError:
    """Return the error with which the ground station ends a run."""
    return HandshakeError("ground station", message)


def enum_name(enum: str, value: int) -> str:
    """Return the dialect's name of an enum value, such as MAV_MISSION_NO_SPACE; the number if it has none."""
    from pymavlink.dialects.v20 import common

    entry = common.enums[enum].get(value)
    return f"{enum} {value}" if entry is None else entry.name


_REAL32 = 9  # MAV_PARAM_TYPE; below it the integers


def param_as_held(value: float, kind: int) -> float | None:
    """Return the value as a parameter of MAV_PARAM_TYPE `kind` stores it, in 32 bits; None if it does not fit."""
    if kind >= _REAL32:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    return float(value) if value == int(value) and abs(value) < 2**31 else None


def param_as_sent(value: float, kind: int, *, bytewise: bool = True) -> float:
    """Return the float that carries a value. PX4 sends an integer's bits (`bytewise`), ArduPilot its value."""
    if kind >= _REAL32 or not bytewise:
        return value
    return float(struct.unpack("<f", struct.pack("<i", int(value)))[0])


def param_as_read(carried: float, kind: int, *, bytewise: bool = True) -> float:
    """Return the value of a received float: the inverse of `param_as_sent`."""
    if kind >= _REAL32 or not bytewise:
        return carried
    return float(struct.unpack("<i", struct.pack("<f", carried))[0])
