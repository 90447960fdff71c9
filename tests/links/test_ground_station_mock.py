"""The ground station and the lockstep link against the mocked flight controller, on a vehicle that never moves."""

import math

import pytest

from firmware_bridge.ground_station.phased_flight import Phase
from firmware_bridge.ground_station.station import GroundStation
from firmware_bridge.links.makers import mock_in_memory, mock_over_pty
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.mock_pixhawk.faults import Fault
from hil.signals.errors import HandshakeError, LinkClosed, LockstepLost
from hil.signals.mission import MissionItem
from hil.signals.noise import NoiseStream
from hil.signals.samples import BaroSample, GpsSample, ImuSample, MagSample

TICK_NS = 4_000_000


def item(seq, command):
    return MissionItem(
        seq, 6, command, int(seq == 0), 1, 0.0, 0.0, 0.0, math.nan, 473_977_418 + 100 * seq, 85_455_938, 10.0
    )


MISSION = [item(0, 22), item(1, 16), item(2, 16), item(3, 21)]


def fly(link, station, seconds):
    """Feed a level vehicle at rest; ((bytes sent, bytes received) per tick, phases passed, time spent in each)."""
    noise = NoiseStream(1, "rest", lanes=9)
    log, phases, frames = [], [], []
    for tick in range(round(seconds * 250)):
        t_ns = tick * TICK_NS
        z = noise.normal(tick)
        imu = ImuSample(
            tick,
            t_ns,
            t_ns,
            (0.02 * z[0], 0.02 * z[1], 9.80665 + 0.02 * z[2]),
            (0.001 * z[3], 0.001 * z[4], 0.001 * z[5]),
            25.0,
        )
        mag = MagSample(tick, t_ns, t_ns, (2.1e-5 + 1e-7 * z[6], -1e-6, -4.3e-5))
        baro = BaroSample(tick, t_ns, t_ns, 95_000.0 + 2.0 * z[7], 540.0 + 0.2 * z[7], 15.0)
        gps = GpsSample(tick, t_ns, t_ns, 47.3977418, 8.5455938, 488.0 + 0.1 * z[8], (0.0, 0.0, 0.0), 0.9, 1.8, 3, 12)
        sent = link.send(tick, t_ns, imu, mag, baro, gps if tick % 25 == 0 else None, station.step(t_ns, frames))
        link.wait(tick, t_ns)
        frames = link.take_frames()
        log.append((sent, b"".join(frame.raw for frame in frames)))
        if station.phase not in phases:
            phases.append(station.phase)
    return log, phases


@pytest.fixture
def in_memory():
    links = []

    def make(*faults):
        link = mock_in_memory(peer=MockPixhawk(faults=faults), reply_limit_s=0.2)
        links.append(link)
        link.open()
        return link

    yield make
    for link in links:
        link.close()


def test_from_first_heartbeat_to_armed(in_memory):
    link = in_memory()
    station = GroundStation(MISSION)
    _, phases = fly(link, station, 8.0)
    assert phases == [Phase.CONNECTING, Phase.UPLOADING, Phase.PREFLIGHT, Phase.ARMING, Phase.FLYING]
    assert station.armed
    assert not station.mission_completed
    stats = link.stats
    assert (stats.bad_crc, stats.garbage_bytes, stats.lost_frames) == (0, 0, 0)


def test_a_vehicle_that_never_leaves_the_ground_says_so(in_memory):
    with pytest.raises(HandshakeError, match=r"disarmed before it took off.*[Dd]isarm"):
        fly(in_memory(), GroundStation(MISSION), 60.0)


def test_ten_thousand_items_are_too_many(in_memory):
    with pytest.raises(HandshakeError, match=r"10000 items was refused .*MAV_MISSION_NO_SPACE"):
        fly(in_memory(), GroundStation([item(i, 16) for i in range(10_000)]), 5.0)


@pytest.mark.parametrize(
    ("kind", "error"),
    [("die", LinkClosed), ("stall", LockstepLost), ("wrong_time", LockstepLost), ("garbage", LockstepLost)],
)
def test_injected_faults_end_the_run_in_their_own_name(in_memory, kind, error):
    with pytest.raises(error):
        fly(in_memory(Fault(kind, 2_000_000)), GroundStation(MISSION), 3.0)


def test_noise_between_frames_ends_nothing(in_memory):
    link = in_memory(Fault("noise", 1_000_000))
    fly(link, GroundStation(MISSION), 8.0)
    assert link.stats.garbage_bytes > 10_000


def test_process_on_a_pty_and_object_in_memory_say_the_same(in_memory):
    expected = fly(in_memory(), GroundStation(MISSION), 6.0)
    link = mock_over_pty()
    link.open()
    try:
        assert fly(link, GroundStation(MISSION), 6.0) == expected
    finally:
        link.close()
