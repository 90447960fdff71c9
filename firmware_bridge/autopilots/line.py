"""The line between bench and autopilot in its profile: the messages on which the faults of `faults.links` act."""

from __future__ import annotations

from dataclasses import dataclass

# HIL messages that travel in one direction only.
_TO_AUTOPILOT = frozenset({"HIL_SENSOR", "HIL_GPS", "HIL_OPTICAL_FLOW"})
_FROM_AUTOPILOT = frozenset({"HIL_ACTUATOR_CONTROLS"})


@dataclass(frozen=True)
class Line:
    """Messages on the line on which the faults of `faults.links` act, by name and direction."""

    to_autopilot: frozenset[str] = frozenset()
    from_autopilot: frozenset[str] = frozenset()
    others: bool = True  # every message but HIL messages travels here, in both directions

    def carries(self, message: str, direction: str) -> bool:
        """Return True if a message can travel on this line in a direction: to_autopilot, from_autopilot or both."""
        ways = ("to_autopilot", "from_autopilot") if direction == "both" else (direction,)
        is_other = self.others and message not in _TO_AUTOPILOT | _FROM_AUTOPILOT
        return is_other or any(message in getattr(self, way) for way in ways)


ONE_LINE = Line(_TO_AUTOPILOT, _FROM_AUTOPILOT)
"""HIL messages, commands and telemetry on one line."""
HIL_LINE = Line(_TO_AUTOPILOT | {"DISTANCE_SENSOR"}, _FROM_AUTOPILOT | {"HEARTBEAT", "COMMAND_LONG"}, others=False)
"""PX4 SITL's simulator connection (simulator_mavlink); commands, missions and telemetry travel on another one."""
