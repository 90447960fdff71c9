"""Is the vehicle ready to be armed? What it says of itself, and how long to wait."""

from __future__ import annotations

from typing import Any

from hil.signals.time import NS_PER_S

_PREARM_CHECK = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
# A vehicle that does not report its pre-arm check is asked to arm after this long, and again until it agrees.
_UNREPORTED_NS = 5 * NS_PER_S


class Health:
    """The pre-arm bit of SYS_STATUS: PX4 sets it when every arming check passes."""

    def __init__(self) -> None:
        self._reported = False
        self._healthy = False
        self._sensors_bad = 0
        self._since_ns: int | None = None

    def on_sys_status(self, message: Any) -> None:
        self._reported = bool(message.onboard_control_sensors_present & _PREARM_CHECK)
        self._healthy = bool(message.onboard_control_sensors_health & _PREARM_CHECK)
        self._sensors_bad = (
            message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health & ~_PREARM_CHECK
        )

    def ready(self, t_ns: int) -> bool:
        """Worth asking to arm at `t_ns`?"""
        if self._since_ns is None:
            self._since_ns = t_ns
        if self._reported:
            return self._healthy
        return t_ns - self._since_ns >= _UNREPORTED_NS

    def complaint(self) -> str:
        """What is missing, in words."""
        if not self._reported:
            return "it does not report its pre-arm check (SYS_STATUS)"
        return f"its pre-arm check does not pass (unhealthy sensors: {self._sensors_bad:#x} in SYS_STATUS)"
