"""What training does to a picture before each look at it: mirrored, nearer or farther, moved, other light, four in one.

Every picture draws from a stream of its own, numbered by epoch and picture, so that nothing depends on which thread
prepares it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.detect.picture_store import PictureStore, Rgb

_FILL = (114, 114, 114)
# What training looks for begins below what is judged: there are twice as many things to learn from, and one found too
# many down there counts for nothing. What was recorded with fewer pixels than RECORDED_FROM_PX is a blot at any size.
TRAINED_FROM_PX, RECORDED_FROM_PX = 40, 20
_LEAST_LEFT = 0.35  # share of a box that must still be in the picture; below it is nobody's to find


@dataclass(frozen=True)
class Example:
    """One picture as the network gets it, and its objects."""

    rgb: Rgb
    boxes_px: NDArray[np.float32]
    classes: NDArray[np.int64]
    area_px: NDArray[np.float32]  # visible

    @property
    def difficult(self) -> NDArray[np.bool_]:
        """Too little of it to be seen; what was recorded small is not any more once it is drawn larger."""
        return np.asarray(self.area_px < TRAINED_FROM_PX, np.bool_)


@dataclass(frozen=True)
class Strength:
    """How far from what was recorded."""

    zoom: tuple[float, float] = (0.85, 2.2)
    stretch: float = 0.12  # of width against height
    mosaic_share: float = 0.1
    brightness: float = 0.25
    contrast: float = 0.25
    saturation: float = 0.3
    hue: float = 0.04  # of the circle
    noise_share: float = 0.15
    blur_share: float = 0.1


class Augmenter:
    """Numbers classes by `classes`; objects of others are as difficult ones."""

    def __init__(self, store: PictureStore, classes: tuple[str, ...], seed: int, strength: Strength | None) -> None:
        self._store = store
        self._number = {name: i for i, name in enumerate(classes)}
        self._seed = seed
        self._strength = strength

    def example(self, index: int, epoch: int) -> Example:
        """Picture `index` as it is seen in that epoch; without a strength, as it was recorded."""
        plain = self.plain(index)
        s = self._strength
        if s is None:
            return plain
        rng = np.random.Generator(np.random.Philox(key=[self._seed, (epoch << 32) | index]))
        if rng.random() < s.mosaic_share:
            others = rng.integers(0, len(self._store), 3)
            example = _mosaic([plain, *(self.plain(int(i)) for i in others)], rng)
        else:
            example = _moved(plain, s, rng)
        return Example(_relit(example.rgb, s, rng), example.boxes_px, example.classes, example.area_px)

    def plain(self, index: int) -> Example:
        picture = self._store.pictures[index]
        numbers = np.array([self._number.get(name, -1) for name in picture.labels], np.int64)
        known = numbers >= 0
        boxes, areas = self._store.boxes_px(index)[known], self._store.area_px(index)[known]
        areas = np.where(areas < RECORDED_FROM_PX, 0.0, areas).astype(np.float32)
        return Example(self._store.rgb(index), boxes, numbers[known], areas)


def _moved(e: Example, s: Strength, rng: np.random.Generator) -> Example:
    height, width = e.rgb.shape[:2]
    zoom = float(np.exp(rng.uniform(np.log(s.zoom[0]), np.log(s.zoom[1]))))
    stretch = float(np.exp(rng.uniform(-s.stretch, s.stretch)))
    zoom_x, zoom_y = zoom * stretch, zoom / stretch
    # Where the picture's left upper corner comes to lie: anywhere so that the gap, or what is cut off, is shared out.
    shift_x = float(rng.uniform(min(0.0, width * (1 - zoom_x)), max(0.0, width * (1 - zoom_x))))
    shift_y = float(rng.uniform(min(0.0, height * (1 - zoom_y)), max(0.0, height * (1 - zoom_y))))
    mirrored = bool(rng.random() < 0.5)
    a = np.array([[zoom_x, 0.0, shift_x], [0.0, zoom_y, shift_y]])
    if mirrored:
        a = np.array([[-zoom_x, 0.0, width - shift_x], [0.0, zoom_y, shift_y]])
    # Pixel centres lie at half: a box from 0 to width maps by `a`, a pixel's index by half a pixel less on both sides.
    half = a.copy()
    half[:, 2] += a[:, 0] * 0.5 + a[:, 1] * 0.5 - 0.5
    rgb = cv2.warpAffine(e.rgb, half, (width, height), flags=cv2.INTER_LINEAR, borderValue=_FILL)
    boxes = e.boxes_px * np.array([zoom_x, zoom_y] * 2, np.float32) + np.array([shift_x, shift_y] * 2, np.float32)
    if mirrored:
        boxes = np.stack([width - boxes[:, 2], boxes[:, 1], width - boxes[:, 0], boxes[:, 3]], axis=1)
    cut, area, left = _cut(boxes, e.area_px * np.float32(zoom_x * zoom_y), (width, height))
    return Example(np.asarray(rgb, np.uint8), cut[left], e.classes[left], area[left])


def _mosaic(parts: list[Example], rng: np.random.Generator) -> Example:
    """Four pictures at 0.6 of their size, each cut to its quarter: small things, and things beside others."""
    height, width = parts[0].rgb.shape[:2]
    rgb = np.empty_like(parts[0].rgb)
    boxes, classes, areas = [], [], []
    scale = 0.6
    w, h = round(width * scale), round(height * scale)
    for quarter, part in enumerate(parts):
        x0, y0 = (quarter % 2) * (width // 2), (quarter // 2) * (height // 2)
        cut_x, cut_y = int(rng.integers(0, w - width // 2 + 1)), int(rng.integers(0, h - height // 2 + 1))
        small = cv2.resize(part.rgb, (w, h), interpolation=cv2.INTER_AREA)
        rgb[y0 : y0 + height // 2, x0 : x0 + width // 2] = small[
            cut_y : cut_y + height // 2, cut_x : cut_x + width // 2
        ]
        at = part.boxes_px * np.float32(scale) + np.array([-cut_x, -cut_y] * 2, np.float32)
        cut, area, left = _cut(at, part.area_px * np.float32(scale * scale), (width // 2, height // 2))
        boxes.append(cut[left] + np.array([x0, y0] * 2, np.float32))
        areas.append(area[left])
        classes.append(part.classes[left])
    return Example(rgb, np.concatenate(boxes), np.concatenate(classes), np.concatenate(areas))


def _cut(
    boxes: NDArray[np.float32], area_px: NDArray[np.float32], size: tuple[int, int]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """Boxes cut off at the edges, how much of each thing is then to be seen, and which are still there at all.

    A thing is taken to be spread evenly over its box. Of one that is mostly cut off nothing is said any more.
    """
    cut = np.clip(boxes, 0.0, np.array([size[0], size[1]] * 2, np.float32)).astype(np.float32)
    area = (cut[:, 2] - cut[:, 0]) * (cut[:, 3] - cut[:, 1])
    share = area / np.maximum((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]), 1e-6)
    seen = np.where(share < _LEAST_LEFT, 0.0, area_px * share).astype(np.float32)
    return cut, seen, np.asarray(area > 4.0, np.bool_)


def _relit(rgb: Rgb, s: Strength, rng: np.random.Generator) -> Rgb:
    brightness = 1.0 + rng.uniform(-s.brightness, s.brightness)
    contrast = 1.0 + rng.uniform(-s.contrast, s.contrast)
    saturation = 1.0 + rng.uniform(-s.saturation, s.saturation)
    angle = 2.0 * np.pi * rng.uniform(-s.hue, s.hue)
    # Saturation and hue are one matrix in the plane across grey; brightness and contrast scale and shift it.
    grey = np.full((3, 3), 1.0 / 3.0)
    cross = np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]]) / np.sqrt(3.0)
    turn = grey + saturation * (np.cos(angle) * (np.eye(3) - grey) + np.sin(angle) * cross)
    matrix = brightness * contrast * turn
    shift = np.full((3, 1), 128.0 * brightness * (1.0 - contrast))
    out = cv2.transform(rgb, np.hstack([matrix, shift]))
    if rng.random() < s.noise_share:
        sigma = float(rng.uniform(1.0, 7.0))
        noise = rng.standard_normal(rgb.shape, np.float32) * np.float32(sigma)
        out = np.clip(out.astype(np.float32) + noise, 0.0, 255.0).astype(np.uint8)
    if rng.random() < s.blur_share:
        out = cv2.GaussianBlur(out, (3, 3), 0.0)
    return np.asarray(out, np.uint8)
