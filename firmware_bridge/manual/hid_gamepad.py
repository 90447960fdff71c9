"""A HID gamepad, joystick or radio, read without waiting, and default mappings for common ones.

Sticks are in "mode 2": throttle and yaw left, pitch and roll right. A gamepad's y axes read low when pushed forward.
"""

from __future__ import annotations

from dataclasses import replace

from firmware_bridge.devices.buses import HidBus, HidDevice
from firmware_bridge.devices.gamepads import HidApi
from firmware_bridge.devices.inventory import Gamepad, find_devices
from firmware_bridge.manual.axes import Axis, StickMapping
from firmware_bridge.manual.report_layout import HidState, ReportLayout, parse_report_descriptor
from firmware_bridge.manual.sticks import ManualControlError, StickLost, StickState

_REPORT_BYTES = 4096
_READS_LIMIT = 256  # reports read in one poll: a device that sends without pause must not block the bench
_BAD_LIMIT = 25  # unreadable reports in a row after which the device counts as lost
_USAGE_JOYSTICK = 0x04
_USAGES = {"joystick": _USAGE_JOYSTICK, "gamepad": 0x05}


class HidGamepad:
    """An open device. Most send a report only when a control moved, so silence is not a loss."""

    def __init__(
        self, device: HidDevice, layout: ReportLayout, mapping: StickMapping, *, name: str, needs_dead_man: bool = True
    ) -> None:
        if needs_dead_man and mapping.dead_man is None:
            raise ManualControlError(
                f"{name}: the mapping has no dead-man button: name one, or set needs_dead_man to false"
            )
        mapping.check(layout)
        self.name = name
        self.bad_reports = 0
        self._bad_in_a_row = 0
        self._device, self._layout, self._mapping = device, layout, mapping
        self._state: HidState | None = None
        self._tapped: frozenset[int] = frozenset()  # pressed at any moment since the last poll

    @property
    def mapping(self) -> StickMapping:
        """The functions of its axes and buttons."""
        return self._mapping

    def poll(self) -> StickState | None:
        """Return the newest state; None before the first report. StickLost if unplugged, or if reports are invalid."""
        self._tapped = frozenset()
        try:
            for _ in range(_READS_LIMIT):
                report = self._device.read(_REPORT_BYTES)
                if not report:
                    break
                self._take(report)
        except OSError as error:
            raise StickLost(f"{self.name}: unplugged or no longer readable ({error}); plug it in again") from error
        if self._bad_in_a_row >= _BAD_LIMIT:
            raise StickLost(
                f"{self.name}: {self._bad_in_a_row} reports in a row that do not fit its description; "
                "plug it in again, and check the radio's USB mode"
            )
        state, mapping = self._state, self._mapping
        if state is None:
            return None
        held = mapping.dead_man is None or mapping.dead_man in state.pressed
        return StickState(mapping.sticks(state, self._layout), held, state.pressed | self._tapped)

    def close(self) -> None:
        self._device.close()

    def _take(self, report: bytes) -> None:
        if self._layout.is_other_report(report):
            return
        state = self._layout.read(report)
        if state is None:
            self.bad_reports += 1
            self._bad_in_a_row += 1
            return
        self._bad_in_a_row = 0
        self._state = state
        self._tapped |= state.pressed


def open_gamepad(
    pad: Gamepad | None = None,
    *,
    hid: HidBus | None = None,
    mapping: StickMapping | None = None,
    needs_dead_man: bool = True,
) -> HidGamepad:
    """Open `pad`, or the first gamepad found. `mapping` None: the device's default.

    `needs_dead_man` False permits a mapping without dead-man switch. StickLost if there is no gamepad or it cannot be
    opened; ManualControlError if it lacks axes or buttons.
    """
    hid = hid or HidApi()
    if pad is None:
        devices = find_devices(usb=_EmptyBus(), ports=_EmptyBus(), hid=hid)
        if not devices.gamepads:
            raise StickLost("; ".join(("no gamepad, joystick or radio is plugged in", *devices.notes)))
        pad = devices.gamepads[0]
    try:
        device = hid.open(pad.path)
    except OSError as error:
        raise StickLost("; ".join((f"{pad.name}: cannot be opened ({error})", *pad.notes))) from error
    try:
        layout = layout_of(device)
        usage = _USAGES.get(pad.kind, 0)
        chosen = mapping
        if chosen is None:
            chosen = default_mapping(pad.vendor_id, pad.product_id, usage, layout)
            if not needs_dead_man:
                chosen = replace(chosen, dead_man=None)
        return HidGamepad(device, layout, chosen, name=pad.name, needs_dead_man=needs_dead_man)
    except ManualControlError as error:
        device.close()
        raise ManualControlError(f"{pad.name}: {error}") from error


def layout_of(device: HidDevice) -> ReportLayout:
    """Read the layout from the device's descriptor. ManualControlError if it has none that can be used."""
    try:
        return parse_report_descriptor(device.report_descriptor())
    except OSError as error:
        raise ManualControlError(f"its reports are unknown: no report descriptor ({error})") from error


_RADIOS = frozenset({(0x1209, 0x4F54), (0x0483, 0x5710)})
_XBOX = frozenset({(0x045E, 0x02E0), (0x045E, 0x02FD), (0x045E, 0x0B13)})


def default_mapping(vendor_id: int, product_id: int, usage: int, layout: ReportLayout) -> StickMapping:
    """Return the usual mapping for this device.

    Dead-man switch: left shoulder button of a gamepad, trigger of a joystick, channel 9 (button 1) of a radio.
    """
    ids = (vendor_id, product_id)
    if ids in _RADIOS:
        # A radio applies dead zones, expo and reversing itself: channels 1 to 4 (AETR) are used unchanged.
        return StickMapping(
            roll=Axis("x", dead_zone=0.0),
            pitch=Axis("y", dead_zone=0.0),
            throttle=Axis("z", dead_zone=0.02),
            yaw=Axis("rx", dead_zone=0.0),
            dead_man=1,
        )
    if usage == _USAGE_JOYSTICK and layout.range_of("slider") is not None:
        twist = "rz" if layout.range_of("rz") is not None else "z"
        return StickMapping(
            roll=Axis("x", expo=0.3),
            pitch=Axis("y", inverted=True, expo=0.3),
            throttle=Axis("slider", inverted=True),
            yaw=Axis(twist, expo=0.3, dead_zone=0.1),
            dead_man=1,
        )
    right = ("z", "rz") if layout.range_of("rz") is not None and layout.range_of("z") is not None else ("rx", "ry")
    if layout.range_of("rx") is not None and layout.range_of("ry") is not None and ids in _XBOX:
        right = ("rx", "ry")  # older Xbox firmware: z and rz are the triggers
    return StickMapping(
        yaw=Axis("x", expo=0.3, dead_zone=0.1),
        throttle=Axis("y", inverted=True, dead_zone=0.1),
        roll=Axis(right[0], expo=0.3, dead_zone=0.1),
        pitch=Axis(right[1], inverted=True, expo=0.3, dead_zone=0.1),
        dead_man=_left_shoulder(ids, layout),
    )


def _left_shoulder(ids: tuple[int, int], layout: ReportLayout) -> int:
    # Newer Xbox pads leave gaps in the numbers (A 1, B 2, X 4, Y 5, LB 7) and have 15 of them; older have ten.
    return 7 if ids in _XBOX and len(layout.buttons) > 12 else 5


class _EmptyBus:
    """A bus without devices, for those that are not listed."""

    def devices(self) -> tuple[()]:
        return ()

    def ports(self) -> tuple[()]:
        return ()
