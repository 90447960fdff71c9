"""The configuration of a bench after validation, with the contents of the files that it names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from firmware_bridge.autopilots.firmware import Firmware
from firmware_bridge.autopilots.profile import Profile
from hil.config.missions import Geopoint, Mission
from hil.config.missions.path import Leg, planned_path
from hil.config.missions.script import MissionScript, Outcome
from hil.config.schema import BenchConfig
from hil.config.sensors.noise import noise_factors, scaled_parameters
from sim.physics.vehicle import Vehicle
from sim.randomize.variant import drawn
from sim.scene.scene import Scene
from sim.scene.world import World
from sim.world_loader import load_world

_FIXED_WING = 1  # MAV_TYPE


def firmware_for(profile: Profile, vehicle: Vehicle) -> Firmware:
    """Return the facts about the firmware of an autopilot on a vehicle."""
    return profile.firmware.of_type(_FIXED_WING) if vehicle.has_wings else profile.firmware


@dataclass(frozen=True)
class Bench:
    """Settings of a bench, and the contents of the files that they name.

    `files` maps 'bench', 'rig', 'vehicle', 'scene' and 'mission' to the file that each was read from, if there is one.
    If the mission is a script with a plan, 'plan' is the file of that plan.
    `vehicles` holds the complete bench of each vehicle of a bench with several; this bench itself then flies nothing.
    """

    config: BenchConfig
    vehicle: Vehicle
    scene: Scene
    mission: Mission | None
    files: Mapping[str, Path]
    script: MissionScript | None = None
    vehicles: Mapping[str, Bench] = field(default_factory=dict)

    @property
    def each_vehicle(self) -> Mapping[str, Bench]:
        """The bench of every vehicle by name; the name of an only vehicle is empty."""
        return self.vehicles or {"": self}

    @property
    def firmware(self) -> Firmware:
        """Facts about the autopilot's firmware on this vehicle."""
        return firmware_for(self.config.autopilot.profile, self.vehicle)

    @property
    def outcome(self) -> Outcome:
        """Required end of the flight."""
        return "complete" if self.script is None else self.script.script.outcome

    @cached_property
    def legs(self) -> tuple[Leg, ...]:
        """The planned path from where the bench starts the vehicle; empty without a mission. A run's may be higher."""
        return () if self.mission is None else planned_path(self.mission, self.scene, home_W=self.config.start.p_W)

    def sensor_parameters(self, name: str) -> Any:
        """Return the parameters of a sensor, with its noise scaled by the factor drawn from the seed."""
        return scaled_parameters(self.config, name)

    def random_choices(self) -> dict[str, Any] | None:
        """Return the random choices of `randomize` as data, None if it is off."""
        choices = drawn(self.scene, self.config.randomize, load_world)
        if choices is not None and self.config.randomize.noise is not None:
            choices["noise"] = noise_factors(self.config)
        return choices

    @property
    def world(self) -> World:
        """The geometry of the scene, cached, and of all vehicles of a bench with several.

        Raises ConfigError if the scene's map is invalid.
        """
        world = load_world(self.scene)
        if not self.vehicles:
            return world
        from sim.physics.vehicle_bodies import with_vehicles  # loads MuJoCo

        return with_vehicles(world, {name: bench.vehicle for name, bench in self.vehicles.items()})


def site_of(scene: Scene) -> Geopoint:
    """Return latitude, longitude and altitude of the scene's origin."""
    return Geopoint(scene.site.latitude_deg, scene.site.longitude_deg, scene.site.altitude_m)
