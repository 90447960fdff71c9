"""A moving average of a network's weights, which judges better than where the optimiser just stands."""

from __future__ import annotations

import copy

import torch
from torch import nn


class Averaged:
    """After n steps each weight counts the last 1 / (1 - decay) steps or so; fewer at the beginning."""

    def __init__(self, model: nn.Module, decay: float) -> None:
        self.model = copy.deepcopy(model).eval()
        self.decay = decay
        self.steps = 0
        for p in self.model.parameters():
            p.requires_grad_(False)

    @torch.no_grad()
    def update(self, model: nn.Module) -> None:
        self.steps += 1
        decay = min(self.decay, (1.0 + self.steps) / (10.0 + self.steps))
        for own, new in zip(self.model.state_dict().values(), model.state_dict().values(), strict=True):
            if own.dtype.is_floating_point:
                own.lerp_(new, 1.0 - decay)
            else:
                own.copy_(new)
