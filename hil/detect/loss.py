"""What training makes small: how wrong the scores are, and how wrong the boxes.

Scores by quality focal loss (Li et al. 2020): |sigmoid - t|^2 times the cross-entropy, where the target t of an
anchor's class is the overlap that its box has with the object just now, and 0 elsewhere. A score then says how good the
box is, too. Boxes by generalised IoU (Rezatofighi et al. 2019), weighted by t. Both are divided by the sum of t.
"""

from __future__ import annotations

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
    wrong = (logits.detach().sigmoid() - wanted).square()
    entropy = F.softplus(logits) - logits * wanted
    counted = (found != NOTHING).unsqueeze(2)
    scores = (wrong * entropy * counted).sum() / count
    boxes_loss = (iou * (1.0 - giou)).sum() / count
    return scores, BOX_WEIGHT * boxes_loss
