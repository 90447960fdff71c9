"""Fixtures of the ArduPilot JSON link's tests, which stand in several files."""

from tests.worlds.ardupilot_json_sitl import make, sitl

__all__ = ["make", "sitl"]
