"""A world for the mock autopilot: physics, sensors and a ground station, in one process, tick by tick."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from firmware_bridge.codecs.hil import hil_gps_payload, hil_sensor_payload
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from signals.time import RateAccumulator
from sim.physics.forces.force import Effects
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from tests.worlds.installed_sensor import installed

TICK_NS = 4_000_000
TICK_HZ = 250
GCS, GCS_COMPONENT = 255, 190


class World:
    """A vehicle on the airfield with the default sensors; `autopilot` flies it."""

    def __init__(
        self, *, seed: int = 1, gps: bool = True, vehicle: str = "x500", shaken: bool = False, **autopilot: Any
    ) -> None:
        scene, flown = load_scene("airfield"), load_vehicle(vehicle)
        # The mock by its airframe's name knows the vehicle in the air of its file.
        self.physics = VehiclePhysics(flown, scene, TICK_NS, effects=Effects(air_density=False))
        shaken_by = flown if shaken else None

        def sensor(name: str, preset: str, rate_hz: float) -> Any:
            return installed(name, scene, preset=preset, rate_hz=rate_hz, seed=seed, shaken_by=shaken_by)

        self._imu = sensor("imu", "icm20689", TICK_HZ)
        self._others = [
            (sensor(name, preset, rate), RateAccumulator(event_millihz=rate * 1000, tick_millihz=TICK_HZ * 1000))
            for name, preset, rate in (("gps", "here_plus", 10), ("baro", "ms5611", 50), ("mag", "ist8310", 50))
        ]
        self._seq = [0, 0, 0]
        self._waiting: list[list[Any]] = [[], [], []]
        self.gps_on = gps
        self.autopilot = MockPixhawk(airframe=vehicle, **autopilot)
        self._bench = FrameEncoder(GCS, 200)
        self._gcs = FrameEncoder(GCS, GCS_COMPONENT)
        self._parser = FrameParser()
        self.received: list[Frame] = self._parser.feed(self.autopilot.boot())
        self.tick = 0
        self.controls: tuple[float, ...] = (0.0,) * 16
        self.truth = self.physics.advance(0, self.controls)
        self._outbox: list[bytes] = []
        self.extra: Callable[[int, list[Frame]], bytes] = lambda t_ns, frames: b""
        self.each_tick: Callable[[World], None] = lambda world: None
        self.answered = True

    @property
    def t_s(self) -> float:
        return self.tick * TICK_NS * 1e-9

    def send(self, name: str, **fields: Any) -> None:
        """Queue a message from the ground station for the next tick."""
        message = message_class(name)(**fields)
        self._outbox.append(self._gcs.frame(message.MSGID, pack(message)))

    def command(self, command: int, *params: float, target_component: int = 1) -> None:
        """Queue a COMMAND_LONG."""
        values = {f"param{i + 1}": (params[i] if i < len(params) else 0.0) for i in range(7)}
        self.send(
            "COMMAND_LONG",
            target_system=1,
            target_component=target_component,
            command=command,
            confirmation=0,
            **values,
        )

    def step(self) -> list[Frame]:
        """Run one tick; return the frames that the autopilot sent in it."""
        t_ns = self.tick * TICK_NS
        due: list[Any] = [None, None, None]
        for i, (sensor, rate) in enumerate(self._others):
            if rate.due():
                self._waiting[i].append(sensor.sample(self.truth, self._seq[i]))
                self._seq[i] += 1
            if self._waiting[i] and self._waiting[i][0].t_available_ns <= t_ns:
                due[i] = self._waiting[i].pop(0)
        data = b"".join(self._outbox)
        self._outbox.clear()
        data += self.extra(t_ns, self.received)
        if due[0] is not None and self.gps_on:
            data += self._bench.frame(MSGID["HIL_GPS"], hil_gps_payload(t_ns, due[0]))
        imu = self._imu.sample(self.truth, self.tick)
        data += self._bench.frame(MSGID["HIL_SENSOR"], hil_sensor_payload(t_ns, imu, due[2], due[1]))
        self.received = self._parser.feed(self.autopilot.feed(data))
        self.answered = False
        for frame in self.received:
            if frame.msgid == MSGID["HIL_ACTUATOR_CONTROLS"]:
                self.controls = unpack(frame).controls
                self.answered = True
        self.tick += 1
        self.truth = self.physics.advance(self.tick, self.controls)
        self.each_tick(self)
        return self.received

    def run(self, seconds: float) -> list[Frame]:
        """Run and return all frames but the actuator controls."""
        frames: list[Frame] = []
        for _ in range(round(seconds * TICK_HZ)):
            frames += [f for f in self.step() if f.msgid != MSGID["HIL_ACTUATOR_CONTROLS"]]
        return frames

    def run_until(self, done: Callable[[World], bool], limit_s: float) -> list[Frame]:
        """Run until `done(world)`, at most `limit_s`; AssertionError otherwise."""
        frames: list[Frame] = []
        for _ in range(round(limit_s * TICK_HZ)):
            frames += [f for f in self.step() if f.msgid != MSGID["HIL_ACTUATOR_CONTROLS"]]
            if done(self):
                return frames
        raise AssertionError(f"not within {limit_s} s: {texts(frames)}")


def messages(frames: list[Frame], name: str) -> list[Any]:
    """Return all messages of one kind."""
    return [unpack(frame) for frame in frames if frame.msgid == MSGID[name]]


def texts(frames: list[Frame]) -> list[str]:
    """Return all STATUSTEXTs, chunks joined."""
    found: list[str] = []
    for m in messages(frames, "STATUSTEXT"):
        if m.id and m.chunk_seq:
            found[-1] += m.text
        else:
            found.append(m.text)
    return found


def results(frames: list[Frame]) -> list[tuple[int, int]]:
    """Return (command, result) of every COMMAND_ACK."""
    return [(m.command, m.result) for m in messages(frames, "COMMAND_ACK")]


def sticks(
    world: World, seconds: float, *, x: int = 0, y: int = 0, z: int = 500, r: int = 0, every_s: float = 0.1
) -> list[Frame]:
    """Hold the sticks for a while; return the frames of the autopilot."""
    frames: list[Frame] = []
    for _ in range(round(seconds / every_s)):
        world.send("MANUAL_CONTROL", target=1, x=x, y=y, z=z, r=r, buttons=0)
        frames += world.run(every_s)
    return frames
