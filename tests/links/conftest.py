"""Fixtures of link tests that stand in several files."""

from tests.worlds.ardupilot_json_sitl import make, sitl
from tests.worlds.hitl_board import board
from tests.worlds.router_clients import client

__all__ = ["board", "client", "make", "sitl"]
