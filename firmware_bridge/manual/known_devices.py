"""What the common gamepads and radios send and how they are held, for want of anything better.

A device's own report descriptor always comes first; these layouts stand in where it cannot be read. Sticks are in
"mode 2": throttle and yaw left, pitch and roll right. A gamepad's y axes read low when pushed forward.
"""

from __future__ import annotations

from firmware_bridge.manual.axes import Axis, StickMapping
from firmware_bridge.manual.report_layout import AxisField, ButtonField, ReportLayout

_USAGE_JOYSTICK = 0x04


def _byte_axes(*names: str, at: int = 0) -> tuple[AxisField, ...]:
    return tuple(AxisField(name, at + 8 * i, 8, 0, 255) for i, name in enumerate(names))


def _buttons(count: int, at: int) -> tuple[ButtonField, ...]:
    return tuple(ButtonField(i + 1, at + i) for i in range(count))


# Eight channels of 11 bits in 16, after 24 buttons (EdgeTX "classic" joystick, OpenTX 2.3).
_EDGETX = ReportLayout(
    None,
    19,
    tuple(
        AxisField(name, 24 + 16 * i, 16, 0, 2047)
        for i, name in enumerate(("x", "y", "z", "rx", "ry", "rz", "slider", "slider2"))
    ),
    _buttons(24, 0),
)
_DUALSHOCK4 = ReportLayout(1, 63, _byte_axes("x", "y", "z", "rz"), _buttons(14, 36))
_DUALSENSE = ReportLayout(1, 63, _byte_axes("x", "y", "z", "rz"), _buttons(15, 60))
_LOGITECH_D = ReportLayout(None, 8, _byte_axes("x", "y", "z", "rz"), _buttons(12, 36))

LAYOUTS = {
    (0x1209, 0x4F54): _EDGETX,
    (0x054C, 0x05C4): _DUALSHOCK4,
    (0x054C, 0x09CC): _DUALSHOCK4,
    (0x054C, 0x0CE6): _DUALSENSE,
    (0x046D, 0xC216): _LOGITECH_D,
    (0x046D, 0xC218): _LOGITECH_D,
    (0x046D, 0xC219): _LOGITECH_D,
}

_RADIOS = frozenset({(0x1209, 0x4F54), (0x0483, 0x5710)})
_XBOX = frozenset({(0x045E, 0x02E0), (0x045E, 0x02FD), (0x045E, 0x0B13)})


def default_mapping(vendor_id: int, product_id: int, usage: int, layout: ReportLayout) -> StickMapping:
    """A mapping for this device as it is usually held.

    Dead-man switch: left shoulder button of a gamepad, trigger of a joystick, channel 9 (button 1) of a radio.
    """
    ids = (vendor_id, product_id)
    if ids in _RADIOS:
        # A radio has done its own dead zones, expo and reversing: take channels 1 to 4 (AETR) as they come.
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
