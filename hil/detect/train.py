"""Training: epochs over the pictures with a falling learning rate, judged now and then, stored after each.

The same data, settings, versions and processor give the same weights, whatever else the machine does: batches and
their augmentation are numbered, PyTorch is held to deterministic algorithms, and the number of threads is a setting,
because sums are split by it. A training that was stopped goes on from `last.pt` as if nothing had been.
"""

from __future__ import annotations

import copy
import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import torch
from hil_companion.detect.decode import decode
from torch import Tensor, nn

from hil.detect.arrangement import INPUT_PX, LEVELS, described
from hil.detect.assign import Assigner
from hil.detect.augment import Augmenter, Strength
from hil.detect.batches import Batches, blob_of
from hil.detect.evaluate import Evaluation, judged_at
from hil.detect.loss import detection_loss
from hil.detect.model import SsdLite, by_anchor
from hil.detect.picture_store import PictureStore
from hil.detect.pictures import Picture, class_counts
from hil.signals.errors import ConfigError, Problem, RecordingError

CHECKPOINT = "last.pt"
_JUDGED_PICTURES = 400  # at most, while training: the whole set is judged at the end
_JUDGED_SCORE = 0.05
_WARM_UP_STEPS = 200
_GRADIENT_NORM = 10.0


@dataclass(frozen=True)
class Settings:
    """What a training hangs on besides its data."""

    epochs: int = 30
    batch: int = 16
    seed: int = 1
    learning_rate: float = 2e-3  # of AdamW, at its highest
    weight_decay: float = 0.02
    average_decay: float = 0.998
    threads: int = 2
    precision: str = "fp32"  # or bf16: convolutions in half the bits, weights in all of them
    least_objects: int = 100  # of a class in the training pictures; with fewer it is left out
    judge_every: int = 3  # epochs

    def __post_init__(self) -> None:
        wrong = [
            Problem(f"--{name.replace('_', '-')}", f"{getattr(self, name)!r}", "a number above 0 is needed")
            for name in ("epochs", "batch", "learning_rate", "threads", "least_objects", "judge_every")
            if not getattr(self, name) > 0
        ]
        if self.precision not in ("fp32", "bf16"):
            wrong.append(Problem("--precision", f"{self.precision!r}", "fp32 or bf16"))
        if wrong:
            raise ConfigError(wrong)


@dataclass(frozen=True)
class Epoch:
    """What is told of each."""

    number: int  # from 1
    loss_scores: float
    loss_boxes: float
    learning_rate: float
    evaluation: Evaluation | None


class Averaged:
    """A moving average of a network's weights, which judges better than where the optimiser just stands.

    After n steps each weight counts the last 1 / (1 - decay) steps or so; fewer at the beginning.
    """

    def __init__(self, model: nn.Module, decay: float) -> None:
        self.model = copy.deepcopy(model).eval()
        self.decay = decay
        self.steps = 0
        for p in self.model.parameters():
            p.requires_grad_(False)

    @torch.no_grad()
    def update(self, model: nn.Module) -> None:
        self.steps += 1
        decay = min(self.decay, (1.0 + self.steps) / (10.0 + self.steps))
        for own, new in zip(self.model.state_dict().values(), model.state_dict().values(), strict=True):
            if own.dtype.is_floating_point:
                own.lerp_(new, 1.0 - decay)
            else:
                own.copy_(new)


class Training:
    """One training, from pictures to averaged weights."""

    def __init__(
        self, pictures: Sequence[Picture], validation: Sequence[Picture], settings: Settings, *, out: Path
    ) -> None:
        """ConfigError where no class has enough objects."""
        self.settings = settings
        self.out = out
        counts = class_counts(pictures)
        self.classes = tuple(sorted(n for n, c in counts.items() if c >= settings.least_objects))
        self.left_out = {n: c for n, c in sorted(counts.items()) if c < settings.least_objects}
        if not self.classes:
            most = max(counts.values(), default=0)
            hint = f"record more, or take --least-objects {max(1, most)}"
            raise ConfigError([Problem("labels", f"no class has {settings.least_objects} objects", hint)])
        torch.use_deterministic_algorithms(True)
        # What nobody has written is not read here, and to fill it is a fifth of all time.
        torch.utils.deterministic.fill_uninitialized_memory = False
        torch.set_num_threads(settings.threads)
        cv2.setNumThreads(1)
        torch.manual_seed(settings.seed)
        self._store = PictureStore(pictures, INPUT_PX)
        self._judged = validation[:: max(1, math.ceil(len(validation) / _JUDGED_PICTURES))]
        self._judged_store = PictureStore(self._judged, INPUT_PX)
        self._assigner = Assigner(LEVELS, INPUT_PX)
        self._anchors = torch.from_numpy(self._assigner.anchors_px)
        self.model: nn.Module = SsdLite(len(self.classes), [v.per_place for v in LEVELS]).to(
            memory_format=torch.channels_last
        )
        self._averaged = Averaged(self.model, settings.average_decay)
        plain = [p for p in self.model.parameters() if p.ndim <= 1]
        decayed = [p for p in self.model.parameters() if p.ndim > 1]
        groups = [{"params": decayed, "weight_decay": settings.weight_decay}, {"params": plain, "weight_decay": 0.0}]
        self._optimiser = torch.optim.AdamW(groups, lr=settings.learning_rate)
        self._epochs_done = 0
        augmenter = Augmenter(self._store, self.classes, settings.seed, Strength())
        self.batches = Batches(augmenter, self._assigner, pictures, size=settings.batch, seed=settings.seed)
        # The last sixth sees pictures as they were recorded, but for the light: the statistics of those are judged.
        gentle = Augmenter(self._store, self.classes, settings.seed, Strength(zoom=(1.0, 1.3), mosaic_share=0.0))
        self._gentle = Batches(gentle, self._assigner, pictures, size=settings.batch, seed=settings.seed)

    @property
    def averaged(self) -> nn.Module:
        """The weights to use."""
        return self._averaged.model

    @property
    def epochs_done(self) -> int:
        return self._epochs_done

    def take_over(self, path: Path) -> tuple[int, int]:
        """Begin from a user's weights, as far as names and shapes agree: how many tensors, of how many. ConfigError."""
        data = _loaded(path)
        state = data.get("average", data)
        own = self.model.state_dict()
        same = {
            k: v
            for k, v in state.items()
            if k in own and isinstance(v, Tensor) and tuple(v.shape) == tuple(own[k].shape)
        }
        if not same:
            hint = f"give a {CHECKPOINT} of `hil detect train`, or a state_dict of its model"
            raise ConfigError([Problem(str(path), "has no weights that fit this network", hint)])
        self.model.load_state_dict({**own, **same})
        self._averaged = Averaged(self.model, self.settings.average_decay)
        return len(same), len(own)

    def resume(self) -> bool:
        """Go on from the folder's checkpoint, where there is one. ConfigError if it is of another training."""
        path = self.out / CHECKPOINT
        if not path.is_file():
            return False
        data = _loaded(path)
        made = {"settings": asdict(self.settings), "classes": list(self.classes)}
        for key, value in made.items():
            if data.get(key) != value:
                hint = "begin in another folder, or leave out --resume"
                raise ConfigError([Problem(str(path), f"is of a training with other {key}", hint)])
        self.model.load_state_dict(data["model"])
        self._averaged.model.load_state_dict(data["average"])
        self._averaged.steps = int(data["steps"])
        self._optimiser.load_state_dict(data["optimiser"])
        self._epochs_done = int(data["epoch"])
        return True

    def run(self, *, step: Callable[[int, int, float], None], epoch: Callable[[Epoch], None]) -> None:
        """All epochs that are left. `step(epoch, step, loss)` after each batch."""
        total = self.settings.epochs * len(self.batches)
        while self._epochs_done < self.settings.epochs:
            number = self._epochs_done
            late = number >= self.settings.epochs - max(1, self.settings.epochs // 6)
            sums, rate = [0.0, 0.0], 0.0
            for i, batch in enumerate((self._gentle if late else self.batches).epoch(number)):
                rate = self._rate(number * len(self.batches) + i, total)
                scores, boxes = self._step(batch.blob, batch.found, batch.target_px, rate)
                sums = [sums[0] + scores, sums[1] + boxes]
                step(number + 1, i + 1, scores + boxes)
            self._epochs_done += 1
            self._store_checkpoint()
            due = self._epochs_done % self.settings.judge_every == 0 or self._epochs_done == self.settings.epochs
            count = len(self.batches)
            judged = self.judged() if due and self._judged else None
            epoch(Epoch(self._epochs_done, sums[0] / count, sums[1] / count, rate, judged))

    def _step(self, blob: Tensor, found: Tensor, target_px: Tensor, rate: float) -> tuple[float, float]:
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        self.model.train()
        with torch.autocast("cpu", torch.bfloat16, enabled=self.settings.precision == "bf16"):
            maps = self.model(blob)
        logits, offsets = by_anchor([m.float() for m in maps], len(self.classes))
        scores, boxes = detection_loss(logits, offsets, self._anchors, found, target_px)
        self._optimiser.zero_grad(set_to_none=True)
        (scores + boxes).backward()
        nn.utils.clip_grad_norm_(self.model.parameters(), _GRADIENT_NORM)
        self._optimiser.step()
        self._averaged.update(self.model)
        values = float(scores.detach()), float(boxes.detach())
        if not all(math.isfinite(v) for v in values):
            hint = "a lower --learning-rate"
            raise ConfigError([Problem("training", "the loss is not a number any more", hint)])
        return values

    def _rate(self, done: int, total: int) -> float:
        warm = min(1.0, (done + 1) / min(_WARM_UP_STEPS, max(1, total // 10)))
        return self.settings.learning_rate * warm * (0.01 + 0.99 * 0.5 * (1.0 + math.cos(math.pi * done / total)))

    @torch.no_grad()
    def judged(self) -> Evaluation:
        """The averaged weights on a part of the validation pictures."""
        layout = described(self.out, self.classes)
        found = []
        for first in range(0, len(self._judged), self.settings.batch):
            rows = range(first, min(first + self.settings.batch, len(self._judged)))
            with torch.autocast("cpu", torch.bfloat16, enabled=self.settings.precision == "bf16"):
                maps = self.averaged(blob_of([self._judged_store.rgb(i) for i in rows]))
            logits, offsets = by_anchor([m.float() for m in maps], len(self.classes))
            for i, at, to in zip(rows, logits.numpy(), offsets.numpy(), strict=True):
                picture = self._judged[i]
                found.append(decode(layout, at, to, (picture.width, picture.height), _JUDGED_SCORE))
        return judged_at(layout.score_threshold, self._judged, found, self.classes)

    def weights_digest(self) -> str:
        """SHA-256 of the averaged weights: two trainings agree where this does."""
        whole = hashlib.sha256()
        for name, value in self.averaged.state_dict().items():
            whole.update(name.encode() + value.contiguous().numpy().tobytes())
        return whole.hexdigest()

    def _store_checkpoint(self) -> None:
        data = {
            "settings": asdict(self.settings),
            "classes": list(self.classes),
            "epoch": self._epochs_done,
            "model": self.model.state_dict(),
            "average": self.averaged.state_dict(),
            "steps": self._averaged.steps,
            "optimiser": self._optimiser.state_dict(),
        }
        path = self.out / CHECKPOINT
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            torch.save(data, path.with_suffix(".new"))
            path.with_suffix(".new").replace(path)  # whole or not at all
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written ({error.strerror or error})") from error


def _loaded(path: Path) -> Mapping[str, Any]:
    try:
        data = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise ConfigError([Problem(str(path), f"cannot be read ({error.strerror or error})")]) from None
    except Exception as error:  # noqa: BLE001  torch raises whatever its readers and pickle do
        words = " ".join(str(error).split())[:120]
        raise ConfigError([Problem(str(path), f"is no file of PyTorch weights ({words})")]) from None
    if not isinstance(data, Mapping):
        raise ConfigError([Problem(str(path), "is no file of PyTorch weights: it holds no names")])
    return data
