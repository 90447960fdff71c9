"""Batches for training, prepared by a thread while the network works on the one before.

Pictures that hold something rare are drawn more often (repeat factors of Gupta et al. 2019, LVIS): of a class that a
share f of the pictures holds, by sqrt(OFTEN / f), where that is more than 1; the rarest class of a picture counts.
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

from hil.detect.arrangement import MEAN, STD
from hil.detect.assign import Assigner
from hil.detect.augment import Augmenter
from hil.detect.picture_store import Rgb
from hil.detect.pictures import Picture

OFTEN = 0.3  # share of the pictures from which on a class is not rare
_AHEAD = 3  # batches


class Batch(NamedTuple):
    blob: Tensor  # (B, 3, H, W)
    found: Tensor  # (B, N) as `Assigner.targets` numbers classes
    target_px: Tensor  # (B, N, 4)


def blob_of(pictures: list[Rgb]) -> Tensor:
    """The network's input, channels last, as the companion's `Detector.blob` makes it."""
    height, width, _ = pictures[0].shape
    scale = np.tile(1.0 / (255.0 * np.array(STD)), width).astype(np.float32)  # of a row: numpy is slow on axes of three
    shift = np.tile(np.array(MEAN) / np.array(STD), width).astype(np.float32)
    blob = np.empty((len(pictures), height, width * 3), np.float32)
    for whole, rgb in zip(blob, pictures, strict=True):
        np.multiply(rgb.reshape(height, width * 3), scale, out=whole)
        whole -= shift
    blob = blob.reshape(-1, height, width, 3)
    return torch.from_numpy(blob).permute(0, 3, 1, 2)  # channels last as it lies in memory


def repeat_factors(pictures: Sequence[Picture]) -> NDArray[np.float64]:
    """How often each picture is drawn, on average 1."""
    held = [{n for n, hard in zip(p.labels, p.difficult, strict=True) if not hard} for p in pictures]
    counts = Counter(name for names in held for name in names)
    factor = {name: max(1.0, math.sqrt(OFTEN * len(pictures) / count)) for name, count in counts.items()}
    each = np.array([max((factor[name] for name in sorted(names)), default=1.0) for names in held])
    return np.asarray(each / each.mean(), np.float64)


class Batches:
    """The same batches in the same order for a seed, whatever the threads do."""

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
        """In an epoch; what does not fill a batch is left for other epochs."""
        return self._pictures // self._size

    def epoch(self, number: int) -> Iterator[Batch]:
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
        """Each picture as often as its factor says, the rest of it by chance; as many in all as there are pictures."""
        times = np.floor(self._factors + rng.random(self._pictures)).astype(np.int64)
        drawn = rng.permutation(np.repeat(np.arange(self._pictures), times))
        missing = max(0, self._pictures - len(drawn))
        return np.concatenate([drawn, rng.permutation(self._pictures)[:missing]])[: self._pictures]

    def _make(self, chosen: NDArray[np.int64], epoch: int) -> Batch:
        examples = [self._augmenter.example(int(i), epoch) for i in chosen]
        targets = [self._assigner.targets(e.boxes_px, e.classes, e.difficult) for e in examples]
        return Batch(
            blob_of([e.rgb for e in examples]),
            torch.from_numpy(np.stack([t[0] for t in targets])),
            torch.from_numpy(np.stack([t[1] for t in targets])),
        )
