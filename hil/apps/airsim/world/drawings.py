"""Drawings of simPlot* for the dashboard's 3-D view: lines, arrows, points, axes and texts, until their time is over.

All but texts are segments with a width and a colour; a point is a segment of length 0. As in AirSim, sizes of points
are pixels, thicknesses of lines and lengths of axes are centimetres, and colours are linear. A persistent drawing stays
until `clear`, a text without a duration too. Any other drawing without a duration is there for one frame in AirSim,
which no page would show; here it is there for `SHORTEST_NS` of simulated time.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.apps.airsim.rpc.arguments import Pose, Vector
from hil.apps.airsim.world.ned import NedFrame
from signals.time import NS_PER_S

MOST_SEGMENTS = 20_000
MOST_TEXTS = 500
SHORTEST_NS = NS_PER_S // 10
_MOST_CHARS = 200  # of one text
_ENDLESS_NS = 1 << 62
_M_PER_CM = 0.01
_AXES_RGB = ((255, 0, 0, 255), (0, 255, 0, 255), (0, 0, 255, 255))  # front, right, up
_HEAD = 0.1  # least length of an arrow's head over that of the arrow

# Ends in W [m]; `width`: in pixels, or if it is negative in metres.
SEGMENT = np.dtype([("from", "<f4", 3), ("to", "<f4", 3), ("width", "<f4"), ("colour", "u1", 4)])
Segments = NDArray[Any]


class Text(NamedTuple):
    """Text at a point of W."""

    p_W: tuple[float, ...]
    text: str
    rgba: tuple[int, ...]


class _Entry(NamedTuple):
    end_ns: int
    segments: bytes
    texts: list[Text]


class Pen(NamedTuple):
    """Colour, width, and the time that a drawing stays: seconds, or until `clear`."""

    colour: Sequence[float]
    width: float
    duration_s: float
    persistent: bool = False


class Drawings:
    """Drawings of one server. They are kept only if a page may show them (`kept`), and the newest ones at most."""

    def __init__(self, frame: NedFrame, now_ns: Callable[[], int], log: Callable[[str], None]) -> None:
        self.counts: Counter[str] = Counter()  # calls so far, by kind
        self.kept = False
        self._origin_W = np.array(frame.origin_W)
        self._now_ns, self._log = now_ns, log
        self._entries: deque[_Entry] = deque()
        self._held = [0, 0]  # segments and texts in all entries
        self._first_end_ns = _ENDLESS_NS  # before it no entry ends
        self._version = 0
        self._is_full = False

    def _counted(self, kind: str) -> bool:
        """Count a call. Return True if its drawing is kept."""
        if not self.kept and kind not in self.counts:
            self._log(f"drawings of the kind {kind} are only counted; start `hil airsim --dash` to see them")
        self.counts[kind] += 1
        return self.kept

    def points(self, points: Sequence[Vector], pen: Pen) -> None:
        """Draw points whose size is in pixels."""
        if self._counted("points"):
            p_W = self._in_W(points)
            self._add(_segments(p_W, p_W, max(pen.width, 1.0), _srgb(pen.colour)), pen)

    def lines(self, points: Sequence[Vector], pen: Pen, *, strip: bool) -> None:
        """Draw a line from each point to the next one, or from each second point."""
        if self._counted("line_strip" if strip else "line_list"):
            p_W = self._in_W(points)
            a, b = (p_W[:-1], p_W[1:]) if strip else (p_W[: len(p_W) // 2 * 2 : 2], p_W[1::2])
            self._add(_segments(a, b, -_M_PER_CM * pen.width, _srgb(pen.colour)), pen)

    def arrows(self, begin: Sequence[Vector], end: Sequence[Vector], size: float, pen: Pen) -> None:
        """Draw arrows. `size`: square of the head's length in cm, as in Unreal; the head is well visible at least."""
        if self._counted("arrows"):
            a, b = self._in_W(begin), self._in_W(end)
            way = b - a
            length = np.sqrt((way**2).sum(axis=1, keepdims=True))
            ahead = way / np.maximum(length, 1e-9)
            side = np.cross(ahead, np.where(np.abs(ahead[:, 2:]) > 0.99, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
            side /= np.maximum(np.sqrt((side**2).sum(axis=1, keepdims=True)), 1e-9)
            head = np.maximum(_M_PER_CM * max(size, 0.0) ** 0.5, _HEAD * length)
            barbs = [b - head * ahead + sign * 0.5 * head * side for sign in (1.0, -1.0)]
            starts, ends = np.concatenate([a, b, b]), np.concatenate([b, *barbs])
            self._add(_segments(starts, ends, -_M_PER_CM * pen.width, _srgb(pen.colour)), pen)

    def transforms(self, poses: Sequence[Pose], scale_cm: float, pen: Pen, names: Sequence[str] | None = None) -> None:
        """Draw the axes of poses: front red, right green, up blue; and names, in the pen's colour."""
        if not self._counted("transforms"):
            return
        p_W = self._in_W([pose.position for pose in poses])
        q = np.array([pose.orientation for pose in poses], float).reshape(-1, 4)
        axes = _axes_W(q / np.maximum(np.sqrt((q**2).sum(axis=1, keepdims=True)), 1e-9))
        made = [
            _segments(p_W, p_W + _M_PER_CM * scale_cm * axis, -_M_PER_CM * pen.width, rgba)
            for axis, rgba in zip(axes, _AXES_RGB, strict=True)
        ]
        self._add(np.concatenate(made), pen, [] if names is None else _texts(p_W, names, pen.colour))

    def strings(self, texts: Sequence[str], points: Sequence[Vector], pen: Pen) -> None:
        """Write texts at points."""
        if self._counted("strings"):
            endless = pen._replace(persistent=not pen.duration_s > 0.0)
            self._add(np.empty(0, SEGMENT), endless, _texts(self._in_W(points), texts, pen.colour))

    def clear(self) -> None:
        """Take all drawings away."""
        self._keep([])

    def _in_W(self, points: Sequence[Vector]) -> NDArray[np.float64]:
        newest = points[-MOST_SEGMENTS - 1 :]
        return np.array(newest, float).reshape(-1, 3)[:, [1, 0, 2]] * (1.0, 1.0, -1.0) + self._origin_W

    def _add(self, segments: Segments, pen: Pen, texts: Sequence[Text] = ()) -> None:
        if not len(segments) and not texts:
            return
        seconds = min(pen.duration_s, _ENDLESS_NS / NS_PER_S) if pen.duration_s > 0.0 else 0.0
        end_ns = _ENDLESS_NS if pen.persistent else self._now_ns() + max(SHORTEST_NS, round(seconds * NS_PER_S))
        self._drop_old()
        self._version += 1
        new = _Entry(end_ns, segments[-MOST_SEGMENTS:].tobytes(), list(texts[-MOST_TEXTS:]))
        self._entries.append(new)
        self._first_end_ns = min(self._first_end_ns, end_ns)
        self._count(new, 1)
        is_full = len(segments) > MOST_SEGMENTS or len(texts) > MOST_TEXTS
        while self._held[0] > MOST_SEGMENTS or self._held[1] > MOST_TEXTS:
            self._count(self._entries.popleft(), -1)
            is_full = True
        if is_full and not self._is_full:
            self._is_full = True
            self._log(f"only the newest drawings are shown: {MOST_SEGMENTS} lines and points, {MOST_TEXTS} texts")

    def _count(self, entry: _Entry, sign: int) -> None:
        self._held[0] += sign * (len(entry.segments) // SEGMENT.itemsize)
        self._held[1] += sign * len(entry.texts)

    def _keep(self, entries: Sequence[_Entry]) -> None:
        self._entries, self._held = deque(entries), [0, 0]
        self._first_end_ns = min((each.end_ns for each in entries), default=_ENDLESS_NS)
        for each in entries:
            self._count(each, 1)
        self._version += 1

    def _drop_old(self) -> None:
        now_ns = self._now_ns()
        if now_ns >= self._first_end_ns:
            self._keep([each for each in self._entries if each.end_ns > now_ns])

    @property
    def version(self) -> int:
        """Number that changes with what is to be seen now."""
        self._drop_old()
        return self._version

    def present(self) -> tuple[bytes, list[Text]]:
        """Return the segments (rows of `SEGMENT`) and texts that are to be seen now, the oldest first."""
        self._drop_old()
        return b"".join(each.segments for each in self._entries), [t for each in self._entries for t in each.texts]


def _segments(a: NDArray[Any], b: NDArray[Any], width: float, rgba: tuple[int, ...]) -> Segments:
    made = np.empty(len(a), SEGMENT)
    made["from"], made["to"], made["width"], made["colour"] = a, b, width, rgba
    return made


def _texts(p_W: NDArray[Any], texts: Sequence[str], colour: Sequence[float]) -> list[Text]:
    rgba = _srgb(colour)
    newest = zip(p_W.tolist()[-MOST_TEXTS:], texts[-MOST_TEXTS:], strict=True)
    return [Text(tuple(p), text[:_MOST_CHARS], rgba) for p, text in newest]


def _srgb(linear: Sequence[float]) -> tuple[int, ...]:
    """Return a colour as bytes; a missing component is 0, a missing alpha 1."""
    r, g, b, a = (min(max(x, 0.0), 1.0) for x in (*linear, *(0.0, 0.0, 0.0, 1.0)[len(linear) :]))
    rgb = (12.92 * x if x <= 0.0031308 else 1.055 * x ** (1.0 / 2.4) - 0.055 for x in (r, g, b))
    return (*(round(255.0 * x) for x in rgb), round(255.0 * a))


def _axes_W(q: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return front, right and up in W of attitudes FRD->NED."""
    w, x, y, z = q.T
    front_N = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    right_N = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
    down_N = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    front, right, down = (np.stack([e, n, -d], axis=1) for n, e, d in (front_N, right_N, down_N))
    return [front, right, -down]
