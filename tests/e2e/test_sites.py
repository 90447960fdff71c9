"""The mock flies at every site that the bench accepts, up to the poles."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from hil.run.bench_run import run_bench
from signals.geodesy import LocalFrame
from sim.scene.scene import Site

SQUARE_M = ((0.0, 0.0), (0.0, 8.0), (8.0, 8.0), (0.0, 0.0))


def mission(site: Site) -> str:
    """Return a triangle of 8 m at 3 m height, east and north of the site, as a .waypoints file."""
    frame = LocalFrame(site)
    places = [frame.geodetic_from_enu((east, north, 0.0))[:2] for east, north in SQUARE_M]
    rows = [(0, 16, *places[0], site.altitude_m), (3, 22, *places[0], 3.0)]
    rows += [(3, 16, *place, 3.0) for place in places[1:]] + [(3, 21, *places[0], 0.0)]
    lines = [
        f"{number}\t{int(number == 0)}\t{frame}\t{command}\t0\t0\t0\t0\t{latitude:.9f}\t{longitude:.9f}\t{height}\t1"
        for number, (frame, command, latitude, longitude, height) in enumerate(rows)
    ]
    return "\n".join(["QGC WPL 110", *lines, ""])


@pytest.mark.parametrize(
    ("latitude", "longitude"),
    [
        (-89.9, 0.0),
        (80.0, -80.0),
        (-10.0, 180.0),
        (0.0, 10.0),
        *(pytest.param(*place, marks=pytest.mark.slow) for place in ((-75.0, 100.0), (86.0, 0.0))),
    ],
)
def test_the_mock_flies_a_mission_there(tmp_path: Path, latitude: float, longitude: float) -> None:
    site = Site(latitude_deg=latitude, longitude_deg=longitude, altitude_m=2835.0)
    (tmp_path / "scene.yaml").write_text(
        f"name: there\ndescription: ''\nsite: {site.model_dump_json()}\nground_friction: 0.8\n"
    )
    (tmp_path / "m.waypoints").write_text(mission(site))
    (tmp_path / "b.yaml").write_text(
        f"tick_hz: 100\nscene: {tmp_path}/scene.yaml\nmission: {tmp_path}/m.waypoints\nduration_s: 120\n"
        "autopilot: {transport: loopback}\nrecord: {mcap: false, report: false, tlog: false}\n"
    )
    result = run_bench(load_bench(tmp_path / "b.yaml"), tmp_path / "run", quiet=True)
    assert (result.run["verdict"]["reasons"], result.status) == ([], "PASS")
