"""Air in the two lines of a pitot-static tube whose ports are blocked. Equations: sim/sensors/pitot.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from signals._kernel import det_exp


@dataclass(frozen=True)
class BlockedPorts:
    """A blockage at one instant: what it blocks, and how far each port is open."""

    port: Literal["total", "static", "both"]
    open_share: float  # 1: open, 0: closed
    leak: float  # conductance to the static pressure over that of the open port
    response_s: float  # time constant of a line with an open port


class Blockage:
    """Pressures behind the ports. Without a blockage they are those outside."""

    def __init__(self) -> None:
        self._ports: BlockedPorts | None = None
        self._inside: tuple[float, float, float] | None = None  # total and static pressure [Pa], time [s]

    def set(self, ports: BlockedPorts | None) -> None:
        """Set the blockage from the next sample on; None: both ports are open."""
        self._ports = ports

    def difference(self, total_pa: float, static_pa: float, t_s: float) -> float:
        """Return the difference between the two lines at `t_s`, from the pressures outside."""
        ports = self._ports
        total, static = total_pa, static_pa
        if ports is not None and self._inside is not None:
            was_total, was_static, was_s = self._inside
            dt = max(t_s - was_s, 0.0)
            if ports.port != "static":
                total = _line(was_total, total_pa, static_pa, ports, dt)
            if ports.port != "total":
                static = _line(was_static, static_pa, static_pa, ports, dt)
        self._inside = (total, static, t_s)
        return total - static


def _line(was_pa: float, outside_pa: float, static_pa: float, ports: BlockedPorts, dt_s: float) -> float:
    """Return the pressure in a line after `dt_s` with the port and the leak at constant pressures."""
    conductance = ports.open_share + ports.leak
    if conductance <= 0.0:
        return was_pa
    settled = (ports.open_share * outside_pa + ports.leak * static_pa) / conductance
    return settled + (was_pa - settled) * det_exp(-dt_s * conductance / ports.response_s)
