"""One camera's pictures, read by others too: where a camera and a radar look at the same moment, one drawing does.

The camera draws; at a tick at which a reader is due as well, it draws the channels of the reader in the same go. What
the reader gets is what it would have drawn itself, bit for bit: the geometry of the whole picture at the tick, as the
raster gives it. Nothing that the camera does to its own pictures reaches it:

* noise, gain and vignetting change colour, depth noise the planar depth: readers get neither channel;
* blur draws colour at other moments, a second sample per pixel colour alone: such drawings are not shared;
* the rows of a rolling shutter are of different moments: such a camera shares nothing.

Whoever finds nothing here draws for himself. So it does not matter which of the two is sampled first, whether their
rates agree, or whether the camera is sampled at all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from hil.signals.samples import TruthState, Vec3
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.source import Renderer, channel_array

_NEVER_NS = -1
CHANGED_BY_CAMERAS = frozenset({"rgb", "depth"})  # noise, gain, blur: no truth for anybody else


@dataclass(frozen=True)
class _Kept:
    """A picture that was drawn for readers."""

    t_ns: int
    pose: CameraPose
    channels: Mapping[str, NDArray[Any]]


class SharedPicture:
    """The view of one camera, and what was drawn of it last."""

    def __init__(self, camera: CameraModel, *, mount_m: Vec3, mount_rpy_deg: Vec3, near_m: float, far_m: float) -> None:
        self.camera = camera
        self.mount_m, self.mount_rpy_deg = mount_m, mount_rpy_deg
        self.near_m, self.far_m = near_m, far_m
        self._readers: list[tuple[tuple[str, ...], Callable[[int], bool]]] = []
        self._buffers: dict[str, NDArray[Any]] = {}
        self._tick, self._t_ns = 0, _NEVER_NS
        self._kept: _Kept | None = None
        self._missed_ns = _NEVER_NS

    def add_reader(self, channels: Sequence[str], due: Callable[[int], bool]) -> None:
        """Somebody who will look for `channels` at the ticks that are `due`. ValueError for what cameras change."""
        changed = CHANGED_BY_CAMERAS.intersection(channels)
        if changed:
            raise ValueError(f"{', '.join(sorted(changed))}: a camera may change it, so nobody else reads it")
        self._readers.append((tuple(channels), due))

    def expect(self, truth: TruthState) -> None:
        """The camera is about to take its picture of this tick."""
        self._tick, self._t_ns = truth.tick, truth.t_ns

    def lend(self, renderer: Renderer, *, colour_apart: bool) -> Renderer:
        """The camera's renderer, which draws for the readers too. `colour_apart`: it draws colour in another go."""
        return _LentRenderer(self, renderer, colour_apart)

    def find(self, t_ns: int, pose: CameraPose, channels: Sequence[str]) -> Mapping[str, NDArray[Any]] | None:
        """The channels as they are from `pose` at `t_ns`, to be read before the next picture; None: not drawn."""
        kept = self._kept
        if kept is None or kept.t_ns != t_ns or kept.pose != pose or not set(channels) <= set(kept.channels):
            self._missed_ns = t_ns  # drawn by the reader itself: the camera need not do it again
            return None
        return kept.channels

    def wanted(self) -> tuple[str, ...]:
        """What readers want of the camera's present tick."""
        if self._t_ns == self._missed_ns:
            return ()
        names = [name for channels, due in self._readers if due(self._tick) for name in channels]
        return tuple(dict.fromkeys(names))

    def draw(self, renderer: Renderer, pose: CameraPose, out: Mapping[str, NDArray[Any]], more: Sequence[str]) -> None:
        """Draw the camera's own channels and those of the readers in one go."""
        found = {name: out[name] if name in out else self._buffer(name) for name in more}
        renderer.render(pose, {**out, **found})
        self._kept = _Kept(self._t_ns, pose, found)

    def _buffer(self, name: str) -> NDArray[Any]:
        if name not in self._buffers:
            self._buffers[name] = channel_array(name, self.camera)
        return self._buffers[name]


class _LentRenderer:
    """Draws as the camera's own renderer does, and for readers where it costs no drawing of its own."""

    def __init__(self, shared: SharedPicture, renderer: Renderer, colour_apart: bool) -> None:
        self._shared, self._renderer, self._colour_apart = shared, renderer, colour_apart

    def render(self, pose: CameraPose, out: Mapping[str, NDArray[Any]], *, rows: tuple[int, int] | None = None) -> None:
        """Fill exactly the channels in `out`; `rows`: only these."""
        geometry_drawn = any(name != "rgb" or not self._colour_apart for name in out)
        more = self._shared.wanted() if rows is None and geometry_drawn else ()
        if more:
            self._shared.draw(self._renderer, pose, out, more)
        else:
            self._renderer.render(pose, out, rows=rows)
