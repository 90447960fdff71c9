"""Fixtures of fault tests that stand elsewhere."""

from tests.worlds.hitl_board import board

__all__ = ["board"]
