"""The tick: order and counts of its phases, the one-tick delay, and what is left after a failure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from firmware_bridge.links.autopilot_link import LinkCaps
from hil.scheduler import Scheduler, SensorSlot
from hil.signals.errors import LockstepLost, ModelRangeError
from hil.signals.samples import ActuatorFrame, BaroSample, ImuSample, TruthState
from hil.signals.time import RateAccumulator

TICK_NS = 4_000_000


class Script:
    """Stands for physics, sensor, link, ground station and recorder at once, and writes down who called what."""

    caps = LinkCaps("script", lockstep=True, deterministic=True, boot_sensors=0)

    name = "imu"

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []
        self.fail: dict[str, tuple[int, Exception]] = {}
        self.tick = -1

    def _note(self, what: str, *details: object) -> None:
        self.calls.append((what, *details))
        if what in self.fail and self.fail[what][0] == self.tick:
            raise self.fail[what][1]

    def advance(self, tick: int, controls: Sequence[float]) -> TruthState:
        self.tick = tick
        self._note("advance", tick, controls[0])
        zero = (0.0, 0.0, 0.0)
        return TruthState(tick, tick * TICK_NS, zero, (1.0, 0.0, 0.0, 0.0), zero, zero, zero, zero, (), False)

    def take_events(self) -> list[object]:
        return []

    def sample(self, truth: TruthState, seq: int) -> ImuSample:
        self._note("imu", seq)
        return ImuSample(seq, truth.t_ns, truth.t_ns, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0), 20.0)

    def step(self, t_ns: int, frames: Sequence[object]) -> bytes:
        self._note("station", t_ns, list(frames))
        return b"hello"

    def send(self, tick, t_ns, imu, mag, baro, gps, extra, ranging) -> bytes:  # type: ignore[no-untyped-def]
        self._note("send", tick, imu.seq if imu else None, baro.seq if baro else None, extra)
        return extra + b"sensor"

    def wait(self, tick: int, t_ns: int) -> ActuatorFrame | None:
        self._note("wait", tick)
        return ActuatorFrame(tick, t_ns, (0.5 + tick,) + (0.0,) * 15, True, 129) if tick >= 2 else None

    def take_frames(self) -> list[object]:
        self._note("take")
        return [f"frame{self.tick}"]

    def truth(self, truth: TruthState) -> None:
        self._note("rec truth", truth.tick)

    def recorded_sample(self, port: str, sample: ImuSample) -> None:
        self._note("rec sample", port, sample.seq)

    def sent(self, tick: int, t_ns: int, data: bytes) -> None:
        self._note("rec sent", tick, data)

    def received(self, tick: int, t_ns: int, frames: Sequence[object]) -> None:
        self._note("rec received", tick, list(frames))

    def actuators(self, frame: ActuatorFrame) -> None:
        self._note("rec actuators", frame.tick)


class ScriptRecorder:
    def __init__(self, script: Script) -> None:
        self.truth, self.sample, self.sent = script.truth, script.recorded_sample, script.sent
        self.received, self.actuators = script.received, script.actuators


class LateBaro:
    """A barometer at 50 Hz whose samples arrive 10 ms after they were taken."""

    name = "baro"

    def sample(self, truth: TruthState, seq: int) -> BaroSample:
        return BaroSample(seq, truth.t_ns, truth.t_ns + 10_000_000, 101325.0, 0.0, 15.0)


def make(script: Script, *, baro: bool = False) -> Scheduler:
    sensors = [SensorSlot(script, RateAccumulator(event_mhz=250_000, tick_mhz=250_000))]
    if baro:
        sensors.append(SensorSlot(LateBaro(), RateAccumulator(event_mhz=50_000, tick_mhz=250_000)))
    return Scheduler(
        tick_ns=TICK_NS,
        physics=script,
        sensors=sensors,
        link=script,  # type: ignore[arg-type]
        ports={"imu": "imu", "barometer": "baro"},
        commands=[script],
        recorder=ScriptRecorder(script),  # type: ignore[arg-type]
    )


def run(scheduler: Scheduler, ticks: int) -> None:
    for _ in range(ticks):
        scheduler.step()


def test_phases_come_in_the_written_order_once_per_tick() -> None:
    script = Script()
    scheduler = make(script)
    scheduler.step()
    names = [call[0] for call in script.calls]
    assert names == ["advance", "imu", "station", "send", "rec truth", "rec sample", "rec sent", "wait", "take"]
    for _ in range(9):
        scheduler.step()
    for name in ("advance", "imu", "station", "send", "wait", "take", "rec truth", "rec sent"):
        assert sum(call[0] == name for call in script.calls) == 10, name
    assert scheduler.own_ns.count == scheduler.step_ns.count == 10


def test_actuators_move_the_vehicle_one_tick_later_and_none_are_invented() -> None:
    script = Script()
    scheduler = make(script)
    for _ in range(5):
        scheduler.step()
    assert [call[2] for call in script.calls if call[0] == "advance"] == [0.0, 0.0, 0.0, 2.5, 3.5]


def test_the_station_hears_a_tick_later_and_the_record_is_in_order() -> None:
    script = Script()
    scheduler = make(script)
    for _ in range(4):
        scheduler.step()
    assert [call[2] for call in script.calls if call[0] == "station"] == [[], ["frame0"], ["frame1"], ["frame2"]]
    scheduler.flush()
    scheduler.flush()  # nothing left the second time
    record = [call[:2] for call in script.calls if call[0].startswith("rec") and call[0] != "rec sample"]
    expected: list[tuple[str, int]] = []
    for k in range(4):
        expected += [("rec truth", k), ("rec sent", k), ("rec received", k)]
        if k >= 2:
            expected.append(("rec actuators", k))
    assert record == expected


def test_a_sensor_with_latency_reaches_the_autopilot_late() -> None:
    script = Script()
    scheduler = make(script, baro=True)
    for _ in range(10):
        scheduler.step()
    arrivals = {call[1]: call[3] for call in script.calls if call[0] == "send" and call[3] is not None}
    # Captured on ticks 0 and 5, available 10 ms later: the first ticks at or after are 3 and 8.
    assert arrivals == {3: 0, 8: 1}


def test_a_lost_reply_ends_the_run_and_what_did_arrive_is_recorded() -> None:
    script = Script()
    script.fail["wait"] = (3, LockstepLost("pty", "no reply"))
    scheduler = make(script)
    with pytest.raises(LockstepLost):
        run(scheduler, 10)
    scheduler.flush()
    assert script.calls[-1] == ("rec received", 3, ["frame3"])
    assert [call[1] for call in script.calls if call[0] == "rec actuators"] == [2]
    assert sum(call[0] == "send" for call in script.calls) == 4  # nothing was sent after the failure


def test_a_failed_physics_step_is_never_sent() -> None:
    script = Script()
    script.fail["advance"] = (2, ModelRangeError(2, "p_WB[0]", float("nan"), "finite"))
    scheduler = make(script)
    with pytest.raises(ModelRangeError, match=r"tick 2: p_WB\[0\] = nan"):
        run(scheduler, 10)
    assert [call[1] for call in script.calls if call[0] == "send"] == [0, 1]


def test_a_paced_run_never_runs_ahead_of_the_wall_clock() -> None:
    script = Script()
    scheduler = Scheduler(
        tick_ns=TICK_NS,
        physics=script,
        sensors=[],
        link=script,  # type: ignore[arg-type]
        ports={"imu": "imu"},
        commands=[],
        recorder=ScriptRecorder(script),  # type: ignore[arg-type]
        pace=2.0,
    )
    import time

    start = time.perf_counter_ns()
    for _ in range(26):
        scheduler.step()
    assert time.perf_counter_ns() - start >= 25 * TICK_NS / 2
