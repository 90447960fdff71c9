"""Pictures of a camera that other sensors read too, such as a radar that is due at the same tick.

At a tick at which a reader is also due, the camera draws the reader's channels in the same pass. The reader gets the
same bits as if it had drawn them itself: the geometry of the whole picture at the tick. Effects of the camera never
reach a reader:

* noise, gain and vignetting change colour, depth noise changes planar depth: readers get neither channel;
* motion blur and supersampling draw colour in passes of their own: these are not shared;
* the rows of a rolling shutter belong to different times: such a camera shares nothing.

A reader that finds no picture draws its own. So its data do not depend on the order or the rates of the two sensors, or
on whether the camera is sampled at all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from signals.samples import TruthState, Vec3
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.source import Renderer, channel_array

_NEVER_NS = -1
CHANGED_BY_CAMERAS = frozenset({"rgb", "depth", "infrared"})  # channels with the camera's noise, gain and blur


@dataclass(frozen=True)
class _Drawn:
    """Picture that was drawn for readers."""

    t_ns: int
    pose: CameraPose
    channels: Mapping[str, NDArray[Any]]


class SharedPicture:
    """View of one camera, with the picture that was drawn last."""

    def __init__(self, camera: CameraModel, *, mount_m: Vec3, mount_rpy_deg: Vec3, near_m: float, far_m: float) -> None:
        self.camera = camera
        self.mount_m, self.mount_rpy_deg = mount_m, mount_rpy_deg
        self.near_m, self.far_m = near_m, far_m
        self._readers: list[tuple[tuple[str, ...], Callable[[int], bool]]] = []
        self._buffers: dict[str, NDArray[Any]] = {}
        self._tick, self._t_ns = 0, _NEVER_NS
        self._drawn: _Drawn | None = None
        self._missed_ns = _NEVER_NS

    def add_reader(self, channels: Sequence[str], due: Callable[[int], bool]) -> None:
        """Register a reader of `channels` at ticks that are `due`. Raises ValueError for `CHANGED_BY_CAMERAS`."""
        changed = CHANGED_BY_CAMERAS.intersection(channels)
        if changed:
            raise ValueError(
                f"{', '.join(sorted(changed))}: a camera may change this channel, so no other sensor reads it"
            )
        self._readers.append((tuple(channels), due))

    def expect(self, truth: TruthState) -> None:
        """Announce the camera's picture of this tick."""
        self._tick, self._t_ns = truth.tick, truth.t_ns

    def sharing(self, renderer: Renderer, *, separate_colour: bool) -> Renderer:
        """Return a renderer for the camera that also draws for readers.

        `separate_colour`: colour has its own pass.
        """
        return _SharingRenderer(self, renderer, separate_colour)

    def find(self, t_ns: int, pose: CameraPose, channels: Sequence[str]) -> Mapping[str, NDArray[Any]] | None:
        """Return the channels from `pose` at `t_ns`, valid until the next picture; None if they were not drawn."""
        last = self._drawn
        if last is None or last.t_ns != t_ns or last.pose != pose or not set(channels) <= set(last.channels):
            self._missed_ns = t_ns  # the reader draws its own picture, so the camera need not draw for it
            return None
        return last.channels

    def wanted(self) -> tuple[str, ...]:
        """Channels that readers need at the camera's tick."""
        if self._t_ns == self._missed_ns:
            return ()
        names = [name for channels, due in self._readers if due(self._tick) for name in channels]
        return tuple(dict.fromkeys(names))

    def draw(
        self, renderer: Renderer, pose: CameraPose, out: Mapping[str, NDArray[Any]], reader_channels: Sequence[str]
    ) -> None:
        """Draw the channels of the camera and of the readers in one pass."""
        reader_arrays = {name: out[name] if name in out else self._buffer(name) for name in reader_channels}
        renderer.render(pose, {**out, **reader_arrays})
        self._drawn = _Drawn(self._t_ns, pose, reader_arrays)

    def _buffer(self, name: str) -> NDArray[Any]:
        if name not in self._buffers:
            self._buffers[name] = channel_array(name, self.camera)
        return self._buffers[name]


class _SharingRenderer:
    """Renderer of the camera that adds the readers' channels if that needs no further pass."""

    def __init__(self, shared: SharedPicture, renderer: Renderer, separate_colour: bool) -> None:
        self._shared, self._renderer, self._separate_colour = shared, renderer, separate_colour

    def render(self, pose: CameraPose, out: Mapping[str, NDArray[Any]], *, rows: tuple[int, int] | None = None) -> None:
        """Fill exactly the channels in `out`; `rows`: only these."""
        geometry_drawn = any(name != "rgb" or not self._separate_colour for name in out)
        reader_channels = self._shared.wanted() if rows is None and geometry_drawn else ()
        if reader_channels:
            self._shared.draw(self._renderer, pose, out, reader_channels)
        else:
            self._renderer.render(pose, out, rows=rows)
