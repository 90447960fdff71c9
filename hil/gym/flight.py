"""One vehicle, alone in a world that is stepped from outside, and the sensors that are observed."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hil.config import Bench
from hil.gym.actions import make_driver
from hil.gym.options import FlightOptions
from hil.gym.ports import Ports
from hil.gym.randomize import Draw, switch
from hil.run.stepped.vehicle import FlyingVehicle
from hil.run.stepped.world import Departure, SteppedWorld
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_S
from sim.physics.vehicle_physics import Cruise


class Flight:
    """Vehicle of one environment. Raises ValueError for a vehicle that the ideal controller cannot fly."""

    def __init__(self, bench: Bench, options: FlightOptions, ports: Sequence[str] = ()) -> None:
        """`ports`: those observed; no other sensor is made."""
        config = bench.config
        self.bench = bench
        self._world = SteppedWorld(
            bench.scene, config.tick_ns, seed=config.noise_seed, wind=config.wind, integration=options.integration()
        )
        self._vehicle = self._world.add(
            config.name or "vehicle",
            bench.vehicle,
            config.start.flight_start(),
            effects=config.physics.effects,
            faults=config.faults.of_vehicle,
        )
        self.physics = self._vehicle.physics
        self.driver = make_driver(bench, self._vehicle, self._world, options)
        physics = self.physics
        self.ports = Ports(bench, ports, wind_at=lambda: physics.wind_W_mps) if ports else None
        self.departure: Departure | None = None
        self.touched = False  # anything, in any tick of the last action
        self.draw = Draw()  # of the episode
        self.seed = 0
        self._randomize = switch(options.randomize)
        self._delay_ticks = 0
        # Ticks that `cruise_flights` has flown without a contact, of which the world does not know yet: a batch counts
        # them for all its flights at once.
        self.ahead: NDArray[np.int64] = np.zeros(1, np.int64)
        self._coming: deque[tuple[int, Sequence[float]]] = deque()  # (tick, action) of actions that are delayed

    @property
    def world(self) -> SteppedWorld:
        """The world, at the present tick."""
        if self.ahead[0]:
            self._world.cruised(int(self.ahead[0]))
            self.ahead[0], self.touched = 0, False
        return self._world

    @property
    def vehicle(self) -> FlyingVehicle:
        """The vehicle, at the present tick."""
        _ = self.world  # takes notice of ticks that it does not know yet
        return self._vehicle

    @property
    def truth(self) -> TruthState:
        """True state now."""
        return self.vehicle.truth

    @property
    def height_m(self) -> float:
        """Height of the vehicle over z = 0."""
        return float(self.physics.state[2])

    @property
    def crashed(self) -> bool:
        """True if the last action ended in or with a contact, or beyond the range of the model."""
        return self.touched or self.departure is not None

    @property
    def cruises(self) -> bool:
        """True if `cruise_flights` may fly the next action."""
        return self.driver.cruises and self.ports is None and not self._delay_ticks and self._vehicle.cruises

    def restart(self, seed: int) -> None:
        """Return to tick 0; the noise of sensors, the wind and the random vehicle are those of the seed."""
        self.departure, self.seed = None, seed
        self._coming.clear()
        world = self.world
        self.touched = False
        if self._randomize is None:
            world.restart(seed)
            return
        self.draw = draw = self._randomize.draw(seed)
        self._delay_ticks = round(draw.delay_s * NS_PER_S / world.tick_ns)
        self.physics.become(draw.applied_to(self.bench.vehicle))
        world.restart(seed)
        if self._randomize.wind_mps:
            (x, y, z), (dx, dy, dz) = world.wind_W_mps, draw.wind_W_mps
            world.set_wind((x + dx, y + dy, z + dz))

    def begin(self, seed: int, origin_W: Vec3) -> None:
        """Begin the episode where the vehicle was put since `restart`."""
        self.driver.begin(origin_W)
        self.physics.touched = False
        if self._delay_ticks:
            self.driver.command(self.driver.rest())
        if self.ports is not None:
            self.ports.begin(seed, self.vehicle.truth, None if self._randomize is None else self._randomize.scene())

    def fly(self, values: Sequence[float], ticks: int) -> None:
        """Fly an action for a number of ticks."""
        driver, world, ports, coming = self.driver, self.world, self.ports, self._coming
        end = world.tick + ticks
        if self._delay_ticks:
            coming.append((world.tick + self._delay_ticks, values))
        else:
            driver.command(values)
        while world.tick < end:
            until = end if ports is None else min(end, ports.next_tick(world.tick))
            if coming:
                if coming[0][0] <= world.tick:
                    driver.command(coming.popleft()[1])
                if coming:
                    until = min(until, coming[0][0])
            if driver.held is not None:
                world.hold(driver.held, until - world.tick)
            else:
                while world.tick < until:
                    world.step()
            if ports is not None:
                ports.sample(self._vehicle.truth)
        self._landed()

    def resume(self, values: Sequence[float], ticks: int, cruised: Cruise) -> None:
        """Fly an action of which `cruise_flights` has flown a part."""
        self.driver.command(values)
        held = self.driver.held
        assert held is not None
        self.world.hold(held, ticks, cruised)
        self._landed()

    def _landed(self) -> None:
        """Take notice of what happened in an action."""
        self.touched, self.physics.touched = self.physics.touched, False
        departures = self._world.take_departures()
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
