"""Methods that record poses and pictures to files."""

from __future__ import annotations

from hil.apps.airsim.rpc.methods import Method, method
from hil.apps.airsim.simulation import Simulation


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""
    recorder = simulation.recorder
    return [
        method("startRecording", recorder.start),
        method("stopRecording", recorder.stop),
        method("isRecording", lambda: recorder.runs),
        # Names of other clients:
        method("simStartRecording", recorder.start),
        method("simStopRecording", recorder.stop),
        method("simIsRecording", lambda: recorder.runs),
    ]
