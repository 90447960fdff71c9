"""Layout of the network: anchors, normalisation and usual input size, as written into the model's description."""

from __future__ import annotations

from pathlib import Path

from hil_companion.detect.model_file import Level, ModelFile, all_anchors_px

INPUT_PX = (320, 240)  # of the shipped one; another size has the same anchors in pixels of the input
RATIOS = (0.45, 1.0, 2.2)
# Levels with many positions have few anchor shapes; one is enough with adaptive sample selection (Zhang et al. 2020,
# ATSS).
LEVELS = (
    Level(4, (10.0,), (0.6,)),
    Level(8, (20.0,), (0.5, 1.6)),
    Level(16, (40.0,), RATIOS),
    Level(32, (90.0,), RATIOS),
    Level(64, (190.0,), RATIOS),
)
MEAN, STD = (0.5, 0.5, 0.5), (0.25, 0.25, 0.25)
SCORE_THRESHOLD = 0.5  # used until a threshold is chosen by an evaluation
NMS_IOU = 0.5


def describe(
    path: Path,
    classes: tuple[str, ...],
    *,
    input_px: tuple[int, int] = INPUT_PX,
    sha256: str = "",
    threshold: float = SCORE_THRESHOLD,
) -> ModelFile:
    """Return the description of a model with this layout; `path` is its .onnx file, which need not exist yet."""
    return ModelFile(
        path=path,
        sha256=sha256,
        classes=classes,
        input_px=input_px,
        levels=LEVELS,
        mean=MEAN,
        std=STD,
        score_threshold=threshold,
        nms_iou=NMS_IOU,
        anchors_px=all_anchors_px(LEVELS, input_px),
    )
