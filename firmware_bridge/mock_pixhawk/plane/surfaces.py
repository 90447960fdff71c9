"""Allocation of torque demands to control surfaces, by PX4's parameters CA_SV_CSn_*.

CA_SV_CSn_TRQ_R, _P, _Y: torque of the surface at full command over that of a full demand, FRD. The commands are the
least-norm solution of E u = demand, E^T (E E^T)^-1, over the axes that some surface acts on: elevons, ailerons with
elevator and rudder, V-tails are the same to it. An axis without surface (the yaw of a flying wing) is left out. Entries
that are a steering wheel or a brake have no part in this.

A demand beyond the surfaces is cut in this order: yaw, then pitch, then roll, so that a plane in trouble can first of
all level its wings.
"""

from __future__ import annotations

from collections.abc import Sequence

from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from signals.linear import inverse

STEERING_WHEEL = 16  # CA_SV_CSn_TYPE
WHEEL_BRAKE = 20  # of the mock alone: PX4 has no wheel brakes
_LEAST = 1e-3  # an axis with less effect is not controlled
_SOLVABLE = 1e-9


def allocation(effect: Sequence[Sequence[float]]) -> list[list[float]]:
    """Return the commands per unit demand, (surfaces, 3), for the effect (3, surfaces). Sums in fixed order."""
    count = len(effect[0]) if effect else 0
    axes = [a for a in range(3) if any(abs(value) > _LEAST for value in effect[a])]
    while axes:
        square = [[sum(effect[a][i] * effect[b][i] for i in range(count)) for b in axes] for a in axes]
        inverted = inverse(square, _SOLVABLE)
        if inverted is not None:
            break
        axes.pop()  # a V of one surface cannot give all of them: yaw goes first, then pitch
    else:
        return [[0.0, 0.0, 0.0] for _ in range(count)]
    mix = [[0.0, 0.0, 0.0] for _ in range(count)]
    for i in range(count):
        for column, axis in enumerate(axes):
            mix[i][axis] = sum(effect[a][i] * inverted[row][column] for row, a in enumerate(axes))
    return mix


class SurfaceMixer:
    """Commands of the surfaces, -1..1."""

    def __init__(self, params: ParamTable) -> None:
        count = int(params["CA_SV_CS_COUNT"])
        types = [int(params[f"CA_SV_CS{i}_TYPE"]) for i in range(count)]
        flies = [kind not in (STEERING_WHEEL, WHEEL_BRAKE) for kind in types]
        effect = [[params[f"CA_SV_CS{i}_TRQ_{axis}"] if flies[i] else 0.0 for i in range(count)] for axis in "RPY"]
        self._wheels = [
            (i, -1.0 if params[f"CA_SV_CS{i}_TRQ_Y"] < 0.0 else 1.0)
            for i, kind in enumerate(types)
            if kind == STEERING_WHEEL
        ]
        self._brakes = [i for i, kind in enumerate(types) if kind == WHEEL_BRAKE]
        self._mix = allocation(effect)
        self._trim = [params[f"CA_SV_CS{i}_TRIM"] for i in range(count)]

    @property
    def count(self) -> int:
        """Number of surfaces."""
        return len(self._mix)

    def commands(self, roll: float, pitch: float, yaw: float) -> list[float]:
        """Return the commands for torque demands: of yaw, pitch and roll only what the surfaces have left."""
        taken = list(self._trim)
        for axis, demand in ((0, roll), (1, pitch), (2, yaw)):
            share = 1.0
            for now, row in zip(taken, self._mix, strict=True):
                wanted = row[axis] * demand
                room = (1.0 - now) if wanted > 0.0 else (1.0 + now)
                if wanted != 0.0 and abs(wanted) > room:
                    share = min(share, max(room, 0.0) / abs(wanted))
            taken = [now + share * row[axis] * demand for now, row in zip(taken, self._mix, strict=True)]
        return [min(max(value, -1.0), 1.0) for value in taken]

    def set_wheels(self, commands: list[float], *, steering: float, brake: float) -> None:
        """Write the commands of steered and braked wheels. `steering`: -1..1, to the right above 0; `brake`: 0..1."""
        for i, sign in self._wheels:
            commands[i] = min(max(sign * steering, -1.0), 1.0)
        for i in self._brakes:
            commands[i] = min(max(brake, 0.0), 1.0)
