"""The layout of a HID device's reports, read from its report descriptor.

The descriptor is a list of short items (USB HID 1.11, section 6.2.2): a prefix byte of size, type and tag, then 0, 1,
2 or 4 bytes. Global items set a state, local items name usages, and each Input item lays out fields from both. Only
axes, buttons and the hat are kept.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

from firmware_bridge.manual.sticks import ManualControlError

_GENERIC, _SIMULATION, _BUTTONS = 0x01, 0x02, 0x09
_AXES = {
    (_GENERIC, 0x30): "x",
    (_GENERIC, 0x31): "y",
    (_GENERIC, 0x32): "z",
    (_GENERIC, 0x33): "rx",
    (_GENERIC, 0x34): "ry",
    (_GENERIC, 0x35): "rz",
    (_GENERIC, 0x36): "slider",
    (_GENERIC, 0x37): "dial",
    (_GENERIC, 0x38): "wheel",
    (_GENERIC, 0x39): "hat",
    (_SIMULATION, 0xBA): "rudder",
    (_SIMULATION, 0xBB): "throttle",
    (_SIMULATION, 0xC4): "accelerator",
    (_SIMULATION, 0xC5): "brake",
}
_MAX_REPORT_BITS = 8 * 4096
_MAX_DESCRIPTOR_BYTES = 4096  # the limit of Linux and hidapi


class AxisField(NamedTuple):
    """One axis in a report: `bits` from bit `first_bit` on, little-endian, from `low` to `high`."""

    name: str
    first_bit: int
    bits: int
    low: int
    high: int

    def read(self, number: int) -> int:
        """Return its value in a report given as one little-endian number."""
        value = number >> self.first_bit & (1 << self.bits) - 1
        return value - (1 << self.bits) if self.low < 0 and value >> self.bits - 1 else value


class ButtonField(NamedTuple):
    """One button, a single bit."""

    button: int
    bit: int


class HidState(NamedTuple):
    """The contents of one report. Axis values as the device sends them."""

    axes: dict[str, int]
    pressed: frozenset[int]


@dataclass(frozen=True)
class ReportLayout:
    """The input report that carries the sticks. `report_id` None: the device does not number its reports."""

    report_id: int | None
    size_bytes: int  # without the report number
    axes: tuple[AxisField, ...]
    buttons: tuple[ButtonField, ...]

    def range_of(self, axis: str) -> tuple[int, int] | None:
        """Return (lowest, highest) value of `axis`; None if there is no such axis."""
        return next(((a.low, a.high) for a in self.axes if a.name == axis), None)

    def is_other_report(self, report: bytes) -> bool:
        """Return True for a report with another number, such as motion or battery, which is not a fault."""
        return self.report_id is not None and len(report) > 0 and report[0] != self.report_id

    def read(self, report: bytes) -> HidState | None:
        """Return the state in `report`; None if its length is wrong or an axis is out of its range.

        Zeros after the report are not a fault: Windows pads every report to the size of the longest.
        """
        if self.report_id is not None:
            if not report or report[0] != self.report_id:
                return None
            report = report[1:]
        if len(report) < self.size_bytes or any(report[self.size_bytes :]):
            return None
        number = int.from_bytes(report, "little")
        axes: dict[str, int] = {}
        for axis in self.axes:
            value = axis.read(number)
            # A hat out of its range is not pressed (HID's null state); a stick out of its range is invalid.
            if axis.name != "hat" and not axis.low <= value <= axis.high:
                return None
            axes[axis.name] = value
        return HidState(axes, frozenset(b.button for b in self.buttons if number >> b.bit & 1))


@dataclass(frozen=True)
class _Globals:
    page: int = 0
    low: int = 0
    high: int = 0
    high_unsigned: int = 0
    size: int = 0
    count: int = 0
    report_id: int | None = None


@dataclass
class _Report:
    bits: int = 0
    axes: list[AxisField] = field(default_factory=list)
    buttons: list[ButtonField] = field(default_factory=list)


def parse_report_descriptor(descriptor: bytes) -> ReportLayout:
    """Return the layout of the report with the most axes. ManualControlError if none has two axes."""
    if len(descriptor) > _MAX_DESCRIPTOR_BYTES:
        raise _bad(f"it is {len(descriptor)} bytes long")
    state = _Globals()
    stack: list[_Globals] = []
    usages: list[int] = []
    usage_range = [0, 0]
    reports: dict[int | None, _Report] = {}
    position = 0
    while position < len(descriptor):
        prefix = descriptor[position]
        if prefix == 0xFE:  # a long item; none is defined
            position += 3 + (descriptor[position + 1] if position + 1 < len(descriptor) else 0)
            continue
        size = (0, 1, 2, 4)[prefix & 3]
        data = descriptor[position + 1 : position + 1 + size]
        if len(data) < size:
            raise _bad(f"it ends inside the item at byte {position}")
        position += 1 + size
        value = int.from_bytes(data, "little")
        signed = int.from_bytes(data, "little", signed=True)
        kind, tag = prefix >> 2 & 3, prefix >> 4
        if kind == 1:
            if tag == 0:
                state = replace(state, page=value)
            elif tag == 1:
                state = replace(state, low=signed)
            elif tag == 2:
                state = replace(state, high=signed, high_unsigned=value)
            elif tag == 7:
                state = replace(state, size=value)
            elif tag == 8:
                state = replace(state, report_id=value)
            elif tag == 9:
                state = replace(state, count=value)
            elif tag == 10:
                stack.append(state)
            elif tag == 11:
                if not stack:
                    raise _bad("it pops a state that it never pushed")
                state = stack.pop()
        elif kind == 2:
            # A four-byte usage carries its own page.
            usage = value if size == 4 else state.page << 16 | value
            if tag == 0:
                usages.append(usage)
            elif tag in (1, 2):
                usage_range[tag - 1] = usage
                if tag == 2 and usage_range[0] <= usage:
                    usages.extend(range(usage_range[0], min(usage, usage_range[0] + 255) + 1))
        elif kind == 0:
            if tag == 8:
                _lay_out(reports.setdefault(state.report_id, _Report()), state, usages, value)
            usages, usage_range = [], [0, 0]
    if len(reports) > 1 and None in reports:
        raise _bad("some of its reports are numbered and some are not")
    report_id, report = max(reports.items(), key=lambda item: len(item[1].axes), default=(None, _Report()))
    if sum(axis.name != "hat" for axis in report.axes) < 2:
        raise _bad("it has fewer than two axes; is it a gamepad?")
    return ReportLayout(report_id, (report.bits + 7) // 8, tuple(report.axes), tuple(report.buttons))


def _lay_out(report: _Report, state: _Globals, usages: list[int], flags: int) -> None:
    """Add the fields of one Input item."""
    end = report.bits + state.size * state.count
    if end > _MAX_REPORT_BITS or state.size > 64:
        raise _bad(f"a report of {end} bits, or a field of {state.size}")
    constant, variable, relative = flags & 1, flags & 2, flags & 4
    if not constant and variable and not relative and state.size and usages:
        # A range that starts at 0 or above has an unsigned end: 255 in one byte is not -1.
        high = state.high if state.low < 0 else state.high_unsigned
        for i in range(state.count):
            usage = usages[min(i, len(usages) - 1)]
            page, number = usage >> 16, usage & 0xFFFF
            first_bit = report.bits + i * state.size
            if page == _BUTTONS and number and state.size == 1 and i < len(usages):
                report.buttons.append(ButtonField(number, first_bit))
            elif (page, number) in _AXES and high > state.low:
                name = _AXES[page, number]
                same = sum(axis.name.rstrip("23456789") == name for axis in report.axes)
                report.axes.append(
                    AxisField(name if not same else f"{name}{same + 1}", first_bit, state.size, state.low, high)
                )
    report.bits = end


def _bad(what: str) -> ManualControlError:
    return ManualControlError(f"the device's report descriptor cannot be used: {what}")
