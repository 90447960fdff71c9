"""Network ports of the flights that one machine makes at the same time."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.apps.campaign.engines.local import LocalEngine
from hil.apps.campaign.engines.ports import endpoint_port, step, with_own_ports
from hil.apps.campaign.flight import Job
from hil.config import Bench, load_bench
from signals.errors import ConfigError
from tests.worlds.bench_process import free_port

ROUTER = "router={gcs: 'udp:127.0.0.1:14550', sdk: 'udpin:127.0.0.1:14540', more: ['tcp:127.0.0.1:14551']}"


def ports(bench: Bench) -> list[int]:
    flying = list(bench.vehicles.values()) or [bench]
    routers = [each.config.router for each in flying]
    texts = [text for r in routers for text in (r.gcs, r.sdk, r.companion, *r.more) if text]
    return [endpoint_port(text) for text in texts]


def test_no_two_flights_have_a_port_of_the_router_in_common() -> None:
    bench = load_bench(None, settings=[ROUTER])
    assert with_own_ports(bench, 0).config == bench.config
    seen = [port for number in range(64) for port in ports(with_own_ports(bench, number))]
    assert len(seen) == len(set(seen)) == 3 * 64
    assert with_own_ports(bench, 5).config.router.endpoints()[0].name == "gcs"


@pytest.mark.parametrize(("given", "expected"), [([], 1), ([14550], 1), ([5790, 5791], 2), ([14540, 14550], 3)])
def test_the_step_is_the_smallest_that_keeps_all_ports_apart(given: list[int], expected: int) -> None:
    assert step(given) == expected


def test_vehicles_of_a_group_have_ports_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "hil.yaml"
    path.write_text(
        "mission: rigs/missions/short.waypoints\n"
        "vehicles:\n"
        "  a: {router: {sdk: 'udp:127.0.0.1:14540'}}\n"
        "  b: {start: {p_W: [5, 0, 0]}, router: {sdk: 'udp:127.0.0.1:14541'}}\n"
    )
    bench = load_bench(path)
    seen = [port for number in range(10) for port in ports(with_own_ports(bench, number))]
    assert len(seen) == len(set(seen)) == 20


def test_what_cannot_fly_beside_another_is_refused() -> None:
    with pytest.raises(ConfigError, match="router: port 65535 leaves no room for flight 1"):
        with_own_ports(load_bench(None, settings=["router.sdk=udp:127.0.0.1:65535"]), 1)
    awaited = load_bench(None, settings=["companion.clients=1"])
    assert with_own_ports(awaited, 0).config.companion.port == awaited.config.companion.port
    with pytest.raises(ConfigError, match=r"companion.clients: awaits 1 clients.*--workers 1"):
        with_own_ports(awaited, 1)
    with pytest.raises(ConfigError, match=r"ros2\.domain: the graph has another flight"):
        with_own_ports(load_bench(None, settings=["ros2.domain=3"]), 1)
    firmware = load_bench(None, settings=["rig=px4_sitl", "autopilot.start=false"])
    assert with_own_ports(firmware, 99).config.autopilot.instance == 99
    with pytest.raises(ConfigError, match=r"autopilot\.instance: 100 of this flight is above 99"):
        with_own_ports(firmware, 100)


def test_foxglove_follows_the_first_of_several_flights() -> None:
    bench = load_bench(None, settings=["foxglove.port=8765"])
    assert [with_own_ports(bench, number).config.foxglove.port for number in (0, 1)] == [8765, None]


def test_two_flights_at_a_time_have_a_router_each(tmp_path: Path) -> None:
    port = free_port(following=1)
    texts = ("autopilot.transport=loopback", "mission=rigs/missions/short.waypoints", "duration_s=3")
    engine = LocalEngine(2)
    try:
        for name in "ab":
            router = f"router.more=['tcp:127.0.0.1:{port}', 'udpin:127.0.0.1:{port}']"
            engine.submit(Job(name, None, (*texts, router), str(tmp_path / name)))
        ended = []
        while len(ended) < 2:
            ended += engine.wait(60.0)
    finally:
        engine.close()
    assert [done.outcome and done.outcome.status for done in ended] == ["FAIL", "FAIL"], ended
