"""Export of trained weights to a companion's model files: NAME.onnx and its description NAME.json.

Batch normalisation is folded into the preceding convolutions, so that all back ends compute the same products. The
exporter is PyTorch's older one, which needs no further package, with an operator set that OpenCV 4.5 reads.
"""

from __future__ import annotations

import copy
import hashlib
import json
import warnings
from pathlib import Path

import torch
from hil_companion.detect.model_file import ModelFile
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from hil.apps.detect.training.layout import INPUT_PX, LEVELS, describe
from signals.errors import RecordingError

OPERATOR_SET = 11


def folded(model: nn.Module) -> nn.Module:
    """Return a copy for inference with batch normalisation folded into the convolutions."""
    out = copy.deepcopy(model).eval().float().to(memory_format=torch.contiguous_format)
    for module in out.modules():
        if isinstance(module, nn.Sequential):
            for i in range(len(module) - 1):
                if isinstance(module[i], nn.Conv2d) and isinstance(module[i + 1], nn.BatchNorm2d):
                    module[i] = fuse_conv_bn_eval(module[i], module[i + 1])
                    module[i + 1] = nn.Identity()
    return out


@torch.no_grad()
def between(start: nn.Module, end: nn.Module, start_share: float) -> nn.Module:
    """Return a network for inference whose folded weights are the mean of two networks', weighted by `start_share`.

    Networks of which one was trained on from the other have such a mean, which often detects better than both
    (Wortsman et al. 2022, robust fine-tuning).
    """
    out = folded(start)
    for mean, new in zip(out.parameters(), folded(end).parameters(), strict=True):
        mean.lerp_(new, 1.0 - start_share)
    return out


def export(
    model: nn.Module,
    path: Path,
    classes: tuple[str, ...],
    *,
    threshold: float,
    input_px: tuple[int, int] = INPUT_PX,
) -> ModelFile:
    """Write both model files; `path` is the .onnx file. Raises RecordingError."""
    # No layer of a folded network depends on the mode, and of one in evaluation the exporter merges equal tensors, so
    # that a training that starts from the file would miss some.
    inference_model = folded(model).train()
    blob = torch.zeros(1, 3, input_px[1], input_px[0])
    outputs = [f"level{i}" for i in range(len(LEVELS))]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with warnings.catch_warnings(), torch.no_grad():
            # This exporter is deprecated, but OpenCV 4.5 does not read what the newer one writes.
            warnings.simplefilter("ignore")
            torch.onnx.export(
                inference_model,
                (blob,),
                str(path),
                input_names=["picture"],
                output_names=outputs,
                dynamic_axes=_free_axes(outputs),
                opset_version=OPERATOR_SET,
                training=torch.onnx.TrainingMode.PRESERVE,
                dynamo=False,
            )
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        model_file = describe(path, classes, input_px=input_px, sha256=digest, threshold=threshold)
        path.with_suffix(".json").write_text(json.dumps(model_file.description(), indent=1) + "\n")
    except (OSError, RuntimeError) as error:
        raise RecordingError(f"{path}: the model cannot be written ({error})") from error
    return ModelFile.load(path)


def _free_axes(outputs: list[str]) -> dict[str, dict[int, str]]:
    """Return ONNX axes with free height and width; for another input size only the anchors have to be made anew."""
    maps = {name: {2: f"rows{i}", 3: f"columns{i}"} for i, name in enumerate(outputs)}
    return {"picture": {2: "height", 3: "width"}, **maps}


def with_threshold(model: ModelFile, threshold: float) -> ModelFile:
    """Change the score threshold in a model's description and return the model. Raises RecordingError."""
    file = model.path.with_suffix(".json")
    try:
        data = {**json.loads(file.read_text()), "score_threshold": round(threshold, 4)}
        file.write_text(json.dumps(data, indent=1) + "\n")
    except OSError as error:
        raise RecordingError(f"{file}: cannot be written ({error.strerror or error})") from error
    return ModelFile.load(model.path)
