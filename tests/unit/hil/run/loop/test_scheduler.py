"""The tick: order and counts of its phases, the one-tick delay, and the state after a failure."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import pytest

from firmware_bridge.links.autopilot_link import LinkCaps
from hil.run.loop.scheduler import Scheduler, SensorSlot, Wiring
from signals.errors import LockstepLost, ModelRangeError
from signals.samples import ActuatorFrame, BaroSample, ImuSample, TruthState
from signals.time import RateAccumulator

TICK_NS = 4_000_000


class Script:
    """Stand-in for physics, sensor, link, commands and recorder at once; lists the calls.

    `fail` names the error that a call raises, and at which tick.
    """

    name = "imu"

    def __init__(self, **caps: Any) -> None:
        settings = {"lockstep": True, "deterministic": True, "boot_sensors": 0} | caps
        self.caps = LinkCaps("script", **settings)
        self.calls: list[tuple[Any, ...]] = []
        self.commands: dict[int, ActuatorFrame] = {}  # free-running: by the tick at whose beginning they are there
        self.fail: dict[str, tuple[int, Exception]] = {}
        self.tick = -1

    def note(self, *what: Any) -> None:
        self.calls.append(what)
        tick, error = self.fail.get(what[0], (None, None))
        if error is not None and tick == self.tick:
            raise error

    def names(self) -> list[str]:
        return [call[0] for call in self.calls]

    # physics, sensor, ground station

    def advance(self, tick: int, controls: Sequence[float]) -> TruthState:
        self.tick = tick
        self.note("advance", tick, controls[0])
        zero = (0.0, 0.0, 0.0)
        return TruthState(tick, tick * TICK_NS, zero, (1.0, 0.0, 0.0, 0.0), zero, zero, zero, zero, (), False)

    def take_events(self) -> list[Any]:
        return []

    def sample(self, truth: TruthState, seq: int) -> ImuSample:
        self.note("imu", seq)
        return ImuSample(seq, truth.t_ns, truth.t_ns, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0), 20.0)

    def step(self, t_ns: int, frames: Sequence[Any]) -> bytes:
        self.note("commands", list(frames))
        return b"hello"

    # link

    def begin(self, tick: int) -> ActuatorFrame | None:
        self.note("begin", tick)
        return self.commands.get(tick)

    def observe(self, truth: TruthState, wind: Any) -> None:
        self.note("observe", truth.tick, wind)

    def send(self, tick: int, t_ns: int, samples: Any, extra: bytes) -> bytes:
        self.note("send", tick, samples.baro.seq if samples.baro else None)
        return b"sent"

    def wait(self, tick: int, t_ns: int) -> ActuatorFrame | None:
        self.note("wait", tick)
        if self.caps.lockstep and tick >= self.caps.boot_sensors:
            return ActuatorFrame(tick, t_ns, (0.1 * tick,) + (0.0,) * 15, True, 129)
        return None

    def take_frames(self) -> list[Any]:
        self.note("take")
        return [f"frame{self.tick}"]

    # recorder

    @property
    def recorder(self) -> Any:
        script = self

        class Recorder:
            def __getattr__(self, what: str) -> Any:
                return lambda *values: script.note(f"rec {what}", *values)

        return Recorder()


class LateBaro:
    """A barometer at 50 Hz whose samples arrive 10 ms after they were taken."""

    name = "baro"

    def sample(self, truth: TruthState, seq: int) -> BaroSample:
        return BaroSample(seq, truth.t_ns, truth.t_ns + 10_000_000, 101325.0, 0.0, 15.0)


class DroppingSensor:
    """A barometer whose every third sample drops out; lists the numbers that it is asked for."""

    name = "baro"

    def __init__(self) -> None:
        self.asked: list[int] = []

    def sample(self, truth: TruthState, seq: int) -> BaroSample | None:
        self.asked.append(seq)
        return None if seq % 3 == 1 else BaroSample(seq, truth.t_ns, truth.t_ns, 101325.0, 0.0, 15.0)


def make(script: Script, *more: SensorSlot, **settings: Any) -> Scheduler:
    wiring = Wiring(
        physics=script,
        sensors=[*more, SensorSlot(script, RateAccumulator(event_millihz=250_000, tick_millihz=250_000))],
        link=script,  # type: ignore[arg-type]
        ports={"imu": "imu", "barometer": "baro"},
        commands=[script],
        recorder=script.recorder,
    )
    return Scheduler(wiring, tick_ns=TICK_NS, **settings)


def run(scheduler: Scheduler, ticks: int) -> None:
    for _ in range(ticks):
        scheduler.step()


def arguments_of(script: Script, *names: str) -> list[Any]:
    """Return the arguments of each call of these names."""
    return [call[1] for call in script.calls if call[0] in names]


def test_phases_come_in_the_written_order_once_per_tick() -> None:
    script = Script()
    scheduler = make(script)
    scheduler.step()
    phases = ["advance", "imu", "commands", "send", "rec truth", "rec sample", "rec sent", "wait", "take"]
    assert script.names() == phases
    run(scheduler, 9)
    for name in phases:
        assert script.names().count(name) == 10, name
    scheduler.flush()
    assert scheduler.step_ns.count == 10
    assert scheduler.own_ns.count == 1  # of tick 0: its clock is a system call, so not every tick is measured
    assert scheduler.turnaround_ns.count == 9


def test_actuators_move_the_vehicle_one_tick_later_and_none_are_invented() -> None:
    script = Script(boot_sensors=2)
    run(make(script), 5)
    assert [call[2] for call in script.calls if call[0] == "advance"] == pytest.approx([0.0, 0.0, 0.0, 0.2, 0.3])


def test_the_station_receives_a_tick_later_and_the_record_is_in_order() -> None:
    script = Script(boot_sensors=2)
    scheduler = make(script)
    run(scheduler, 4)
    assert arguments_of(script, "commands") == [[], ["frame0"], ["frame1"], ["frame2"]]
    scheduler.flush()
    scheduler.flush()  # nothing left the second time
    told = [call for call in script.calls if call[0].startswith("rec") and call[0] != "rec sample"]
    record = [(name, getattr(of, "tick", of)) for name, of, *_ in told]
    expected: list[tuple[str, int]] = []
    for k in range(4):
        expected += [("rec truth", k), ("rec sent", k), ("rec received", k)]
        if k >= 2:
            expected.append(("rec actuators", k))
    assert record == expected


def test_a_sensor_with_latency_reaches_the_autopilot_late() -> None:
    script = Script()
    run(make(script, SensorSlot(LateBaro(), RateAccumulator(event_millihz=50_000, tick_millihz=250_000))), 10)
    arrivals = {call[1]: call[2] for call in script.calls if call[0] == "send" and call[2] is not None}
    # Captured on ticks 0 and 5, available 10 ms later: the first ticks at or after are 3 and 8.
    assert arrivals == {3: 0, 8: 1}


def test_a_lost_reply_ends_the_run_and_what_did_arrive_is_recorded() -> None:
    script = Script()
    script.fail["wait"] = (3, LockstepLost("pty", "no reply"))
    scheduler = make(script)
    with pytest.raises(LockstepLost):
        run(scheduler, 10)
    scheduler.flush()
    assert script.calls[-1][0] == "rec received"
    assert script.calls[-1][-1] == ["frame3"]
    assert [frame.tick for frame in arguments_of(script, "rec actuators")] == [0, 1, 2]
    assert script.names().count("send") == 4  # nothing was sent after the failure


def test_a_failed_physics_step_is_never_sent() -> None:
    script = Script()
    script.fail["advance"] = (2, ModelRangeError(2, "p_WB[0]", float("nan"), "finite"))
    with pytest.raises(ModelRangeError, match=r"tick 2: p_WB\[0\] = nan"):
        run(make(script), 10)
    assert arguments_of(script, "send") == [0, 1]


def test_a_paced_run_never_runs_ahead_of_the_wall_clock() -> None:
    scheduler = make(Script(), pace=2.0)
    start = time.perf_counter_ns()
    run(scheduler, 26)
    assert time.perf_counter_ns() - start >= 25 * TICK_NS / 2


def test_a_sample_that_drops_out_is_counted() -> None:
    """The noise of a sample is keyed by its number, so it must not depend on which samples before it dropped out."""
    script, sensor = Script(), DroppingSensor()
    slot = SensorSlot(sensor, RateAccumulator(event_millihz=250_000, tick_millihz=250_000))
    scheduler = make(script, slot)
    for _ in range(7):
        scheduler.step()
    assert sensor.asked == list(range(7))
    assert slot.samples == 7
    recorded = [call[2].seq for call in script.calls if call[0] == "rec sample" and call[1] == "baro"]
    assert recorded == [0, 2, 3, 5, 6]
