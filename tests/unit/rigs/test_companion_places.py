"""A companion's set-points are sent to each autopilot in that autopilot's own map projection."""

from __future__ import annotations

from math import dist
from typing import Any

import numpy as np
import pytest

from firmware_bridge.ground_station.projections import Place, ardupilot_ned
from hil.config import load_bench
from hil.run.autopilot import geodetic_from_W
from signals.geodesy import LocalFrame

START_W = (3.0, -4.0, 0.25)
FAR_W = (903.0, 1196.0, 20.25)  # 1.5 km away


def places(kind: str) -> tuple[Any, Place]:
    """Return the projection from W to the Earth for an autopilot, and the start."""
    bench = load_bench(rig=kind, settings=["autopilot.start=false"] if kind.endswith("_sitl") else [])
    site = bench.scene.site
    state = np.array([*START_W, 1.0, 0.0, 0.0, 0.0])
    return geodetic_from_W(bench, state), Place(*LocalFrame(site).geodetic_from_enu(START_W))


def test_ardupilot_sitl_finds_a_point_where_it_was_meant() -> None:
    where, home = places("ardupilot_sitl")
    north, east, down = ardupilot_ned(home, Place(*where(FAR_W)))
    assert (east, north, -down) == pytest.approx((900.0, 1200.0, 20.0), abs=1e-6)
    exact = LocalFrame(load_bench().scene.site).geodetic_from_enu(FAR_W)
    assert dist(ardupilot_ned(home, Place(*exact))[:2], (1200.0, 900.0)) > 1.0  # with the scene's own projection


@pytest.mark.parametrize("kind", ["mock", "px4_sitl", "ardupilot_eahrs"])
def test_the_others_are_told_the_scenes_own_place(kind: str) -> None:
    where, _ = places(kind)
    assert where(FAR_W) == LocalFrame(load_bench().scene.site).geodetic_from_enu(FAR_W)
