"""Faults and gusts that a flight did not meet: which fail it, and which are only warned of."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from hil.run.parts.simulated.unmet_faults import Unmet, UnmetFaultsPart
from tests.worlds.mjcf_world import truth_at

BENCH = """
rig: mock
mission: %s
autopilot: {transport: loopback}
record: {mcap: false, tlog: false, report: false}
sensors:
  imu: {preset: icm20689}
  gps: {preset: here_plus, rate_hz: 10}
  baro: {preset: ms5611, rate_hz: 50}
  mag: {preset: ist8310, rate_hz: 50}
  spare: {preset: here_plus, kind: gps, rate_hz: 5, autopilot: false}
"""
# A hover of a few seconds by modes alone.
HOP = """
actions:
  - {at_s: 3, param: {MIS_TAKEOFF_ALT: 3.0}}
  - {at_s: 4.4, set_mode: TAKEOFF}
  - {at_s: 4.5, arm: true}
  - {after: takeoff, delay_s: 6, set_mode: LAND, required: false}
"""
GUST = "{at_s: %g, velocity_W_mps: [1, 0, 0], rise_s: 0.1, hold_s: 0.1, fall_s: 0.1}"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def fly(more: str, script: str = "", settings: tuple[str, ...] = ()) -> RunResult:
    Path("flight.yaml").write_text(HOP + script)
    Path("bench.yaml").write_text(BENCH % ("flight.yaml" if script else "null") + more)
    return run_bench(load_bench("bench.yaml", settings=settings), Path("out"), quiet=True)


def reasons(result: RunResult) -> list[str]:
    return list(result.run["verdict"]["reasons"])


ROTOR, STALL = "{rotor: 0, kind: efficiency, factor: 0.9, at_s: 400}", "{kind: stall, at_s: 400, for_s: 1}"


@pytest.mark.parametrize(
    ("faults", "action", "name"),
    [
        (f"rotors: [{ROTOR}]", "gust: {speed_mps: 3, direction_deg: 10, for_s: 1}", "rotor 0: efficiency"),
        (f"rotors: [{ROTOR}]", "fault: {rotor: 1, kind: efficiency, factor: 0.9}", "rotor 0: efficiency"),
        (f"links: [{STALL}]", "fault: {link: {kind: drop, rate: 0.1, messages: [HEARTBEAT]}}", "the link: stall"),
        ("sensors: [{sensor: gps, kind: dropout, at_s: 400}]", "fault: {autopilot: noise}", "gps: dropout"),
        ("sensors: [{sensor: gps, kind: dropout, at_s: 400}]", "fault: {sensor: gps, kind: freeze}", "gps: dropout"),
    ],
)
def test_an_action_of_the_script_excuses_no_fault_of_the_bench_at_its_time(faults: str, action: str, name: str) -> None:
    """The time alone told them apart: the fault was taken for the script's, which is not required."""
    result = fly(f"faults: {{{faults}}}\n", f"  - {{at_s: 400, required: false, {action}}}\n")
    (reason,) = reasons(result)
    assert reason.startswith(f"fault of {name} at 400 s never began: ")
    assert len(result.run["unmet"]) == 2


@pytest.mark.parametrize("required", [True, False])
def test_an_action_is_required_or_not_whatever_another_one_with_its_fault_is(required: bool) -> None:
    """Sensor and kind alone told them apart."""
    text = "  - {after: takeoff, delay_s: %s, required: %s, fault: {sensor: gps, kind: dropout, for_s: %s}}\n"
    needed, other = str(required).lower(), str(not required).lower()
    result = fly("", text % (1, other, 0.5) + text % (4.002, needed, 0.001))
    (told,) = result.run["unmet"]
    assert reasons(result) == ([told] if required else [])


def test_what_an_expected_crash_prevents_is_warned_of_but_not_without_a_cause() -> None:
    stuck, late = "  - {at_s: 7, fault: {rotor: 0, kind: stuck}}\n", f"wind: {{gusts: [{GUST % 50}]}}\n"
    result = fly(late, stuck + "outcome: crashed\n")
    assert (result.status, len(result.run["unmet"])) == ("PASS", 1)
    assert result.run["unmet"][0] in [row["text"] for row in result.run["warnings"]]
    early = fly(late, "outcome: aborted\n")
    assert reasons(early) == early.run["unmet"], "nothing that was declared had begun"


@pytest.mark.parametrize(
    ("gust_s", "own", "unmet"),
    [
        (27, "{}", []),
        (
            27,
            "{faults: {rotors: [{rotor: 0, kind: efficiency, factor: 0.99, at_s: 27}]}}",
            ["a: fault of rotor 0: efficiency at 27 s"],
        ),
        (50, "{}", ["a: gust at 50 s", "b: gust at 50 s"]),
    ],
)
def test_of_several_vehicles_one_that_met_it_is_enough(gust_s: float, own: str, unmet: list[str]) -> None:
    """A vehicle that was down before the common gust failed the flight of all."""
    Path("long.yaml").write_text(HOP.replace("delay_s: 6", "delay_s: 20"))
    vehicles = f"vehicles: {{a: {own}, b: {{start: {{p_W: [9, 0, 0]}}, mission: long.yaml}}}}\n"
    result = fly(f"wind: {{gusts: [{GUST % gust_s}]}}\n{vehicles}", "expect: []\n")
    ends_s = [vehicle["sim_s"] for vehicle in result.run["vehicles"].values()]
    assert ends_s[0] < 27 < ends_s[1]
    assert [text.partition(" never began: ")[0] for text in reasons(result)] == unmet


def test_each_of_several_vehicles_says_once_what_it_has_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every other one had asked for all of it, once for each thing that it had missed itself."""
    asked = []

    def found(part: UnmetFaultsPart) -> Iterator[Unmet]:
        asked.append(part)
        return one_found(part)

    one_found = UnmetFaultsPart._found
    monkeypatch.setattr(UnmetFaultsPart, "_found", found)
    places = ", ".join(f"{name}: {{start: {{p_W: [{9 * x}, 0, 0]}}}}" for x, name in enumerate("abc"))
    result = fly(f"wind: {{gusts: [{GUST % 50}, {GUST % 60}]}}\nvehicles: {{{places}}}\n", "expect: []\n")
    assert len(reasons(result)) == 6
    assert len(asked) == len(set(asked)) == 3


@pytest.mark.parametrize("mcap", ["true", "false"])
@pytest.mark.parametrize("until_s", ["null", "5.001"])
def test_what_is_recorded_does_not_change_the_verdict(mcap: str, until_s: str) -> None:
    """The fault of a sensor that only the recording reads failed the flight without one, or with one."""
    fault = f"faults: {{sensors: [{{sensor: spare, kind: dropout, at_s: 5.0005, until_s: {until_s}}}]}}\n"
    result = fly(fault, "expect: []\n", (f"record.mcap={mcap}",))
    assert result.status == "PASS"
    assert ("unmet" in result.run) == (mcap == "false" or until_s != "null")


def test_a_fault_at_an_event_of_a_sensor_that_nothing_reads_is_no_error() -> None:
    """Without a recording it was a KeyError."""
    result = fly("", "  - {after: takeoff, delay_s: 1, fault: {sensor: spare, kind: dropout}}\n")
    assert result.status == "PASS", result.run
    (told,) = result.run["unmet"]
    assert told.endswith(" s had no effect: it was not sampled: nothing reads it")


def test_a_link_fault_that_hits_nothing_is_unmet() -> None:
    """A message that passed was enough, however small the rate."""

    def of(rate: float, more: str = "") -> RunResult:
        fault = f"{{kind: drop, at_s: 5, for_s: 1, direction: to_autopilot, rate: {rate}{more}}}"
        return fly(f"faults: {{links: [{fault}]}}\n", "expect: []\n")

    (reason,) = reasons(of(1e-9, ", messages: [HIL_GPS]"))
    assert reason == "fault of the link: drop of HIL_GPS at 5 s had no effect: it hit none of 10 messages"
    (reason,) = reasons(of(1e-9, ", unit: byte"))
    assert reason.endswith(" bytes")
    assert reasons(of(1.0, ", messages: [HIL_GPS]")) == []
    assert of(0.0).status == "PASS", "a rate of 0 is noted before the flight"


@pytest.mark.parametrize(("rate", "status"), [(0.06, "FAIL"), (0.07, "PASS")])
def test_a_link_fault_that_this_seed_alone_spares_is_warned_of(rate: float, status: str) -> None:
    """A third of the seeds failed a sound bench, of 10 messages at a rate of 0.1. 0.93^10 = 0.48."""
    fault = f"{{kind: drop, at_s: 5, for_s: 1, direction: to_autopilot, messages: [HIL_GPS], rate: {rate}}}"
    result = fly(f"faults: {{links: [{fault}]}}\n", "expect: []\n", ("seed=2",))
    told = "fault of the link: drop of HIL_GPS at 5 s had no effect: it hit none of 10 messages"
    assert (result.status, result.run["unmet"]) == (status, [told])
    assert reasons(result) == ([told] if status == "FAIL" else [])


@pytest.mark.parametrize(
    ("fault", "met"),
    [
        ("kind: stuck_bit, field: altitude_m, bit: 29, level: 0", False),
        ("kind: stuck_bit, field: altitude_m, bit: 0, level: 0", True),
        ("kind: offset, field: altitude_m, value: 1.0e-30", False),
        ("kind: drift, field: altitude_m, rate_per_s: 1.0e-3", True),
    ],
)
def test_a_fault_that_changes_no_sample_is_unmet(fault: str, met: bool) -> None:
    """A sample in its time was enough, though each had the bit as it was."""
    result = fly(f"faults: {{sensors: [{{sensor: gps, at_s: 5, until_s: 6, {fault}}}]}}\n", "expect: []\n")
    kind = fault.split(",")[0].removeprefix("kind: ")
    assert reasons(result) == ([] if met else [f"fault of gps: {kind} at 5 s had no effect: it changed no sample"])


def test_a_gust_over_before_the_take_off_is_unmet() -> None:
    """The run had met it, the flight had not: it passed."""
    (reason,) = reasons(fly(f"wind: {{gusts: [{GUST % 1}]}}\n", "expect: []\n"))
    assert reason == "gust at 1 s had no effect: the vehicle stood on the ground"
    assert reasons(fly(f"wind: {{gusts: [{GUST % 9}]}}\n", "expect: []\n")) == []
    front = GUST.replace(", fall_s: 0.1", "") % 1
    assert reasons(fly(f"wind: {{gusts: [{front}]}}\n", "expect: []\n")) == [], "it blows on"
    loose = "  - {at_s: 1, required: false, gust: {speed_mps: 1, direction_deg: 0, for_s: 1}}\n"
    told = fly("", loose)
    assert (told.status, told.run["unmet"]) == ("PASS", [reason])


def test_a_rotor_that_fails_after_the_landing_is_unmet() -> None:
    part = UnmetFaultsPart(load_bench(None, settings=["faults.rotors=[{rotor: 0, kind: stuck, at_s: 5}]"]))
    (observe,) = part.observers()
    for t_s, up_m in ((0, 0.0), (3, 5.0), (6, 0.0)):
        observe(truth_at(t_s * 1_000_000_000, p_WB=(0.0, 0.0, up_m))._replace(in_contact=not up_m))
    assert [(what.at_s, part._flew) for what in part._grounded] == [(5.0, True)]  # type: ignore[union-attr]
    observe(truth_at(7_000_000_000, p_WB=(0.0, 0.0, -5.0)))
    assert not part._grounded, "in the air, below its start"


def test_a_gust_meets_a_plane_that_rolls() -> None:
    part = UnmetFaultsPart(load_bench(None, settings=[f"wind.gusts=[{GUST % 5}]"]))
    (observe,) = part.observers()
    for t_s, speed_mps in ((0.0, 0.0), (5.1, 0.5)):
        observe(truth_at(round(t_s * 1e9), v_WB_W=(speed_mps, 0.0, 0.0))._replace(in_contact=True))
    assert part._grounded
    observe(truth_at(5_200_000_000, v_WB_W=(3.0, 0.0, 0.0))._replace(in_contact=True))
    assert not part._grounded
