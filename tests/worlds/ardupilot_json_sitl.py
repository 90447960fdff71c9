"""SITL's end of ArduPilot's JSON link, scripted over real sockets, and links to it."""

import re
import socket
import struct

import pytest

from firmware_bridge.codecs.ardupilot_json import MAGIC_16, MAGIC_32, ServoPacket
from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack
from firmware_bridge.links.ardupilot.json_link import ArduPilotJsonLink
from firmware_bridge.links.ardupilot.mavlink_channel import MavlinkChannel
from firmware_bridge.links.autopilot_link import TickSamples
from firmware_bridge.transports.udp import UdpInbox, UdpTransport
from tests.worlds.patience import PATIENCE_S, PATIENT
from tests.worlds.resting_vehicle import IMU, Process, truth_at

TICK_NS = 2_500_000
LOOPBACK = "127.0.0.1"
OFF = (1000,) * 16
HOVER = (1600, 1601, 1602, 1603) + (0,) * 12
Heartbeat = message_class("HEARTBEAT")
StatusText = message_class("STATUSTEXT")
Command = message_class("COMMAND_LONG")


def encode_servos(servos: ServoPacket) -> bytes:
    """Return SITL's datagram with 16 or 32 channels."""
    channels = len(servos.pwm_us)
    magic = {16: MAGIC_16, 32: MAGIC_32}[channels]
    return struct.pack(f"<HHI{channels}H", magic, servos.frame_rate_hz, servos.frame_count & 0xFFFFFFFF, *servos.pwm_us)


def truth(tick, **changes):
    return truth_at(tick * TICK_NS, tick, **({"p_WB": (10.0, 20.0, 0.25 + tick)} | changes))


def beat(base_mode):
    return Heartbeat(type=2, autopilot=3, base_mode=base_mode, custom_mode=0, system_status=3, mavlink_version=3)


class Sitl:
    """SITL's end of the link: sends a packet, takes one datagram as the answer, and sends the next packet."""

    def __init__(self, *, frame_rate=1200, first=0):
        self.servo = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.servo.bind((LOOPBACK, 0))
        self.servo.settimeout(PATIENCE_S)
        self.mavlink = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.mavlink.bind((LOOPBACK, 0))
        self.mavlink.setblocking(False)
        self.encoder = FrameEncoder(1, 1)
        self.to = self.mavlink_to = None
        self.count, self.rate, self.pwm = first, frame_rate, OFF
        self.taken = []

    def attach(self, inbox, side):
        """Return the function that starts SITL, once the link's sockets are open."""

        def start():
            self.to = (LOOPBACK, inbox.port)
            self.mavlink_to = None if side is None or side.udp_port is None else (LOOPBACK, side.udp_port)
            return Process(lambda: self.ask())

        return start

    def ask(self, **changes):
        packet = ServoPacket(self.rate, self.count, self.pwm)._replace(**changes)
        self.servo.sendto(encode_servos(packet), self.to)

    def take(self):
        """Return the oldest answer as text, and count the step that it allows."""
        self.taken.append(self.servo.recv(65536).decode())
        self.count += 1
        return self.taken[-1]

    def step(self):
        self.take()
        self.ask()

    def unread(self):
        """Return the answers that were not taken."""
        self.servo.setblocking(False)
        found = []
        try:
            while True:
                found.append(self.servo.recv(65536))
        except BlockingIOError:
            return found
        finally:
            self.servo.settimeout(PATIENCE_S)

    def reboot(self):
        """Return a new instance on a new port, whose frame count begins at 0."""
        other = Sitl(frame_rate=self.rate)
        other.to, other.mavlink_to = self.to, self.mavlink_to
        return other

    def say(self, message):
        self.mavlink.sendto(self.encoder.frame(message.MSGID, pack(message)), self.mavlink_to)

    def heard(self):
        """Return the MAVLink frames that have arrived."""
        data = b""
        try:
            while True:
                data += self.mavlink.recv(65536)
        except BlockingIOError:
            return FrameParser().feed(data)

    def close(self):
        self.servo.close()
        self.mavlink.close()


@pytest.fixture
def sitl():
    made = Sitl()
    yield made
    made.close()


@pytest.fixture
def make(sitl):
    """Yield a function that makes opened links to `sitl`; close them at the end."""
    links = []

    def build(*, far=sitl, mavlink=True, home=None, **settings):
        settings = {"timeouts": PATIENT} | settings
        side = MavlinkChannel(UdpTransport(0)) if mavlink else None
        inbox, events = UdpInbox(0), []
        link = ArduPilotJsonLink(
            inbox,
            side,
            start_process=far.attach(inbox, side),
            on_event=lambda kind, text: events.append((kind, text)),
            **settings,
        )
        if home is not None:
            link.expect_home(home)
        link.events = events
        links.append(link)
        link.open()
        return link

    yield build
    for link in links:
        link.close()


def send(link, tick, imu=IMU, extra=b"", **changes):
    link.observe(truth(tick, **changes))
    return link.send(tick, tick * TICK_NS, TickSamples(imu), extra)


def fly(link, sitl, ticks, start=0):
    for tick in range(start, start + ticks):
        send(link, tick)
        sitl.step()
        frame = link.wait(tick, tick * TICK_NS)
        assert (frame.tick, frame.t_ns) == (tick, tick * TICK_NS)
    return frame


def value(text, key):
    return [float(x) for x in re.search(rf'"{key}":\[?([-+.\de,]+)', text)[1].strip(",").split(",")]


def command(number):
    return FrameEncoder(255, 190).frame(
        MSGID["COMMAND_LONG"], pack(Command(1, 1, number, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    )
