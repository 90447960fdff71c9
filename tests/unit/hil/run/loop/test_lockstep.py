"""One tick of several vehicles: which errors lose an autopilot, which end the run, and what is recorded of the tick."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from hil.run.part import FlightEnded
from hil.run.runs.lockstep import Lockstep
from hil.run.runs.tick_loop import VehicleFailed
from signals.errors import HandshakeError, LinkClosed, ModelRangeError

LOST = LinkClosed("autopilot", "its process ended")


class Vehicle:
    """Stand-in for a flight and its scheduler, which raises `error` in `phase` of tick 1."""

    def __init__(self, name: str, phase: str = "", error: Exception | None = None, on_loss: str = "go_on") -> None:
        self.name = name
        self.calls: list[tuple[str, int]] = []
        self.events: list[str] = []
        self.tick, self.lost, self.over = 0, False, False
        self._fails, self._error = phase, error
        config = SimpleNamespace(autopilot=SimpleNamespace(on_loss=on_loss))
        self.run = SimpleNamespace(
            bench=SimpleNamespace(config=config), scheduler=self, event=lambda _, text: self.events.append(text)
        )

    def _call(self, phase: str) -> None:
        if phase == self._fails and self.tick == 1 and self._error is not None:
            raise self._error
        self.calls.append((phase, self.tick))

    def begin(self) -> tuple[float, ...]:
        self._call("begin")
        return (0.5,) * 4

    def send(self, truth: Any, began_ns: int) -> None:
        self._call("send")

    def work(self) -> None:
        self._call("work")

    def fall(self, truth: Any) -> None:
        self._call("fall")

    def wait(self) -> None:
        self._call("wait")
        self.tick += 1


def fly(*vehicles: Any, ticks: int = 3) -> None:
    world: Any = SimpleNamespace(advance=lambda _, controls: list(controls), take_contacts=list)
    lockstep = Lockstep(vehicles, world, lambda truths: None, lambda truths, contacts: None)
    for _ in range(ticks):
        lockstep.step()


@pytest.mark.parametrize("phase", ["begin", "send", "wait"])
def test_every_tick_of_a_vehicle_that_loses_its_autopilot_is_recorded_once(phase: str) -> None:
    a, b = Vehicle("a", phase, LOST), Vehicle("b")
    fly(a, b)
    assert a.lost
    assert [tick for call, tick in a.calls if call in ("work", "fall")] == [0, 1, 2]
    assert (a.tick, b.tick) == (3, 3)
    assert not b.lost


@pytest.mark.parametrize(
    ("phase", "error"),
    [
        ("work", LinkClosed("companion detector", "ended", cause="companion")),
        ("send", HandshakeError("autopilot", "refuses the mission")),
        ("wait", RuntimeError("a defect")),
    ],
)
def test_on_loss_applies_to_a_lost_autopilot_alone(phase: str, error: Exception) -> None:
    with pytest.raises(VehicleFailed, match="a") as failed:
        fly(Vehicle("a", phase, error), Vehicle("b"))
    assert failed.value.__cause__ is error


def test_the_end_of_a_flight_is_no_error_of_a_vehicle() -> None:
    with pytest.raises(FlightEnded):
        fly(Vehicle("a", "wait", FlightEnded("the test suite has ended")), Vehicle("b"))


def test_a_vehicle_outside_the_range_of_the_model_is_named() -> None:
    def advance(tick: int, controls: Any) -> Any:
        raise ModelRangeError(tick, "speed_mps", 300.0, "at most 200", vehicle="b")

    world: Any = SimpleNamespace(advance=advance, take_contacts=list)
    vehicles: Any = Vehicle("a"), Vehicle("b")
    lockstep = Lockstep(vehicles, world, lambda truths: None, lambda truths, contacts: None)
    with pytest.raises(VehicleFailed) as caught:
        lockstep.step()
    assert caught.value.name == "b"
