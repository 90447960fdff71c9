"""Error of the path tracer."""

from __future__ import annotations

from sim.frame.mujoco_backend import ColourBackendError


class PathTracerError(ColourBackendError):
    """The path tracer is missing on this machine, does not support this camera, or its process has ended."""
