"""The mock flown in lockstep over a wire with declared faults: it flies well, or ends with the right named error."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from firmware_bridge.autopilots.mock.mock import mock_command
from firmware_bridge.faults.faulty_transport import FaultyTransport
from firmware_bridge.faults.link_fault import LinkFault
from firmware_bridge.ground_station.phased_flight import Phase
from firmware_bridge.ground_station.station import GroundStation
from firmware_bridge.links.autopilot_link import LinkCaps, LinkTimeouts
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.px4.lockstep import LockstepLink
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.transports.loopback import LoopbackTransport
from firmware_bridge.transports.pty import PtyTransport
from firmware_bridge.transports.transport import Transport
from hil.config import Bench, load_bench
from hil.config.missions.path import planned_path
from hil.run.loop.scheduler import Scheduler, SensorSlot, Wiring
from hil.run.verdict.flight import FlightMeasurement, judge
from signals.errors import HandshakeError, LinkClosed, LockstepLost, PortNotFound
from signals.time import NS_PER_S, RateAccumulator
from sim.physics.vehicle_physics import VehiclePhysics
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation
from tests.worlds.hop_flights import HOP
from tests.worlds.patience import PATIENCE_S, expect_silence

BOOT = 20
CAPS = LinkCaps("mock", lockstep=True, deterministic=True, boot_sensors=BOOT)
TICK_NS = 4_000_000


@cache
def bench(mission: Path | None) -> Bench:
    """Return the default bench with this mission."""
    return load_bench(mission=None if mission is None else str(mission))


class NoRecorder:
    """A recorder that keeps the events only."""

    def __init__(self) -> None:
        self.events: list[tuple[int, str, str]] = []

    def event(self, t_ns: int, kind: str, text: str) -> None:
        self.events.append((t_ns, kind, text))

    def truth(self, *_: Any) -> None: ...

    sample = sent = received = actuators = truth


class Flight:
    """The default mission, flown over a faulty wire to the mock: in memory, or in its own process on a pty."""

    def __init__(
        self,
        faults: Sequence[LinkFault],
        *,
        seed: int = 1,
        process: bool = False,
        silent_from_ns: int | None = None,
        mission: Path | None = None,
    ) -> None:
        """`silent_from_ns`: tick from which no answer is awaited. `mission`: another than the default one."""
        self.bench = bench(mission)
        config = self.bench.config
        self.recorder = NoRecorder()
        self.scheduler: Scheduler | None = None
        self.silent_from_ns = silent_from_ns
        pty = PtyTransport()
        inner: Transport = pty if process else LoopbackTransport(MockPixhawk(boot_sensors=BOOT))
        self.wire = FaultyTransport(inner, faults, seed, self.now_ns, self.recorder.event)
        self.link = LockstepLink(
            self.wire,
            CAPS,
            start_process=(lambda: ChildProcess(mock_command(pty.far_path, boot_sensors=BOOT))) if process else None,
            timeouts=LinkTimeouts(PATIENCE_S, connect_s=PATIENCE_S if process else 1.0),
        )
        self.physics = VehiclePhysics(self.bench.vehicle, self.bench.scene, TICK_NS)
        x, y, z = self.physics.state[:3].tolist()
        self.station = GroundStation(self.bench.mission.items)
        self.measurement = FlightMeasurement(
            planned_path(self.bench.mission, self.bench.scene, home_W=(x, y, z)), config.limits
        )
        self.slots = [
            SensorSlot(
                make_sensor(
                    Installation(name, rate_hz=sensor.rate_hz, seed=seed, scene=self.bench.scene, step_ns=TICK_NS),
                    kind=sensor.kind,
                    overrides=sensor.parameters.model_dump(),
                ),
                RateAccumulator(event_millihz=round(sensor.rate_hz * 1000), tick_millihz=250_000),
            )
            for name, sensor in config.sensors.items()
        ]

    def now_ns(self) -> int:
        return 0 if self.scheduler is None else self.scheduler.t_ns

    def fly(self, limit_s: float) -> None:
        """Fly to the mission's end or for `limit_s`. Raises the link's errors."""
        try:
            self.link.open()
            wiring = Wiring(
                physics=self.physics,
                sensors=self.slots,
                link=self.link,
                ports={"imu": "imu", "gps": "gps", "barometer": "baro", "magnetometer": "mag"},
                commands=[self.station],
                recorder=self.recorder,  # type: ignore[arg-type]
                observers=[self.measurement.add],
            )
            self.scheduler = Scheduler(wiring, tick_ns=TICK_NS)
            while self.scheduler.t_ns < limit_s * NS_PER_S and self.station.phase is not Phase.DONE:
                if self.scheduler.t_ns == self.silent_from_ns:
                    expect_silence(self.link)
                self.scheduler.step()
        finally:
            self.link.close()

    @property
    def passed(self) -> bool:
        return judge(self.measurement.result(), self.bench.config.limits).status == "PASS"

    @property
    def height_m(self) -> float:
        return float(self.physics.state[2])

    @property
    def state(self) -> list[float]:
        return list(self.physics.state.tolist())


RATES = pytest.mark.parametrize("rate", [pytest.param(0.001, marks=pytest.mark.slow), 0.01, 0.1])
DIRECTIONS = pytest.mark.parametrize("direction", ["to_autopilot", "from_autopilot"])
WHOLE_MISSION_S = 200.0
UPLOAD = ("MISSION_ITEM_INT", "MISSION_REQUEST_INT", "MISSION_COUNT")
START_S, END_S = 2.0, 15.0  # armed, climbing and on its way


@pytest.fixture(scope="module")
def undisturbed() -> Flight:
    """Fly the same mission over a wire without faults."""
    flight = Flight([])
    flight.fly(END_S)
    return flight


@RATES
@DIRECTIONS
@pytest.mark.parametrize("kind", ["drop", "duplicate", "corrupt"])
def test_faults_fatal_to_lockstep_end_as_lockstep_lost(kind: str, direction: str, rate: float) -> None:
    """At 250 messages a second even the lowest rate soon hits a sensor message or an answer."""
    flight = Flight([LinkFault(kind=kind, direction=direction, at_s=START_S, rate=rate)])  # type: ignore[arg-type]
    if kind == "duplicate" and direction == "to_autopilot":
        flight.fly(END_S)  # PX4 and the mock ignore a repeated time
        assert flight.now_ns() == END_S * NS_PER_S
    else:
        with pytest.raises(LockstepLost, match="time_usec"):
            flight.fly(END_S)
        assert START_S * NS_PER_S <= flight.now_ns() < END_S * NS_PER_S
    assert flight.wire.hits()[0] >= 1
    listed = [event for event in flight.recorder.events if "more units" not in event[2]]
    assert len(listed) == min(flight.wire.hits()[0], 1000)
    assert all(t_ns >= START_S * NS_PER_S and kind_ == "fault" for t_ns, kind_, _ in listed)


@pytest.mark.parametrize(
    "held",
    [
        *({"kind": "delay", "rate": rate, "delay_s": 0.0002} for rate in (0.001, 0.01, 0.1)),
        {"kind": "stall", "for_s": 0.05},
    ],
)
@DIRECTIONS
def test_delays_below_the_reply_limit_change_nothing(direction: str, held: dict[str, Any], undisturbed: Flight) -> None:
    fault = LinkFault(direction=direction, at_s=START_S, **held)  # type: ignore[arg-type]
    flight = Flight([fault])
    flight.fly(END_S)
    assert flight.wire.hits()[0] >= 1
    assert flight.state == undisturbed.state  # simulated time stood still meanwhile


@RATES
@DIRECTIONS
def test_reordered_messages_are_flown_through(direction: str, rate: float) -> None:
    fault = LinkFault(kind="reorder", direction=direction, at_s=START_S, rate=rate, delay_s=0.0002)  # type: ignore[arg-type]
    flight = Flight([fault])
    flight.fly(END_S)
    assert flight.wire.hits()[0] >= 1
    assert flight.now_ns() == END_S * NS_PER_S
    assert flight.height_m > 3.0


@RATES
def test_the_mission_survives_losses_of_redundant_messages(rate: float, tmp_path: Path) -> None:
    """The upload repeats requests, the estimator bridges missing fixes, telemetry is periodic.

    At the lowest rate only the long mission has enough messages.
    """
    hop = tmp_path / "hop.waypoints"
    hop.write_text(HOP)
    flight = Flight(
        [
            LinkFault(kind="drop", at_s=0, rate=rate, messages=UPLOAD),
            LinkFault(kind="drop", at_s=0, rate=rate, messages=("HIL_GPS",)),
            LinkFault(kind="corrupt", at_s=0.1, rate=rate, messages=("ATTITUDE", "LOCAL_POSITION_NED", "SYS_STATUS")),
            LinkFault(kind="duplicate", at_s=0, rate=rate, messages=("HIL_GPS", "COMMAND_LONG", *UPLOAD)),
        ],
        mission=hop if rate > 0.001 else None,
    )
    flight.fly(WHOLE_MISSION_S)
    assert flight.station.phase is Phase.DONE
    assert flight.passed
    assert flight.wire.hits()[1] >= 1


def test_an_upload_that_never_gets_through_is_named() -> None:
    flight = Flight([LinkFault(kind="drop", at_s=0, rate=1.0, messages=("MISSION_ITEM_INT",))])
    with pytest.raises(HandshakeError, match="mission"):
        flight.fly(WHOLE_MISSION_S)


@pytest.mark.parametrize("kind", ["drop", "corrupt"])
def test_no_heartbeat_is_named(kind: str) -> None:
    flight = Flight([LinkFault(kind=kind, direction="from_autopilot", at_s=0, rate=1.0)])  # type: ignore[arg-type]
    with pytest.raises(HandshakeError, match="no heartbeat"):
        flight.fly(END_S)


@DIRECTIONS
def test_a_stall_beyond_the_reply_limit_is_named(direction: str) -> None:
    stall = LinkFault(kind="stall", direction=direction, at_s=START_S)  # type: ignore[arg-type]
    flight = Flight([stall], silent_from_ns=int(START_S * NS_PER_S))
    with pytest.raises(LockstepLost):
        flight.fly(END_S)
    assert flight.now_ns() == START_S * NS_PER_S


def test_a_boot_that_loses_a_sensor_message_is_named() -> None:
    flight = Flight([LinkFault(kind="drop", direction="to_autopilot", at_s=0.04, for_s=0.004, rate=1.0)])
    with pytest.raises(LockstepLost, match="boot_sensors"):
        flight.fly(END_S)
    assert flight.now_ns() == BOOT * TICK_NS


@pytest.mark.parametrize("process", [False, True])
def test_an_unplugged_wire_is_named_and_can_be_opened_again(process: bool) -> None:
    flight = Flight([LinkFault(kind="unplug", at_s=START_S, for_s=3600.0)], process=process)
    with pytest.raises(LinkClosed, match=r"unplugged by the declared link fault 0 at 2 s$") as caught:
        flight.fly(END_S)
    assert caught.value.cause == "unplugged"  # and not that its process has ended, or has closed the link
    assert flight.now_ns() == START_S * NS_PER_S
    with pytest.raises(PortNotFound, match="unplugged"):
        flight.link.open()
    flight.scheduler.tick += 3600 * 250  # type: ignore[union-attr]
    flight.link.open()
    flight.link.close()
    assert flight.wire.hits() == {0: 1}


def test_the_same_seed_hits_the_same_messages() -> None:
    fault = LinkFault(kind="drop", at_s=START_S, rate=0.05, messages=("HIL_GPS", "HEARTBEAT", "ATTITUDE"))
    flights = [Flight([fault], seed=seed) for seed in (1, 1, 2)]
    for flight in flights:
        flight.fly(END_S)
    first, again, other = flights
    assert first.recorder.events
    assert first.recorder.events == again.recorder.events
    assert first.state == again.state
    assert first.recorder.events != other.recorder.events


@pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")
@pytest.mark.parametrize("kind", ["corrupt", *(pytest.param(k, marks=pytest.mark.slow) for k in ("drop", "duplicate"))])
def test_over_a_serial_line_the_same_hits_and_errors_as_in_memory(kind: str) -> None:
    fault = LinkFault(kind=kind, at_s=START_S, rate=0.001)  # type: ignore[arg-type]
    ends: list[Any] = []
    for process in (False, True):
        # Over a pty only a time-out finds the lost message; a slow answer before it must not reach that.
        flight = Flight([fault], process=process, silent_from_ns=ends[0][0] if ends else None)
        with pytest.raises(LockstepLost):
            flight.fly(END_S)
        # The link's queries after the loss, for its cause, depend on the clock and may be hit as well.
        lost_ns = flight.now_ns()
        before = [event for event in flight.recorder.events if event[0] < lost_ns]
        at_last = [event for event in flight.recorder.events if event[0] == lost_ns]
        ends.append((lost_ns, before, at_last[:1]))
    assert ends[0] == ends[1]
