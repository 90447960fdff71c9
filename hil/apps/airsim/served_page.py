"""The dashboard's page of a server: it shows the vehicles, the cameras' pictures and the drawings, and only watches.

The page's server is a process of its own (`hil.apps.dash`), which asks for an update while a page is open.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hil.apps.airsim.pictures.cameras import Wanted
from hil.apps.airsim.pictures.image_types import SCENE, colours
from hil.apps.airsim.rpc.methods import RpcError
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.drone import Drone
from hil.run.feed.live_run import LiveRun
from hil.run.feed.live_vehicle import RunAccess
from hil.run.feed.payloads import array_payload, thinned
from hil.run.feed.streams import DRAWINGS
from signals.samples import ActuatorFrame, TruthState

_PERIOD_S = 0.012
_COLOUR = "/rgb"
_NOT_HERE = "the scripts command these vehicles; wind is set by simSetWind, and rotors and sensors have no faults here"


class _Present(NamedTuple):
    """Present state of a vehicle, as the dashboard reads it."""

    simulation: Simulation
    drone: Drone

    @property
    def tick(self) -> int:
        return self.simulation.world.tick

    @property
    def tick_ns(self) -> int:
        return self.simulation.world.tick_ns

    @property
    def t_ns(self) -> int:
        return self.simulation.world.t_ns

    @property
    def truth(self) -> TruthState:
        return self.drone.vehicle.truth

    @property
    def actuators(self) -> ActuatorFrame:
        vehicle, flight = self.drone.vehicle, self.drone.flight
        most = vehicle.vehicle.rotor_constants.max_speed_radps
        # A rotor's share of its greatest speed is its command where thrust is quadratic in the command.
        controls = tuple(min(abs(speed) / most, 1.0) for speed in vehicle.truth.rotor_speed_radps)
        return ActuatorFrame(self.tick, self.t_ns, controls, flight is not None and flight.armed, 0)

    def take_pace(self) -> float | None:
        return None


class ServedPage:
    """Follows the vehicles of one server for its page, all of them by name."""

    def __init__(self, simulation: Simulation, live: LiveRun, folder: Path) -> None:
        """`folder` holds the bench whose scene the page shows."""
        self._sim, self._live, self._folder = simulation, live, folder
        self._shown: set[str] = set()
        simulation.drawings.kept = True

    async def run(self) -> None:
        """Serve the page until the task is cancelled. A defect of the page ends the page alone."""
        try:
            while True:
                if len(self._shown) < len(self._sim.drones) and self._live.idle:
                    self._add_vehicles()
                self._live.poll()
                await asyncio.sleep(_PERIOD_S)
        except Exception as defect:  # noqa: BLE001 (the clients go on)
            self._sim.log(f"the page ends: {type(defect).__name__}: {defect} (a defect of the server)")
            self._sim.drawings.kept = False
            self._live.close()

    def _add_vehicles(self) -> None:
        new = [drone for drone in self._sim.drones.values() if drone.name not in self._shown]
        vehicles = [(self._live.vehicle(drone.name), drone) for drone in new]
        for vehicle, drone in vehicles:
            self._shown.add(drone.name)
            self._live.attach(vehicle, self._access(drone))

    def _access(self, drone: Drone) -> RunAccess:
        sim = self._sim
        return RunAccess(
            description=self._description(drone),
            scheduler=_Present(sim, drone),
            status=lambda: (_phase(drone), 0, 0),
            texts=lambda: drone.texts,
            wind_W_mps=lambda: sim.world.wind_W_mps,
            slow_facts=lambda: {"told": {"drawings": dict(sim.drawings.counts)}, "skipped": []},
            inject=_refuse,
            set_turbulence=_refuse,
            event=lambda *_: None,
            lockstep=False,
            views=dict,
            stops=False,
            frames=lambda wanted, sent: self._frames(drone, wanted, sent),
        )

    def _description(self, drone: Drone) -> dict[str, Any]:
        sim = self._sim
        cameras = {
            name: {"kind": "camera", "rate_hz": 0.0, "streams": [name + _COLOUR]} for name in drone.settings.cameras
        }
        return {
            "out": str(self._folder.resolve() / drone.name),  # the bench of all is one folder up
            "rig": "AirSim's API",
            "scene": sim.scene.name,
            "mission": None,
            "seed": sim.bench.config.noise_seed,
            "tick_ns": sim.world.tick_ns,
            "lockstep": False,
            "home": drone.vehicle.truth.p_WB,
            "path": [],
            "sensors": cameras,
            "previews": [],
            "watches": True,
            "rotor_positions": [list(rotor.position_m) for rotor in drone.vehicle.vehicle.rotors],
        }

    def _frames(self, drone: Drone, wanted: Sequence[str], sent: dict[str, int]) -> dict[str, Any]:
        """Return the drawings, if they are new, and the pictures that open panes show."""
        sim, truth = self._sim, drone.vehicle.truth
        frames: dict[str, Any] = {}
        if DRAWINGS in wanted and sent.get(DRAWINGS) != sim.drawings.version:
            sent[DRAWINGS] = sim.drawings.version
            segments, texts = sim.drawings.present()
            place = {"t_ns": truth.t_ns, "p": truth.p_WB, "q": truth.q_WB}
            frames[DRAWINGS] = place | {"texts": texts, "segments": segments}
        panes = [stream for stream in wanted if stream.endswith(_COLOUR)]
        # A world that lacks changes is made when a script needs it, so that a page changes nothing.
        if panes and sim.present.is_settled and not sim.lock.held:
            if not sim.frames.is_made:  # after a vehicle was added
                sim.lock.run(sim.frames.seen_by)
                return frames
            pictures = {stream: self._picture(drone, stream) for stream in panes}
            frames |= {stream: picture for stream, picture in pictures.items() if picture is not None}
        return frames

    def _picture(self, drone: Drone, stream: str) -> dict[str, Any] | None:
        sim = self._sim
        try:
            camera = sim.cameras.find(stream.removesuffix(_COLOUR), drone.name)
            rgb = colours(SCENE, sim.cameras.take([Wanted(camera, SCENE)])[0])
        except RpcError:
            return None
        place = camera.place()
        return {"t_ns": sim.world.t_ns, "p": place.p_W, "q": place.q_WC, **array_payload(thinned(rgb))}


def _phase(drone: Drone) -> str:
    flight = drone.flight
    if flight is None:
        return "stands where scripts put it"
    if flight.busy:
        return "in a move"
    return "landed" if flight.landed else "hovers" if flight.armed else "not armed"


def _refuse(_: Any) -> None:
    raise ValueError(_NOT_HERE)
