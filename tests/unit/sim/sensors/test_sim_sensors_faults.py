"""Sensor faults: each does what it says while it lasts, nothing before and after, and is told."""

from __future__ import annotations

import math
from typing import Any

import pydantic
import pytest

from signals.samples import TruthState
from sim.scene.atmosphere import pressure_altitude_m
from sim.scene.scene import load_scene
from sim.sensors.catalog import KINDS, PRESETS, make_sensor
from sim.sensors.faults import FAULT_FIELDS, FAULT_LIST, FaultySensor, fault_problems
from sim.sensors.sensor import Installation

TICK_NS = 4_000_000
SCENE = load_scene("airfield")
ZERO = (0.0, 0.0, 0.0)
BEGIN_S, END_S = 1.0, 2.0
# Cameras and LiDARs need a world: their faults are in their own tests.
PLAIN = sorted(name for name, preset in PRESETS.items() if not KINDS[preset.kind].needs_frames)


def truth(k: int) -> TruthState:
    s = math.sin(0.05 * k)
    return TruthState(
        k, k * TICK_NS, (s, 0.0, 2.0 + s), (1.0, 0.0, 0.0, 0.0), (s, 0.0, s), ZERO, ZERO, ZERO, (500.0,) * 4, False
    )


def plain(preset: str) -> Any:
    return make_sensor(Installation("s", rate_hz=250.0, seed=1, scene=SCENE, step_ns=TICK_NS), preset=preset)


def fault(kind: str, **values: Any) -> Any:
    entry = {"kind": kind, "sensor": "s", "at_s": BEGIN_S, "until_s": END_S} | values
    return FAULT_LIST.validate_python([entry])[0]


def flown(preset: str, faults: list[Any], ticks: int = 750) -> tuple[list[Any], list[Any], list[tuple[int, str, str]]]:
    events: list[tuple[int, str, str]] = []
    good, bad = plain(preset), FaultySensor(plain(preset), faults, on_event=lambda *e: events.append(e))
    rows = [(good.sample(truth(k), k), bad.sample(truth(k), k)) for k in range(ticks)]
    return [r[0] for r in rows], [r[1] for r in rows], events


DURING = range(250, 500)  # ticks of 1.0 s <= t < 2.0 s
FAULTS = [
    {"kind": "freeze"},
    {"kind": "dropout"},
    {"kind": "offset", "value": 1000.0},
    {"kind": "drift", "rate_per_s": 1e6},
    {"kind": "stuck_bit", "bit": 0, "level": 1},
]


@pytest.mark.parametrize("preset", PLAIN)
@pytest.mark.parametrize("values", FAULTS, ids=lambda v: v["kind"])
def test_every_fault_on_every_preset_only_while_it_lasts(preset: str, values: dict[str, Any]) -> None:
    good, bad, events = flown(preset, [fault(**values)])
    for k in range(750):
        if k not in DURING:
            assert bad[k] == good[k]
        elif values["kind"] == "dropout":
            assert bad[k] is None
        else:
            assert type(bad[k]) is type(good[k])
            assert bad[k][:3] == good[k][:3]
    if values["kind"] != "dropout":
        assert any(bad[k] != good[k] for k in DURING)
    kind = values["kind"]
    assert events == [(10**9, "fault", f"s: {kind} began"), (2 * 10**9, "fault", f"s: {kind} ended")]


def test_freeze_holds_the_last_values_before_it() -> None:
    good, bad, _ = flown("ms5611", [fault("freeze")])
    for k in DURING:
        assert bad[k][3:] == good[249][3:]
        assert bad[k].t_capture_ns == k * TICK_NS
    _, from_start, _ = flown("ms5611", [fault("freeze", at_s=0.0)])
    assert from_start[100][3:] == good[0][3:]


def test_offset_on_one_axis_of_one_field() -> None:
    good, bad, _ = flown("icm20689", [fault("offset", value=0.25, field="gyro_radps", axis="y")])
    for k in DURING:
        (x, y, z), clean = bad[k].gyro_radps, good[k].gyro_radps
        assert (x, y, z) == (clean[0], clean[1] + 0.25, clean[2])
        assert bad[k].accel_mps2 == good[k].accel_mps2


def test_drift_grows_from_its_beginning() -> None:
    good, bad, _ = flown("ms5611", [fault("drift", rate_per_s=10.0)])
    for k in DURING:
        assert bad[k].pressure_pa - good[k].pressure_pa == pytest.approx(10.0 * (k - 250) * 0.004, abs=1e-9)


def test_the_pressure_altitude_follows_the_pressure() -> None:
    _, bad, _ = flown("ms5611", [fault("offset", value=-1200.0)])
    for k in (249, 250, 300):
        assert bad[k].pressure_altitude_m == pressure_altitude_m(bad[k].pressure_pa)
    assert bad[250].pressure_altitude_m - bad[249].pressure_altitude_m > 90.0
    _, vacuum, _ = flown("ms5611", [fault("offset", value=-1e6)])
    assert math.isfinite(vacuum[300].pressure_altitude_m)


@pytest.mark.parametrize(("bit", "level"), [(0, 1), (3, 0), (9, 1)])
def test_stuck_bit_is_stuck_in_every_word(bit: int, level: int) -> None:
    preset = "icm20689"
    word = plain(preset).resolution["accel_mps2"]
    good, bad, _ = flown(preset, [fault("stuck_bit", bit=bit, level=level, axis="z")])
    for k in DURING:
        change = (bad[k].accel_mps2[2] - good[k].accel_mps2[2]) / word
        counts = math.floor(good[k].accel_mps2[2] / word + 0.5) + round(change)
        assert counts >> bit & 1 == level
        assert change == pytest.approx(0.0, abs=1e-6) or abs(change) == pytest.approx(1 << bit)
        assert bad[k].accel_mps2[:2] == good[k].accel_mps2[:2]


def test_faults_add_up_in_their_order() -> None:
    good, bad, events = flown(
        "ms5611", [fault("offset", value=5.0), fault("offset", value=7.0, at_s=1.5, until_s=None)]
    )
    assert bad[300].pressure_pa == good[300].pressure_pa + 5.0
    assert bad[400].pressure_pa == pytest.approx(good[400].pressure_pa + 12.0)
    assert bad[700].pressure_pa == good[700].pressure_pa + 7.0
    assert [text for _, _, text in events] == ["s: offset began", "s: offset began", "s: offset ended"]


def test_a_slow_sensor_tells_of_the_fault_at_its_first_sample_within() -> None:
    events: list[tuple[int, str, str]] = []
    gps = FaultySensor(plain("m8n"), [fault("dropout", at_s=1.003, until_s=1.25)], on_event=lambda *e: events.append(e))
    taken = [gps.sample(truth(k), n) for n, k in enumerate(range(0, 500, 25))]
    assert [n for n, sample in enumerate(taken) if sample is None] == [11, 12]
    assert [t for t, _, _ in events] == [1_100_000_000, 1_300_000_000]


def test_every_kind_has_fields_that_exist() -> None:
    assert set(FAULT_FIELDS) >= {kind.sample_type for kind in KINDS.values()}
    for sample_type, fields in FAULT_FIELDS.items():
        assert set(fields) <= set(sample_type._fields)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"kind": "explode"}, "explode"),
        ({"kind": "offset"}, "value"),
        ({"kind": "freeze", "value": 1.0}, "value"),
        ({"kind": "freeze", "at_s": -1.0}, "at_s"),
        ({"kind": "freeze", "at_s": math.nan}, "at_s"),
        ({"kind": "freeze", "until_s": 1.0}, "until_s 1 must come after at_s 1"),
        ({"kind": "stuck_bit", "bit": 32, "level": 1}, "bit"),
        ({"kind": "stuck_bit", "bit": 3, "level": 2}, "level"),
        ({"kind": "offset", "value": 1.0, "axis": "w"}, "axis"),
        ({"kind": "dropout", "sensor": ""}, "sensor"),
    ],
)
def test_malformed_faults_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=message):
        fault(**values)


@pytest.mark.parametrize(
    ("values", "key", "message"),
    [
        ({"kind": "dropout", "sensor": "gsp"}, "sensor", "is unknown: 'gsp' (sensors: s)"),
        ({"kind": "offset", "value": 1.0, "field": "speed"}, "field", "is unknown: 'speed'"),
        ({"kind": "offset", "value": 1.0, "axis": "x"}, "axis", "has no axes"),
        ({"kind": "offset", "value": 1.0, "field": "temperature_degc", "axis": "z"}, "axis", "has no axes"),
    ],
)
def test_faults_that_do_not_fit_the_sensor_are_named(values: dict[str, Any], key: str, message: str) -> None:
    chosen = fault(**values)
    ((index, where, text),) = fault_problems([chosen], {"s": KINDS["barometer"].sample_type})
    assert (index, where) == (0, key)
    assert message in text
    with pytest.raises(ValueError, match=key):
        FaultySensor(plain("ms5611"), [chosen])


def test_a_flow_has_only_two_axes() -> None:
    ((_, key, text),) = fault_problems([fault("offset", value=1.0, axis="z")], {"s": KINDS["optical_flow"].sample_type})
    assert key == "axis"
    assert "only x, y" in text
