"""When a vehicle came to a place, between two frames that show it before and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

HALVINGS = 30


@dataclass(frozen=True)
class Seen:
    """Where a frame shows the vehicle."""

    t_ns: int
    p_W: np.ndarray
    v_W: np.ndarray


def came_within_s(before: Seen, now: Seen, place_W: np.ndarray, radius_m: float) -> float:
    """How long ago it came so near: on the cubic through positions and velocities of both (Hermite's).

    It was farther away before, and is not now. However far the frames lie apart, the answer is nearly the same.
    """
    h_s = (now.t_ns - before.t_ns) * 1e-9
    d, b0, b1 = now.p_W - before.p_W, h_s * before.v_W, h_s * now.v_W
    c2, c3 = 3.0 * d - 2.0 * b0 - b1, b0 + b1 - 2.0 * d
    outside, inside = 0.0, 1.0
    for _ in range(HALVINGS):
        s = 0.5 * (outside + inside)
        p_W = before.p_W + (b0 + (c2 + c3 * s) * s) * s
        if float(np.linalg.norm(p_W - place_W)) < radius_m:
            inside = s
        else:
            outside = s
    return (1.0 - inside) * h_s
