"""Facts about a firmware that its messages do not tell by themselves."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Firmware:
    """Facts about one firmware."""

    name: str  # for messages to the user
    failsafe_texts: Sequence[str]  # regular expressions; a STATUSTEXT that one matches, in flight, is a failsafe
    mav_autopilot: int  # MAV_AUTOPILOT in its HEARTBEAT
    bytewise_params: bool  # PARAM_VALUE carries an integer's bits, not its value as a float
    airframe_parameter: str = ""  # holds the number of the airframe; empty: the firmware has no such numbers

    def is_failsafe(self, text: str) -> bool:
        """Return True if a STATUSTEXT of an armed vehicle says that a failsafe has acted."""
        return any(re.search(pattern, text, re.IGNORECASE) for pattern in self.failsafe_texts)
