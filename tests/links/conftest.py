"""Fixtures of link tests that stand in several files."""

from tests.worlds.ardupilot_json_sitl import make, sitl
from tests.worlds.hitl_board import board

__all__ = ["board", "make", "sitl"]
