"""Messages that pymavlink leaves out (work in progress in MAVLink's XML) and that autopilots send all the same.

Only framing knows them: their frames are checked, counted and handed on to ground stations, never unpacked here.
Source: MAVLink message definitions `common`, `minimal` and `development` of August 2025; (crc_extra, length without
extensions, length) follow from the definition by MAVLink's own rule.
"""

from __future__ import annotations

FRAMING_ONLY: dict[int, tuple[str, int, int, int]] = {
    8: ("LINK_NODE_STATUS", 117, 36, 36),
    80: ("COMMAND_CANCEL", 14, 4, 4),
    290: ("ESC_INFO", 251, 46, 46),
    291: ("ESC_STATUS", 10, 57, 57),
    300: ("PROTOCOL_VERSION", 217, 22, 22),
    334: ("CELLULAR_STATUS", 72, 10, 10),
    336: ("CELLULAR_CONFIG", 245, 84, 84),
    354: ("SET_VELOCITY_LIMITS", 210, 14, 14),
    355: ("VELOCITY_LIMITS", 6, 12, 12),
    361: ("FIGURE_EIGHT_EXECUTION_STATUS", 93, 33, 33),
    369: ("BATTERY_STATUS_V2", 151, 24, 24),
    371: ("FUEL_STATUS", 10, 26, 26),
    372: ("BATTERY_INFO", 26, 140, 140),
    380: ("TIME_ESTIMATE_TO_TARGET", 232, 20, 20),
    395: ("COMPONENT_INFORMATION", 0, 212, 212),
    396: ("COMPONENT_INFORMATION_BASIC", 50, 160, 160),
    397: ("COMPONENT_METADATA", 182, 108, 108),
    400: ("PLAY_TUNE_V2", 110, 254, 254),
    401: ("SUPPORTED_TUNES", 183, 6, 6),
    410: ("EVENT", 160, 53, 53),
    411: ("CURRENT_EVENT_SEQUENCE", 106, 3, 3),
    412: ("REQUEST_EVENT", 33, 6, 6),
    413: ("RESPONSE_EVENT_ERROR", 77, 7, 7),
    414: ("GROUP_START", 109, 16, 16),
    415: ("GROUP_END", 161, 16, 16),
    440: ("ILLUMINATOR_STATUS", 66, 35, 35),
    510: ("TARGET_ABSOLUTE", 245, 106, 106),
    511: ("TARGET_RELATIVE", 28, 71, 71),
    512: ("CONTROL_STATUS", 184, 2, 2),
}
