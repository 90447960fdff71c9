"""Settings of a training, which need no PyTorch."""

from __future__ import annotations

from dataclasses import dataclass

from signals.errors import ConfigError, Problem


@dataclass(frozen=True)
class Settings:
    """Settings that determine the trained weights, besides the data. Raises ConfigError for a value out of range."""

    epochs: int = 30
    batch: int = 16
    seed: int = 1
    learning_rate: float = 2e-3  # of AdamW, at its highest
    weight_decay: float = 0.02
    average_decay: float = 0.998
    threads: int = 2
    precision: str = "fp32"  # or bf16: convolutions with 16 bits, weights with 32
    min_objects: int = 100  # of a class in the training pictures; with fewer it is left out
    validate_every: int = 3  # epochs
    start_share: float = 0.0  # of the weights to start from in the result; the rest is the training's
    weak_epochs: int = 0  # the last, with weak augmentation; 0: a sixth of all
    input_px: tuple[int, int] = (320, 240)  # width, height of the network's input; multiples of 16

    def __post_init__(self) -> None:
        problems = [
            Problem(f"--{name.replace('_', '-')}", f"must be above 0, not {getattr(self, name)!r}")
            for name in ("epochs", "batch", "learning_rate", "threads", "min_objects", "validate_every")
            if not getattr(self, name) > 0
        ]
        if not 0.0 <= self.start_share < 1.0:
            problems.append(Problem("--start-share", f"must be 0 or more and below 1, not {self.start_share!r}"))
        if not 0 <= self.weak_epochs <= self.epochs:
            problems.append(Problem("--weak-epochs", f"must be 0 to {self.epochs}, not {self.weak_epochs}"))
        if not all(n > 0 and n % 16 == 0 for n in self.input_px):
            problems.append(
                Problem("--input", f"must be two multiples of 16, not {self.input_px[0]} {self.input_px[1]}")
            )
        if self.precision not in ("fp32", "bf16"):
            problems.append(Problem("--precision", f"must be fp32 or bf16, not {self.precision!r}"))
        if problems:
            raise ConfigError(problems)
