"""Failsafes are found in texts and heartbeats, with the mode that follows, once each."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_bridge.autopilots.ardupilot.firmware import ARDUPILOT
from firmware_bridge.autopilots.firmware import Firmware
from firmware_bridge.autopilots.px4.firmware import PX4
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import message_class, pack
from firmware_bridge.ground_station.failsafe_watch import FailsafeWatch
from firmware_bridge.ground_station.modes import ARDUPILOT as ARDUPILOT_ID
from firmware_bridge.ground_station.modes import PX4 as PX4_ID
from firmware_bridge.ground_station.modes import mode_number

Heartbeat = message_class("HEARTBEAT")
Text = message_class("STATUSTEXT")
ACTIVE, CRITICAL = 4, 5
S = 1_000_000_000


class Flight:
    """A vehicle that sends heartbeats and texts at given times [s]."""

    def __init__(self, firmware: Firmware, autopilot: int) -> None:
        self.watch, self.autopilot = FailsafeWatch(firmware), autopilot
        self.encoder = FrameEncoder(1, 1)

    def send(self, t_s: float, message: Any) -> None:
        frames: list[Frame] = FrameParser().feed(self.encoder.frame(message.MSGID, pack(message)))
        self.watch.step(round(t_s * S), frames)

    def beat(self, t_s: float, mode: str, status: int = ACTIVE, *, armed: bool = True) -> None:
        number = mode_number(self.autopilot, mode).custom_mode
        self.send(t_s, Heartbeat(2, self.autopilot, 0x81 if armed else 0x01, number, status, 3))

    def text(self, t_s: float, text: str, severity: int = 2) -> None:
        self.send(t_s, Text(severity, text))

    @property
    def found(self) -> list[tuple[float, str, str]]:
        return [(f.t_ns / S, f.text, f.mode) for f in self.watch.found]


def test_px4_lands_after_a_hold() -> None:
    """PX4 sends each text with a tab, for ground stations that also take its EVENTs."""
    flight = Flight(PX4, PX4_ID)
    flight.beat(49.0, "MISSION")
    flight.text(50.2, "Failsafe activated: entering Hold for 5 seconds\t")
    flight.beat(51.0, "HOLD", CRITICAL)
    flight.beat(52.0, "HOLD", CRITICAL)
    flight.text(55.2, "Failsafe activated\t")
    flight.beat(56.0, "LAND", CRITICAL)
    flight.beat(57.0, "LAND", CRITICAL)
    assert flight.found == [
        (50.2, "Failsafe activated: entering Hold for 5 seconds", "HOLD"),
        (55.2, "Failsafe activated", "LAND"),
    ]


def test_a_heartbeat_alone_tells_a_failsafe_and_its_next_mode() -> None:
    flight = Flight(ARDUPILOT, ARDUPILOT_ID)
    for second in range(5):
        flight.beat(second, "MISSION")
    for second in range(5, 9):
        flight.beat(second, "RTL" if second < 7 else "LAND", CRITICAL)
    assert flight.found == [
        (5.0, "Failsafe (HEARTBEAT: MAV_STATE_CRITICAL)", "RTL"),
        (7.0, "Failsafe (HEARTBEAT: MAV_STATE_CRITICAL)", "LAND"),
    ]


def test_a_text_after_its_heartbeat_tells_the_same_failsafe() -> None:
    """As ArduCopter 4.7 sends them, in one packet."""
    flight = Flight(ARDUPILOT, ARDUPILOT_ID)
    flight.beat(52.0, "MISSION")
    flight.beat(53.0, "LAND", CRITICAL)
    flight.text(53.0, "EKF Failsafe: changed to LAND Mode")
    flight.beat(54.0, "LAND", CRITICAL)
    flight.beat(55.0, "LAND", CRITICAL)
    assert flight.found == [(53.0, "EKF Failsafe: changed to LAND Mode", "LAND")]


def test_a_second_failsafe_after_the_first_is_over_counts() -> None:
    flight = Flight(PX4, PX4_ID)
    flight.beat(9.0, "MISSION")
    for start in (10.0, 30.0):
        flight.text(start, "Failsafe activated")
        flight.beat(start + 0.5, "HOLD", CRITICAL)
        flight.beat(start + 1.5, "MISSION")
    assert [t_s for t_s, _, _ in flight.found] == [10.0, 30.0]


def test_texts_before_take_off_and_warnings_are_none() -> None:
    flight = Flight(ARDUPILOT, ARDUPILOT_ID)
    flight.text(3.0, "Radio Failsafe")
    flight.beat(4.0, "STABILIZED", CRITICAL, armed=False)
    flight.text(5.0, "PreArm: Radio failsafe on")
    flight.beat(6.0, "OFFBOARD")
    for text in ("GPS Glitch or Compass error", "GCS Failsafe Cleared", "GCS Failsafe Off", "EKF3 IMU0 is using GPS"):
        flight.text(7.0, text)
    flight.beat(8.0, "OFFBOARD")
    assert flight.found == []
    px4 = Flight(PX4, PX4_ID)
    px4.beat(1.0, "MISSION")
    px4.text(2.0, "Failsafe warning: low battery")
    px4.text(2.5, "Failsafe mode deactivated")
    px4.beat(3.0, "MISSION")
    assert px4.found == []


@pytest.mark.parametrize(
    "text",
    ["EKF Failsafe: changed to LAND Mode", "Radio Failsafe - Continuing Auto", "Battery Failsafe", "GCS Failsafe",
     "Failsafe: Terrain data missing", "Circle fence breached", "RC Long Failsafe On: RTL", "Throttle failsafe on",
     "Crash: Disarming: AngErr=84>30, Accel=1.2<3.0", "Terminating due to fence breach"],
)  # fmt: skip
def test_texts_of_ardupilot(text: str) -> None:
    flight = Flight(ARDUPILOT, ARDUPILOT_ID)
    flight.beat(1.0, "MISSION")
    flight.text(2.0, text)
    flight.beat(3.0, "LAND")
    assert flight.found == [(2.0, text, "LAND")]


def test_the_last_text_of_a_flight_counts_without_a_heartbeat() -> None:
    flight = Flight(PX4, PX4_ID)
    flight.beat(1.0, "MISSION")
    flight.text(1.5, "Failsafe activated")
    assert flight.found == []
    assert [f.mode for f in flight.watch.conclude()] == ["MISSION"]
