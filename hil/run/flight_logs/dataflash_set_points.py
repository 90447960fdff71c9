"""Set-points and wind of a DataFlash log.

    PSCN, PSCE, PSCD   one message an axis: TP. the target's position about the origin of the estimator, DV. and DA.
                       velocity and acceleration beside it; TV. and TA. contain the position controller's own
                       corrections, so they do not count
    PSC, CTUN.DAlt     ArduPilot 4.0 and before: horizontal target, and height
    ATT.DesYaw         yaw, the target of the attitude controller, which feeds its rate forward
    XKF2, NKF2         the estimator's wind, first core

ArduPilot writes an axis only while its controller runs: none in STABILIZE, down alone in ALT_HOLD.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.columns_of_time import series_of
from hil.run.flight_logs.flight_log import Series
from hil.run.flight_logs.set_points import Columns, Rows, SetPoints, commanded_at, set_points_of, unwrapped_at

Messages = Callable[..., dict[str, NDArray[Any]] | None]

_US = 1e-6
_AXES = ("N", "E", "D")
_OTHER_VEHICLES = {"ArduPlane": "a plane", "ArduRover": "a rover", "ArduSub": "a submarine", "Blimp": "a blimp"}


def dataflash_set_points(messages: Messages) -> SetPoints | None:
    """Return the set-points of a log; None if it has none."""
    axes = [messages(f"PSC{axis}") for axis in _AXES]
    topic = "PSCN, PSCE, PSCD"
    if any(data is not None for data in axes):
        t_s = np.unique(np.concatenate([_times(data) for data in axes if data is not None]))
        p_N, v_N, a_N = (
            np.concatenate([_axis(t_s, data, f"{what}{axis}") for data, axis in zip(axes, _AXES, strict=True)], axis=1)
            for what in ("TP", "DV", "DA")
        )
    else:
        data, height = messages("PSC"), messages("CTUN")
        if data is None or "TPX" not in data:
            return None
        topic, t_s = "PSC, CTUN.DAlt", _times(data)
        down = _axis(t_s, height, "DAlt")
        p_N = np.concatenate([_axis(t_s, data, "TPX"), _axis(t_s, data, "TPY"), -down], axis=1)
        v_N = a_N = np.full_like(p_N, np.nan)
    attitude = messages("ATT")
    yaw_rad = np.full(len(t_s), np.nan)
    if attitude is not None and "DesYaw" in attitude:
        yaw_rad = unwrapped_at(t_s, _times(attitude), np.radians(attitude["DesYaw"].astype(np.float64)))
        topic += ", ATT.DesYaw"
    rate_radps = np.gradient(np.unwrap(yaw_rad), t_s) if len(t_s) > 1 else np.full(len(t_s), np.nan)
    return set_points_of(topic, Columns(t_s, p_N, v_N, a_N, yaw_rad, rate_radps), ned=True)


def dataflash_wind(messages: Messages) -> Series | None:
    """Return the estimated velocity of the air, east and north [m/s]; None if the log has none."""
    for name in ("XKF2", "NKF2"):
        data = messages(name, 0)
        if data is None or "VWN" not in data:
            continue
        wind = np.stack([data["VWE"].astype(np.float64), data["VWN"].astype(np.float64)], axis=1)
        if np.any(wind):
            return series_of(_times(data), wind)
    return None


def dataflash_other_vehicle(messages: Messages) -> str:
    """Return what made the log if it was no multirotor, else an empty text."""
    data = messages("MSG")
    texts = [] if data is None else [bytes(text).decode(errors="replace") for text in data["Message"]]
    return next((what for text in texts for name, what in _OTHER_VEHICLES.items() if text.startswith(name)), "")


def _times(data: dict[str, NDArray[Any]]) -> Rows:
    return np.asarray(data["TimeUS"].astype(np.float64) * _US)


def _axis(t_s: Rows, data: dict[str, NDArray[Any]] | None, name: str) -> Rows:
    """Return a column at these times, (n, 1)."""
    if data is None or name not in data:
        return np.full((len(t_s), 1), np.nan)
    at_s, first = np.unique(_times(data), return_index=True)
    return commanded_at(t_s, at_s, data[name].astype(np.float64)[first, None])
