"""Training loop: epochs with a falling learning rate, regular validation, and a checkpoint after each epoch.

The same data, settings, versions and processor give the same weights: batches and their augmentation are numbered,
PyTorch uses deterministic algorithms, and the number of threads, which determines the order of sums, is a setting. A
training that was stopped continues from `last.pt` with the same result.
"""

from __future__ import annotations

import copy
import hashlib
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import torch
from hil_companion.detect.decode import decode
from torch import nn

from hil.apps.detect.evaluate import Evaluation, evaluation_of
from hil.apps.detect.picture_store import PictureStore
from hil.apps.detect.pictures import Picture, class_counts
from hil.apps.detect.training.assign import Assigner
from hil.apps.detect.training.augment import Augmenter, Strength
from hil.apps.detect.training.batches import Batch, Batches, blob_of
from hil.apps.detect.training.export import between, folded
from hil.apps.detect.training.layout import LEVELS, describe
from hil.apps.detect.training.loss import detection_loss
from hil.apps.detect.training.model import SsdLite, Widths, by_anchor, new_blocks
from hil.apps.detect.training.settings import Settings
from hil.apps.detect.training.start_weights import (
    normalisation_renamed,
    read_start_weights,
    read_tensors,
    set_statistics,
    with_heads_of,
)
from hil.run.runs.result_database import require_plain
from signals.errors import ConfigError, Problem, RecordingError

CHECKPOINT = "last.pt"
_DIGEST = "digest"  # key of a checkpoint: of all others
_MAX_VALIDATION_PICTURES = 400  # during training; the whole set is evaluated at the end
_VALIDATION_SCORE = 0.05
_WARM_UP_STEPS = 200
_STATISTICS_PICTURES = 64  # that show a folded network's activations
_GRADIENT_NORM = 10.0


@dataclass(frozen=True)
class Epoch:
    """Result of one epoch, numbered from 1. `evaluation` is None in epochs without validation."""

    number: int
    loss_scores: float
    loss_boxes: float
    learning_rate: float
    evaluation: Evaluation | None


def digest_of(value: Any) -> str:
    """Return the SHA-256 of the content of a checkpoint: mappings, sequences, tensors and plain values."""
    checksum = hashlib.sha256()

    def add(item: Any) -> None:
        if isinstance(item, torch.Tensor):
            checksum.update(f"{item.dtype} {tuple(item.shape)}".encode())
            checksum.update(item.detach().cpu().contiguous().reshape(-1).view(torch.uint8).numpy())
        elif isinstance(item, Mapping):
            add(list(item.items()))
        elif isinstance(item, list | tuple):
            checksum.update(f"[{len(item)}".encode())
            for part in item:
                add(part)
        else:
            checksum.update(f"{type(item).__name__} {item!r};".encode())

    add(value)
    return checksum.hexdigest()


class WeightAverage:
    """Moving average of a network's weights, which detects better than the weights after the last step.

    The average spans about 1 / (1 - decay) steps, fewer at the start.
    """

    def __init__(self, model: nn.Module, decay: float) -> None:
        self.model = copy.deepcopy(model).eval()
        self.decay = decay
        self.steps = 0
        for p in self.model.parameters():
            p.requires_grad_(False)

    @torch.no_grad()
    def update(self, model: nn.Module) -> None:
        """Add the weights of `model` after a step."""
        self.steps += 1
        decay = min(self.decay, (1.0 + self.steps) / (10.0 + self.steps))
        for average, new in zip(self.model.state_dict().values(), model.state_dict().values(), strict=True):
            if average.dtype.is_floating_point:
                average.lerp_(new, 1.0 - decay)
            else:
                average.copy_(new)


class Training:
    """One training, from pictures to averaged weights."""

    def __init__(
        self,
        pictures: Sequence[Picture],
        validation: Sequence[Picture],
        settings: Settings,
        *,
        out: Path,
        classes: Sequence[str] = (),
    ) -> None:
        """`classes`: those to detect, default all with enough objects. Raises ConfigError if there are none."""
        self.settings = settings
        self.out = out
        counts = class_counts(pictures)
        self.classes = tuple(classes) or tuple(sorted(n for n, c in counts.items() if c >= settings.min_objects))
        self.left_out = {n: c for n, c in sorted(counts.items()) if n not in self.classes}
        if not self.classes:
            max_count = max(counts.values(), default=0)
            hint = f"record more, or use --min-objects {max(1, max_count)}"
            raise ConfigError([Problem("labels", f"no class has {settings.min_objects} objects", hint)])
        torch.use_deterministic_algorithms(True)
        # No uninitialised memory is read here, and filling it would take a fifth of the time.
        torch.utils.deterministic.fill_uninitialized_memory = False
        torch.set_num_threads(settings.threads)
        cv2.setNumThreads(1)
        torch.manual_seed(settings.seed)
        self._store = PictureStore(pictures, settings.input_px)
        self._validation = validation[:: max(1, math.ceil(len(validation) / _MAX_VALIDATION_PICTURES))]
        self._validation_store = PictureStore(self._validation, settings.input_px)
        self._assigner = Assigner(LEVELS, settings.input_px)
        self._anchors = torch.from_numpy(self._assigner.anchors_px)
        self.model: nn.Module = SsdLite(len(self.classes), [v.anchors_per_position for v in LEVELS]).to(
            memory_format=torch.channels_last
        )
        self._averaged = WeightAverage(self.model, settings.average_decay)
        not_decayed = [p for p in self.model.parameters() if p.ndim <= 1]
        decayed = [p for p in self.model.parameters() if p.ndim > 1]
        groups = [
            {"params": decayed, "weight_decay": settings.weight_decay},
            {"params": not_decayed, "weight_decay": 0.0},
        ]
        self._optimiser = torch.optim.AdamW(groups, lr=settings.learning_rate)
        self._epochs_done = 0
        self._start: nn.Module | None = None
        self._start_digest = ""  # of the file's tensors
        augmenter = Augmenter(self._store, self.classes, settings.seed, Strength())
        self.batches = Batches(augmenter, self._assigner, pictures, size=settings.batch, seed=settings.seed)
        # The last epochs use weak augmentation, so that the statistics match those of recorded pictures.
        weak = Augmenter(self._store, self.classes, settings.seed, Strength(zoom=(1.0, 1.3), mosaic_share=0.0))
        self._late_batches = Batches(weak, self._assigner, pictures, size=settings.batch, seed=settings.seed)

    @property
    def averaged(self) -> nn.Module:
        """Network with the averaged weights."""
        return self._averaged.model

    @property
    def result(self) -> nn.Module:
        """Network of the training's result: the averaged weights, with their share of those of the start."""
        if self._start is None or not self.settings.start_share:
            return self.averaged
        return between(self._start, self.averaged, self.settings.start_share)

    @property
    def epochs_done(self) -> int:
        """Number of finished epochs."""
        return self._epochs_done

    def load_weights(self, path: Path) -> tuple[int, int]:
        """Start from the weights in a file, as far as names and shapes agree; heads are matched by class.

        Returns the number of tensors loaded and the number in the file. Raises ConfigError if none fits, or if the
        result is to have a share of them and some of this network's are not among them: these would be random numbers.
        """
        start = read_start_weights(path)
        current = self.model.state_dict()
        state = with_heads_of(start, self.classes, current)
        if start.folded:
            state = normalisation_renamed(self.model, state)
        fitting = {k: v for k, v in state.items() if k in current and v.shape == current[k].shape}
        if not fitting:
            hint = f"give a model or a {CHECKPOINT} of `hil detect train`, or a state_dict of its network"
            raise ConfigError([Problem(str(path), "has no weights that fit this network", hint)])
        if self.settings.start_share:
            needed = normalisation_renamed(self.model, folded(self.model).state_dict()) if start.folded else current
            # A block that they lack altogether returns its input: the network is theirs, whole.
            prefixes = new_blocks(self.model, fitting)
            missing = [name for name in needed if name not in fitting and not name.startswith(prefixes)]
            new = [name for name in self.classes if name not in start.classes] if start.classes else []
            if missing or new:
                hint = "use --keep-classes, or leave out --start-share" if new else "leave out --start-share"
                lacks = f"classes {', '.join(new)}" if new else f"{len(missing)} of the network's {len(needed)} tensors"
                raise ConfigError([Problem("--start-share", f"needs whole weights: {path} does not fit {lacks}", hint)])
        self.model.load_state_dict({**current, **fitting})
        if start.folded:
            count = min(_STATISTICS_PICTURES, len(self._store))
            numbers = [i * len(self._store) // count for i in range(count)]
            set_statistics(self.model, blob_of([self._store.rgb(i) for i in numbers]))
        self._averaged = WeightAverage(self.model, self.settings.average_decay)
        self._start = copy.deepcopy(self.model)
        self._start_digest = digest_of(start.tensors)
        return len(fitting), len(state)

    def resume(self) -> bool:
        """Load the folder's checkpoint and return True; False if there is none.

        Raises ConfigError if it belongs to another training.
        """
        path = self.out / CHECKPOINT
        if not path.is_file():
            return False
        require_plain(path)
        data = dict(read_tensors(path))
        if data.pop(_DIGEST, None) != digest_of(data):
            hint = "choose another folder, or leave out --resume"
            raise ConfigError([Problem(str(path), "is damaged, or of an earlier hil-bench", hint)])
        expected = {"network": asdict(Widths()), "settings": asdict(self.settings), "classes": list(self.classes)}
        for key, value in expected.items():
            if data.get(key) != value:
                hint = "choose another folder, or leave out --resume"
                raise ConfigError([Problem(str(path), f"is of a training with other {key}", hint)])
        # Without a share the checkpoint's weights replace those of the start.
        if self.settings.start_share and data.get("start") != self._start_digest:
            message, hint = (
                "is of a training that started from other weights",
                "give the --weights from which it started",
            )
            if "start" not in data:
                message, hint = "does not tell its --weights: it is of an older version", "leave out --resume"
            raise ConfigError([Problem(str(path), message, hint)])
        self.model.load_state_dict(data["model"])
        self._averaged.model.load_state_dict(data["average"])
        self._averaged.steps = int(data["steps"])
        self._optimiser.load_state_dict(data["optimiser"])
        self._epochs_done = int(data["epoch"])
        return True

    def run(self, *, on_step: Callable[[int, int, float], None], on_epoch: Callable[[Epoch], None]) -> None:
        """Run the remaining epochs, calling `on_step(epoch, step, loss)` after each batch and `on_epoch` after each.

        Raises ConfigError if the loss is not finite, RecordingError if the checkpoint cannot be written.
        """
        total = self.settings.epochs * len(self.batches)
        while self._epochs_done < self.settings.epochs:
            number = self._epochs_done
            late = number >= self.settings.epochs - (self.settings.weak_epochs or max(1, self.settings.epochs // 6))
            sums, rate = [0.0, 0.0], 0.0
            for i, batch in enumerate((self._late_batches if late else self.batches).epoch(number)):
                rate = self._learning_rate(number * len(self.batches) + i, total)
                scores, boxes = self._step(batch, rate)
                sums = [sums[0] + scores, sums[1] + boxes]
                on_step(number + 1, i + 1, scores + boxes)
            self._epochs_done += 1
            self._store_checkpoint()
            due = self._epochs_done % self.settings.validate_every == 0 or self._epochs_done == self.settings.epochs
            count = len(self.batches)
            evaluation = self.evaluate() if due and self._validation else None
            on_epoch(Epoch(self._epochs_done, sums[0] / count, sums[1] / count, rate, evaluation))

    def _step(self, batch: Batch, rate: float) -> tuple[float, float]:
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        self.model.train()
        with torch.autocast("cpu", torch.bfloat16, enabled=self.settings.precision == "bf16"):
            maps = self.model(batch.blob)
        logits, offsets = by_anchor([m.float() for m in maps], len(self.classes))
        scores, boxes = detection_loss(logits, offsets, self._anchors, batch.classes, batch.target_px)
        self._optimiser.zero_grad(set_to_none=True)
        (scores + boxes).backward()
        nn.utils.clip_grad_norm_(self.model.parameters(), _GRADIENT_NORM)
        self._optimiser.step()
        self._averaged.update(self.model)
        values = float(scores.detach()), float(boxes.detach())
        if not all(math.isfinite(v) for v in values):
            hint = "use a lower --learning-rate"
            raise ConfigError([Problem("training", "diverged: the loss is not finite", hint)])
        return values

    def _learning_rate(self, done: int, total: int) -> float:
        warm = min(1.0, (done + 1) / min(_WARM_UP_STEPS, max(1, total // 10)))
        return self.settings.learning_rate * warm * (0.01 + 0.99 * 0.5 * (1.0 + math.cos(math.pi * done / total)))

    @torch.no_grad()
    def evaluate(self) -> Evaluation:
        """Evaluate the averaged weights on a part of the validation pictures."""
        model = describe(self.out, self.classes, input_px=self.settings.input_px)
        detections = []
        for first in range(0, len(self._validation), self.settings.batch):
            rows = range(first, min(first + self.settings.batch, len(self._validation)))
            with torch.autocast("cpu", torch.bfloat16, enabled=self.settings.precision == "bf16"):
                maps = self.averaged(blob_of([self._validation_store.rgb(i) for i in rows]))
            logits, offsets = by_anchor([m.float() for m in maps], len(self.classes))
            for i, scores, boxes in zip(rows, logits.numpy(), offsets.numpy(), strict=True):
                picture = self._validation[i]
                detections.append(decode(model, scores, boxes, (picture.width, picture.height), _VALIDATION_SCORE))
        return evaluation_of(model.score_threshold, self._validation, detections, self.classes)

    def weights_digest(self) -> str:
        """Return the SHA-256 of the result's weights, equal for trainings with the same result."""
        checksum = hashlib.sha256()
        for name, value in self.result.state_dict().items():
            checksum.update(name.encode() + value.contiguous().numpy().tobytes())
        return checksum.hexdigest()

    def _store_checkpoint(self) -> None:
        data = {
            "network": asdict(Widths()),
            "settings": asdict(self.settings),
            "classes": list(self.classes),
            "start": self._start_digest,
            "epoch": self._epochs_done,
            "model": self.model.state_dict(),
            "average": self.averaged.state_dict(),
            "steps": self._averaged.steps,
            "optimiser": self._optimiser.state_dict(),
        }
        path = self.out / CHECKPOINT
        new, content = path.with_suffix(".new"), io.BytesIO()
        for file in (path, new):
            require_plain(file)
        # Not into the file: PyTorch has no name for a full disk, and does not check what it reads back.
        torch.save({**data, _DIGEST: digest_of(data)}, content)
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            new.write_bytes(content.getbuffer())
            new.replace(path)  # atomic
        except OSError as error:
            text = f"{path}: cannot be written ({error.strerror or error}); the epochs before are kept"
            raise RecordingError(f"{text}. Free some space, then continue with --resume") from error
