"""Wiring check, demand pruning and order of stages."""

from __future__ import annotations

import pytest

from hil.run.loop.stages import Port, StageSpec, plan_stages
from signals.errors import WiringError
from signals.samples import ActuatorFrame, BaroSample, GpsSample, ImuSample, TruthState

TRUTH = Port("truth", TruthState)
IMU = Port("imu", ImuSample)
GPS = Port("gps", GpsSample)
ACTUATORS = Port("actuators", ActuatorFrame)


def bench(*, extra: tuple[StageSpec, ...] = (), delayed: bool = True) -> list[StageSpec]:
    loop = {"delayed_inputs": (ACTUATORS,)} if delayed else {"inputs": (ACTUATORS,)}
    return [
        StageSpec("link", inputs=(IMU, GPS), outputs=(ACTUATORS,), sink=True),
        StageSpec("gps", inputs=(TRUTH,), outputs=(GPS,)),
        StageSpec("imu", inputs=(TRUTH,), outputs=(IMU,)),
        StageSpec("physics", outputs=(TRUTH,), **loop),
        *extra,
    ]


def test_order_follows_data_and_breaks_ties_by_declaration() -> None:
    assert plan_stages(bench()).order == ("physics", "gps", "imu", "link")


def test_a_stage_without_consumer_is_skipped_and_reported() -> None:
    spare = StageSpec("baro2", inputs=(TRUTH,), outputs=(Port("baro2", BaroSample),))
    plan = plan_stages(bench(extra=(spare,)))
    assert "baro2" not in plan.order
    assert [(s.stage, s.reason) for s in plan.skipped] == [("baro2", "no consumer for baro2")]


def test_demand_is_transitive() -> None:
    chain = (
        StageSpec("a", inputs=(TRUTH,), outputs=(Port("a", BaroSample),)),
        StageSpec("b", inputs=(Port("a", BaroSample),), outputs=(Port("b", BaroSample),)),
    )
    assert {s.stage for s in plan_stages(bench(extra=chain)).skipped} == {"a", "b"}
    reader = StageSpec("reader", inputs=(Port("b", BaroSample),), sink=True)
    plan = plan_stages(bench(extra=(*chain, reader)))
    assert not plan.skipped
    assert plan.order.index("a") < plan.order.index("b") < plan.order.index("reader")


def test_algebraic_loop_is_refused_with_its_whole_path() -> None:
    with pytest.raises(WiringError, match="algebraic loop") as caught:
        plan_stages(bench(delayed=False))
    text = str(caught.value)
    for name in ("physics", "link"):
        assert name in text
    path = text.split(": ")[1].split(" -> ")
    assert path[0] == path[-1]
    assert len(path) >= 4


@pytest.mark.parametrize(
    ("stages", "message"),
    [
        ([StageSpec("x", inputs=(IMU,), sink=True)], "'x' reads port 'imu', which no stage writes"),
        ([StageSpec("x", outputs=(IMU,)), StageSpec("y", outputs=(IMU,))], "written by both 'x' and 'y'"),
        ([StageSpec("x"), StageSpec("x")], "two stages are named 'x'"),
        (
            [
                StageSpec("x", outputs=(Port("p", ImuSample),)),
                StageSpec("y", inputs=(Port("p", GpsSample),), sink=True),
            ],
            "as GpsSample, but 'x' writes ImuSample",
        ),
    ],
)
def test_bad_wiring_is_named(stages: list[StageSpec], message: str) -> None:
    with pytest.raises(WiringError) as caught:
        plan_stages(stages)
    assert message in str(caught.value)


def test_a_port_of_a_type_without_units_is_refused() -> None:
    with pytest.raises(WiringError, match="SAMPLE_FIELDS"):
        Port("x", dict)
