"""Network ports of a flight, apart from those of the other flights on this machine.

A simulated autopilot gets an instance of its own, and a companion that the bench starts any free port. Flight n adds
n * s to the ports of the router, with s the smallest step that never gives two flights the same port. Foxglove follows
flight 0 alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from typing import Any

from hil.config import Bench
from hil.config.schema import Router
from signals.errors import ConfigError

_MOST = 65535
_MOST_INSTANCE = 99  # hil.config.schema.Autopilot


def with_own_ports(bench: Bench, number: int) -> Bench:
    """Return `bench` as flight `number` of this machine makes it. Raises ConfigError if it cannot be."""
    flying = list(bench.vehicles.values()) or [bench]
    ports = {endpoint_port(text) for each in flying for text in _addresses(each.config.router)}
    move = number * step(sorted(ports))
    if ports and max(ports) + move > _MOST:
        text = f"port {max(ports)} leaves no room for flight {number} of this machine, which adds {move}"
        raise ConfigError.at("router", text, "lower ports, or fewer --workers")
    if number:
        bench = _unfollowed(bench)
    moved = {name: _moved(each, number * len(flying), move) for name, each in bench.vehicles.items()}
    return replace(bench, vehicles=moved) if moved else _moved(bench, number, move)


def step(ports: Sequence[int]) -> int:
    """Return the smallest number that divides no difference of two ports."""
    differences = [b - a for i, a in enumerate(ports) for b in ports[i + 1 :]]
    return next(s for s in count(1) if all(difference % s for difference in differences))


def endpoint_port(address: str) -> int:
    return int(address.rpartition(":")[2])


def _addresses(router: Router) -> list[str]:
    named = (router.gcs, router.sdk, router.companion, *router.more)
    return [address for address in named if address is not None]


def _unfollowed(bench: Bench) -> Bench:
    """Return `bench` without Foxglove. Raises ConfigError if it is a node of a ROS 2 graph."""
    if any(each.config.ros2.domain is not None for each in (bench, *bench.vehicles.values())):
        text = "the graph has another flight of this machine"
        raise ConfigError.at("ros2.domain", text, "one flight at a time: --workers 1")
    config = bench.config
    return replace(bench, config=config.model_copy(update={"foxglove": type(config.foxglove)()}))


def _moved(bench: Bench, instances: int, move: int) -> Bench:
    config, update = bench.config, dict[str, Any]()
    companion, router = config.companion, config.router
    if config.autopilot.profile.is_program:
        instance = config.autopilot.instance + instances
        if instance > _MOST_INSTANCE:
            text = f"{instance} of this flight is above {_MOST_INSTANCE}"
            raise ConfigError.at("autopilot.instance", text, "fewer --workers")
        update["autopilot"] = config.autopilot.model_copy(update={"instance": instance})
    if companion.start and companion.clients <= len(companion.start):
        update["companion"] = companion.model_copy(update={"port": 0})
    elif companion.on and instances:
        text = f"awaits {companion.clients} clients, of which the bench starts {len(companion.start)}"
        raise ConfigError.at("companion.clients", text, "one flight at a time has its port: --workers 1")

    def shifted(address: str | None) -> str | None:
        return address and f"{address.rpartition(':')[0]}:{endpoint_port(address) + move}"

    if move:
        named = {key: shifted(getattr(router, key)) for key in ("gcs", "sdk", "companion")}
        update["router"] = router.model_copy(update={**named, "more": tuple(map(shifted, router.more))})
    return replace(bench, config=config.model_copy(update=update))
