"""Training loss of scores and boxes.

The loss of scores is the quality focal loss (Li et al. 2020), |sigmoid - t|^2 times the cross-entropy. For the class of
an anchor's object the target t is the current IoU of the anchor's box with the object, so that a score also expresses
the quality of the box; for other classes and background it is 0. At the anchors of a difficult object the score of its
own class does not count: a bicycle too small to count may be found or not, but it is no person. The loss of boxes is
the generalised IoU loss (Rezatofighi et al. 2019), weighted by t. Both losses are divided by the sum of t.
"""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from hil_companion.detect.decode import CENTRE_VARIANCE, SIZE_VARIANCE
from torch import Tensor

from hil.apps.detect.training.assign import ignored

BOX_WEIGHT = 2.0
_MAX_LOG_SCALE = 4.0


def boxes_px(anchors_px: Tensor, offsets: Tensor) -> Tensor:
    """Return boxes (..., 4), x0, y0, x1, y1, of anchors and offsets (..., 4), as in `hil_companion.detect.decode`."""
    centre = anchors_px[..., :2] + CENTRE_VARIANCE * offsets[..., :2] * anchors_px[..., 2:]
    scale = (SIZE_VARIANCE * offsets[..., 2:]).clamp(-_MAX_LOG_SCALE, _MAX_LOG_SCALE).exp()
    half = 0.5 * anchors_px[..., 2:] * scale
    return torch.cat([centre - half, centre + half], -1)


def overlaps(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Return IoU and generalised IoU, (n,) each, of pairs of boxes (n, 4)."""
    common = (torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])).clamp(min=0.0).prod(1)
    area_a, area_b = (a[:, 2:] - a[:, :2]).prod(1), (b[:, 2:] - b[:, :2]).prod(1)
    union = (area_a + area_b - common).clamp(min=1e-6)
    hull = (torch.maximum(a[:, 2:], b[:, 2:]) - torch.minimum(a[:, :2], b[:, :2])).prod(1).clamp(min=1e-6)
    iou = common / union
    return iou, iou - (hull - union) / hull


class QualityFocal(torch.autograd.Function):
    """Quality focal loss: the sum of |p - t|^2 (softplus(x) - x t) with p = sigmoid(x).

    The first factor is held constant, so the gradient is (p - t)^3. It is written by hand, because the intermediate
    values of automatic differentiation would take most of the memory of a training.
    """

    @staticmethod
    def forward(ctx: Any, logits: Tensor, targets: Tensor, picture: Tensor, anchor: Tensor, number: Tensor) -> Tensor:
        """Return the sum over logits and targets (B, N, classes), but for those of (picture, anchor, class number)."""
        error = logits.sigmoid().sub_(targets)
        error[picture, anchor, number] = 0.0
        ctx.save_for_backward(error)
        entropy = F.softplus(logits).addcmul_(logits, targets, value=-1.0)
        return entropy.mul_(error).mul_(error).sum()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None, None]:
        """Return the gradient with respect to the logits."""
        (error,) = ctx.saved_tensors
        return error.square().mul_(error).mul_(gradients[0]), None, None, None, None


def detection_loss(
    logits: Tensor, offsets: Tensor, anchors_px: Tensor, classes: Tensor, target_px: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the losses of scores and of boxes.

    `logits` is (B, N, classes), `offsets` (B, N, 4), `anchors_px` (N, 4), `classes` (B, N) of the anchors as returned
    by `Assigner.targets`, `target_px` (B, N, 4).
    """
    picture, anchor = torch.nonzero(classes >= 0, as_tuple=True)
    targets = torch.zeros_like(logits)
    giou = iou = logits.new_zeros(0)
    if len(picture):
        boxes = boxes_px(anchors_px[anchor], offsets[picture, anchor])
        iou, giou = overlaps(boxes, target_px[picture, anchor])
        iou = iou.detach()
        targets[picture, anchor, classes[picture, anchor]] = iou
    count = iou.sum().clamp(min=1.0)
    not_counted = torch.nonzero(classes <= ignored(0), as_tuple=True)
    scores = QualityFocal.apply(logits, targets, *not_counted, ignored(classes[not_counted])) / count
    boxes_loss = (iou * (1.0 - giou)).sum() / count
    return scores, BOX_WEIGHT * boxes_loss
