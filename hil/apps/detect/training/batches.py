"""Training batches, prepared by a thread while the network processes the previous batch.

Pictures with rare classes are repeated more often, by repeat factors (Gupta et al. 2019, LVIS): a picture's factor is
max(1, sqrt(COMMON_SHARE / f)), where f is the share of pictures that hold its rarest class.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hil.apps.detect.picture_store import Rgb
from hil.apps.detect.pictures import Picture
from hil.apps.detect.training.assign import Assigner
from hil.apps.detect.training.augment import Augmenter
from hil.apps.detect.training.layout import MEAN, STD

COMMON_SHARE = 0.3  # a class in at least this share of the pictures is not rare
_AHEAD = 3  # batches prepared in advance


class Batch(NamedTuple):
    """Input and targets of a training step, for B pictures and N anchors."""

    blob: Tensor  # (B, 3, H, W)
    classes: Tensor  # (B, N) target classes of the anchors, as returned by `Assigner.targets`
    target_px: Tensor  # (B, N, 4) x0, y0, x1, y1


def blob_of(pictures: list[Rgb]) -> Tensor:
    """Return the network's input, (B, 3, H, W) in channels-last memory, as the companion's `Detector.blob` makes it."""
    height, width, _ = pictures[0].shape
    # Repeated over a whole picture row, because numpy broadcasts slowly along an axis of 3.
    scale = np.tile(1.0 / (255.0 * np.array(STD)), width).astype(np.float32)
    shift = np.tile(np.array(MEAN) / np.array(STD), width).astype(np.float32)
    blob = np.empty((len(pictures), height, width * 3), np.float32)
    for out, rgb in zip(blob, pictures, strict=True):
        np.multiply(rgb.reshape(height, width * 3), scale, out=out)
        out -= shift
    blob = blob.reshape(-1, height, width, 3)
    return torch.from_numpy(blob).permute(0, 3, 1, 2)  # memory stays channels-last


def repeat_factors(pictures: Sequence[Picture]) -> NDArray[np.float64]:
    """Return each picture's expected number of uses per epoch, (pictures,), with mean 1."""
    classes_by_picture = [{n for n, hard in zip(p.labels, p.difficult, strict=True) if not hard} for p in pictures]
    counts = Counter(name for names in classes_by_picture for name in names)
    factor = {name: max(1.0, math.sqrt(COMMON_SHARE * len(pictures) / count)) for name, count in counts.items()}
    factors = np.array([max((factor[name] for name in sorted(names)), default=1.0) for names in classes_by_picture])
    return np.asarray(factors / factors.mean(), np.float64)


class Batches:
    """Batches of an epoch. The same seed gives the same batches in the same order, regardless of threads."""

    def __init__(
        self, augmenter: Augmenter, assigner: Assigner, pictures: Sequence[Picture], *, size: int, seed: int
    ) -> None:
        self._augmenter = augmenter
        self._assigner = assigner
        self._pictures = len(pictures)
        self._factors = repeat_factors(pictures)
        self._size = min(size, len(pictures))
        self._seed = seed

    def __len__(self) -> int:
        """Return the number of batches per epoch; pictures that do not fill a last batch are not used in that epoch."""
        return self._pictures // self._size

    def epoch(self, number: int) -> Iterator[Batch]:
        """Yield the batches of epoch `number`."""
        # The low half of the key is a picture's number in `Augmenter.example`; all ones is the number of no picture.
        order = self._order(np.random.Generator(np.random.Philox(key=[self._seed, (number << 32) | 0xFFFFFFFF])))
        waiting: deque[Future[Batch]] = deque()
        with ThreadPoolExecutor(1) as pool:
            for i in range(len(self)):
                chosen = order[i * self._size : (i + 1) * self._size]
                waiting.append(pool.submit(self._make, chosen, number))
                if len(waiting) > _AHEAD:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()

    def _order(self, rng: np.random.Generator) -> NDArray[np.int64]:
        """Return an epoch's picture numbers in random order, as many as there are pictures.

        A picture is repeated by the whole part of its factor, and once more with the probability of the fraction.
        """
        repeats = np.floor(self._factors + rng.random(self._pictures)).astype(np.int64)
        order = rng.permutation(np.repeat(np.arange(self._pictures), repeats))
        missing = max(0, self._pictures - len(order))
        return np.concatenate([order, rng.permutation(self._pictures)[:missing]])[: self._pictures]

    def _make(self, chosen: NDArray[np.int64], epoch: int) -> Batch:
        examples = [self._augmenter.example(int(i), epoch) for i in chosen]
        targets = [self._assigner.targets(e.boxes_px, e.classes, e.difficult) for e in examples]
        return Batch(
            blob_of([e.rgb for e in examples]),
            torch.from_numpy(np.stack([t[0] for t in targets])),
            torch.from_numpy(np.stack([t[1] for t in targets])),
        )
