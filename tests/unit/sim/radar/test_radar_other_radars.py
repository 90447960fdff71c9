"""Radars of several vehicles in one world: who disturbs whom, and what stands between them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from signals.samples import Quat, TruthState, Vec3
from sim.frame.mount import quaternion_of_rpy
from sim.frame.source import SharedFrames
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_bodies import with_vehicles
from sim.scene.scene import load_scene
from sim.sensors.catalog import make_sensor
from sim.sensors.radar import Radar
from sim.sensors.sensor import Installation
from sim.world_loader import load_world

SCENE = load_scene("airfield")
ZERO = (0.0, 0.0, 0.0)
QUIET = dict.fromkeys(("leakage", "frame_start", "dc_wander", "noise", "adc"))
BACK: Quat = quaternion_of_rpy((0.0, 0.0, 180.0))
HERE: Vec3 = (0.0, 0.0, 30.0)


def state(p_WB: Vec3, q_WB: Quat) -> TruthState:
    return TruthState(0, 0, p_WB, q_WB, ZERO, ZERO, ZERO, ZERO, (0.0,) * 4, False)


def raw_of(
    other: dict[str, Any] | None, own: dict[str, Any], *, turned: Quat = BACK, blocked: bool = False
) -> NDArray[Any]:
    """Return a frame of the radar of "a"; 10 m ahead "b" looks back at it, and "c" may stand between them."""
    vehicle = load_vehicle("x500")
    frames = SharedFrames(with_vehicles(load_world(SCENE), {"a": vehicle, "b": vehicle, "c": vehicle}))
    radars: dict[str, Radar] = {}
    for name, values in (("a", own), ("b", other)):
        if values is None:
            continue
        made = make_sensor(
            Installation("radar", rate_hz=20.0, seed=1, scene=SCENE, step_ns=4_000_000, frames=frames.seen_by(name)),
            preset="bgt60tr13c",
            overrides={"impairments": QUIET, "outputs": ("raw",)} | values,
        )
        assert isinstance(made, Radar)
        radars[name] = made
    truth = state(HERE, (1.0, 0.0, 0.0, 0.0))
    frames.place("a", truth)
    frames.place("b", state((10.0, 0.0, 30.0), turned))
    frames.place("c", state((4.0, 0.0, 30.0) if blocked else (4.0, 30.0, 30.0), BACK))
    return radars["a"].sample(truth, 0).channels["raw"].astype(np.int64)


ON: dict[str, Any] = {"interference": {}}


def test_a_radar_that_looks_back_disturbs() -> None:
    alone, off = raw_of(None, {}), raw_of({}, {})
    assert np.array_equal(alone, off)
    assert np.array_equal(alone, raw_of(ON, {}))  # both have to take part
    assert np.array_equal(alone, raw_of({}, ON))
    disturbed = raw_of(ON, ON)
    assert np.std(disturbed - alone) > 5.0
    assert np.array_equal(disturbed, raw_of(ON, ON))


def test_not_one_that_looks_away_or_is_hidden() -> None:
    alone = raw_of(None, ON)
    assert np.array_equal(alone, raw_of(ON, ON, turned=(1.0, 0.0, 0.0, 0.0)))
    hidden, alone_hidden = raw_of(ON, ON, blocked=True), raw_of(None, ON, blocked=True)
    assert np.array_equal(hidden, alone_hidden)


def test_clocks_decide_where_the_ghost_is() -> None:
    frames = [raw_of(ON, {"interference": {"clock_offset_s": -s}}) for s in (0.0, 1e-8)]
    peaks = [np.argmax(np.abs(np.fft.rfft(f[0, 0] - f[0, 0].mean()))) for f in frames]
    assert peaks[1] - peaks[0] == pytest.approx(12.5e12 * 1e-8 / 31_250.0, abs=1.0)  # slope, bin
