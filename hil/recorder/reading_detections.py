"""What a companion had detected, read back from a recording."""

from __future__ import annotations

from hil.recorder.reading import RecordedMessage
from hil.recorder.reading_frames import capture_ns
from hil.signals.detections import MOST_BOXES, Detection, Detections

DETECTIONS = "hil_msgs/Detections"


def detections(message: RecordedMessage) -> Detections:
    """The boxes of a hil_msgs/Detections; the objects found so far are left out."""
    v = message.decode()
    boxes = []
    for at in (f"detections[{i}]" for i in range(MOST_BOXES)):
        if f"{at}.label" not in v:
            break
        x0, y0, x1, y1 = (float(v[f"{at}.box_px[{k}]"]) for k in range(4))
        range_m, speed_mps = (float(v[f"{at}.{name}"]) for name in ("range_m", "radial_speed_mps"))
        boxes.append(
            Detection(
                v[f"{at}.label"],
                float(v[f"{at}.score"]),
                (x0, y0, x1, y1),
                range_m if range_m == range_m else None,  # NaN: it had none
                speed_mps if speed_mps == speed_mps else None,
            )
        )
    return Detections(v["topic"], capture_ns(v), (int(v["width"]), int(v["height"])), tuple(boxes))
