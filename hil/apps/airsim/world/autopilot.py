"""Flight controller of one vehicle, and the result of its running move."""

from __future__ import annotations

from collections.abc import Sequence

from hil.apps.airsim.rpc.methods import Pending
from signals.samples import TruthState


class Autopilot:
    """`simple_flight` of one vehicle: arming, api control, and the move that runs."""

    def __init__(self, rotors: int, *, armed: bool) -> None:
        self._still = (0.0,) * rotors
        self._armed_at_start = armed
        self._task: Pending | None = None
        self.reset()

    def reset(self) -> None:
        """Cancel the move and return to the state at the start."""
        self.cancel()
        self.api_control = False
        self.armed = self._armed_at_start

    @property
    def busy(self) -> bool:
        """True while a move runs."""
        return self._task is not None

    @property
    def landed(self) -> bool:
        """True on the ground with idle rotors."""
        return True

    def cancel(self) -> None:
        """End the running move; its caller receives False."""
        task, self._task = self._task, None
        if task is not None:
            task.resolve(False)

    def enable_api_control(self, enabled: bool) -> None:
        """Give the api control, or take it away."""
        self.api_control = enabled

    def arm(self, armed: bool) -> None:
        """Arm or disarm the rotors."""
        self.armed = armed

    def placed(self) -> None:
        """Take notice that the vehicle was put elsewhere."""

    def controls(self, truth: TruthState) -> Sequence[float]:  # noqa: ARG002
        """Return the commands of the rotors until the next tick."""
        return self._still
