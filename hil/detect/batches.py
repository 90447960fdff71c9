"""Batches for training, prepared by threads while the network works on the one before."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
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

_AHEAD = 3  # batches


class Batch(NamedTuple):
    blob: Tensor  # (B, 3, H, W)
    found: Tensor  # (B, N) as `Assigner.targets` numbers classes
    target_px: Tensor  # (B, N, 4)


def blob_of(pictures: list[Rgb]) -> Tensor:
    """The network's input, channels last, as the companion's `Detector.blob` makes it."""
    stacked = torch.from_numpy(np.stack(pictures)).permute(0, 3, 1, 2).to(torch.float32)
    mean, std = torch.tensor(MEAN).reshape(1, 3, 1, 1), torch.tensor(STD).reshape(1, 3, 1, 1)
    return (stacked * (1.0 / (255.0 * std)) - mean / std).contiguous(memory_format=torch.channels_last)


class Batches:
    """The same batches in the same order for a seed, whatever the threads do."""

    def __init__(self, augmenter: Augmenter, assigner: Assigner, pictures: int, *, size: int, seed: int) -> None:
        self._augmenter = augmenter
        self._assigner = assigner
        self._pictures = pictures
        self._size = min(size, pictures)
        self._seed = seed

    def __len__(self) -> int:
        """In an epoch; what does not fill a batch is left for other epochs."""
        return self._pictures // self._size

    def epoch(self, number: int) -> Iterator[Batch]:
        order = np.random.Generator(np.random.Philox(key=[self._seed, (number << 32) | 0xFFFFFFFF])).permutation(
            self._pictures
        )
        waiting: deque[Future[Batch]] = deque()
        with ThreadPoolExecutor(1) as pool:
            for i in range(len(self)):
                chosen = order[i * self._size : (i + 1) * self._size]
                waiting.append(pool.submit(self._make, chosen, number))
                if len(waiting) > _AHEAD:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()

    def _make(self, chosen: NDArray[np.int64], epoch: int) -> Batch:
        examples = [self._augmenter.example(int(i), epoch) for i in chosen]
        targets = [self._assigner.targets(e.boxes_px, e.classes, e.difficult) for e in examples]
        return Batch(
            blob_of([e.rgb for e in examples]),
            torch.from_numpy(np.stack([t[0] for t in targets])),
            torch.from_numpy(np.stack([t[1] for t in targets])),
        )
