"""Servo packets as ArduPilot SITL sends them."""

import struct

from firmware_bridge.codecs.ardupilot_json import MAGIC_16, MAGIC_32, ServoPacket


def encode_servos(servos: ServoPacket) -> bytes:
    """The datagram of 16 or 32 channels."""
    channels = len(servos.pwm_us)
    magic = {16: MAGIC_16, 32: MAGIC_32}[channels]
    return struct.pack(f"<HHI{channels}H", magic, servos.frame_rate_hz, servos.frame_count & 0xFFFFFFFF, *servos.pwm_us)
