"""Geometry shared by the frame sensors of one run. An actor is posed at most once per time, for all sensors."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from signals.channels import CHANNELS
from signals.classes import Classes
from signals.samples import TruthState
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.shading import PLAIN, Shading

VEHICLE_CLASS = "drone"  # class of a run's vehicles, and prefix of their names among the actors


def channel_array(channel: str, camera: CameraModel) -> NDArray[Any]:
    """Return a new array for a channel, with undefined content."""
    return CHANNELS[channel].empty(camera.height, camera.width)


class Renderer(Protocol):
    """Renderer of one camera's view of posed geometry."""

    def render(self, pose: CameraPose, out: Mapping[str, NDArray[Any]], *, rows: tuple[int, int] | None = None) -> None:
        """Fill exactly the channels in `out`; `rows`: only rows [from, to), multiples of 4 or the height."""
        ...


@runtime_checkable
class ExposingRenderer(Protocol):
    """Renderer that draws the colour of a whole exposure at once, with all its moments and rows."""

    def expose(self, moments: Sequence[Sequence[tuple[tuple[int, int], CameraPose]]], rgb: NDArray[np.uint8]) -> None:
        """Fill `rgb` with the mean, in linear light, of moments; each is a list of rows [from, to) and their pose."""
        ...


class SharedFrames:
    """Geometry for all frame sensors of a run.

    The world of a run of several vehicles holds them all as actors (sim/physics/vehicle_bodies.py). `place` gives their
    states, and the sensors of each vehicle have the source `seen_by` it, which does not show the vehicle itself.
    """

    def __init__(self, world: Any, *, threads: int = 1) -> None:
        """`world`: sim.scene.world.World."""
        from sim.frame.geometry import FrameGeometry

        self.world = world
        self.geometry: Any = FrameGeometry(world)
        self.classes = Classes(world.class_names, world.class_colours)
        self._threads = threads
        self._to_close: list[Callable[[], None]] = []
        self._number_of = {id(actor): number for number, actor in enumerate(world.map.actors)}
        self._actors = {actor.name: (number, actor) for number, actor in enumerate(world.map.actors)}

    def place(self, vehicle: str, truth: TruthState) -> None:
        """Give the state of a vehicle at a tick, before the sensors of that tick are sampled."""
        number, actor = self._actors[f"{VEHICLE_CLASS}:{vehicle}"]
        actor.place(truth)
        self.geometry.forget(number)

    def place_alone(self, vehicle: str, truth: TruthState) -> None:
        """Give the state of a vehicle at a tick in place of all others, if ticks are sampled in any order."""
        number, actor = self._actors[f"{VEHICLE_CLASS}:{vehicle}"]
        actor.place_alone(truth)
        self.geometry.forget(number)

    def restore(self, vehicle: str, states: bytes) -> None:
        """Give the states of a vehicle up to a tick, as `VehicleBodies.states_since` has returned them."""
        number, actor = self._actors[f"{VEHICLE_CLASS}:{vehicle}"]
        actor.restore(states)
        self.geometry.forget(number)

    def moved(self, actor: Any) -> None:
        """Take notice that an actor of the world was put elsewhere."""
        self.geometry.forget(self._number_of[id(actor)])

    def seen_by(self, vehicle: str) -> SharedFrames:
        """Return the source for the sensors of a vehicle: the same geometry without the vehicle itself."""
        view = copy.copy(self)
        view.geometry = self.geometry.without(f"{VEHICLE_CLASS}:{vehicle}")
        view._to_close = []
        return view

    @property
    def posed(self) -> int:
        """Number of actor poses so far."""
        count: int = self.geometry.posed
        return count

    @property
    def unposed(self) -> int:
        """Number of actor poses skipped because no sensor could see the actor."""
        count: int = self.geometry.unposed
        return count

    def expect(self, t_ns: int) -> None:
        """Set the time to `t_ns`; each sensor then poses the actors that it may see."""
        self.geometry.expect(t_ns)

    def renderer(
        self,
        camera: CameraModel,
        *,
        shadows: bool,
        supersample: int,
        near_m: float,
        far_m: float,
        shading: Shading = PLAIN,
        colour: str = "native",
        samples: int | None = None,
    ) -> Renderer:
        """Return a renderer for one camera. Raises ColourBackendError if the backend of its colour is missing.

        `colour`: the backend of its rgb (sim.frame.mujoco_backend, sim.frame.path_traced.renderer). `samples`: paths
        per pixel of `path_traced`.
        """
        from sim.frame.renderer import Execution, FrameRenderer

        # Beside another backend the raster draws no colour, and needs nothing that belongs to colour.
        draws_colour = colour == "native"
        native = FrameRenderer(
            self.geometry,
            camera,
            shadows=shadows and draws_colour,
            supersample=supersample if draws_colour else 1,
            planes_m=(near_m, far_m),
            shading=shading if draws_colour else PLAIN,
            execution=Execution(threads=self._threads),
        )
        if draws_colour:
            return native
        if colour == "path_traced":
            from sim.frame.path_traced.renderer import DEFAULT_SAMPLES, PathTracedRenderer, tracer_of

            traced = PathTracedRenderer(
                native, tracer_of(self.geometry), samples=samples or DEFAULT_SAMPLES, shading=shading
            )
            self._to_close.append(traced.close)
            return traced
        from sim.frame.mujoco_backend import MixedRenderer, MujocoColour

        mixed = MixedRenderer(
            native, MujocoColour(self.world, camera, backend=colour, shadows=shadows, near_m=near_m, far_m=far_m)
        )
        self._to_close.append(mixed.close)
        return mixed

    def close(self) -> None:
        """Release the graphics contexts and the path tracer's process. Call once, after the last picture."""
        while self._to_close:
            self._to_close.pop()()
