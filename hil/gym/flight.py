"""One vehicle, alone in a world that is stepped from outside, and the sensors that are observed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hil.config import Bench
from hil.gym.actions import make_driver
from hil.gym.options import FlightOptions
from hil.gym.ports import Ports
from hil.run.stepped.vehicle import SteppedVehicle
from hil.run.stepped.world import Departure, SteppedWorld
from signals.samples import TruthState, Vec3


class Flight:
    """Vehicle of one environment. Raises ValueError for a vehicle that the ideal controller cannot fly."""

    def __init__(self, bench: Bench, options: FlightOptions, ports: Sequence[str] = ()) -> None:
        """`ports`: those observed; no other sensor is made."""
        config = bench.config
        self.bench = bench
        self.world = SteppedWorld(bench.scene, config.tick_ns, seed=config.noise_seed, wind=config.wind)
        self.vehicle: SteppedVehicle = self.world.add(
            config.name or "vehicle",
            bench.vehicle,
            config.start.flight_start(),
            effects=config.physics.effects,
            faults=config.faults.rotors,
        )
        assert self.vehicle.physics is not None
        self.physics = self.vehicle.physics
        self.driver = make_driver(bench, self.vehicle, self.world, options)
        self.ports = Ports(bench, ports) if ports else None
        self.departure: Departure | None = None

    @property
    def truth(self) -> TruthState:
        """True state now."""
        return self.vehicle.truth

    @property
    def height_m(self) -> float:
        """Height of the vehicle over z = 0."""
        return float(self.physics.state[2])

    def restart(self, seed: int) -> None:
        """Return to tick 0; the noise of sensors and the wind are those of the seed."""
        self.departure = None
        self.world.restart(seed)

    def begin(self, seed: int, origin_W: Vec3) -> None:
        """Begin the episode where the vehicle was put since `restart`."""
        self.driver.begin(origin_W)
        if self.ports is not None:
            self.ports.begin(seed, self.vehicle.truth)

    def fly(self, values: Sequence[float], ticks: int) -> None:
        """Fly an action for a number of ticks."""
        driver, world, ports = self.driver, self.world, self.ports
        driver.command(values)
        end = world.tick + ticks
        while world.tick < end:
            until = end if ports is None else min(end, ports.next_tick(world.tick))
            if driver.held is not None:
                world.hold(driver.held, until - world.tick)
            else:
                while world.tick < until:
                    world.step()
            if ports is not None:
                ports.sample(self.vehicle.truth)
        departures = world.take_departures()
        if departures:
            self.departure = departures[0]

    def close(self) -> None:
        """End the autopilot and release renderers."""
        self.driver.close()
        if self.ports is not None:
            self.ports.close()


def with_map_seed(bench: Bench, map_seed: int) -> Bench:
    """Return the bench in another map. Raises ValueError if its scene is not made from a seed."""
    scene = bench.scene.with_map_seed(map_seed)
    return replace(bench, scene=scene, config=bench.config.model_copy(update={"map_seed": map_seed}))
