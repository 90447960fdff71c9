"""What the frame sensors of one run share: the world's geometry. Actors are posed once a moment, however many look."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from numpy.typing import NDArray

from hil.signals.classes import Classes
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.channels import CHANNELS


def channel_array(channel: str, camera: CameraModel) -> NDArray[Any]:
    """A new, unfilled picture."""
    return CHANNELS[channel].empty(camera.height, camera.width)


class Renderer(Protocol):
    """Draws what one camera sees of geometry that has been posed."""

    def render(self, pose: CameraPose, out: Mapping[str, NDArray[Any]], *, rows: tuple[int, int] | None = None) -> None:
        """Fill exactly the channels in `out`; `rows`: only these, from a multiple of 4 to one or to the last."""
        ...


class FrameSource(Protocol):
    """Geometry for all frame sensors of a run."""

    @property
    def geometry(self) -> Any:
        """The FrameGeometry, for whoever casts rays of his own."""
        ...

    @property
    def posed(self) -> int:
        """How many actors were put where they are at some moment, so far."""
        ...

    @property
    def unposed(self) -> int:
        """How many were left out because whoever looked could not see them."""
        ...

    @property
    def classes(self) -> Classes:
        """What the class ids mean."""
        ...

    def expect(self, t_ns: int) -> None:
        """The time is `t_ns`; a renderer then poses what it may see, if nobody has yet."""
        ...

    def renderer(
        self,
        camera: CameraModel,
        *,
        shadows: bool,
        supersample: int,
        near_m: float,
        far_m: float,
        textures: bool = True,
        colour: str = "native",
    ) -> Renderer:
        """A renderer for one camera; `colour`: who draws its rgb (sim.frame.mujoco_backend)."""
        ...

    def close(self) -> None:
        """Give back what renderers hold. Call once, when no further picture is taken."""
        ...


class SharedFrames:
    """The `FrameSource` of a run."""

    def __init__(self, world: Any, *, threads: int = 1) -> None:
        """`world`: sim.scene.world.World. The vehicle's own body is not in it, and so is not seen."""
        from sim.frame.geometry import FrameGeometry

        self.world = world
        self.geometry: Any = FrameGeometry(world)
        self.classes = Classes(world.class_names, world.class_colours)
        self._threads = threads
        self._to_close: list[Callable[[], None]] = []

    @property
    def posed(self) -> int:
        """How many actors were posed, so far."""
        count: int = self.geometry.posed
        return count

    @property
    def unposed(self) -> int:
        """How many were left out because nobody could see them."""
        count: int = self.geometry.unposed
        return count

    def expect(self, t_ns: int) -> None:
        """The time is `t_ns`."""
        self.geometry.expect(t_ns)

    def renderer(
        self,
        camera: CameraModel,
        *,
        shadows: bool,
        supersample: int,
        near_m: float,
        far_m: float,
        textures: bool = True,
        colour: str = "native",
    ) -> Renderer:
        """A renderer for one camera. Raises ColourBackendError where MuJoCo's is asked for and cannot be had."""
        from sim.frame.renderer import FrameRenderer

        native = FrameRenderer(
            self.geometry,
            camera,
            shadows=shadows,
            supersample=supersample,
            textures=textures,
            near_m=near_m,
            far_m=far_m,
            threads=self._threads,
        )
        if colour == "native":
            return native
        from sim.frame.mujoco_backend import MixedRenderer, MujocoColour

        made = MixedRenderer(
            native, MujocoColour(self.world, camera, backend=colour, shadows=shadows, near_m=near_m, far_m=far_m)
        )
        self._to_close.append(made.close)
        return made

    def close(self) -> None:
        """Gives graphics contexts back."""
        while self._to_close:
            self._to_close.pop()()
