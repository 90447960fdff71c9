"""Order of the steps of a tick for autopilots that run freely, that share the bench's processor, or that restart."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from firmware_bridge.autopilots.catalog import PROFILES
from firmware_bridge.links.autopilot_link import LinkCaps
from firmware_bridge.links.px4.lockstep import LockstepLink
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.transports.loopback import LoopbackTransport
from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.loop.scheduler import PHASES, Scheduler, SensorSlot
from signals.errors import LockstepLost
from signals.samples import ActuatorFrame, ImageSample
from signals.time import RateAccumulator
from tests.unit.hil.run.loop.test_scheduler import TICK_NS, Script, make


def command(tick: int, value: float) -> ActuatorFrame:
    return ActuatorFrame(tick, tick * TICK_NS, (value,) + (0.0,) * 15, True, 181)


def test_a_free_running_tick_begins_with_the_newest_command() -> None:
    script = Script(lockstep=False, deterministic=False)
    script.commands = {2: command(2, 0.5), 3: command(3, 0.6)}
    scheduler = make(script, pace=1.0)  # ignored: a free-running link starts each tick by its own clock
    for _ in range(5):
        scheduler.step()
    ticks = " ".join(script.names()).split("begin")[1:]
    assert [tick.split()[0] for tick in ticks] == ["advance"] * 5
    assert script.names()[:9] == [
        "begin", "advance", "imu", "commands", "send", "rec truth", "rec sample", "rec sent", "wait",
    ]  # fmt: skip
    # A command moves the vehicle from the first tick that begins after its arrival, until a newer command arrives.
    assert [call[2] for call in script.calls if call[0] == "advance"] == [0.0, 0.0, 0.5, 0.6, 0.6]
    # Recorded once, in the tick in which it applies, after the frames of that tick.
    recorded = [call for call in script.calls if call[0] in ("rec actuators", "rec received", "rec truth")]
    names = [(call[0], call[1].tick if call[0] == "rec actuators" else None) for call in recorded]
    begins = names.index(("rec actuators", 2))
    assert names[begins - 1][0] == "rec received"
    assert names[begins + 1][0] == "rec truth"
    assert [tick for what, tick in names if what == "rec actuators"] == [2, 3]
    assert scheduler.actuators == script.commands[3]
    assert scheduler.late == 0


def test_a_link_that_takes_truth_gets_it_before_the_send() -> None:
    script = Script(takes_truth=True)
    scheduler = make(script, wind_at=lambda: (1.0, 2.0, 3.0))
    scheduler.step()
    at = script.names().index("observe")
    assert script.calls[at : at + 2] == [("observe", 0, (1.0, 2.0, 3.0)), ("send", 0, None)]


def test_after_a_skipped_tick_all_controls_are_zero() -> None:
    script = Script()
    scheduler = make(script)
    for _ in range(4):
        scheduler.step()
    assert scheduler.actuators.controls[0] == pytest.approx(0.3)
    script.fail["wait"] = (4, LockstepLost("script", "rebooted"))
    with pytest.raises(LockstepLost):
        scheduler.step()
    scheduler.skip_tick()
    assert (scheduler.tick, scheduler.actuators.armed) == (5, False)
    scheduler.step()
    assert [call[1:] for call in script.calls if call[0] == "advance"][-1] == (5, 0.0)
    # What the failed tick received is on record, in its place.
    received = [call[1] for call in script.calls if call[0] == "rec received"]
    assert received == [0, 1, 2, 3, 4]


def scheduler_that(record_first: bool, *arguments: Any, **settings: Any) -> Scheduler:
    scheduler = Scheduler(*arguments, **settings)
    scheduler.record_first = record_first
    return scheduler


def test_the_same_bytes_on_disk_in_either_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A flight of the mock, recorded during its computing, and before the send as on a shared processor."""
    (tmp_path / "bench.yaml").write_text("")
    settings = ("autopilot.transport=loopback", "duration_s=12", "record.report=false")
    mission = "rigs/missions/square.waypoints"
    bench = load_bench(
        tmp_path / "bench.yaml", mission=str(Path(__file__).resolve().parents[5] / mission), settings=settings
    )
    digests = []
    for record_first in (False, True):
        caps = LinkCaps("mock", lockstep=True, deterministic=True, boot_sensors=20)
        link = LockstepLink(LoopbackTransport(MockPixhawk(boot_sensors=20)), caps)
        profile = replace(PROFILES["mock"], make_link=lambda *_, link=link: link)
        monkeypatch.setitem(PROFILES, "mock", profile)
        monkeypatch.setattr("hil.run.runs.vehicle_run.Scheduler", partial(scheduler_that, record_first))
        out = tmp_path / str(record_first)
        result = run_bench(bench, out, quiet=True)
        assert result.run["error"] is None
        assert result.run["sim_s"] == 12.0
        files = [hashlib.sha256((out / name).read_bytes()).hexdigest() for name in ("run.mcap", "flight.tlog")]
        digests.append((result.run["digest"], *files))
    assert digests[0] == digests[1]


class Watcher:
    """A camera whose every second picture takes a tick to arrive."""

    name = "front"

    def __init__(self, script: Script) -> None:
        self._script = script

    def sample(self, truth: Any, seq: int) -> Any:
        self._script.note("look", truth.tick)
        return ImageSample(seq, truth.t_ns, truth.t_ns + seq % 2 * TICK_NS, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), {})


@pytest.mark.parametrize(
    ("record_first", "order"),
    [
        (False, ["imu", "commands", "send", "look", "rec truth", "rec sample", "rec sample", "rec sent", "wait"]),
        (True, ["imu", "commands", "look", "rec truth", "rec sample", "rec sample", "send", "rec sent", "wait"]),
    ],
)
def test_cameras_are_sampled_after_the_send_or_before_it_on_a_shared_processor(
    record_first: bool, order: list[str]
) -> None:
    script = Script()
    rate = RateAccumulator(event_millihz=250_000, tick_millihz=250_000)
    scheduler = make(script, SensorSlot(Watcher(script), rate, after_send=True))
    scheduler.record_first = record_first
    for _ in range(4):
        scheduler.step()
    scheduler.flush()
    names = script.names()
    assert names[names.index("imu") : names.index("take")] == order
    told = [(call[1], call[2].seq) for call in script.calls if call[0] == "rec sample"]
    # A picture without delay is released in its own tick, a delayed one in the next tick, before that tick's picture.
    assert [seq for port, seq in told if port == "front"] == [0, 1, 2]
    assert told[:2] == [("imu", 0), ("front", 0)]
    ticks = [n for n, call in enumerate(script.calls) if call[0] == "rec truth"]
    third = [call[2].seq for call in script.calls[ticks[2] :] if call[0] == "rec sample" and call[1] == "front"]
    assert third == [1, 2]
    assert all(scheduler.phase_ns[name].count == 4 for name in PHASES)
