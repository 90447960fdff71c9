"""Almanac files: both formats give the same orbits, and a bad file is refused with its line."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest

from signals.errors import ConfigError
from sim.gnss.almanac import read_almanac
from sim.gnss.constellations import nominal_orbits
from sim.gnss.gps_time import full_week, gps_seconds
from sim.scene.light import time_of


def record(number: int, health: str = "000") -> str:
    """Return a satellite of a YUMA file, without its headline."""
    return f"""ID:                         {number:02}
Health:                     {health}
Eccentricity:               0.5000000000E-002
Time of Applicability(s):  405504.0000
Orbital Inclination(rad):   0.9424777961
Rate of Right Ascen(r/s):  -0.7853981634E-008
SQRT(A)  (m 1/2):           5153.600000
Right Ascen at Week(rad):  -0.1570796327E+001
Argument of Perigee(rad):   0.785398163
Mean Anom(rad):             0.3141592654E+000
Af0(s):                     0.1000000000E-003
Af1(s/s):                   0.0000000000E+000
week:                        320
"""


HEADLINE = "******** Week 320 almanac for PRN-{} ********\n"
YUMA = f"{HEADLINE.format('01')}{record(1)}\n{HEADLINE.format('02')}{record(2, '063')}"
SEM = """2  CURRENT.ALM
320 405504

1
63
0
 5.0000000000E-03  0.0000000000E+00 -2.5000000000E-09
 5.1536000000E+03 -5.0000000000E-01  2.5000000000E-01
 1.0000000000E-01  1.0000000000E-04  0.0000000000E+00
0
11

2
61
0
 5.0000000000E-03  0.0000000000E+00 -2.5000000000E-09
 5.1536000000E+03 -5.0000000000E-01  2.5000000000E-01
 1.0000000000E-01  1.0000000000E-04  0.0000000000E+00
63
11
"""


def written(folder: Path, text: str, name: str = "almanac.txt") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def problems(folder: Path, text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        read_almanac(written(folder, text))
    return [f"{p.where.rpartition(':')[2]}: {p.message}" for p in caught.value.problems]


def test_both_formats_hold_the_same_orbit(tmp_path: Path) -> None:
    (yuma,) = read_almanac(written(tmp_path, YUMA))
    (sem,) = read_almanac(written(tmp_path, SEM, "a.al3"))
    assert yuma.name == sem.name == "G01"  # the second satellite is not healthy
    for field in type(yuma).model_fields:
        if field not in ("system",):
            assert getattr(yuma, field) == pytest.approx(getattr(sem, field), rel=1e-8), field
    assert sem.inclination_rad == pytest.approx(0.3 * math.pi)


def test_a_bad_line_is_named(tmp_path: Path) -> None:
    bad = YUMA.replace("0.785398163\nMean", "far\nMean", 1)
    assert problems(tmp_path, bad)[0] == "10: perigee_rad must be a number, not 'far'"
    bad = YUMA.replace("ID:                         01", "ID:                         88", 1)
    assert problems(tmp_path, bad)[0].startswith("2: satellite 88: number is 88")
    bad = YUMA.replace("SQRT(A)  (m 1/2):           5153.600000\n", "", 1)
    assert problems(tmp_path, bad)[0] == "2: satellite 1: sqrt_semi_major_rtm is missing"
    bad = YUMA.replace("Health:                     000", "Colour: blue", 1)
    assert problems(tmp_path, bad)[0] == "3: is no line of a YUMA almanac: 'Colour: blue'"
    assert problems(tmp_path, YUMA + YUMA)[0] == "31: satellite 1 is there twice"


def test_a_file_cut_off_within_the_last_week_is_refused(tmp_path: Path) -> None:
    """A week of fewer digits is another year, and its satellite would be anywhere."""
    both = YUMA.replace("Health:                     063", "Health:                     000")
    whole = both.rstrip()
    path = tmp_path / "whole.alm"
    path.write_text(whole)
    assert len(read_almanac(path)) == 2
    assert problems(tmp_path, whole[:-1])[0] == "17: satellite 2 has week 32, and satellite 1 320"


def test_a_bad_sem_file_is_named(tmp_path: Path) -> None:
    assert problems(tmp_path, SEM.replace("2  CURRENT", "3  CURRENT"))[0].startswith("20: ends after 16 lines")
    bad = SEM.replace(" 5.1536000000E+03 -5.0000000000E-01  2.5", " 5.1536000000E+03  2.5", 1)
    assert problems(tmp_path, bad)[0] == "8: must have 3 numbers, not 2"
    assert problems(tmp_path, "hello\nworld\n")[0] == "1: is neither a YUMA nor a SEM almanac"
    assert problems(tmp_path, "")[0].endswith("is neither a YUMA nor a SEM almanac")
    assert problems(tmp_path, "9" * 5000 + " X\n100 405504\n")[0] == "1: declares more than 63 satellites"
    with pytest.raises(ConfigError):
        read_almanac(tmp_path / "absent.alm")


def test_a_week_of_ten_bits_is_the_nearest() -> None:
    now = gps_seconds(time_of("2026-11-29T00:00:00Z"))
    week = int(now) // 604_800
    assert full_week(week % 1024, now) == week
    assert full_week((week + 3) % 1024, now) == week + 3
    assert full_week((week - 400) % 1024, now) == week - 400
    assert full_week(week, now) == week


def test_nominal_constellations_are_walkers() -> None:
    orbits = nominal_orbits(("gps", "galileo", "glonass", "beidou"), start_s=1.4e9)
    assert [sum(o.system == s for o in orbits) for s in ("gps", "galileo", "glonass", "beidou")] == [32, 24, 24, 24]
    galileo = [o for o in orbits if o.system == "galileo"]
    nodes = sorted({round(o.node_rad, 9) for o in galileo})
    assert np_diff(nodes) == pytest.approx([2.0 * math.pi / 3.0] * 2)
    ahead = (galileo[1].anomaly_rad - galileo[0].anomaly_rad) % (2.0 * math.pi)
    assert ahead == pytest.approx(math.pi / 4.0)
    assert len(nominal_orbits(("gps",), start_s=1.4e9, gps_satellites=24)) == 24
    turned = nominal_orbits(("gps",), start_s=1.4e9, seed=5)
    assert turned[0].node_rad != orbits[0].node_rad
    assert (turned[1].anomaly_rad - turned[0].anomaly_rad) % 6.283185307179586 == pytest.approx(
        (orbits[1].anomaly_rad - orbits[0].anomaly_rad) % 6.283185307179586
    )


def np_diff(values: list[float]) -> list[float]:
    return [b - a for a, b in pairwise(values)]
