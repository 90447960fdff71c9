"""Converts axis readings to stick positions and MANUAL_CONTROL: calibration, dead zone, expo, mapping of axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from firmware_bridge.manual.report_layout import HidState, ReportLayout
from firmware_bridge.manual.sticks import ManualControlError, Sticks


@dataclass(frozen=True)
class Calibration:
    """The readings of an axis at its ends and at rest."""

    minimum: int
    centre: int
    maximum: int

    def __post_init__(self) -> None:
        if not self.minimum < self.centre < self.maximum:
            raise ManualControlError(
                f"axis range {self.minimum}, {self.centre}, {self.maximum}: minimum, centre and maximum must rise"
            )

    def position(self, raw: int) -> float:
        """Return -1..1, each side of the centre scaled separately, limited at the ends."""
        if raw >= self.centre:
            return min((raw - self.centre) / (self.maximum - self.centre), 1.0)
        return max((raw - self.centre) / (self.centre - self.minimum), -1.0)


@dataclass(frozen=True)
class Axis:
    """One axis of a device and its response. `source` is the device's name of it: x, y, z, rx, slider..."""

    source: str
    inverted: bool = False
    dead_zone: float = 0.05  # share of the travel around the centre that counts as the centre
    expo: float = 0.0  # 0 linear .. 1 cubic: finer around the centre, same ends
    calibration: Calibration | None = None  # None: the range in the device's description

    def __post_init__(self) -> None:
        if not 0.0 <= self.dead_zone < 1.0:
            raise ManualControlError(f"axis {self.source}: dead_zone {self.dead_zone} must be 0 or more and below 1")
        if not 0.0 <= self.expo <= 1.0:
            raise ManualControlError(f"axis {self.source}: expo {self.expo} must be from 0 to 1")

    def value(self, raw: int, low: int, high: int) -> float:
        """Return -1..1 for a reading of a device with the range `low` to `high`."""
        if self.calibration is not None:
            position = self.calibration.position(raw)
        else:
            position = (2 * raw - low - high) / (high - low)
        if self.inverted:
            position = -position
        return shape(position, self.dead_zone, self.expo)


def shape(position: float, dead_zone: float, expo: float) -> float:
    """Apply the dead zone, then expo. Continuous, odd, rising; 1 stays 1."""
    size = abs(position)
    if size <= dead_zone:
        return 0.0
    size = min((size - dead_zone) / (1.0 - dead_zone), 1.0)
    size = (1.0 - expo) * size + expo * size * size * size
    return size if position > 0.0 else -size


@dataclass(frozen=True)
class StickMapping:
    """The functions of axes and buttons. Buttons are numbered from 1, as the device does."""

    pitch: Axis
    roll: Axis
    throttle: Axis
    yaw: Axis
    dead_man: int | None = None  # the sticks count only while this button is held
    arm: int | None = None
    disarm: int | None = None
    modes: Mapping[int, str] = field(default_factory=dict)  # button -> name of a mode

    def check(self, layout: ReportLayout) -> None:
        """Raise ManualControlError with all that is missing if the device lacks an axis or a button of this mapping."""
        missing = [
            f"axis {axis.source!r} for {role}"
            for role, axis in (
                ("pitch", self.pitch),
                ("roll", self.roll),
                ("throttle", self.throttle),
                ("yaw", self.yaw),
            )
            if layout.range_of(axis.source) is None
        ]
        available = {b.button for b in layout.buttons}
        wanted = {"dead-man": self.dead_man, "arm": self.arm, "disarm": self.disarm}
        wanted |= {f"mode {name}": button for button, name in self.modes.items()}
        missing += [f"button {b} for {role}" for role, b in wanted.items() if b is not None and b not in available]
        if missing:
            axes = ", ".join(a.name for a in layout.axes)
            raise ManualControlError(
                f"the device has no {'; no '.join(missing)}. It has the axes {axes} and {len(available)} buttons: "
                "give a mapping that names these"
            )

    def sticks(self, state: HidState, layout: ReportLayout) -> Sticks:
        """Return the stick positions in `state`. The mapping must have passed `check`."""
        ranges = {a.name: (a.low, a.high) for a in layout.axes}

        def value(axis: Axis) -> float:
            return axis.value(state.axes[axis.source], *ranges[axis.source])

        return Sticks(value(self.pitch), value(self.roll), value(self.throttle), value(self.yaw))


def manual_control_axes(sticks: Sticks) -> tuple[int, int, int, int]:
    """Return (x, y, z, r) of MANUAL_CONTROL: x forward, y right, r nose right, each -1000..1000; z 0..1000, centre 500.

    The message's documentation has r positive counter-clockwise; PX4, ArduPilot and QGroundControl all use positive for
    a turn to the right, and so does this.
    """
    pitch, roll, throttle, yaw = (min(max(s, -1.0), 1.0) for s in sticks)
    return round(1000 * pitch), round(1000 * roll), round(500 + 500 * throttle), round(1000 * yaw)
