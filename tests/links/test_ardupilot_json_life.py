"""The ArduPilot JSON link in a run: reboots, messages in both directions, silence, an ended process."""

import math
import socket
import subprocess
import sys
import threading
import time

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack
from firmware_bridge.links.ardupilot.json_link import ArduPilotJsonLink, RestartRequested
from firmware_bridge.links.ardupilot.mavlink_channel import MavlinkChannel
from firmware_bridge.links.autopilot_link import LinkTimeouts, TickSamples
from firmware_bridge.transports.tcp import TcpClient
from firmware_bridge.transports.udp import UdpInbox
from signals.errors import HandshakeError, LinkClosed, LockstepLost, PortBusy
from tests.worlds.ardupilot_json_sitl import (
    HOVER,
    LOOPBACK,
    TICK_NS,
    StatusText,
    beat,
    command,
    fly,
    send,
    truth,
    value,
)
from tests.worlds.patience import PATIENT, expect_silence
from tests.worlds.resting_vehicle import IMU


@pytest.mark.parametrize("when", ["before", "after"])
def test_a_reboot_ends_a_mission(make, sitl, when):
    """The reboot is seen before our answer (during our computing) or while we wait for the next packet."""
    link = make()
    sitl.say(StatusText(0, b"Crash: Disarming", 0, 0))
    fly(link, sitl, 10)
    new = sitl.reboot()
    if when == "before":
        new.ask()
        with pytest.raises(LinkClosed, match=r"started again.*fell from 10 to 0.*Crash: Disarming") as caught:
            send(link, 10)
    else:
        send(link, 10)
        new.ask()
        with pytest.raises(LinkClosed, match="started again") as caught:
            link.wait(10, 10 * TICK_NS)
    assert caught.value.cause == "restarted"
    assert [kind for kind, _ in link.events] == ["restart"]
    assert new.unread() == []
    new.close()


def test_with_on_restart_reset_a_reboot_resets_the_run(make, sitl):
    link = make(on_restart="reset", mavlink=False, timeouts=LinkTimeouts(math.inf, math.inf))
    for _ in range(4):
        fly(link, sitl, 20)
        send(link, 20)
        old, sitl = sitl, sitl.reboot()
        old.ask()  # a last packet of the old instance, which gets no answer
        sitl.ask()
        with pytest.raises(RestartRequested, match=r"at 0\.050 s"):
            link.wait(20, 20 * TICK_NS)
        old.ask(frame_count=20)
        sitl.ask()
        assert len(old.unread()) == 1
        old.close()
    # Home is where the vehicle stands now, and time begins again.
    link.observe(truth(0, p_WB=(7.0, 7.0, 7.0)))
    link.send(0, 0, TickSamples(IMU), b"")
    text = sitl.take()
    assert value(text, "position") == [0.0, 0.0, 0.0]
    assert value(text, "timestamp") == [0.0]
    assert (link.stats.restarts, link.stats.stale) == (4, 4)
    sitl.close()


def test_a_reboot_on_the_same_source_port_is_detected(make, sitl):
    link = make(on_restart="reset")
    fly(link, sitl, 7)
    sitl.count = 0
    sitl.ask()
    with pytest.raises(RestartRequested, match="fell from 7 to 0"):
        send(link, 7)
    fly(link, sitl, 3)
    assert sitl.unread() == []


def test_a_reboot_before_the_first_answer_is_not_reported(make, sitl):
    link = make()
    new = sitl.reboot()
    sitl.ask()
    new.ask()
    fly(link, new, 3)
    assert sitl.unread() == []
    assert link.stats.restarts == 0
    new.close()


def test_sitl_in_mid_flight_is_not_taken_over(sitl, make):
    sitl.count = 4711
    with pytest.raises(HandshakeError, match=r"4711.*start it again") as caught:
        make()
    assert caught.value.cause == "midflight"
    assert sitl.unread() == []


def test_messages_go_before_the_state_and_telemetry_belongs_to_its_tick(make, sitl):
    link = make()
    sitl.say(beat(81))
    fly(link, sitl, 1)
    assert [frame.msgid for frame in link.take_frames()] == [MSGID["HEARTBEAT"]]
    data = send(link, 1, extra=command(400))
    assert data.startswith(command(400))
    sitl.take()
    # The state has arrived, so earlier messages are there without waiting.
    assert [frame.msgid for frame in sitl.heard()] == [MSGID["COMMAND_LONG"]]
    sitl.say(beat(81 | 128))
    sitl.ask()
    frame = link.wait(1, TICK_NS)
    assert (frame.armed, frame.mode) == (True, 81 | 128)
    assert len(link.take_frames()) == 1
    assert link.take_frames() == []


def test_messages_for_an_autopilot_not_heard_yet_are_queued(make, sitl):
    link = make()
    send(link, 0, extra=command(1))
    sitl.step()
    link.wait(0, 0)
    assert sitl.heard() == []
    sitl.say(beat(81))
    fly(link, sitl, 1, start=1)
    send(link, 2, extra=command(2))
    assert [frame.payload[28] for frame in sitl.heard()] == [1, 2]


def test_motors_that_turn_are_armed_before_the_next_heartbeat(make, sitl):
    link = make()
    sitl.say(beat(81))
    assert not fly(link, sitl, 1).armed
    sitl.pwm = HOVER
    frame = fly(link, sitl, 1, start=1)
    assert (frame.armed, frame.mode) == (True, 81 | 128)


def test_telemetry_is_read_while_waiting(make, sitl):
    """The link reads before the answer arrives: over TCP an unread SITL blocks, over UDP messages would be lost."""
    link = make()
    fly(link, sitl, 1)
    send(link, 1)

    def talk():
        for i in range(1, 401):
            sitl.say(StatusText(6, b"word %d" % i, 0, 0))
            while i % 50 == 0 and link.stats.rx_frames < i:
                time.sleep(0.001)
        sitl.step()

    thread = threading.Thread(target=talk)
    thread.start()
    link.wait(1, TICK_NS)
    thread.join()
    assert len(link.take_frames()) == 400
    assert link.stats.lost_frames == 0


def test_messages_over_tcp_and_again_after_a_reboot(sitl):
    """As SITL does by default: it listens, and sends no packet before a client connects."""
    listener = socket.create_server((LOOPBACK, 0))
    inbox, side = UdpInbox(0), MavlinkChannel(TcpClient(listener.getsockname()[1]))
    link = ArduPilotJsonLink(inbox, side, start_process=sitl.attach(inbox, side), on_restart="reset", timeouts=PATIENT)
    asked = sitl.ask
    connections = []

    def wait_for_client_then_ask():
        connections.append(listener.accept()[0])
        asked()

    sitl.ask = lambda **changes: threading.Thread(target=wait_for_client_then_ask).start()
    try:
        link.open()
        sitl.ask = asked
        connections[0].sendall(sitl.encoder.frame(MSGID["HEARTBEAT"], pack(beat(81))))
        connections[0].setblocking(True)
        send(link, 0, extra=command(400))
        assert FrameParser().feed(connections[0].recv(4096))[0].msgid == MSGID["COMMAND_LONG"]
        sitl.step()
        link.wait(0, 0)
        connections.pop().close()
        new = sitl.reboot()
        new_asks = threading.Thread(target=lambda: (connections.append(listener.accept()[0]), new.ask()))
        new_asks.start()
        send(link, 1)
        with pytest.raises(RestartRequested):
            link.wait(1, TICK_NS)
        new_asks.join()
        fly(link, new, 3)
        new.close()
    finally:
        link.close()
        for connection in connections:
            connection.close()
        listener.close()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads Linux's table of connections")
def test_another_client_of_the_tcp_port_is_named(sitl, tmp_path):
    """MAVProxy, as sim_vehicle.py starts it, takes the one client that SITL serves on 5760."""
    client = tmp_path / "mavproxy.py"
    client.write_text(
        "import socket, sys\n"
        "held = socket.create_connection(('127.0.0.1', int(sys.argv[1])))\nprint(1, flush=True)\nsys.stdin.read()\n"
    )
    with socket.create_server((LOOPBACK, 0)) as listener:
        port = listener.getsockname()[1]
        command = [sys.executable, str(client), str(port)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
            other.stdout.readline()
            side = MavlinkChannel(TcpClient(port))
            side.open()
            with pytest.raises(PortBusy, match=rf"mavproxy.py \(process {other.pid}\) .*mavlink_port=tcp:{port + 2}"):
                side.read()
            side.close()
            other.stdin.close()
        again = MavlinkChannel(TcpClient(port))  # the other one has ended
        again.open()
        assert again.read() == []
        assert again.fileno() is not None
        again.close()


def test_a_silence_error_names_the_messages_still_received(make, sitl):
    link = make()
    fly(link, sitl, 2)
    expect_silence(link)
    sitl.say(StatusText(2, b"EKF variance", 0, 0))
    send(link, 2)
    sitl.ask()  # does not take the answer
    with pytest.raises(
        LockstepLost,
        match=r"repeats frame 2.*1 sent again.*MAVLink frames still come.*process still runs.*EKF variance",
    ) as caught:
        link.wait(2, 2 * TICK_NS)
    assert caught.value.cause == "silent"
    assert len(sitl.unread()) == 2


def test_an_ended_process_is_reported_with_its_status(make, sitl):
    link = make()
    fly(link, sitl, 2)
    send(link, 2)
    link._process.alive = False
    with pytest.raises(LinkClosed, match=r"(?s)exit status 7.*Panic") as caught:
        link.wait(2, 2 * TICK_NS)
    assert caught.value.cause == "crashed"


def test_a_sitl_that_never_sends_is_named():
    link = ArduPilotJsonLink(UdpInbox(0), timeouts=LinkTimeouts(connect_s=0.2))
    with pytest.raises(HandshakeError, match=r"no datagram came.*--sim-port-out \d+"):
        link.open()


def test_frame_rate_that_follows_the_tick_is_not_reported(make, sitl):
    sitl.rate = 401
    link = make()
    fly(link, sitl, 1100)
    assert link.events == []


def test_frame_rate_that_stays_different_is_reported_once(make, sitl):
    link = make(mavlink=False)
    for tick in range(2200):
        sitl.rate = max(600, 1200 - tick)  # drifts by 1 Hz a packet
        fly(link, sitl, 1, start=tick)
    ((kind, text),) = link.events
    assert kind == "warning"
    assert "requests 6" in text
    assert link.stats.frame_rate_hz == 600


HOME = (47.397742, 8.545594, 488.23, 90.0)


def home_position(latitude, longitude, altitude):
    place = (round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1e3))
    return message_class("HOME_POSITION")(*place, 0.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0)


@pytest.mark.parametrize(
    ("place", "apart"),
    [
        ((-35.363261, 149.165230, 584.0), r"14041 km away and \+95\.8 m"),
        ((47.411142, 8.545594, 488.23), r"1492 m away and \+0\.0 m"),
        ((47.397742, 8.545594, 0.0), r"0 m away and -488\.2 m"),
    ],
)
def test_a_home_elsewhere_ends_the_run_with_both_places(make, sitl, place, apart):
    link = make(home=HOME)
    fly(link, sitl, 3)
    sitl.say(home_position(*place))
    with pytest.raises(HandshakeError, match=apart) as caught:
        fly(link, sitl, 3, 3)
    text = str(caught.value)
    assert caught.value.cause == "home"
    assert f"home is {place[0]:.6f}, {place[1]:.6f}" in text
    assert "stands at 47.397742, 8.545594, 488.2 m" in text
    assert "--home 47.397742000,8.545594000,488.2300,90.0000" in text


def test_the_right_home_is_checked_once_and_again_after_a_reboot(make, sitl):
    link = make(home=HOME, on_restart="reset")
    sitl.say(home_position(47.3977421, 8.5455941, 488.5))
    fly(link, sitl, 3)
    sitl.say(home_position(0.0, 0.0, 0.0))  # moved in flight by another ground station
    fly(link, sitl, 3, 3)
    new = sitl.reboot()
    new.ask()
    with pytest.raises(RestartRequested):
        send(link, 6)
    new.say(home_position(0.0, 0.0, 0.0))
    with pytest.raises(HandshakeError, match="ArduPilot's home is 0"):
        fly(link, new, 3, 7)
    new.close()
