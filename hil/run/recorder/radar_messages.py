"""Points and tracks of a radar as radar_msgs/RadarScan and radar_msgs/RadarTracks, beside their PointCloud2.

Frames and signs are those of ROS: azimuth to the left, elevation upwards, and as in the points `doppler_velocity` is
positive for what recedes. `amplitude` is the signal-to-noise ratio in dB. A track's number fills the last two bytes of
its UUID. With the deviations of range, azimuth and elevation, and the unit vectors d, a and e along them,

    position_covariance = s_r^2 d d' + (r cos(elevation) s_a)^2 a a' + (r s_e)^2 e e'
    velocity_covariance = s_v^2 d d'            across d a radar measures no speed

Acceleration and size are not tracked: zeros. A RadarTrack has 212 bytes and doubles aligned to 8, so its distance to
the next one depends on where it is in the message (cdr.py).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_cos, det_sin

_RETURN = ("range_m", "azimuth_rad", "elevation_rad", "speed_mps", "snr_db")
_TRACK = (
    "id", "p_R_m", "v_R_mps", "range_m", "azimuth_rad", "elevation_rad", "range_std_m", "azimuth_std_rad",
    "elevation_std_rad", "speed_std_mps",
)  # fmt: skip
_UUID_BYTES = 16
_POINT_ALIGNMENT = 8


class RadarMessage(NamedTuple):
    """Message of radar_msgs that has an output of a radar."""

    output: str
    topic: str
    type_name: str
    sequence: str  # field of the elements, the last of the message
    fields: frozenset[str]  # of a record


SCAN = RadarMessage("points", "radar_scan", "radar_msgs/RadarScan", "returns", frozenset(_RETURN))
TRACKS = RadarMessage("tracks", "radar_tracks", "radar_msgs/RadarTracks", "tracks", frozenset(_TRACK))
RADAR_MESSAGES = {message.output: message for message in (SCAN, TRACKS)}


def elements(message: RadarMessage, records: NDArray[Any], frame_id: str) -> bytes:
    """Return the elements of a message behind its header and its count, from the records of the output."""
    if message is SCAN:
        return np.stack([records[name] for name in _RETURN], axis=1).astype("<f4").tobytes()
    return _tracks(records, _start(frame_id))


def _start(frame_id: str) -> int:
    """Return the offset of the first element in the body: stamp, frame with its length and zero, count."""
    end = 8 + 4 + len(frame_id.encode()) + 1
    return end + -end % 4 + 4


def _tracks(records: NDArray[Any], start: int) -> bytes:
    data = bytearray()
    for record in records:
        data += int(record["id"]).to_bytes(_UUID_BYTES, "big")
        data += bytes(-(start + len(data)) % _POINT_ALIGNMENT)
        doubles = np.zeros(12, "<f8")
        doubles[:3], doubles[3:6] = record["p_R_m"], record["v_R_mps"]
        data += doubles.tobytes()  # position, velocity, acceleration, size
        data += bytes(4)  # no classification, and two bytes up to the floats
        position, velocity = _covariances(record)
        data += np.concatenate([position, velocity, np.zeros(12)]).astype("<f4").tobytes()
    return bytes(data)


def _covariances(record: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the upper triangles of position and velocity."""
    azimuth, elevation, r = (float(record[name]) for name in ("azimuth_rad", "elevation_rad", "range_m"))
    (ca, sa), (ce, se) = ((det_cos(x), det_sin(x)) for x in (azimuth, elevation))
    along, left, up = np.array([ce * ca, ce * sa, se]), np.array([-sa, ca, 0.0]), np.array([-se * ca, -se * sa, ce])
    d = np.outer(along, along)
    position = float(record["range_std_m"]) ** 2 * d
    position += (r * ce * float(record["azimuth_std_rad"])) ** 2 * np.outer(left, left)
    position += (r * float(record["elevation_std_rad"])) ** 2 * np.outer(up, up)
    triangle = np.triu_indices(3)
    return position[triangle], (float(record["speed_std_mps"]) ** 2 * d)[triangle]
