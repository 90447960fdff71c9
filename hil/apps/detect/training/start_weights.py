"""Weights to start a training from: a checkpoint, a state_dict, or the ONNX file of an exported model.

An export has batch normalisation folded into its convolutions. Training needs it back: with mean m and variance v of a
convolution's outputs over some training pictures,

    folded      y = W x + b
    normalised  y = g (W' x - m') / sqrt(v' + eps) + b'
                W' = W / sqrt(v), m' = m / sqrt(v), v' = 1, g = sqrt(v (1 + eps)), b' = b + m

are the same function, and the statistics of training batches, which are close to m' and v', hardly change it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from hil_companion.detect.model_file import SHIPPED, ModelFile
from hil_companion.errors import OptionError
from torch import Tensor, nn

from signals.errors import ConfigError, Problem

_MIN_DEVIATION = 1e-3  # of a channel's outputs; below it the channel is constant


@dataclass(frozen=True)
class StartWeights:
    """Tensors by name and the classes of the heads, () if unknown. `folded`: without batch normalisation."""

    tensors: Mapping[str, Tensor]
    classes: tuple[str, ...]
    folded: bool


def read_start_weights(path: Path) -> StartWeights:
    """Read a checkpoint, a state_dict or a model: its ONNX file or the name of a shipped one. Raises ConfigError."""
    if path.suffix == ".onnx" or str(path) in SHIPPED:
        return _of_model(path)
    data = read_tensors(path)
    tensors = {k: v for k, v in data.get("average", data).items() if isinstance(v, Tensor)}
    return StartWeights(tensors, tuple(data.get("classes", ())), folded=False)


def _of_model(path: Path) -> StartWeights:
    try:
        model = ModelFile.load(path)
        import onnx
        from onnx.numpy_helper import to_array

        initializers = onnx.load(model.path).graph.initializer
    except OptionError as error:
        raise ConfigError([Problem("--weights", str(error))]) from None
    except ImportError as error:
        raise ConfigError([Problem(str(path), f"needs the package onnx ({error})", "pip install onnx")]) from None
    except Exception as error:  # noqa: BLE001  protobuf's errors have no public common base class
        raise _no_weights(path, error) from None
    tensors = {tensor.name: torch.from_numpy(to_array(tensor).copy()) for tensor in initializers}
    return StartWeights(tensors, model.classes, folded=True)


def read_tensors(path: Path) -> Mapping[str, Any]:
    """Read a file of `torch.save`. Raises ConfigError."""
    try:
        data = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise ConfigError([Problem(str(path), f"cannot be read ({error.strerror or error})")]) from None
    except Exception as error:  # noqa: BLE001  torch passes on any exception of its readers and of pickle
        raise _no_weights(path, error) from None
    if not isinstance(data, Mapping):
        raise ConfigError([Problem(str(path), "is not a file of PyTorch weights: it holds no names")])
    return data


def _no_weights(path: Path, error: Exception) -> ConfigError:
    text = " ".join(str(error).split())[:120]
    return ConfigError([Problem(str(path), f"is not a file of PyTorch weights ({text})")])


def with_heads_of(start: StartWeights, classes: Sequence[str], current: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return the tensors with the heads' rows ordered for `classes`; new classes keep their rows of `current`."""
    out = dict(start.tensors)
    if not start.classes or start.classes == tuple(classes):
        return out
    old, new = len(start.classes) + 4, len(classes) + 4
    source = [start.classes.index(name) if name in start.classes else -1 for name in classes]
    source += list(range(len(start.classes), old))  # the box
    for name, value in start.tensors.items():
        is_last_of_head = name.startswith("heads.") and name.split(".")[2] == "1"
        if is_last_of_head and name in current and value.ndim and value.shape[0] % old == 0:
            rows = value.reshape(-1, old, *value.shape[1:])
            ordered = current[name].clone().reshape(-1, new, *value.shape[1:])
            known = [i for i, k in enumerate(source) if k >= 0]
            ordered[:, known] = rows[:, [source[i] for i in known]]
            out[name] = ordered.reshape(-1, *value.shape[1:])
    return out


def normalisation_renamed(model: nn.Module, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return folded tensors for `model`, which normalises: biases of convolutions are its, and its weights are 1."""
    names = {f"{c}.bias": n for c, n in _normalised_convolutions(model)}
    out: dict[str, Tensor] = {}
    for name, value in tensors.items():
        if name in names:
            out |= {f"{names[name]}.bias": value, f"{names[name]}.weight": torch.ones_like(value)}
        else:
            out[name] = value
    return out


@torch.no_grad()
def set_statistics(model: nn.Module, blob: Tensor) -> None:
    """Set the batch normalisation to the statistics of pictures (B, 3, H, W), without changing what `model` computes.

    The normalisation must have mean 0 and variance 1.
    """
    modules = dict(model.named_modules())
    outputs: dict[str, Tensor] = {}

    def observed(name: str) -> Callable[[nn.Module, Any, Tensor], None]:
        def observe(_: nn.Module, __: Any, output: Tensor) -> None:
            outputs[name] = torch.stack([output.mean((0, 2, 3)), output.std((0, 2, 3), unbiased=False)])

        return observe

    pairs = _normalised_convolutions(model)
    hooks = [modules[c].register_forward_hook(observed(c)) for c, _ in pairs]
    model.eval()(blob)
    for hook in hooks:
        hook.remove()
    for convolution, name in pairs:
        normalisation = modules[name]
        mean, deviation = outputs[convolution]
        deviation = deviation.clamp(min=_MIN_DEVIATION)
        modules[convolution].weight.div_(deviation[:, None, None, None])
        normalisation.running_mean.copy_(mean / deviation)
        normalisation.bias.add_(normalisation.weight * mean)
        normalisation.weight.mul_(deviation * (1.0 + normalisation.eps) ** 0.5)


def _normalised_convolutions(model: nn.Module) -> list[tuple[str, str]]:
    """Return the names of each convolution and of the batch normalisation after it."""
    pairs = []
    for name, module in model.named_modules():
        if isinstance(module, nn.Sequential):
            for i in range(len(module) - 1):
                if isinstance(module[i], nn.Conv2d) and isinstance(module[i + 1], nn.BatchNorm2d):
                    pairs.append((f"{name}.{i}", f"{name}.{i + 1}"))
    return pairs
