"""A test for a firmware team's own repository: the build hovers, on the mock in CI and on a board."""

import pytest


def test_hover(rig, mission):
    run = rig.fly(mission("hover.plan"), seed=3)
    assert run.passed, run.reasons
    assert run.max_cross_track_m < 0.5
    assert run.landing_speed_mps < 1.0


def test_the_same_seed_is_the_same_flight(rig, mission):
    first, second = (rig.fly(mission("hover.plan"), seed=7) for _ in range(2))
    assert first.digest == second.digest


@pytest.mark.hil_feature("optical_flow")
def test_hover_without_gps(rig, mission):
    """Skipped on rigs that have no flow sensor."""
    run = rig.fly(mission("hover.plan"), settings=["faults.sensors=[{kind: dropout, sensor: gps, at_s: 12}]"])
    assert run.landed


# The bench calls a line with bytes between its frames unhealthy; here they are the point.
@pytest.mark.hil_allow("garbage")
def test_noise_on_the_wire_is_survived(rig, mission):
    run = rig.fly(mission("hover.plan"), settings=["autopilot.faults.noise_at_s=10"])
    assert run.passed, run.reasons
