"""SSD-Lite network with a small MobileNet-style backbone, for pictures of 320 x 240 and objects from 6 pixels up.

    stride   2  stem     3 x 3
             4  detail   3 x 3, 3 x 3
             8  mid      3 x 3, inverted residuals
            16  deep     3 x 3, inverted residuals
            32  wide     3 x 3, inverted residuals
            64  far      3 x 3
    levels  4, 8, each with the upsampled features of the next level added; 16, 32, 64

Strided layers are plain convolutions: processors run them faster, and train them several times faster, than an
expansion at the higher resolution followed by a depthwise convolution.

Each level's head is one map: a 3 x 3 depthwise convolution, then 1 x 1 to classes + 4 numbers per anchor, in the order
of `hil_companion.detect.model_file`. Sources: Sandler et al. (2018), MobileNetV2; Liu et al. (2016), SSD; Lin et al.
(2017), FPN.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

PRIOR = 0.01  # initial score of every anchor; a higher one would let the many background anchors dominate the loss


@dataclass(frozen=True)
class Widths:
    """Channels and number of blocks at each stride."""

    stem: int = 16
    detail: int = 32
    mid: int = 64
    deep: int = 128
    wide: int = 192
    far: int = 128
    mid_blocks: int = 3
    deep_blocks: int = 6
    wide_blocks: int = 3
    expand: int = 2
    head: int = 96
    fine_head: int = 48  # of the level at stride 4, which has three times as many positions as all others together


def _conv(
    channels_in: int, channels_out: int, kernel: int, stride: int = 1, groups: int = 1, act: bool = True
) -> nn.Sequential:
    layers: list[nn.Module] = [
        nn.Conv2d(channels_in, channels_out, kernel, stride, kernel // 2, groups=groups, bias=False),
        nn.BatchNorm2d(channels_out),
    ]
    return nn.Sequential(*layers, nn.ReLU(inplace=True)) if act else nn.Sequential(*layers)


class InvertedResidual(nn.Module):
    """Inverted residual block: expansion, depthwise convolution, projection, and the input added (Sandler 2018).

    A new one returns its input (Goyal et al. 2017), so that blocks can be added to a trained network.
    """

    def __init__(self, width: int, expand: int) -> None:
        super().__init__()
        hidden = width * expand
        self.body = nn.Sequential(
            _conv(width, hidden, 1), _conv(hidden, hidden, 3, groups=hidden), _conv(hidden, width, 1, act=False)
        )

    def forward(self, x: Tensor) -> Tensor:
        """Return features of the same shape as `x`, (B, width, rows, columns)."""
        return x + self.body(x)


def new_blocks(model: nn.Module, known: Collection[str]) -> tuple[str, ...]:
    """Return the prefixes of the tensors of those blocks of which none has a name in `known`."""
    prefixes = (f"{name}." for name, module in model.named_modules() if isinstance(module, InvertedResidual))
    return tuple(prefix for prefix in prefixes if not any(name.startswith(prefix) for name in known))


class Join(nn.Module):
    """Sum of a level's features and the upsampled features of the next coarser level (Lin 2017)."""

    def __init__(self, fine: int, coarse: int, width: int) -> None:
        super().__init__()
        self.side = _conv(fine, width, 1, act=False)
        self.down = _conv(coarse, width, 1, act=False)
        self.up = nn.Upsample(scale_factor=2, mode="nearest")
        self.mix = _conv(width, width, 3, groups=width)

    def forward(self, fine: Tensor, coarse: Tensor) -> Tensor:
        """Return the joined features, (B, width, rows, columns); `coarse` has half the rows and columns of `fine`."""
        up = self.up(self.down(coarse))
        mixed: Tensor = self.mix(torch.relu(self.side(fine) + up))
        return mixed


class SsdLite(nn.Module):
    """The network: blobs (B, 3, H, W) to one map per level, (B, anchors_per_position * (classes + 4), rows, columns).

    H and W must be multiples of 16; `anchors_per_position` is the number of anchors per position of each level.
    """

    def __init__(self, classes: int, anchors_per_position: Sequence[int], widths: Widths | None = None) -> None:
        super().__init__()
        w = widths or Widths()
        self.classes = classes
        self.stem = _conv(3, w.stem, 3, 2)
        self.detail = nn.Sequential(_conv(w.stem, w.detail, 3, 2), _conv(w.detail, w.detail, 3))
        self.mid = _stage(w.detail, w.mid, w.mid_blocks, w.expand)
        self.deep = _stage(w.mid, w.deep, w.deep_blocks, w.expand)
        self.wide = _stage(w.deep, w.wide, w.wide_blocks, w.expand)
        self.far = _stage(w.wide, w.far, 0, w.expand)
        self.down = _conv(w.deep, w.head, 1)
        self.near_join = Join(w.mid, w.head, w.head)
        self.fine_join = Join(w.detail, w.head, w.fine_head)
        channels_in = (w.fine_head, w.head, w.head, w.wide, w.far)
        if len(anchors_per_position) != len(channels_in):
            raise ValueError(f"{len(anchors_per_position)} levels for a network of {len(channels_in)}")
        self.heads = nn.ModuleList(_head(i, n, classes) for i, n in zip(channels_in, anchors_per_position, strict=True))
        self._initialise_weights(anchors_per_position)

    def forward(self, x: Tensor) -> list[Tensor]:
        """Return one map per level, from fine to coarse."""
        detail = self.detail(self.stem(x))
        mid = self.mid(detail)
        deep = self.deep(mid)
        wide = self.wide(deep)
        far = self.far(wide)
        deep = self.down(deep)
        near = self.near_join(mid, deep)
        fine = self.fine_join(detail, near)
        return [head(v) for head, v in zip(self.heads, (fine, near, deep, wide, far), strict=True)]

    def _initialise_weights(self, anchors_per_position: Sequence[int]) -> None:
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
        for module in self.modules():
            if isinstance(module, InvertedResidual):
                nn.init.zeros_(module.body[-1][-1].weight)
        for head, n in zip(self.heads, anchors_per_position, strict=True):
            last = head[-1]
            nn.init.normal_(last.weight, std=0.01)
            bias = torch.zeros(n, self.classes + 4)
            bias[:, : self.classes] = -math.log((1.0 - PRIOR) / PRIOR)
            last.bias.data.copy_(bias.reshape(-1))


def _stage(channels_in: int, channels_out: int, blocks: int, expand: int) -> nn.Sequential:
    return nn.Sequential(
        _conv(channels_in, channels_out, 3, 2), *(InvertedResidual(channels_out, expand) for _ in range(blocks))
    )


def _head(channels_in: int, anchors_per_position: int, classes: int) -> nn.Sequential:
    return nn.Sequential(
        _conv(channels_in, channels_in, 3, groups=channels_in),
        nn.Conv2d(channels_in, anchors_per_position * (classes + 4), 1),
    )


def by_anchor(maps: Sequence[Tensor], classes: int) -> tuple[Tensor, Tensor]:
    """Return the maps as logits (B, N, classes) and offsets (B, N, 4), in the order that the companion decodes."""
    flat = [m.permute(0, 2, 3, 1).reshape(m.shape[0], -1, classes + 4) for m in maps]
    joined = torch.cat(flat, 1)
    return joined[..., :classes], joined[..., classes:]
