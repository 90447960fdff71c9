"""The send buffer of a board in HITL: it never waits, and what does not fit goes whole."""

from __future__ import annotations

import os

from firmware_bridge.mock_pixhawk.line import SendBuffer


def test_what_does_not_fit_is_dropped_whole_and_the_rest_arrives_in_order():
    near, far = os.pipe()
    os.set_blocking(far, False)
    os.set_blocking(near, False)
    buffer = SendBuffer(far, size=1000)
    sent = 0
    while not buffer.dropped:
        buffer.write(bytes([sent % 251]) * 300)
        sent += 1
    assert buffer.dropped == 300
    assert len(buffer.pending) <= 1000
    arrived = b""
    while True:
        try:
            arrived += os.read(near, 65536)
        except BlockingIOError:
            if not buffer.pending:
                break
            buffer.write(b"")
    os.close(near)
    os.close(far)
    assert arrived == b"".join(bytes([k % 251]) * 300 for k in range(sent - 1))
