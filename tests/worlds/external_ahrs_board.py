"""A fake ArduPilot with an External AHRS: sensor driver and MAVLink on two wires in memory, run tick by tick."""

import time

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from firmware_bridge.codecs.vectornav import sentence
from firmware_bridge.links.ardupilot.external_ahrs import ExternalAhrsLink
from firmware_bridge.links.ardupilot.vectornav_stream import InsErrors
from firmware_bridge.links.autopilot_link import TickSamples
from firmware_bridge.links.realtime.deadline_schedule import DeadlineSchedule
from signals.errors import LinkClosed, PortNotFound
from tests.worlds.resting_vehicle import BARO, GPS, IMU, MAG, truth_at

TICK_NS = 2_500_000
SETUP = (
    "VNASY,0", "VNWRG,06,0,1", "VNRRG,01", "VNWRG,75,3,2,01,0721", "VNWRG,76,3,16,31,0001,0106,0613",
    "VNWRG,77,3,160,49,0003,26B8,0018", "VNASY,1",
)  # fmt: skip
SIZES = {b"\x01": 82, b"\x31": 104, b"\x49": 110}
Heartbeat, Ack = message_class("HEARTBEAT"), message_class("COMMAND_ACK")
Servo = message_class("SERVO_OUTPUT_RAW")
NO_ERRORS = InsErrors(position_m=0.0, velocity_mps=0.0, attitude_deg=0.0)


def geodetic(p_W):
    return (47.0 + p_W[1] * 1e-5, 8.0 + p_W[0] * 1e-5, 400.0 + p_W[2])


def truth(tick, **changes):
    return truth_at(tick * TICK_NS, tick, **({"p_WB": (10.0, 20.0, 0.25), "v_WB_W": (1.0, 2.0, 3.0)} | changes))


class Board:
    """ArduPilot's driver and its MAVLink. `tell` and `ask` are its next output; `loop_us` is its main period."""

    def __init__(self, *, loop_us=5000, asks=SETUP):
        self.to_bench = {"sensor": b"", "mavlink": b""}
        self.gone = {"sensor": False, "mavlink": False}
        self.parser, self.encoder = FrameParser(), FrameEncoder(1, 1)
        self.loop_us = loop_us
        self.asks = list(asks)
        self.waits_for = None
        self.answers = []
        self.packets = []
        self.commands = []
        self.requested = []
        self._bytes = b""
        self.boot_us = 5_000_000
        self.streaming = False
        self.talks = True

    # ---- sensor wire

    def ask_next(self):
        if self.waits_for is None and self.asks:
            self.waits_for = self.asks[0]
            self.to_bench["sensor"] += sentence(self.waits_for)

    def hear_sensor(self, data):
        self._bytes += data
        while self._bytes:
            if self._bytes[:1] == b"$":
                line, found, rest = self._bytes.partition(b"\r\n")
                if not found:
                    return
                self._bytes = rest
                self.answers.append(line.decode())
                if self.waits_for is not None and line.decode().startswith("$" + self.waits_for[:8]):
                    self.asks.pop(0)
                    self.waits_for = None
                    self.ask_next()
            else:
                size = SIZES[self._bytes[1:2]]
                assert self._bytes[:1] == b"\xfa"
                if len(self._bytes) < size:
                    return
                self.packets.append(self._bytes[:size])
                self._bytes = self._bytes[size:]

    # ---- MAVLink

    def say(self, message):
        if self.talks:
            self.to_bench["mavlink"] += self.encoder.frame(message.MSGID, pack(message))

    def beat(self, base_mode=0):
        self.say(Heartbeat(type=2, autopilot=3, base_mode=base_mode, custom_mode=0, system_status=3, mavlink_version=3))

    def outputs(self, *pwm):
        self.boot_us += 6000
        names = {f"servo{i + 1}_raw": us for i, us in enumerate(pwm + (0,) * (16 - len(pwm)))}
        self.say(Servo(time_usec=self.boot_us % 2**32, port=0, **names))

    def hear_mavlink(self, data):
        for frame in self.parser.feed(data):
            if frame.msgid != MSGID["COMMAND_LONG"]:
                continue
            command = unpack(frame)
            self.commands.append((frame.sysid, command))
            if command.command == 511 and command.param1 == MSGID["SERVO_OUTPUT_RAW"]:
                self.requested.append(command.param2)
                ms = int(command.param2 / 1000)
                result = 2 if ms * 800 < self.loop_us and int(self.loop_us / 800) > ms else 0
                self.streaming = self.streaming or result == 0
                self.say(Ack(511, result, 0, 0, frame.sysid, frame.compid))


class Wire:
    """A wire between the link and the board."""

    def __init__(self, board, side):
        self.board, self.side, self.opened = board, side, 0

    name = property(lambda self: self.side)

    def open(self):
        if self.board.gone[self.side] is True:
            raise PortNotFound(self.side, "no such port")
        self.opened += 1

    def close(self):
        pass

    def write(self, data):
        if self.board.gone[self.side]:
            raise LinkClosed(self.side, "unplugged")
        getattr(self.board, f"hear_{self.side}")(data)

    def read(self, timeout_s):
        if self.board.gone[self.side]:
            error = LinkClosed(self.side, "unplugged")
            if self.board.gone[self.side] == "back soon":
                self.board.gone[self.side] = False
            raise error
        if self.side == "sensor":
            self.board.ask_next()
        data, self.board.to_bench[self.side] = self.board.to_bench[self.side], b""
        return data

    def fileno(self):
        return None


class Bench:
    """Runs the link, tick by tick."""

    def __init__(self, board, **settings):
        self.events = []
        self.board = board
        wires = {side: Wire(board, side) for side in ("sensor", "mavlink")}
        usual = {"period_ns": TICK_NS, "geodetic": geodetic, "errors": NO_ERRORS}
        self.link = ExternalAhrsLink(
            wires["sensor"],
            wires["mavlink"],
            on_event=lambda kind, text: self.events.append((kind, text)),
            own_sender=False,
            **(usual | settings),
        )
        self.link.open()
        # Ticks follow one another without waiting: most tests here do not depend on time.
        self.now_ns = time.monotonic_ns()
        self.link.schedule = DeadlineSchedule(
            period_ns=TICK_NS, lead_ns=0, clock_ns=lambda: self.now_ns, sleep_s=self.sleep
        )
        self.tick = 0
        self.controls = None

    def sleep(self, for_s):
        self.now_ns += round(for_s * 1e9)

    def run(self, ticks=1, *, each=lambda tick: None, extra=b"", **samples):
        """Run `ticks` ticks, each with a sample of every sensor unless `samples` has another, or None."""
        usual = {"imu": IMU, "mag": MAG, "baro": BARO, "gps": GPS if self.tick % 40 == 0 else None}
        chosen = usual | samples
        for _ in range(ticks):
            each(self.tick)
            found = self.link.begin(self.tick)
            self.controls = found or self.controls
            t_ns = self.tick * TICK_NS
            self.link.observe(chosen.pop("truth", None) or truth(self.tick), (0.0, 0.0, 0.0))
            gps = chosen["gps"] and chosen["gps"]._replace(t_capture_ns=t_ns, t_available_ns=t_ns)
            sent = self.link.send(
                self.tick, t_ns, TickSamples(chosen["imu"], chosen["mag"], chosen["baro"], gps), extra
            )
            assert self.link.wait(self.tick, t_ns) is None
            self.tick += 1
            chosen["gps"] = samples.get("gps", GPS if self.tick % 40 == 0 else None)
        return sent

    def kinds(self):
        return [kind for kind, _ in self.events]
