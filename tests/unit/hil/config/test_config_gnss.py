"""A GPS with `sky` in a bench file: its almanac, its faults, and what is refused with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from hil.config.saved import save_bench
from signals.errors import ConfigError
from sim.gnss.constellations import nominal_orbits
from sim.gnss.gps_time import gps_seconds
from sim.scene.light import time_of
from tests.unit.sim.gnss.test_gnss_almanac import record


def written(folder: Path, sky: str, more: str = "") -> Path:
    path = folder / "bench.yaml"
    path.write_text(f"rig: mock\nmission: null\nsensors:\n  gps: {{preset: m8n, rate_hz: 5, sky: {sky}}}\n{more}")
    (folder / "current.alm").write_text(record(5))
    return path


def refused(folder: Path, sky: str, more: str = "") -> str:
    with pytest.raises(ConfigError) as caught:
        load_bench(written(folder, sky, more))
    return "\n".join(str(problem).replace(f"{folder}/", "") for problem in caught.value.problems)


def test_the_almanac_is_found_beside_the_bench_and_kept_in_its_settings(tmp_path: Path) -> None:
    bench = load_bench(written(tmp_path, "{almanac: current.alm}"))
    sky = bench.config.sensors["gps"].parameters.sky
    assert sky.almanac is None
    assert [orbit.name for orbit in sky.orbits] == ["G05"]
    (tmp_path / "current.alm").unlink()
    saved = load_bench(save_bench(bench, tmp_path / "saved"))
    assert saved.config.sensors["gps"].parameters == bench.config.sensors["gps"].parameters


def test_without_the_key_there_is_no_sky(tmp_path: Path) -> None:
    assert load_bench(written(tmp_path, "null")).config.sensors["gps"].parameters.sky is None


def test_what_is_wrong_is_named_with_its_line(tmp_path: Path) -> None:
    assert "bench.yaml:4: sensors.gps.sky.almanac names a file that does not exist: no.alm" in refused(
        tmp_path, "{almanac: no.alm}"
    )
    assert "bench.yaml:4: sensors.gps.sky.utc" in refused(tmp_path, "{utc: yesterday}")
    assert "elevation_mask_deg" in refused(tmp_path, "{elevation_mask_deg: 80}")
    assert "systems" in refused(tmp_path, "{systems: [navstar]}")
    assert "unknown" in refused(tmp_path, "{sattelites: 3}")
    assert "which systems leaves out" in refused(tmp_path, "{almanac: current.alm, systems: [galileo]}")
    bad = written(tmp_path, "{almanac: current.alm}")
    (tmp_path / "current.alm").write_text(record(5).replace("5153.6", "fast"))
    with pytest.raises(ConfigError) as caught:
        load_bench(bad)
    assert any(problem.where.endswith("current.alm:7") for problem in caught.value.problems)


def test_an_almanac_of_another_year_is_refused_with_the_limit(tmp_path: Path) -> None:
    """Week 320 of ten bits is week 2368, from 25 May 2025: 405504 s later, with 18 leap seconds, 29 May 16:38:06."""
    said = refused(tmp_path, "{almanac: current.alm, utc: '2028-01-01T00:00:00Z'}")
    assert said == (
        "bench.yaml:4: sensors.gps.sky.almanac (current.alm) has orbits of 2025-05-29T16:38:06Z, 135 weeks from the "
        "run's begin, 2028-01-01T00:00:00Z; they hold 52 (take one of that time, or set sky.utc to "
        "2025-05-29T16:38:06Z)"
    )
    for utc in ("2026-05-27T00:00:00Z", "2024-06-01T00:00:00Z"):
        load_bench(written(tmp_path, f"{{almanac: current.alm, utc: '{utc}'}}"))
    for utc in ("2026-05-30T00:00:00Z", "2024-05-29T00:00:00Z"):
        assert "52" in refused(tmp_path, f"{{almanac: current.alm, utc: '{utc}'}}")


@pytest.mark.parametrize("kind", ["jammer", "spoofer"])
def test_transmitters_need_a_sky(tmp_path: Path, kind: str) -> None:
    fault = f"{{kind: {kind}, sensor: gps, at_s: 1, place_m: [0, 0, 2], power_dbm: 10}}"
    faults = f"faults:\n  sensors:\n    - {fault}\n"
    load_bench(written(tmp_path, "{}", faults))
    said = refused(tmp_path, "null", faults)
    assert f"bench.yaml:7: faults.sensors[0].kind is '{kind}', and 'gps' does not see the scene" in said
    assert "power_dbm" in refused(tmp_path, "{}", faults.replace("power_dbm: 10", "power_dbm: 1000"))
    assert "only a gps hears transmitters" in refused(tmp_path, "{}", faults.replace("sensor: gps", "sensor: baro"))


def test_a_system_counts_once(tmp_path: Path) -> None:
    assert "sensors.gps.sky.systems: holds 'gps' twice" in refused(tmp_path, "{systems: [gps, galileo, gps]}")


def test_what_is_found_is_kept(tmp_path: Path) -> None:
    """A limit of finding below that of keeping would lose and find a signal in turns."""
    text = refused(tmp_path, "{}, tracking_dbhz: 50, acquisition_dbhz: 10")
    assert "acquisition_dbhz 10 is below tracking_dbhz 50" in text


def test_a_key_of_another_kind_of_fault_is_not_meant(tmp_path: Path) -> None:
    """`capture_db` is a spoofer's: a jammer was asked whether it means capture_db."""
    jammer = "{kind: jammer, sensor: gps, at_s: 1, place_m: [0, 0, 2], power_dbm: 0, capture_db: 6}"
    text = refused(tmp_path, "{}", f"faults: {{sensors: [{jammer}]}}\n")
    assert "capture_db: unknown key (known: sensor, at_s, until_s, kind" in text


@pytest.mark.parametrize("utc", ["1700-01-01T00:00:00Z", "0001-01-01T00:00:00+14:00", "9999-12-31T23:59:59-14:00"])
def test_a_time_without_a_week_is_refused(tmp_path: Path, utc: str) -> None:
    """Such a time passed the check and ended the flight."""
    assert "sensors.gps.sky.utc: must be in the years 1981 to 2136" in refused(tmp_path, f'{{utc: "{utc}"}}')


@pytest.mark.parametrize("utc", ["1981-01-01T00:00:00+14:00", "2136-12-31T23:59:59-14:00"])
def test_the_first_and_the_last_time_have_satellites(utc: str) -> None:
    orbits = nominal_orbits(["gps"], start_s=gps_seconds(time_of(utc)), gps_satellites=32, seed=0)
    assert len(orbits) == 32
