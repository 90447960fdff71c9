"""Jammers and spoofers as faults of a receiver: loss by power and distance, shadow, recovery, the false place."""

from __future__ import annotations

from typing import Any

import pytest

from signals.geodesy import LocalFrame
from sim.gnss.decibel import decibel
from sim.gnss.interference import BANDS, SIGNAL_DBW, tolerated_js_db
from sim.sensors.faults import FAULT_LIST, FaultySensor, fault_problems
from tests.worlds.street_canyon import at, one_wall, receiver_in

SCENE = one_wall(30.0)


def transmitter(kind: str, **keys: Any) -> dict[str, Any]:
    return {"kind": kind, "sensor": "gps", "at_s": 2.0, "place_m": [-200.0, 0.0, 1.0], "power_dbm": 30.0, **keys}


def course(gps: Any, entry: dict[str, Any], *, place: Any = (0.0, 0.0, 70.0), seconds: float = 8.0) -> list[Any]:
    faulty = FaultySensor(gps, FAULT_LIST.validate_python([entry]))
    return [faulty.sample(at(place, 0.2 * k), k) for k in range(round(5 * seconds))]


def test_a_strong_jammer_takes_the_fix_and_gives_it_back() -> None:
    samples = course(receiver_in(SCENE), transmitter("jammer", until_s=4.0))
    kinds = [sample.fix_type for sample in samples]
    assert kinds[:10] == [3] * 10
    assert kinds[10:20] == [1] * 10
    assert samples[15].satellites == 0
    assert samples[15].horizontal_accuracy_m == 1000.0
    back = kinds.index(3, 20)
    assert 20 < back <= 26  # the reacquisition of 1 s, after the first sample without the jammer
    assert kinds[back:] == [3] * (len(kinds) - back)


def test_a_weak_jammer_costs_signal_and_no_fix() -> None:
    gps = receiver_in(SCENE)
    samples = course(gps, transmitter("jammer", power_dbm=-12.0))
    assert all(sample.fix_type == 3 for sample in samples)
    clean = receiver_in(SCENE)
    clean.sample(at((0.0, 0.0, 70.0)), 0)
    assert gps.sky_fix.mean_cn0_dbhz < clean.sky_fix.mean_cn0_dbhz - 0.5
    assert gps.sky_fix.jamming_db > 0.0


def test_the_fix_is_lost_at_the_stated_jamming() -> None:
    gps = receiver_in(SCENE, sky={"systems": ["gps"], "reflections": False})
    gps.sample(at((0.0, 0.0, 70.0)), 0)
    receiver = gps.receiver
    best = max(view.cn0_dbhz for view in receiver.views)
    limit_db = tolerated_js_db(best, 22.0, BANDS["wide"], 1.023e6)
    up = (0.0, 0.0, 1.0)
    for over_db, lost in ((-1.0, False), (1.0, True)):
        entry = transmitter("jammer", at_s=0.0)
        fault = FAULT_LIST.validate_python([entry])[0]
        here = receiver.listener.received_dbw(fault.emitter("wide"), (0.0, 0.0, 70.0), up)
        # J/S is that for the strongest satellite, whose level over the zenith's is best - 48.
        power_dbm = 30.0 + (SIGNAL_DBW + best - 48.0 + limit_db + over_db) - here
        fresh = receiver_in(SCENE, sky={"systems": ["gps"], "reflections": False})
        fresh.sample(at((0.0, 0.0, 70.0)), 0)
        course(fresh, transmitter("jammer", at_s=0.0, power_dbm=power_dbm), seconds=0.4)
        assert all(view.cn0_dbhz < 22.0 for view in fresh.receiver.views) == lost


def test_a_wall_in_between_shields() -> None:
    behind = transmitter("jammer", place_m=[200.0, 0.0, 1.0], power_dbm=8.0)
    shadowed = course(receiver_in(SCENE), behind, place=(0.0, 0.0, 2.0), seconds=3.0)
    beside = transmitter("jammer", place_m=[-200.0, 0.0, 1.0], power_dbm=8.0)
    free = course(receiver_in(SCENE), beside, place=(0.0, 0.0, 2.0), seconds=3.0)
    assert free[-1].satellites < shadowed[-1].satellites


def test_a_spoofer_moves_the_place_at_its_speed() -> None:
    entry = transmitter(
        "spoofer", power_dbm=0.0, offset_m=[30.0, -10.0, 5.0], velocity_mps=[1.0, 0.0, 0.0], until_s=6.0
    )
    quiet = {"horizontal_noise_m": 0.0, "vertical_noise_m": 0.0, "horizontal_drift_m": 0.0, "vertical_drift_m": 0.0}
    gps = receiver_in(SCENE, horizontal_accuracy_m=1.0, vertical_accuracy_m=2.0, **quiet)
    samples = course(gps, entry)
    frame = LocalFrame(SCENE.site)
    for k, sample in enumerate(samples):
        place = frame.enu_from_geodetic(sample.latitude_deg, sample.longitude_deg, sample.altitude_m)
        held = 10 <= k < 30
        if 30 <= k < 36:
            continue  # it looks for the true signals again
        away = (30.0 + 0.2 * (k - 10), -10.0, 75.0) if held else (0.0, 0.0, 70.0)
        assert place == pytest.approx(away, abs=1e-3)
        assert sample.fix_type == 3
        assert sample.v_W[0] == pytest.approx(1.0 if held else 0.0, abs=0.4)


def test_a_spoofer_that_is_too_weak_only_disturbs() -> None:
    gps = receiver_in(SCENE)
    samples = course(gps, transmitter("spoofer", power_dbm=-70.0, offset_m=[500.0, 0.0, 0.0]))
    assert not gps.sky_fix.spoofed
    assert all(sample.fix_type == 3 for sample in samples)


def test_an_rtk_receiver_falls_to_a_3d_fix_under_a_spoofer() -> None:
    samples = course(receiver_in(SCENE, preset="f9p"), transmitter("spoofer", power_dbm=0.0))
    assert samples[5].fix_type == 6
    assert samples[15].fix_type == 3
    assert samples[15].horizontal_accuracy_m > 10.0 * samples[5].horizontal_accuracy_m


def test_only_a_gps_with_a_sky_hears_transmitters() -> None:
    faults = FAULT_LIST.validate_python([transmitter("jammer")])
    with pytest.raises(ValueError, match="needs a gps with `sky`"):
        FaultySensor(receiver_in(SCENE, sky=None), faults)
    baro = FAULT_LIST.validate_python([transmitter("jammer", sensor="baro")])
    from signals.samples import BaroSample

    ((_, key, text),) = fault_problems(baro, {"baro": BaroSample})
    assert key == "kind"
    assert "only a gps hears transmitters" in text


def test_decibels_are_those_of_the_definition() -> None:
    assert decibel(1000.0) == pytest.approx(30.0)
