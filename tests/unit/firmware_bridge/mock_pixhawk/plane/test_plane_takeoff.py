"""Take-offs: a launch is seen where it is one and never before the engine, a roll rotates once and opens its limits."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.plane.engine_watch import EngineWatch
from firmware_bridge.mock_pixhawk.plane.pilot import PERIOD_S
from firmware_bridge.mock_pixhawk.plane.takeoff import PlaneTakeoff
from signals.units import RAD_PER_DEG

STEP_US = round(PERIOD_S * 1e6)


class RecordingPilot:
    """Keeps the last step that was asked of it: its name and what it was given."""

    def __init__(self) -> None:
        self.forward_force_mps2 = 0.0
        self.air = SimpleNamespace(airspeed_mps=0.0)
        self.course_rad = 0.0
        self.path: Any = None
        self.step: tuple[str, dict[str, Any]] = ("none", {})
        self.place = (0.0, 0.0, 0.0)

    def here(self) -> tuple[float, float, float]:
        return self.place

    def height_m(self) -> float:
        return -self.place[2]

    def take_over(self) -> None: ...

    def idle(self) -> None:
        self.step = ("idle", {})

    def attitude(self, roll: float, pitch: float, throttle: float) -> None:
        self.step = ("attitude", {"roll": roll, "pitch": pitch, "throttle": throttle})

    def fly(self, **wanted: Any) -> None:
        self.step = ("fly", wanted)

    def roll_on_ground(self, line: Any, **wanted: Any) -> None:
        self.step = ("roll", wanted | {"line": line})


class Takeoff:
    """A take-off with its recording pilot, stepped at 50 Hz."""

    def __init__(self, **params: float) -> None:
        table = ParamTable.of_firmware(plane=True)
        for name, value in params.items():
            assert table.set(name, value) is None
        self.pilot, self.said, self.now_us = RecordingPilot(), [], 0
        vehicle = SimpleNamespace(landed=True, yaw=0.0, pos_d=0.0, home=None)
        pilot: Any = self.pilot
        self.takeoff = PlaneTakeoff(pilot, vehicle, table, self.said.append)  # type: ignore[arg-type]
        self.takeoff.begin(0, -30.0, None)

    def run(self, seconds: float, *, force_mps2: float = 0.0, airspeed_mps: float = 0.0) -> str:
        self.pilot.forward_force_mps2, self.pilot.air.airspeed_mps = force_mps2, airspeed_mps
        for _ in range(round(seconds / PERIOD_S)):
            self.takeoff.climb(self.now_us)
            self.now_us += STEP_US
        return self.pilot.step[0]


def waiting(**more: float) -> Takeoff:
    return Takeoff(FW_LAUN_DETCN_ON=1, FW_LAUN_AC_THLD=12.0, FW_LAUN_AC_T=0.1, **more)


@pytest.mark.parametrize(
    ("force_mps2", "seconds"),
    [
        pytest.param(11.0, 3.0, id="too weak"),
        pytest.param(40.0, 0.08, id="a knock, too short"),
    ],
)
def test_what_is_no_launch_leaves_the_engine_idle(force_mps2: float, seconds: float) -> None:
    flight = waiting()
    assert flight.run(2.0) == "idle"
    assert flight.run(seconds, force_mps2=force_mps2) == "idle"
    assert flight.run(5.0) == "idle"
    assert flight.said == ["Waiting for launch"]
    assert not flight.takeoff.launched


def test_two_short_knocks_are_not_one_launch() -> None:
    flight = waiting()
    for _ in range(5):
        flight.run(0.08, force_mps2=40.0)
        flight.run(0.02)
    assert flight.pilot.step[0] == "idle"


# v^2 / 2 s of hand and catapult, and k s / m of a bungee at its beginning.
@pytest.mark.parametrize("force_mps2", [8.0**2 / 2.0, 16.0**2 / 8.0, 60.0 * 2.0 / 3.36])
def test_a_launch_starts_the_engine_after_its_delay_and_not_before(force_mps2: float) -> None:
    flight = waiting(FW_LAUN_MOT_DEL=0.4)
    flight.run(1.0)
    assert flight.run(0.08, force_mps2=force_mps2) == "idle"
    assert flight.run(0.06, force_mps2=force_mps2) == "attitude"
    assert flight.said[-1] == "Launch detected"
    assert flight.pilot.step[1]["throttle"] == 0.0
    assert flight.run(0.3) == "attitude"
    assert flight.pilot.step[1]["throttle"] == 0.0
    assert flight.run(0.2) == "fly"


def rolling(**more: float) -> Takeoff:
    roll = {"RWTO_TKOFF": 1, "RWTO_ROT_AIRSPD": 11.0, "RWTO_PSP": 11.4, "RWTO_ROT_TIME": 1.0, "RWTO_RAMP_TIME": 2.0}
    return Takeoff(FW_TKO_AIRSPD=13.0, **roll, **more)


def test_a_roll_ramps_its_throttle_and_holds_pitch_and_line() -> None:
    flight = rolling()
    assert flight.run(1.0, airspeed_mps=3.0) == "roll"
    wanted = flight.pilot.step[1]
    assert wanted["throttle"] == pytest.approx(0.49)  # of the step 0.98 s after the start
    assert wanted["pitch_rad"] == pytest.approx(11.4 * RAD_PER_DEG)
    assert (wanted["line"].t_n, wanted["line"].t_e) == (1.0, 0.0)
    assert flight.run(2.0, airspeed_mps=10.9) == "roll"
    assert flight.pilot.step[1]["throttle"] == 1.0


def test_the_nose_rises_at_the_rotation_speed_within_the_rotation_time() -> None:
    flight = rolling(FW_AIRSPD_STALL=9.0, FW_AIRSPD_MIN=10.8, FW_TKO_PITCH_MIN=15.0, FW_P_LIM_MAX=30.0)
    flight.run(3.0, airspeed_mps=10.0)
    flight.run(PERIOD_S, airspeed_mps=11.05)
    assert flight.run(PERIOD_S, airspeed_mps=11.05) == "fly"
    low, high = (flight.pilot.step[1][name] / RAD_PER_DEG for name in ("pitch_min_rad", "pitch_max_rad"))
    assert low == pytest.approx(11.4 + 0.02 * (15.0 - 11.4), abs=0.01)
    assert high == pytest.approx(11.4 + 0.02 * (30.0 - 11.4), abs=0.01)
    assert flight.pilot.step[1]["runway"] is not None  # wheels may still touch
    flight.pilot.place = (0.0, 0.0, -2.0)
    flight.run(1.0, airspeed_mps=12.0)
    assert flight.pilot.step[1]["pitch_min_rad"] == pytest.approx(15.0 * RAD_PER_DEG)
    assert flight.pilot.step[1]["runway"] is None


def test_without_a_rotation_speed_it_is_nine_tenths_of_the_take_off_speed() -> None:
    flight = Takeoff(RWTO_TKOFF=1, FW_TKO_AIRSPD=12.0)
    assert flight.run(3.0, airspeed_mps=10.7) == "roll"
    flight.run(PERIOD_S, airspeed_mps=10.9)
    assert flight.run(PERIOD_S, airspeed_mps=10.9) == "fly"


def roll_watch(speeds_mps: list[float]) -> float | None:
    """Return when an engine is found to have failed that gives these speeds, 50 a second [s]; None: never."""
    watch = EngineWatch(ParamTable.of_firmware(plane=True))
    for k, speed in enumerate(speeds_mps):
        if watch.roll_step(k * STEP_US, ground_mps=speed):
            return k * PERIOD_S
    return None


def test_an_engine_that_fails_on_the_roll_is_found_by_the_speed() -> None:
    grows = [min(6.0 * k * PERIOD_S, 9.0) for k in range(75)]
    assert roll_watch(grows) is None
    found = roll_watch(grows + [9.0 - 0.6 * k * PERIOD_S for k in range(200)])
    assert found == pytest.approx(1.5 + 0.5 / 0.6, abs=0.05)


def test_an_engine_that_never_pulls_is_found_3_s_after_full_throttle() -> None:
    assert roll_watch([0.0] * 500) == pytest.approx(2.0 + 3.0, abs=0.05)


def test_a_slow_but_steady_roll_is_no_failure() -> None:
    assert roll_watch([0.5 * k * PERIOD_S for k in range(1000)]) is None
