"""What training makes small: how wrong the scores are, and how wrong the boxes.

Scores by quality focal loss (Li et al. 2020): |sigmoid - t|^2 times the cross-entropy, where the target t of an
anchor's class is the overlap that its box has with the object just now, and 0 elsewhere. A score then says how good the
box is, too. Boxes by generalised IoU (Rezatofighi et al. 2019), weighted by t. Both are divided by the sum of t.
"""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from hil_companion.detect.decode import CENTRE_VARIANCE, SIZE_VARIANCE
from torch import Tensor

from hil.detect.assign import NOTHING

BOX_WEIGHT = 2.0
_MOST_GROWTH = 4.0


def boxes_px(anchors_px: Tensor, offsets: Tensor) -> Tensor:
    """Of (..., 4) anchors and offsets: x0, y0, x1, y1, as `hil_companion.detect.decode` does."""
    centre = anchors_px[..., :2] + CENTRE_VARIANCE * offsets[..., :2] * anchors_px[..., 2:]
    growth = (SIZE_VARIANCE * offsets[..., 2:]).clamp(-_MOST_GROWTH, _MOST_GROWTH).exp()
    half = 0.5 * anchors_px[..., 2:] * growth
    return torch.cat([centre - half, centre + half], -1)


def overlaps(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """IoU and generalised IoU of (n, 4) boxes, pair by pair."""
    common = (torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])).clamp(min=0.0).prod(1)
    area_a, area_b = (a[:, 2:] - a[:, :2]).prod(1), (b[:, 2:] - b[:, :2]).prod(1)
    union = (area_a + area_b - common).clamp(min=1e-6)
    hull = (torch.maximum(a[:, 2:], b[:, 2:]) - torch.minimum(a[:, :2], b[:, :2])).prod(1).clamp(min=1e-6)
    iou = common / union
    return iou, iou - (hull - union) / hull


class QualityFocal(torch.autograd.Function):
    """The sum of |p - t|^2 (softplus(x) - x t), p = sigmoid(x), the first factor held: its gradient is (p - t)^3.

    By hand, since by far most of what training holds besides the network's own maps would be this formula's.
    """

    @staticmethod
    def forward(ctx: Any, logits: Tensor, wanted: Tensor, counted: Tensor) -> Tensor:
        wrong = logits.sigmoid().sub_(wanted).mul_(counted)
        ctx.save_for_backward(wrong)
        entropy = F.softplus(logits).addcmul_(logits, wanted, value=-1.0)
        return entropy.mul_(wrong).mul_(wrong).sum()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        (wrong,) = ctx.saved_tensors
        return wrong.square().mul_(wrong).mul_(gradients[0]), None, None


def detection_loss(
    logits: Tensor, offsets: Tensor, anchors_px: Tensor, found: Tensor, target_px: Tensor
) -> tuple[Tensor, Tensor]:
    """Of scores and of boxes. `found`: (B, N) classes as `Assigner.targets` numbers them; `target_px`: (B, N, 4)."""
    picture, anchor = torch.nonzero(found >= 0, as_tuple=True)
    wanted = torch.zeros_like(logits)
    giou = iou = logits.new_zeros(0)
    if len(picture):
        boxes = boxes_px(anchors_px[anchor], offsets[picture, anchor])
        iou, giou = overlaps(boxes, target_px[picture, anchor])
        iou = iou.detach()
        wanted[picture, anchor, found[picture, anchor]] = iou
    count = iou.sum().clamp(min=1.0)
    scores = QualityFocal.apply(logits, wanted, (found != NOTHING).unsqueeze(2)) / count
    boxes_loss = (iou * (1.0 - giou)).sum() / count
    return scores, BOX_WEIGHT * boxes_loss
