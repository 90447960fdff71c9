"""The mock Pixhawk in HITL, free-running; its link is that of PX4 on a board."""

from __future__ import annotations

from hil.run.autopilots.px4_hitl import make_link

__all__ = ["make_link"]
