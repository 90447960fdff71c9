"""Where what companions answer goes: to the pilot, into the recording, to the judgement of a goal or a search."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from hil.recorder.recorder import Recorder
from hil.signals.desired import DesiredState
from hil.signals.detections import Detections

if TYPE_CHECKING:  # both load OpenCV, which most runs do without
    from hil.goal.judgement import GoalMeasurement
    from hil.search.judgement import SearchMeasurement


class AnswerSinks:
    """Of one run."""

    def __init__(
        self,
        recorder: Recorder,
        *,
        event: Callable[[int, str, str], None],
        pilot: OffboardPilot | None,
        goal: GoalMeasurement | None,
        search: SearchMeasurement | None,
    ) -> None:
        """`pilot`: who flies what is desired; None: nobody."""
        self._recorder, self._event = recorder, event
        self._pilot, self._goal, self._search = pilot, goal, search
        self._outcomes: dict[str, str] = {}  # by client: what it last said

    @property
    def flies(self) -> bool:
        return self._pilot is not None

    def desire(self, desired: DesiredState, t_apply_ns: int, t_of_ns: int) -> None:
        """Where a client wants to be, from `t_apply_ns` on."""
        if self._goal is not None and desired.land:
            self._goal.over(t_apply_ns)
        if self._pilot is not None:
            self._pilot.set_desired(desired, t_apply_ns, t_of_ns)

    def report(self, client: str, report: Mapping[str, Any], t_ns: int) -> None:
        """What a client says of itself: how it ended is an event."""
        if self._goal is not None and self._pilot is not None:
            self._goal.reported(report, t_ns)
        outcome = report.get("outcome")
        if isinstance(outcome, str) and outcome != self._outcomes.get(client, "flying"):
            self._outcomes[client] = outcome
            why = f": {report['why']}" if report.get("why") else ""
            self._event(t_ns, "companion_outcome", f"{client}: {outcome}{why}")

    def detections(self, client: str, detections: Detections, t_ns: int) -> None:
        """What a client has made out in a picture."""
        self._recorder.detected(t_ns, client, detections)
        if self._search is not None:
            self._search.detected(client, detections)
