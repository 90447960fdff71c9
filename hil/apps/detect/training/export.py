"""Export of trained weights to a companion's model files: NAME.onnx, its description NAME.json, NAME.pt for PyTorch.

Batch normalisation is folded into the preceding convolutions, so that all back ends compute the same products. The
exporter is PyTorch's older one, which needs no further package, with an operator set that OpenCV 4.5 reads.
"""

from __future__ import annotations

import copy
import hashlib
import json
import warnings
import zipfile
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
    """Write the three model files; `path` is the .onnx file. Raises RecordingError."""
    inference_model = folded(model)
    blob = torch.zeros(1, 3, input_px[1], input_px[0])
    outputs = [f"level{i}" for i in range(len(LEVELS))]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with warnings.catch_warnings(), torch.no_grad():
            warnings.simplefilter("ignore")  # this exporter and TorchScript are deprecated, but JetPack needs both
            torch.onnx.export(
                inference_model,
                (blob,),
                str(path),
                input_names=["picture"],
                output_names=outputs,
                dynamic_axes=_free_axes(outputs),
                opset_version=OPERATOR_SET,
                dynamo=False,
            )
            torch.jit.trace(inference_model, blob, check_trace=False).save(str(path.with_suffix(".pt")))
        _remove_debug_records(path.with_suffix(".pt"))
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        model_file = describe(path, classes, input_px=input_px, sha256=digest, threshold=threshold)
        path.with_suffix(".json").write_text(json.dumps(model_file.description(), indent=1) + "\n")
    except (OSError, RuntimeError) as error:
        raise RecordingError(f"{path}: the model cannot be written ({error})") from error
    return ModelFile.load(path)


def _remove_debug_records(file: Path) -> None:
    """Remove the debug records of a TorchScript file, which contain file paths of the machine that wrote it."""
    with zipfile.ZipFile(file) as old:
        entries = [(info, old.read(info)) for info in old.infolist() if not info.filename.endswith(".debug_pkl")]
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as new:
        for info, data in entries:
            new.writestr(zipfile.ZipInfo(info.filename, info.date_time), data)


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
