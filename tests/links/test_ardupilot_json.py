"""The ArduPilot JSON link against a scripted SITL over real sockets.

Most tests alternate in one thread: the link sends, the fake steps, the link waits. If the link has to act while it
waits, the fake runs in a thread of its own.
"""

import socket
import threading

import pytest

from firmware_bridge.links.ardupilot.json_link import StateLine
from firmware_bridge.links.autopilot_link import TickSamples
from signals.errors import LockstepLost
from signals.samples import DifferentialPressureSample, RangeSample, VaneSample
from tests.worlds.ardupilot_json_sitl import (
    HOVER,
    TICK_NS,
    fly,
    send,
    truth,
    value,
)
from tests.worlds.resting_vehicle import IMU


def test_one_packet_one_answer(make, sitl):
    link = make()
    sitl.pwm = HOVER
    frame = fly(link, sitl, 50)
    assert sitl.unread() == []
    assert frame.controls == (0.6, 0.601, 0.602, 0.603) + (0.0,) * 12
    stats = link.stats
    assert (stats.steps, stats.rtt.count) == (50, 50)
    assert (stats.repeats, stats.answered_again, stats.unasked_steps, stats.stale, stats.junk) == (0,) * 5
    assert stats.rx_bytes == 51 * 40
    assert (stats.frame_rate_hz, stats.channels) == (1200, 16)
    assert link.caps.lockstep
    assert link.caps.takes_truth
    assert link.caps.boot_sensors == 0


def test_answer_is_truth_from_home_with_the_imus_values(make, sitl):
    link = make()
    fly(link, sitl, 1)
    data = send(link, 1, p_WB=(13.0, 24.0, 5.25), v_WB_W=(1.0, 2.0, 3.0))
    sitl.step()
    assert sitl.taken[-1].encode() == data
    text = sitl.taken[-1]
    assert value(text, "position") == [4.0, 3.0, -5.0]
    assert value(text, "velocity") == [2.0, 1.0, -3.0]
    assert value(text, "accel_body") == [0.5, -0.25, -9.75]
    assert value(text, "gyro") == [0.125, -0.25, -0.5]
    assert value(text, "timestamp")[0] == pytest.approx(0.0025, rel=1e-6)
    assert "rng_1" not in text
    assert "airspeed" not in text


def test_an_imu_slower_than_the_tick_is_held_and_before_its_first_sample_truth_stands_in(make, sitl):
    link = make(mavlink=False)
    samples = [None, IMU, None, IMU._replace(accel_mps2=(0.0, 0.0, 9.5))]
    for tick, imu in enumerate(samples):
        send(link, tick, imu=imu)
        sitl.step()
        link.wait(tick, tick * TICK_NS)
    assert [value(text, "accel_body")[2] for text in sitl.taken] == [-9.80665, -9.75, -9.75, -9.5]


def test_range_finder_is_sent_from_its_first_sample_on(make, sitl):
    link = make()
    sample = RangeSample(0, 0, 0, 1.25, 0.1, 12.0, 0.01, 100, (0.0, 0.0, -1.0))
    for tick, ranging in enumerate([(), (sample,), ()]):
        link.observe(truth(tick))
        link.send(tick, tick * TICK_NS, TickSamples(IMU, others=ranging), b"")
        sitl.step()
        link.wait(tick, tick * TICK_NS)
    assert ["rng_1" in text for text in sitl.taken] == [False, True, True]
    assert value(sitl.taken[2], "rng_1") == [1.25]


def test_the_wind_is_told_only_where_asked_for(make, sitl):
    link = make(state_line=StateLine(wind_vane=True))
    link.observe(truth(0, v_WB_W=(5.0, 0.0, 0.0)), (1.0, 2.0, 0.0))
    link.send(0, 0, TickSamples(IMU), b"")
    text = sitl.take()
    assert "windvane" in text
    assert "airspeed" not in text
    assert value(text, "velocity") == [0.0, 5.0, 0.0]


def test_a_pitot_tube_is_the_airspeed_that_its_pressure_shows_and_a_vane_turns_the_wind_vane(make, sitl):
    """SITL divides the airspeed by sqrt(rho_0 / rho); at 2000 m rho is 1.00649, at sea level 1.225 kg/m3 (ISO 2533)."""
    link = make(state_line=StateLine(home_altitude_m=2000.0))
    pitot, vane = DifferentialPressureSample(0, 0, 0, 137.8125, 20.0), VaneSample(0, 0, 0, 0.05, -0.125)
    for tick, others in enumerate([(), (pitot, vane), (), (pitot._replace(differential_pressure_pa=-3.0),)]):
        link.observe(truth(tick, p_WB=(10.0, 20.0, 0.25), v_WB_W=(3.0, 4.0, 0.0)))
        link.send(tick, tick * TICK_NS, TickSamples(IMU, others=others), b"")
        sitl.step()
        link.wait(tick, tick * TICK_NS)
    assert ["airspeed" in text for text in sitl.taken] == [False, True, True, True]
    equivalent = [value(text, "airspeed")[0] / (1.225 / 1.00649) ** 0.5 for text in sitl.taken[1:]]
    assert equivalent == pytest.approx([15.0, 15.0, 0.0], rel=2e-5)  # 1.225 / 2 * 15^2 Pa
    assert '"windvane":{"direction":-0.125,"speed":5}' in sitl.taken[2]


def test_arduplanes_place_holders_at_boot_move_no_motor(make, sitl):
    """Output 1 has 1500 us until ArduPlane sets it: half throttle to a plane whose motor is there."""
    link = make(signed=frozenset({1}))
    sitl.pwm = (1500, 1500, 1000, 1500) + (1000,) * 12
    frame = fly(link, sitl, 3)
    assert frame.controls == (0.0,) * 16
    assert not frame.armed
    sitl.pwm = (1000, 1500, 1000, 1500) + (1000,) * 12
    send(link, 3)
    sitl.step()
    assert link.wait(3, 3 * TICK_NS).controls == (0.0, 0.0, 0.0, 0.5) + (0.0,) * 12
    sitl.pwm = (1500, 1500, 1000, 1500) + (1000,) * 12  # from then on its own
    send(link, 4)
    sitl.step()
    assert link.wait(4, 4 * TICK_NS).controls == (0.5, 0.0, 0.0, 0.5) + (0.0,) * 12


def test_truth_of_another_tick_is_refused(make):
    link = make()
    with pytest.raises(LockstepLost, match="observe"):
        link.send(0, 0, TickSamples(IMU), b"")
    link.observe(truth(3))
    with pytest.raises(LockstepLost, match="observe"):
        link.send(4, 4 * TICK_NS, TickSamples(IMU), b"")


def test_repeats_while_the_bench_was_away_get_one_answer(make, sitl):
    """During a breakpoint or a pause SITL repeats its packet once a second, and steps once."""
    link = make()
    fly(link, sitl, 3)
    for _ in range(5):
        sitl.ask()
    fly(link, sitl, 4, start=3)
    assert sitl.unread() == []
    assert link.stats.repeats == 5
    assert link.stats.answered_again == 0


def test_a_repeat_that_crossed_the_answer_gets_none(make, sitl):
    link = make()
    send(link, 0)
    sitl.ask()  # left before the answer came
    sitl.step()
    link.wait(0, 0)
    fly(link, sitl, 3, start=1)
    assert sitl.unread() == []
    assert (link.stats.repeats, link.stats.answered_again) == (1, 0)


def test_a_lost_answer_is_sent_again_the_same_bytes_without_a_step(make, sitl):
    link = make()
    fly(link, sitl, 3)
    data = send(link, 3)
    assert len(sitl.unread()) == 1  # lost on the way

    def ask_until_answered():
        sitl.ask()
        sitl.step()

    thread = threading.Thread(target=ask_until_answered)
    thread.start()
    frame = link.wait(3, 3 * TICK_NS)
    thread.join()
    assert frame.tick == 3
    assert sitl.taken[-1].encode() == data
    assert sitl.unread() == []
    assert (link.stats.steps, link.stats.answered_again) == (4, 1)


def test_an_extra_answer_is_used_up_at_once(make, sitl):
    """SITL steps on the extra answer, and the link answers the newest packet only."""
    link = make()
    fly(link, sitl, 3)
    data = send(link, 3)
    link._inbox.send(data, link._sender)
    sitl.step()
    sitl.step()
    link.wait(3, 3 * TICK_NS)
    fly(link, sitl, 5, start=4)
    assert sitl.unread() == []
    assert link.stats.unasked_steps == 1


def test_packets_of_the_past_get_no_answer(make, sitl):
    link = make()
    fly(link, sitl, 5)
    sitl.ask(frame_count=2)
    sitl.ask(frame_count=4)
    fly(link, sitl, 3, start=5)
    assert sitl.unread() == []
    assert link.stats.stale == 2


def test_junk_is_counted_and_gets_no_answer(make, sitl):
    link = make()
    fly(link, sitl, 2)
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for data in (b"", b"hello", b"\xff" * 40, b"\0" * 72, bytes(60000)):
        stranger.sendto(data, sitl.to)
        sitl.servo.sendto(data, sitl.to)
    fly(link, sitl, 3, start=2)
    stranger.close()
    assert sitl.unread() == []
    assert link.stats.junk == 10


def test_thirty_two_channels_in_mid_flight_and_back(make, sitl):
    link = make()
    for start, pwm in ((0, HOVER), (4, HOVER + (1500,) * 16), (8, HOVER)):
        sitl.pwm = pwm
        frame = fly(link, sitl, 4, start=start)
        assert len(frame.controls) == 16
        assert frame.controls[:5] == (0.6, 0.601, 0.602, 0.603, 0.0)
        assert link.stats.channels == len(pwm)


def test_a_frame_count_that_wraps_goes_on(make, sitl):
    far = sitl
    link = make()
    fly(link, far, 1)
    link._packet = link._packet._replace(frame_count=2**32 - 2)
    far.count = 2**32 - 2
    send(link, 1)
    far.step()
    link.wait(1, TICK_NS)
    assert link.stats.steps == 2


def test_frames_that_are_missing_end_the_run(make, sitl):
    link = make()
    fly(link, sitl, 3)
    send(link, 3)
    sitl.take()
    sitl.ask(frame_count=sitl.count + 4)
    with pytest.raises(LockstepLost, match="frame count went from 3 to 8") as caught:
        link.wait(3, 3 * TICK_NS)
    assert caught.value.cause == "gap"


def test_a_second_autopilot_on_the_same_port_ends_the_run(make, sitl):
    link = make()
    fly(link, sitl, 3)
    other = sitl.reboot()
    other.ask(frame_count=1234)
    with pytest.raises(LockstepLost, match=r"second autopilot.*1234") as caught:
        send(link, 3)
    assert caught.value.cause == "second_autopilot"
    other.close()
